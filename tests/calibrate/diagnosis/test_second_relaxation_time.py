"""A material that relaxes over two decades of time: both branches are found, and one branch alone needs no other."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from relaxing_plate import FAST, MU, SLOW, TIMES, held

from calibrate.diagnosis import score_tests, weighted_fit
from calibrate.diagnosis.base_fit import prepare
from calibrate.diagnosis.discovery import discover
from calibrate.diagnosis.effect_fit import refit
from calibrate.diagnosis.problem import all_rows
from calibrate.diagnosis.selection import Verdict
from calibrate.diagnosis.selection.candidate_fit import is_told
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from calibrate.equations import discretisation_error
from calibrate.errors import FitError

FIRST, SECOND = (next(e for e in CATALOGUE if e.name == name) for name in ("viscoelasticity", "second relaxation time"))


@pytest.mark.slow
def test_both_times_are_found():
    found = discover([held(SLOW, FAST)])
    assert found.verdict is Verdict.EXPLAINED and len(found.named) == 2
    assert all(a.effect.stage == "relaxation" for a in found.final.additions)
    values = sorted((a.amplitudes[0] / (MU if a.effect.has_spring else 1), a.shape[0]) for a in found.final.additions)
    for (g, tau), (true_g, true_tau) in zip(values, sorted((SLOW, FAST)), strict=True):
        assert g == pytest.approx(true_g, rel=0.05) and tau == pytest.approx(true_tau, rel=0.2)


def test_weights_have_the_relaxation_of_the_fit():
    """From one that is half as large again, with which a misfit would be taken for noise: chi-square was too small by a twentieth."""
    problem, base = prepare([held(FAST, noise=1e-3)], [all_rows])
    weights, fit = weighted_fit.fit_with_own_weights(problem, base.c, (Addition(FIRST, (0.25,), (2.0,)),))
    (known,), (found,), ((deviation,),) = weights.amplifying, fit.additions, fit.errors
    assert abs(known.amplitudes[0] - found.amplitudes[0]) < weighted_fit.NEAR * deviation
    assert found.amplitudes[0] == pytest.approx(FAST[0], abs=3 * deviation)


def test_a_time_that_one_of_several_tests_tells_is_told():
    """A pull of ten seconds beside a pause of an hour refuses no time of ten minutes."""
    short, long = (SimpleNamespace(time=np.array([0.0, end])) for end in (10.0, 3600.0))
    for tests, told in (((short,), False), ((short, long), True), ((long,), True)):
        assert is_told(SimpleNamespace(tests=tests), Addition(FIRST, (0.1,), (600.0,))) is told


def test_a_fit_that_leaves_nothing_of_the_base_is_a_named_error(monkeypatch):
    """Whatever takes its place: it has no weights of its own, nor a discretisation error."""
    problem, base = prepare([held(FAST)], [all_rows])
    gone = replace(base, c=np.zeros_like(base.c))
    monkeypatch.setattr(weighted_fit, "fit_with_weights", lambda problem, c, additions: (problem, gone))
    with pytest.raises(FitError, match="viscoelasticity: takes the place of the material"):
        weighted_fit.fit_with_own_weights(problem, base.c, (Addition(FIRST, (0.3,), (2.0,)),))
    left = discretisation_error.sources(problem.trained[0].system, problem.basis, gone.c)
    assert all(columns.size == 0 and len(columns) > 0 for columns, _ in left.parts)


def test_a_second_time_is_a_candidate_beside_the_first_alone_and_takes_its_place():
    problem, base = prepare([held(FAST)], [all_rows])
    assert SECOND.name not in {one.effect.name for one in score_tests.score(problem, base, (FIRST, SECOND))}
    one = refit(problem, base.c, (Addition(FIRST, (0.25,), (2.0,)),))
    assert [s.effect.name for s in score_tests.score(problem, one, (FIRST, SECOND))] == [SECOND.name]
    additions = (Addition(FIRST, (0.0,), (30.0,)), Addition(SECOND, (0.25,), (2.0,)))
    _, left = weighted_fit.without_superfluous(
        problem, replace(one, additions=additions, null_covariances=(np.array([[1e-4]]),) * 2)
    )
    assert [a.effect for a in left.additions] == [FIRST]
    assert left.additions[0].shape[0] == pytest.approx(2.0, rel=0.2)


def test_times_are_tried_that_the_first_of_several_tests_is_too_short_for():
    """The time that is found is nearest to the true one of those that are tried, and is not tried of the short test alone."""
    long = held(SLOW)
    short = replace(long.select(np.arange(4)), name="short")
    problem, base = prepare([short, long], [all_rows, all_rows])
    times = np.array([tau for (tau,) in problem.shapes(FIRST)])
    alone = [tau for (tau,) in problem.of_one_test.shapes(FIRST)]
    assert times[: len(alone)].tolist() == alone and max(alone) == TIMES[3] and times.max() == TIMES[-1]
    (best,) = score_tests.score(problem, base, (FIRST,))
    assert best.shape[0] == times[np.abs(np.log(times / SLOW[1])).argmin()]
    assert problem.shapes(CATALOGUE[0]) == CATALOGUE[0].shape_values(problem.tests[0])
