"""What would decide between explanations that a test cannot tell apart: which specimen, loaded how, and by how much."""
