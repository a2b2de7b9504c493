"""The same runs of a sheet on one rank and on two."""

import numpy as np
import pytest
from forward_mpi_case import CHECKPOINTS, KINDS, checkpoint_of, run
from interrupted import interrupted
from two_ranks import needs_mpi, on_two_ranks

from forward import SurfaceSolution

pytestmark = needs_mpi


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    """Folder of what two ranks have solved; one of the checkpoints was there, cut off after two increments."""
    folder = tmp_path_factory.mktemp("two")
    for kind in KINDS:
        with interrupted(2):
            run(kind, checkpoint_of(folder, kind, "resumed"))
    done = on_two_ranks("forward_mpi_case.py", folder)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.parametrize("kind", KINDS)
def test_two_ranks_give_the_same(two, kind):
    one = run(kind)
    for which in CHECKPOINTS:
        found = SurfaceSolution.load(two / f"{kind}-{which}.npz")
        np.testing.assert_allclose(found.displacements, one.displacements, atol=1e-10)
        np.testing.assert_allclose(found.energy, one.energy, rtol=1e-10)
        for side in one.reactions:
            np.testing.assert_allclose(found.reactions[side], one.reactions[side], rtol=1e-10)
        assert found.history.keys() == one.history.keys()
        for name, values in one.history.items():
            np.testing.assert_allclose(found.history[name], values, atol=1e-10)
