"""Thick, nearly incompressible specimens: triquadratic hexes with a linear pressure."""
