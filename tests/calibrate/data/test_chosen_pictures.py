"""Which pictures are used: as many as are affordable, evenly spread, the turning points among them, and what is not used is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from small_sheet import stretched

from calibrate import errors
from calibrate.data import chosen_pictures
from calibrate.data.chosen_pictures import chosen, spread
from calibrate.data.experiment import Experiment


def pulled(stretches) -> Experiment:
    """A sheet at these stretches, in proportion to which its forces grow."""
    one = stretched()
    unit = one.displacements[-1] / one.displacements[-1].max()
    sizes = np.asarray(stretches, float)
    forces = [replace(b, force=np.outer(sizes, b.force[-1])) for b in one.loaded]
    return replace(
        one, displacements=sizes[:, None, None] * unit, loaded=tuple(forces), time=np.arange(1.0, len(sizes) + 1)
    )


RAMP = np.linspace(0.05, 1, 20)


def test_all_are_used_where_they_are_affordable():
    test = pulled(RAMP)
    assert chosen(test) is test
    assert chosen(test, "all") is test
    assert chosen(test, 20) is test


def test_points_times_pictures_are_bounded(monkeypatch):
    test = pulled(RAMP)
    monkeypatch.setattr(chosen_pictures, "AFFORDABLE", 15 * len(test.points) + 3)
    found = chosen(test)
    assert found.n_increments == 15
    assert found.provenance["pictures"]["of"] == 20 and not found.provenance["pictures"]["asked_for"]
    assert chosen(test, "all").n_increments == 20
    monkeypatch.setattr(chosen_pictures, "AFFORDABLE", 1)  # however many points there are
    assert chosen(test).n_increments == chosen_pictures.FEWEST


@pytest.mark.parametrize("most", [1, 2, 3, 6, 7, 20, 50])
def test_pictures_are_spread_evenly_and_the_last_is_among_them(most):
    index = spread(pulled(RAMP), most)
    assert len(index) == min(most, 20) and index[-1] == 19
    assert np.ptp(np.diff(index, prepend=-1)) <= 1


def test_listed_pictures_count_from_one():
    found = chosen(pulled(RAMP), (1, 5, 20))
    assert found.time.tolist() == [1.0, 5.0, 20.0]
    assert found.provenance["pictures"] == {"used": [1, 5, 20], "of": 20, "asked_for": True}


@pytest.mark.parametrize("numbers", [(0, 3), (3, 2), (3, 21), ()])
def test_pictures_that_are_not_there_are_named(numbers):
    with pytest.raises(errors.ConfigError, match="1 to 20"):
        chosen(pulled(RAMP), numbers)


def test_turning_points_are_among_them():
    """Softening knows the largest deformation so far only from the pictures that are used."""
    sizes = np.concatenate(
        [np.linspace(0, 0.5, 11)[1:], np.linspace(0.5, 0.1, 9)[1:], np.linspace(0.1, 1.0, 15)[1:], [0.7, 0.4, 0.2]]
    )
    test = pulled(sizes)
    for most in (3, 4, 6, 10):
        index = spread(test, most)
        assert len(index) == most and index[-1] == len(sizes) - 1
        seen, true = np.maximum.accumulate(sizes[index]), np.maximum.accumulate(sizes)[index]
        assert (true - seen <= chosen_pictures.UNSEEN + 1e-12).all()


def test_every_turn_of_a_cyclic_test_is_among_them():
    """Relaxation knows the course of the load from the pictures that are used alone; noise is no turn."""
    cycle = np.concatenate([np.linspace(0, 1, 9)[1:], np.linspace(1, 0.1, 9)[1:]])
    sizes = np.concatenate([0.4 * cycle, 0.7 * cycle, cycle])
    noisy = pulled(sizes + 0.005 * np.random.default_rng(0).standard_normal(len(sizes)))
    assert chosen_pictures.turns(noisy.deformation_shares) == [7, 15, 23, 31, 39]
    for most in (10, 12, 20):
        index = spread(noisy, most)
        assert len(index) == most and index[-1] == len(sizes) - 1
        assert {7, 15, 23, 31, 39} <= set(index.tolist())
    assert chosen_pictures.turns(pulled(RAMP).deformation_shares) == []
    assert len(spread(noisy, 4)) == 4  # more turns than half of the places


def test_some_pictures_are_still_the_same_test():
    """Whichever were fitted, and of files that know only the pictures that were."""
    test = pulled(RAMP)
    some, others = chosen(test, 6), chosen(test, (2, 9, 20))
    assert some.fingerprint != others.fingerprint and some.whole == others.whole == test.fingerprint
    assert others.is_of(some.whole) and some.is_of(some.fingerprint) and chosen(test, "all").is_of(some.whole)
    assert not others.is_of(some.fingerprint) and not pulled(2 * RAMP).is_of(some.whole)
    assert chosen(some, 3).whole == test.fingerprint


@pytest.mark.parametrize("wanted", [0, -5])
def test_no_pictures_are_no_choice(wanted):
    with pytest.raises(errors.ConfigError, match="at least 1"):
        chosen(pulled(np.linspace(1.1, 1.6, 6)), wanted)
