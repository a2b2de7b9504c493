"""The same run on one rank and on two."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from forward import ArrudaBoyce, Loading, SurfaceSolution
from forward.sheet.plane_stress import solve
from meshes import Cross, quads

ROOT = Path(__file__).parents[2]
MPIEXEC = shutil.which("mpiexec", path=str(Path(sys.executable).parent)) or shutil.which("mpiexec")


@pytest.mark.skipif(MPIEXEC is None, reason="no mpiexec beside this Python")
@pytest.mark.parametrize("checkpoint", [(), ("checkpoint.npz",)], ids=["plain", "checkpoint"])
def test_two_ranks_give_the_same(tmp_path, checkpoint):
    command = [MPIEXEC, "-n", "2", sys.executable, str(ROOT / "tests" / "fixtures" / "forward_mpi_case.py")]
    command += [str(tmp_path / "two.npz"), *(str(tmp_path / name) for name in checkpoint)]
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "tests" / "fixtures"))),
        "OMP_NUM_THREADS": "1",
    }
    run = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert run.returncode == 0, run.stderr
    two = SurfaceSolution.load(tmp_path / "two.npz")
    mesh = quads(Cross(), quarter=True, size_factor=4.0)
    one = solve(mesh, ArrudaBoyce(), Loading.clamped(Cross.loaded, 30.0), 3)
    np.testing.assert_allclose(two.displacements, one.displacements, atol=1e-10)
    np.testing.assert_allclose(two.energy, one.energy, rtol=1e-10)
    for side in one.reactions:
        np.testing.assert_allclose(two.reactions[side], one.reactions[side], rtol=1e-10)
