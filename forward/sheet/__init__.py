"""Thin sheets in the plane: plane stress, plane strain, and plane stress with a history."""
