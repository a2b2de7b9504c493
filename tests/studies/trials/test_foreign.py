"""Foreign trials: forms of their own that do about as much as the effects they replace, and noise that is not what is stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrate.effects import CATALOGUE
from forward.errors import MaterialError
from forward.loading import Loading
from forward.materials import Gent, MooneyRivlin, NeoHooke
from forward.sheet.damage_and_dispersion import OgdenPart, RectangularInclusion
from forward.sheet.inelastic import solve_history
from studies.trials import blind_solution
from studies.trials.blind_case import Plan
from studies.trials.blind_data import draw, label, make
from studies.trials.blind_plans import Numbers, plans
from studies.trials.blind_solution import clean_experiment, sheet
from studies.trials.blind_trial import ForeignNoise
from studies.trials.foreign import FOREIGN, foreign, laws, noise_of

COARSE = {"hole_size": 2.0, "far_size": 4.0}


@pytest.fixture
def coarse(monkeypatch):
    monkeypatch.setattr(blind_solution, "SIZES", dict.fromkeys(blind_solution.SIZES, COARSE))
    blind_solution.forward_mesh.cache_clear()
    yield
    blind_solution.forward_mesh.cache_clear()


def recorded(trial):
    """Displacements, and forces in the unit in which the largest is 1."""
    clean = clean_experiment(trial)
    forces = np.concatenate([b.force.ravel() for b in clean.loaded])
    return np.concatenate([forces / np.abs(forces).max(), clean.displacements.ravel()]), np.abs(forces).max()


def change(one, other):
    """Relative, of forces and displacements together."""
    (a, force), (b, other_force) = one, other
    return np.linalg.norm(np.append(a - b, force / other_force - 1)) / np.linalg.norm(b)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*FOREIGN, "inclusion"])
def test_a_foreign_form_is_another_law_of_like_size(coarse, name):
    """Beside the same base it changes the recording by 0.2 to 5 times as much as the effect of the catalogue does."""
    own = next(t for t in (draw(seed, name) for seed in range(7, 40)) if t.specimen == "plate")
    other = replace(foreign(own), material=own.material)
    assert set(laws(other).solved) == {name}
    known, form, without = (recorded(trial) for trial in (own, other, replace(own, effects=())))
    assert change(form, known) > 0.02 * change(known, without)
    assert 0.2 < change(form, without) / change(known, without) < 5


def test_a_power_of_minus_two_is_the_second_invariant(coarse):
    """Ogden's term with alpha = -2 is c01 (I2 - 3)."""
    trial = replace(draw(3, None), material=NeoHooke(0.4))
    described = sheet(trial)
    parts = [
        replace(described, additions=(OgdenPart(-2 * 0.05, -2.0),)),
        replace(described, material=MooneyRivlin(0.2, 0.05)),
    ]
    load = Loading.clamped(blind_solution.SPECIMENS[trial.specimen].loaded, trial.displacement)
    mesh = blind_solution.forward_mesh(trial.specimen)
    one, other = (solve_history(mesh, part, load, (0.5, 1.0), (1.0, 2.0)) for part in parts)
    for side, force in one.reactions.items():
        np.testing.assert_allclose(force, other.reactions[side], rtol=1e-6, atol=1e-6 * np.abs(force).max())


@pytest.mark.parametrize(("common", "stated"), [(0.0, 1.0), (0.9, 0.5), (0.5, None)])
def test_foreign_noise_is_what_is_drawn_and_states_what_is_said(coarse, common, stated):
    trial = replace(foreign(draw(5, None)), foreign=ForeignNoise(common, stated))
    clean = clean_experiment(trial)
    own = make(replace(trial, foreign=None))[0].noise
    errors, said = noise_of(trial, clean, own)
    assert np.sqrt((errors[-1] ** 2).mean()) == pytest.approx(trial.displacement_std, rel=0.5)  # of one draw
    step = np.sqrt(((errors[-1] - errors[-2]) ** 2).mean() / 2)
    assert step < 1.3 * trial.displacement_std * np.sqrt(1 - common) + 0.1 * trial.displacement_std
    if stated is None:
        assert said is None
    else:
        assert said.total_std == pytest.approx(stated * trial.displacement_std)
        assert said.is_common is (common > 0)


def test_plans_are_random_pairs_and_names_tell_them_apart():
    found = plans(Numbers(1, 2, 12), seed=100, foreign=True)
    pairs = {plan.effects for plan in found if len(plan.effects) == 2}
    assert len(pairs) > 5 and all(plan.foreign for plan in found)
    assert all(plan.name.startswith("foreign-") for plan in found)
    trial = Plan(100, ("viscoelasticity",), foreign=True).trial()
    assert isinstance(trial.material, Gent) and trial.foreign is not None
    assert label(trial)["foreign"] == {"common": trial.foreign.common, "stated": trial.foreign.stated}
    assert set(FOREIGN) < {effect.name for effect in CATALOGUE}


def test_parts_that_cannot_be_are_refused():
    with pytest.raises(MaterialError, match="alpha"):
        OgdenPart(0.1, 0.0)
    with pytest.raises(MaterialError, match="short"):
        RectangularInclusion(0.1, 0.0, 0.0, 1.0, -1.0, 0.0)


def test_numbers_of_two_foreign_forms_are_independent():
    """Over many seeds: how long an inclusion is, and where the lens beside it has its centre."""
    trials = [foreign(draw(seed, "stiffness field", "lens distortion")) for seed in range(200)]
    sides, places = zip(*((t.effects[0].more["slender"], t.effects[1].shape["x"]) for t in trials), strict=True)
    assert abs(np.corrcoef(sides, places)[0, 1]) < 0.2
