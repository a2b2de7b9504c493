"""Finite element model updating, on forces in closed form: it ends at the truth wherever it starts, keeps what forces do not see, and says when it cannot start."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from calibrate.diagnosis.replayed import updating
from calibrate.diagnosis.replayed.observations import Observations
from calibrate.diagnosis.replayed.replayed_rows import ReplayedRows
from calibrate.diagnosis.replayed.updating import update
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from calibrate.errors import FitError

EFFECTS = {effect.name: effect for effect in CATALOGUE}
TIMES = np.arange(1.0, 13.0)
STIFFNESS, G, TAU = 2.0, 0.8, 1.3
PRIORS = {
    "viscoelasticity": (np.zeros(1), np.full(1, 1.0)),
    "second invariant": (np.full(1, 0.05), np.full(1, 0.01)),
}


def ramp(c: np.ndarray, additions: tuple[Addition, ...]) -> np.ndarray:
    """Forces (t,) of a ramp of unit rate: linear viscoelasticity, and an effect that no force of this test sees."""
    visco = [a for a in additions if a.effect.name == "viscoelasticity"]
    (g,), (tau,) = (visco[0].amplitudes, visco[0].shape) if visco else ((0.0,), (1.0,))
    return c[0] * (TIMES + g * tau * (1 - np.exp(-TIMES / tau)))


def start(g: float, tau: float) -> tuple[Addition, ...]:
    return (
        Addition(EFFECTS["viscoelasticity"], (g,), (tau,)),
        Addition(EFFECTS["second invariant"], (0.04,)),
    )


TRUE = ramp(np.array([STIFFNESS]), start(G, TAU))


def observations(replayed: np.ndarray, is_force: bool = True, noise: float = 1e-3) -> Observations:
    n = len(TIMES)
    return Observations(
        np.zeros(n, int), np.arange(n), np.zeros(n, bool), np.full(n, is_force), TRUE, replayed, noise**2 * np.eye(n),
        ("top y",) * n, np.zeros((1, n)), np.array([10]),
    )  # fmt: skip


class Replays:
    """Exact forces; between two replays those of a law that is wrong by a share, as at displacements that do not follow. softest: factors below have no equilibrium."""

    def __init__(self, wrong: float = 0.0, softest: float = 0.0, is_force: bool = True) -> None:
        self.wrong, self.softest, self.is_force, self.made = wrong, softest, is_force, 0

    def __call__(self, c, additions):
        self.made += 1
        if c[0] < self.softest:
            return None
        rows = observations(ramp(c, additions), self.is_force)
        here = ramp(c, additions)

        def near(d, others):
            return rows.residual - (1 + self.wrong) * (ramp(d, others) - here)

        def slopes(directions, used):
            columns = []
            for i in range(len(directions.sizes)):
                if not used[i]:
                    columns.append(np.zeros(len(TIMES)))
                    continue
                moved = near(*directions.moved(i)) - near(directions.c, directions.additions)
                columns.append(moved / directions.sizes[i])
            return np.array(columns).T

        return ReplayedRows(rows, near, slopes, ())


@pytest.mark.parametrize(("g", "tau"), [(0.3, 6.0), (2.0, 0.5), (0.75, 60.0)])
@pytest.mark.parametrize("wrong", [0.0, 0.2])
def test_relaxation_is_that_of_the_forces_wherever_the_equations_left_it(g, tau, wrong):
    """Also where the forces between two replays are off by a fifth of their change."""
    replays = Replays(wrong)
    found = update(replays, np.array([1.5]), start(g, tau), PRIORS)
    visco = found.additions[0]
    assert found.converged and replays.made <= 6
    assert found.before.force > 0.004 and found.after.force < 2e-3
    assert found.c[0] == pytest.approx(STIFFNESS, rel=0.03)
    assert visco.amplitudes[0] * visco.shape[0] == pytest.approx(G * TAU, rel=0.1)


def test_what_forces_do_not_see_is_what_the_equations_say():
    """Mean and standard deviation of the fit to the equations."""
    found = update(Replays(), np.array([1.5]), start(0.5, 3.0), PRIORS)
    mean, deviation = PRIORS["second invariant"]
    assert found.additions[1].amplitudes[0] == pytest.approx(mean[0], rel=1e-6)
    assert found.deviations[1][0] == pytest.approx(deviation[0], rel=1e-6)
    assert 0 < found.deviations[0][0] < PRIORS["viscoelasticity"][1][0]


def test_a_model_that_meets_the_forces_stays_as_it_is():
    """One replay, and no step."""
    replays = Replays()
    priors = PRIORS | {
        "viscoelasticity": (np.full(1, G), np.ones(1)),
        "second invariant": (np.full(1, 0.04), np.ones(1)),
    }
    found = update(replays, np.array([STIFFNESS]), start(G, TAU), priors)
    assert replays.made == 1 and found.converged
    assert found.c[0] == STIFFNESS and found.additions == start(G, TAU)


def test_a_step_to_where_there_is_no_equilibrium_is_shortened():
    found = update(Replays(softest=1.9), np.array([3.5]), start(0.5, 3.0), PRIORS)
    assert found.c[0] >= 1.9
    assert found.after.force < found.before.force


def test_without_an_equilibrium_or_a_force_nothing_is_updated():
    assert update(Replays(softest=9.0), np.array([1.5]), start(0.5, 3.0), PRIORS) is None
    with pytest.raises(FitError, match="no force"):
        update(Replays(is_force=False), np.array([1.5]), start(0.5, 3.0), PRIORS)


def test_a_trial_that_is_not_finite_is_not_taken_and_a_derivative_that_is_not_is_named():
    """Beyond a relaxation time of 10 s there is no force in the first, anywhere no derivative in the second."""

    class Broken(Replays):
        def __init__(self, near, slopes):
            super().__init__()
            self.change = near, slopes

        def __call__(self, c, additions):
            rows = super().__call__(c, additions)
            near, slopes = self.change
            beyond = np.nan if near else 0.0
            return ReplayedRows(
                rows.rows,
                lambda d, others: rows.near(d, others) + (beyond if others[0].shape[0] > 10.0 else 0.0),
                lambda directions, used: rows.slopes(directions, used) + (np.nan if slopes else 0.0),
                (),
            )

    far = (Addition(EFFECTS["viscoelasticity"], (0.75,), (60.0,)), start(0.5, 3.0)[1])
    found = update(Broken(True, False), np.array([1.5]), start(0.5, 3.0), PRIORS, [far])
    assert found.converged and found.additions[0].amplitudes[0] * found.additions[0].shape[0] == pytest.approx(
        G * TAU, rel=0.1
    )
    with pytest.raises(FitError, match="viscoelasticity and second invariant have no finite derivative"):
        update(Broken(False, True), np.array([1.5]), start(0.5, 3.0), PRIORS)


def test_a_shape_that_forces_do_not_see_is_uncertain_by_itself():
    """Relaxation of no strength, whose time is anything."""
    priors = PRIORS | {"viscoelasticity": (np.zeros(1), np.full(1, 1e-9))}
    found = update(Replays(), np.array([1.5]), start(0.0, 3.0), priors)
    assert np.linalg.norm(found.spread.root[2]) == pytest.approx(3.0, rel=1e-3)


def test_without_effects_the_base_alone_is_updated():
    """The factor that meets the forces best, by their weights."""
    found = update(Replays(), np.array([1.5]), (), PRIORS)
    variance = 1e-6 + (0.005 * TRUE) ** 2
    assert found.c[0] == pytest.approx((TRUE * TIMES / variance).sum() / (TIMES**2 / variance).sum(), rel=1e-6)
    assert found.present == ((), ())


def test_the_best_of_several_times_is_gone_on_from(monkeypatch):
    """Without a step the fit ends at the start whose forces are closest."""
    monkeypatch.setattr(
        updating.gauss_newton, "minimise", lambda linearise, start, rule, steps: SimpleNamespace(point=start)
    )
    others = [start(G, 5.0), start(G, TAU), start(G, 0.2)]
    found = update(Replays(), np.array([STIFFNESS]), start(0.5, 30.0), PRIORS, others)
    assert found.additions[0].shape == pytest.approx((TAU,))
    assert found.after.force < found.before.force


def test_other_times_change_nothing_that_has_one_minimum():
    """And leave what has no memory to the fit of all."""
    others = [start(0.5, tau) for tau in (0.3, 3.0, 30.0)]
    alone, several = (update(Replays(0.1), np.array([1.5]), start(0.5, 8.0), PRIORS, some) for some in ((), others))
    assert several.additions[0].shape[0] == pytest.approx(alone.additions[0].shape[0], rel=0.02)
    assert several.additions[0].amplitudes[0] == pytest.approx(alone.additions[0].amplitudes[0], rel=0.02)
    assert several.additions[1].amplitudes[0] == pytest.approx(PRIORS["second invariant"][0][0], rel=1e-6)


def test_effects_without_a_memory_may_stay_as_the_fields_have_them():
    """Relaxation follows the forces, and the second invariant neither them nor its prior; it is as uncertain as before."""
    priors = PRIORS | {"second invariant": (np.full(1, 0.01), np.full(1, 0.001))}
    found = update(Replays(), np.array([1.5]), start(0.5, 3.0), priors, of_memory=True)
    assert found.additions[1].amplitudes[0] == pytest.approx(0.04, rel=1e-12)
    assert found.deviations[1][0] == pytest.approx(0.001, rel=1e-6)
    visco = found.additions[0]
    assert visco.amplitudes[0] * visco.shape[0] == pytest.approx(G * TAU, rel=0.1)
