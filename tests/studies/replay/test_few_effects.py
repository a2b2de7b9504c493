"""Few effects by the fields of replays: the gradient that a relaxing sheet was solved with, from its fitted pictures alone, and nothing where nothing is."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from calibrate.data.experiment import Experiment, Noise
from calibrate.diagnosis import base_fit
from calibrate.diagnosis.evidence.priors import Prior, read_priors
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.replayed.few_effects import FewEffects, FewModel
from calibrate.diagnosis.replayed.observations import ReplayErrors
from calibrate.diagnosis.replayed.parameter_spread import Directions, Spread
from calibrate.diagnosis.replayed.updating import Updated
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from calibrate.equations.noise_covariance import noise_factor, sample
from forward.loading import Loading
from forward.materials import NeoHooke
from forward.sheet.inelastic import solve_history
from meshes import quads, triangles
from meshes.known_specimens import SPECIMENS
from studies.replay import few_effects_replay
from studies.replay.few_effects_replay import FewEffectsReplays
from studies.reports.discovery.replays.few_effects_table import few_record, few_table
from studies.synthetic import camera, effect_laws

STRIP = SPECIMENS["strip"]()
NAMES = {"compressibility", "second invariant", "stiffness gradient", "image rotation", "viscoelasticity"}  # fmt: skip
EFFECTS = tuple(effect for effect in CATALOGUE if effect.name in NAMES)
GX, G, TAU, C10, FITTED = -0.2, 0.8, 1.5, 0.2, 6.0


@cache
def strip_test(gradient: float) -> Experiment:
    pull, times = Loading.clamped(STRIP.loaded, 15.0), np.arange(1.0, 11.0)
    effects = [("stiffness gradient", {"gx": gradient, "gy": 0.0}, {}), ("viscoelasticity", {"g": G}, {"tau": TAU})]
    low, high = STRIP_MESH.points.min(axis=0), STRIP_MESH.points.max(axis=0)
    extent = effect_laws.Extent(float((high - low).max()), tuple(((low + high) / 2).tolist()))
    sheet = effect_laws.sheet(NeoHooke(C10), 1.0, effects, extent, [])
    exact = camera.observe(solve_history(quads(STRIP), sheet, pull, times / 10, times), STRIP_MESH, name="strip")
    noise = Noise(3e-3, 2.0, 1e-3)
    errors = sample(noise_factor(exact, noise), np.random.default_rng(1), exact.n_increments)
    return replace(exact, displacements=exact.displacements + errors, noise=noise)


STRIP_MESH = triangles(STRIP, n_nodes=250)


@cache
def found(gradient: float, later: float = 1.0) -> tuple[FewEffects, Updated]:
    """Of a test whose forces and displacements after `FITTED` are as many times larger."""
    test = strip_test(gradient)
    factor = np.where(test.time > FITTED, later, 1.0)[:, None]
    loaded = tuple(replace(b, force=factor * b.force) for b in test.loaded)
    test = replace(test, loaded=loaded, displacements=factor[..., None] * test.displacements)
    problem, base = base_fit.prepare([test], [HoldOut.parse(f"after:{FITTED:g}", 0).training], base="neo-Hooke")
    replays = FewEffectsReplays(problem, base.c, EFFECTS, read_priors())
    few = replays.by_fields()
    return few, replays.with_forces(few, few.best)


def test_a_gradient_and_the_relaxation_beside_it_are_found():
    few, updated = found(GX)
    assert few.best is not None and few.best.effects == ("stiffness gradient",)
    assert few.inclusion["stiffness gradient"] > 0.95
    (mean, deviation) = few.best.priors["stiffness gradient"]
    assert mean[0] == pytest.approx(GX, rel=0.02) and np.all(np.abs(mean - [GX, 0.0]) < 3 * deviation)
    assert few.best.errors.field < 0.3 * few.base.field
    relaxation = next(a for a in updated.additions if a.effect.remembers)
    assert relaxation.amplitudes[0] * relaxation.shape[0] == pytest.approx(G * TAU, rel=0.1)
    assert updated.converged and updated.after.force < 3e-3


def test_nothing_is_found_where_nothing_is():
    few, updated = found(0.0)
    assert few.best is None and few.sets[0][0] == () and max(few.inclusion.values()) < 0.5
    assert {a.effect.name for a in updated.additions} == {"viscoelasticity"}


def test_nothing_that_is_held_out_is_used():
    (own, updated), (other, again) = found(GX), found(GX, 1.2)
    assert own.inclusion == pytest.approx(other.inclusion, rel=1e-3)
    np.testing.assert_allclose(updated.c, again.c, rtol=1e-3)


def test_table_and_record_have_what_was_found():
    few, updated = found(GX)
    columns, rows = few_table(few, "MPa")
    assert rows[0][0] == "stiffness gradient" and "gx = -0.199" in rows[0][2] and len(rows[0]) == len(columns)
    record = few_record(replace(few, models=(FewModel(few.best.effects, 0.9, updated),)))
    assert record["sets"][0]["effects"] == ["stiffness gradient"] and record["models"][0]["converged"]
    assert few_record(None) is None


def test_an_amplitude_that_its_prior_stops_is_said_to_be():
    """Three deviations of 0.02 where the fields ask for -0.2: no interval, which would be that of the prior."""
    problem, base = base_fit.prepare(
        [strip_test(GX)], [HoldOut.parse(f"after:{FITTED:g}", 0).training], base="neo-Hooke"
    )
    narrow = read_priors() | {"stiffness gradient": Prior(0.02, "", "")}
    few = FewEffectsReplays(
        problem, base.c, tuple(e for e in EFFECTS if e.name == "stiffness gradient"), narrow
    ).by_fields()
    gradient = next(one for one in few.fitted if one.effects == ("stiffness gradient",))
    assert gradient.at_limit["stiffness gradient"].tolist() == [True, False]
    assert gradient.additions[0].amplitudes[0] == pytest.approx(-0.06)
    _, rows = few_table(few, "MPa")
    said = next(row[2] for row in rows if row[0] == "stiffness gradient")
    assert said.startswith("gx = -0.06") and "(where its prior stops it), gy = " in said and said.count("+-") == 1
    recorded = next(one for one in few_record(few)["fitted"] if one["effects"])
    assert recorded["effects"][0]["at_limit_of_prior"] == [True, False]


@pytest.mark.parametrize(("fields", "tried"), [((0.1,), 1), ((0.5, 0.1), 2), ((0.5, 0.5, 0.1), 3)])
def test_forces_do_not_take_the_fields_further_off(monkeypatch, fields, tried):
    """Of what may follow the forces the first is taken that leaves the fields as they were: all, a memory alone, the factor alone."""
    problem, _ = base_fit.prepare([strip_test(GX)], [HoldOut.parse(f"after:{FITTED:g}", 0).training], base="neo-Hooke")
    few, _ = found(GX)
    asked = []

    def update(replays, c, additions, priors, others, of_memory):
        asked.append((of_memory, any(a.effect.remembers for a in additions), bool(others)))
        errors = {"before": ReplayErrors(0.1, 0.1), "after": ReplayErrors(0.0, fields[len(asked) - 1])}
        there = tuple(replace(a, amplitudes=(1.0,) * len(a.amplitudes)) for a in additions)
        return SimpleNamespace(additions=there, deviations=tuple((0.0,) * len(a.amplitudes) for a in there), **errors)

    monkeypatch.setattr(few_effects_replay, "update", update)
    monkeypatch.setattr(FewEffectsReplays, "_nearest", few.base.field)
    monkeypatch.setattr(few_effects_replay, "ComparedTest", lambda part, pictures, base: SimpleNamespace(part=part))
    assert FewEffectsReplays(problem, few.c, EFFECTS, read_priors()).with_forces(few, few.best).after.field == 0.1
    assert asked == [(False, True, True), (True, True, True), (True, False, False)][:tried]


def test_what_the_forces_do_not_tell_from_none_is_taken_out(monkeypatch):
    """Of a relaxation that is 1.5 standard deviations from none, and one that is three; a gradient is of the fields."""
    known = {effect.name: effect for effect in EFFECTS}
    gradient = Addition(known["stiffness gradient"], (0.001, 0.0), ())
    weak, strong = (Addition(known["viscoelasticity"], (g,), (2.0,)) for g in (0.15, 0.3))

    def update(replays, c, additions, priors, others, of_memory):
        return Updated(
            Spread(Directions.of(np.ones(2), additions, np.ones((2, 1)), 1.0), np.zeros((0, 0))),
            ReplayErrors(0.5, 0.5),
            ReplayErrors(0.0, 0.1),
            True,
            9,
        )

    monkeypatch.setattr(few_effects_replay, "update", update)
    for one, left in ((weak, (gradient,)), (strong, (gradient, strong))):
        first = SimpleNamespace(
            additions=(gradient, one), deviations=((0.1, 0.1), (0.1,)), c=np.ones(2), before=ReplayErrors(0.2, 0.2)
        )
        new = few_effects_replay._without_weak(None, first, {}, False)
        assert new.additions == left and new.before == ReplayErrors(0.2, 0.2)
