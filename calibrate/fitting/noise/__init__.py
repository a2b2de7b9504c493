"""Noise of the displacements as the equations see it: its size, its correlation lengths, and what increments have in common of it."""
