"""What is left out of a measured field, or replaced in it, before it is triangulated."""
