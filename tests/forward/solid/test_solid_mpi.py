"""The same run of the solid on one rank and on two."""

from dataclasses import replace

import numpy as np
import pytest
import solid_mpi_case
from two_ranks import needs_mpi, on_two_ranks

from forward import SolidSolution

pytestmark = needs_mpi


@pytest.fixture(scope="module")
def one():
    return solid_mpi_case.run()


def check_same(two, one):
    np.testing.assert_allclose(two.displacements, one.displacements, atol=1e-10 * np.abs(one.displacements).max())
    np.testing.assert_allclose(two.pressure, one.pressure, atol=1e-10 * np.abs(one.pressure).max())
    np.testing.assert_allclose(two.energy, one.energy, rtol=1e-10)
    np.testing.assert_array_equal(two.iterations, one.iterations)
    for side, force in one.reactions.items():
        np.testing.assert_allclose(two.reactions[side], force, atol=1e-10 * np.abs(force).max())


def test_two_ranks_give_the_same(tmp_path, one):
    run = on_two_ranks("solid_mpi_case.py", tmp_path / "two.npz", tmp_path / "checkpoint.npz")
    assert run.returncode == 0, run.stderr
    check_same(SolidSolution.load(tmp_path / "two.npz"), one)
    check_same(SolidSolution.load(tmp_path / "checkpoint.npz"), one)


@pytest.mark.slow
def test_two_ranks_go_on_where_one_stopped(tmp_path, one):
    """The checkpoint of a run on one rank, cut after two increments, is continued on two."""
    path = tmp_path / "checkpoint.npz"
    first_two(one).save(path)
    run = on_two_ranks("solid_mpi_case.py", tmp_path / "two.npz", path)
    assert run.returncode == 0, run.stderr
    check_same(SolidSolution.load(tmp_path / "two.npz"), one)


def first_two(solution):
    names = ("displacements", "pressure", "time", "energy", "iterations")
    parts = {name: getattr(solution, name)[:2] for name in names}
    return replace(solution, reactions={side: force[:2] for side, force in solution.reactions.items()}, **parts)


@pytest.mark.slow
def test_an_unwritable_checkpoint_ends_both_ranks(tmp_path):
    """The rank that does not write learns of the error too; nothing hangs."""
    (tmp_path / "file").touch()
    run = on_two_ranks("solid_mpi_case.py", tmp_path / "two.npz", tmp_path / "file" / "below.npz")
    assert run.returncode != 0
    assert run.stderr.count("CheckpointError: ") >= 2
