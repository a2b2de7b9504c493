"""The dominant effect: what most of a misfit is traced to that nothing explains."""

from __future__ import annotations

from dataclasses import replace

import pytest
from discoveries import explained, nothing

from calibrate.diagnosis.residual_tests import ChiSquare
from calibrate.diagnosis.selection import Discovery, Verdict
from calibrate.diagnosis.selection.dominant_effect import dominant_effect

NAME = "second invariant"


def open_verdict(**changes: object) -> Discovery:
    """The plate of a Mooney-Rivlin material, as if more than noise were left."""
    found = explained()
    return replace(found, verdict=Verdict.NOT_EXPLAINED, named=(), closest=(NAME,), **changes)


def with_left(excess: float) -> Discovery:
    """The same with this share of the misfit of the base left, beyond noise."""
    first, last = explained().rounds
    before, after = (one.fit.misfits.everything for one in (first, last))
    left = ChiSquare(after.degrees + excess * (before.value - before.degrees), after.degrees)
    fit = replace(last.fit, misfits=last.fit.misfits._replace(everything=left))
    return open_verdict(rounds=(first, replace(last, fit=fit)))


def test_an_effect_that_takes_nearly_all_of_the_misfit_is_dominant() -> None:
    found = dominant_effect(open_verdict())
    assert found is not None
    assert (found.effect, found.like) == (NAME, ())
    assert found.share > 0.95


@pytest.mark.parametrize(("left", "is_dominant"), [(0.08, True), (0.12, False)])
def test_an_effect_that_leaves_more_than_a_tenth_is_not(left: float, is_dominant: bool) -> None:
    found = dominant_effect(with_left(left))
    assert (found is not None) == is_dominant
    if found is not None:
        assert found.share == pytest.approx(1 - left)


def test_what_is_explained_or_cannot_be_judged_has_none() -> None:
    unknown = open_verdict()
    assert dominant_effect(explained()) is None
    assert dominant_effect(nothing()) is None
    assert dominant_effect(replace(unknown, problem=replace(unknown.problem, noise_is_known=False))) is None


def test_an_alarm_beside_a_misfit_as_noise_is_traced_to_nothing() -> None:
    first = explained().rounds[0]
    fit = replace(
        first.fit, misfits=first.fit.misfits._replace(everything=ChiSquare(first.fit.degrees, first.fit.degrees))
    )
    assert dominant_effect(open_verdict(rounds=(replace(first, fit=fit), *explained().rounds[1:]))) is None
