"""Solve a small solid on however many ranks there are; the first writes the solution. Run by a test."""

import sys

import numpy as np

from forward import ArrudaBoyce, Loading
from forward._dolfinx import MPI
from forward.solid import Options, solve
from meshes import PlateWithHole, extrude, quads

OPTIONS = Options(tolerance=1e-11, volume_tolerance=1e-13, solver="mumps")


def run(checkpoint=None):
    mesh = extrude(quads(PlateWithHole(), quarter=True, size_factor=4.0), 10.0, 2)
    loading = Loading.clamped(PlateWithHole.loaded, 20.0, dimension=3)
    return solve(mesh, ArrudaBoyce(), loading, 3, options=OPTIONS, checkpoint=checkpoint)


if __name__ == "__main__":
    solution = run(sys.argv[2] if len(sys.argv) > 2 else None)
    comm = MPI.COMM_WORLD
    assert comm.size == 2
    # every rank has the whole solution
    everywhere = comm.gather((solution.displacements, solution.pressure, solution.reactions["right"]))
    if comm.rank == 0:
        for mine, other in zip(*everywhere, strict=True):
            np.testing.assert_array_equal(mine, other)
        solution.save(sys.argv[1])
