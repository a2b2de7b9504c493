"""Solve a small cross on however many ranks there are; the first writes the solution. Run by a test."""

import sys

from forward import ArrudaBoyce, Loading
from forward._dolfinx import MPI
from forward.plane_stress import solve
from meshes import Cross, quads

if __name__ == "__main__":
    mesh = quads(Cross(), quarter=True, size_factor=4.0)
    checkpoint = sys.argv[2] if len(sys.argv) > 2 else None
    solution = solve(mesh, ArrudaBoyce(), Loading.clamped(Cross.loaded, 30.0), 3, checkpoint=checkpoint)
    if MPI.COMM_WORLD.rank == 0:
        assert MPI.COMM_WORLD.size == 2
        solution.save(sys.argv[1])
