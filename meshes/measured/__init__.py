"""The mesh of a measured test: its outline, curved, and the camera's triangles, quadratic."""
