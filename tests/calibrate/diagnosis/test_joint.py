"""Effects fitted at once: what is there is found, what is not is none, in whatever order the candidates come."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from discoveries import C01, sheet

from calibrate.data.experiment import Experiment
from calibrate.diagnosis import base_fit, effect_fit, score_tests
from calibrate.diagnosis.joint import equations as joint_equations
from calibrate.diagnosis.joint import fit as joint_fit
from calibrate.diagnosis.joint.everything import candidates
from calibrate.diagnosis.parameters import n_parameters
from calibrate.diagnosis.problem import Problem, all_rows
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition, Chain
from calibrate.errors import FitError

BY_NAME = {effect.name: effect for effect in CATALOGUE}
NAMES = ("stiffness gradient", "second invariant", "lens distortion", "image rotation")
PHI = 0.01
WIDTHS = {effect.name: np.array([3 * p.typical for p in effect.amplitudes]) for effect in CATALOGUE}  # of a wide prior


@cache
def turned() -> Experiment:
    """A Mooney-Rivlin plate seen by a camera that is turned by PHI: places and displacements turn, forces do not."""
    R = np.array([[np.cos(PHI), -np.sin(PHI)], [np.sin(PHI), np.cos(PHI)]])
    e = sheet()
    return replace(e, points=e.points @ R.T, displacements=e.displacements @ R.T)


@cache
def plate() -> tuple[Problem, effect_fit.Fit]:
    return base_fit.prepare([sheet()], [all_rows])


@cache
def turned_plate() -> tuple[Problem, effect_fit.Fit]:
    return base_fit.prepare([turned()], [all_rows])


@cache
def found(names: tuple[str, ...]) -> joint_fit.Joint:
    """The fit of candidates in some order."""
    problem, base = turned_plate()
    scores = {s.effect.name: s for s in score_tests.score(problem, base, [BY_NAME[name] for name in names])}
    return joint_fit.fit(problem, base.c, candidates([scores[name] for name in names]), WIDTHS)


def amplitudes(one: joint_fit.Joint) -> dict[str, float]:
    return {a.effect.name: a.amplitudes[0] for a in one.additions}


@pytest.mark.slow
def test_all_slopes_are_finite_differences() -> None:
    problem, base = plate()
    chain: Chain = problem.parts[0].chain
    effects = (BY_NAME["second invariant"], BY_NAME["one fibre family"], BY_NAME["lens distortion"])
    shapes = (), (0.3, 0.5, 0.1), (0.1, -0.05)
    additions = tuple(Addition(e, (a,), s) for e, a, s in zip(effects, (0.02, 0.01, 0.002), shapes, strict=True))
    J = chain.jacobian(base.c, additions)
    assert len(J) == sum(map(n_parameters, additions)) == 8
    moves = [(i, kind, j) for i, a in enumerate(additions) for kind, values in (("amplitudes", a.amplitudes), ("shape", a.shape)) for j in range(len(values))]  # fmt: skip
    for column, (i, kind, j) in zip(J, moves, strict=True):
        ends = []
        for step in (1e-5, -1e-5):
            values = list(getattr(additions[i], kind))
            values[j] += step
            moved = replace(additions[i], **{kind: tuple(values)})
            ends.append(chain.residual(base.c, (*additions[:i], moved, *additions[i + 1 :])))
        slope = (ends[0] - ends[1]) / 2e-5
        assert np.abs(column - slope).max() < 1e-5 * np.abs(slope).max()


def test_what_is_hidden_is_found_and_what_is_not_is_none() -> None:
    final = found(NAMES)
    values, deviations = amplitudes(final), {k: d[0] for k, d in final.deviations.items()}
    for name, truth in (("second invariant", C01), ("image rotation", PHI)):
        assert abs(values[name] - truth) < 3 * deviations[name]
        assert abs(values[name]) > 5 * deviations[name]
    for name in ("stiffness gradient", "lens distortion"):
        assert abs(values[name]) < 3 * deviations[name]
    assert final.converged
    assert final.dispersion == pytest.approx(1.0, abs=0.25)


@pytest.mark.slow
def test_the_order_of_the_candidates_does_not_matter() -> None:
    here, there = found(NAMES), found(NAMES[::-1])
    assert here.objective == pytest.approx(there.objective, rel=1e-3)
    for name, value in amplitudes(here).items():
        assert amplitudes(there)[name] == pytest.approx(value, abs=0.2 * here.deviations[name][0])


def test_stiffness_follows_the_forces() -> None:
    """Forces three times as large: every stress is three times as large, everything else is as it was. Without the lens, which is absent, so that its
    centre may be anywhere."""
    e = turned()
    loaded = tuple(replace(b, force=3 * b.force) for b in e.loaded)
    noise = replace(e.noise, force_std=3 * e.noise.force_std)
    problem, base = base_fit.prepare([replace(e, loaded=loaded, noise=noise)], [all_rows])
    final = found(tuple(name for name in NAMES if name != "lens distortion"))
    tripled = tuple(
        replace(a, amplitudes=tuple(3 * v for v in a.amplitudes)) if a.effect.amplitudes[0].unit == "MPa" else a
        for a in final.additions
    )
    widths = WIDTHS | {"second invariant": 3 * WIDTHS["second invariant"]}  # what is believed of it, too
    again = joint_fit.fit(problem, base.c, tripled, widths)
    assert again.converged
    assert again.loss == pytest.approx(final.loss, rel=1e-4)
    values, before = amplitudes(again), amplitudes(final)
    assert values["second invariant"] == pytest.approx(3 * before["second invariant"], rel=0.02)
    assert values["image rotation"] == pytest.approx(before["image rotation"], rel=0.02)


def test_r_squared_of_an_effect_on_the_others() -> None:
    """A gradient beside a field of stiffness that holds its lowest terms."""
    problem, base = turned_plate()
    additions = (Addition(BY_NAME["stiffness gradient"], (0.0, 0.0)), Addition(BY_NAME["stiffness field"], (0.0,) * 15))
    one = joint_fit.fit(problem, base.c, additions, WIDTHS)
    assert one.r_squared["stiffness gradient"] > 0.8


def test_the_cost_of_an_effect_is_the_rise_of_the_misfit_without_it() -> None:
    """To first order; the rest is fitted again."""
    problem, _ = turned_plate()
    final = found(("second invariant", "image rotation"))
    for name in final.costs:
        others = tuple(a for a in final.additions if a.effect.name != name)
        other = joint_fit.fit(problem, final.c, others, WIDTHS)
        assert final.costs[name] == pytest.approx(other.loss - final.loss, rel=0.3)


def test_the_prior_on_the_base_counts_in_what_is_minimised() -> None:
    """A strong one takes the stiffening out, though that raises the misfit."""
    problem, base = plate()
    strong = replace(problem, prior=100 * problem.prior)
    plain, bound = (joint_fit.fit(one, base.c, (), WIDTHS) for one in (problem, strong))
    stiffening = [np.linalg.norm(problem.prior @ one.c) for one in (plain, bound)]
    assert plain.converged and bound.converged
    assert stiffening[1] < 0.1 * stiffening[0]
    assert bound.loss > plain.loss
    assert bound.objective < plain.loss + (100 * stiffening[0]) ** 2


def test_a_start_that_pushes_where_the_grips_pull_is_taken_back() -> None:
    """It ends where a small start ends; a base without any stiffness cannot be, and is named."""
    problem, base = plate()

    def fitted(c01: float) -> joint_fit.Joint:
        return joint_fit.fit(problem, base.c, (Addition(BY_NAME["second invariant"], (c01,)),), WIDTHS)

    assert fitted(-10.0).objective == pytest.approx(fitted(-1e-3).objective, rel=1e-3)
    with pytest.raises(FitError, match="finite"):
        joint_fit.fit(problem, 0.0 * base.c, (), WIDTHS)


@pytest.mark.parametrize("at_minimum", [True, False])
def test_a_fit_that_cannot_move_has_converged_only_at_a_minimum(
    at_minimum: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every step raises the misfit, as with slopes that are wrong: what they promise decides."""
    problem, _ = turned_plate()
    final = found(NAMES)
    start = (
        final.additions
        if at_minimum
        else tuple(replace(a, amplitudes=tuple(p.null for p in a.effect.amplitudes)) for a in final.additions)
    )
    right, calls = joint_equations.Equations.residual, iter([1.0, 1.0])

    def raised(self: joint_equations.Equations, *where: Any) -> Any:
        r, s, g = right(self, *where)
        return next(calls, 1e3) * r, s, g

    monkeypatch.setattr(joint_equations.Equations, "residual", raised)
    assert joint_fit.fit(problem, final.c, start, WIDTHS).converged is at_minimum
