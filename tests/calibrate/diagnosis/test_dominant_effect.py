"""The dominant effect: what most of a misfit is traced to that nothing explains."""

from __future__ import annotations

from dataclasses import replace

import pytest
from discoveries import explained, nothing

from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.residual_tests import ChiSquare
from calibrate.diagnosis.selection import Discovery, Verdict
from calibrate.diagnosis.selection import dominant_effect as module
from calibrate.diagnosis.selection.dominant_effect import dominant_effect

NAME = "second invariant"


def open_verdict(**changes: object) -> Discovery:
    """The plate of a Mooney-Rivlin material, as if more than noise were left."""
    found = explained()
    return replace(found, verdict=Verdict.NOT_EXPLAINED, named=(), closest=(NAME,), **changes)


def with_left(excess: float) -> Discovery:
    """The same with this share of the misfit of the base left, beyond noise."""
    first, last = explained().rounds
    before, after = (one.fit.unexplained for one in (first, last))
    left = ChiSquare(after.degrees + excess * (before.value - before.degrees), after.degrees)
    fit = replace(last.fit, unexplained=left)
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


def with_misfits(*values: float, degrees: int = 20000) -> list[Fit]:
    """Fits of the last model with these chi-squares per degree of freedom."""
    fit = explained().rounds[1].fit
    tests = (ChiSquare(value * degrees, degrees) for value in values)
    return [replace(fit, unexplained=test) for test in tests]


def test_an_alarm_beside_a_misfit_as_noise_is_traced_to_nothing() -> None:
    """A chi-square of 1.12, which noise that is known to 5 % makes, however much of it an effect takes."""
    first, last = explained().rounds
    for size, is_dominant in ((1.12, False), (3.0, True)):
        before, after = with_misfits(size, 1.0)
        rounds = (replace(first, fit=replace(before, additions=(), errors=())), replace(last, fit=after))
        assert (dominant_effect(open_verdict(rounds=rounds)) is not None) == is_dominant


def test_effects_that_leave_little_more_are_told_best_first(monkeypatch: pytest.MonkeyPatch) -> None:
    a, b, c, d = with_misfits(1.4, 1.8, 1.7, 1.9)
    found = {NAME: a, "upturn": b, "compressibility": c, "image rotation": d}
    monkeypatch.setattr(module, "_alone", lambda *_: found.items())
    first, last = explained().rounds
    (before,) = with_misfits(9.0)
    rounds = (replace(first, fit=replace(before, additions=(), errors=())), last)
    traced = dominant_effect(open_verdict(rounds=rounds))
    assert traced is not None
    assert (traced.effect, traced.like) == (NAME, ("compressibility", "upturn"))
    assert traced.share == pytest.approx(0.95)


def test_without_a_round_of_one_effect_every_likely_one_is_fitted_alone() -> None:
    """As where the rounds were run on from an explanation of several."""
    first, last = explained().rounds
    several = replace(last, fit=replace(last.fit, additions=last.fit.additions * 2))
    found = dominant_effect(open_verdict(rounds=(first, several)))
    assert found is not None
    assert found.effect == NAME
    assert found.share > 0.95
