"""The same run of a sheet on one rank and on two."""

import forward_mpi_case
import numpy as np
import pytest
from interrupted import interrupted
from two_ranks import needs_mpi, on_two_ranks

from forward import SurfaceSolution

pytestmark = needs_mpi


@pytest.fixture(scope="module", params=["elastic", "history"])
def case(request):
    return request.param, forward_mpi_case.run(request.param)


def check_same(two, one):
    np.testing.assert_allclose(two.displacements, one.displacements, atol=1e-10)
    np.testing.assert_allclose(two.energy, one.energy, rtol=1e-10)
    for side in one.reactions:
        np.testing.assert_allclose(two.reactions[side], one.reactions[side], rtol=1e-10)
    for name, values in one.history.items():
        np.testing.assert_allclose(two.history[name], values, atol=1e-10)


@pytest.mark.parametrize("checkpoint", ["", "checkpoint.npz"], ids=["plain", "checkpoint"])
def test_two_ranks_give_the_same(tmp_path, case, checkpoint):
    kind, one = case
    run = on_two_ranks("forward_mpi_case.py", kind, tmp_path / "two.npz", checkpoint and tmp_path / checkpoint)
    assert run.returncode == 0, run.stderr
    check_same(SurfaceSolution.load(tmp_path / "two.npz"), one)


def test_two_ranks_go_on_where_one_stopped(tmp_path, case):
    (kind, one), path = case, tmp_path / "checkpoint.npz"
    with interrupted(2):
        forward_mpi_case.run(kind, path)
    run = on_two_ranks("forward_mpi_case.py", kind, tmp_path / "two.npz", path)
    assert run.returncode == 0, run.stderr
    check_same(SurfaceSolution.load(tmp_path / "two.npz"), one)
