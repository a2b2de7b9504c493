"""Measured sheets: gaps in the pictures, initial warp, transferring a material, locating a stiffer place, the command."""

import json
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial import legendre
from scipy.optimize import brentq

from calibrate import errors
from calibrate.data.experiment import Experiment, LoadedBoundary
from calibrate.diagnosis import base_fit, effect_fit, score_tests
from calibrate.diagnosis.problem import all_rows
from calibrate.effects.chain import Addition, Chain
from calibrate.effects.compressibility import Compressibility
from calibrate.effects.out_of_plane import OutOfPlane
from calibrate.effects.viscosity import Viscosity
from calibrate.effects.warp import ORDER, InitialWarp, integrals
from calibrate.equations.basis import SingleBasis
from calibrate.equations.equilibrium import equilibrium, neo_hooke
from calibrate.models.extended_model import ExtendedModel
from studies.commands import measured
from studies.importers.recording.missing_frames import missing_frames
from studies.sheets import (
    leave_one_out,
    measured_loop,
    measured_map,
    measured_results,
    measured_transfer,
    model_errors,
    sheet_models,
    tables,
)
from studies.sheets.measured_control import groups, interpolation
from studies.sheets.measured_results import RivalResult
from studies.sheets.model_errors import Split
from studies.sheets.sheet_results import ErrorsOfParts, ForceAndField, ModelErrors, ModelName, NamedModel, SheetResult

SIZE, MU = 40.0, 0.4
TIME = np.linspace(1.0, 20.0, 10)
BASIS = SingleBasis(0, 1.0, 12)


def material(*additions):
    """Neo-Hooke with effects."""
    return ExtendedModel(
        BASIS, neo_hooke(BASIS, MU), additions, tuple((0.0,) * len(a.amplitudes) for a in additions), "MPa"
    )


MATERIAL = material()


def sheet(stretches, lateral, forces, free):
    """A square of SIZE mm whose rows (n,) move to the integral of `stretches` (t, n - 1), pulled along y; thickness 1 mm."""
    n = stretches.shape[1] + 1
    line = np.linspace(0, SIZE, n)
    x, y = map(np.ravel, np.meshgrid(line, line))
    number = np.arange(n * n).reshape(n, n)
    a, b, c, d = (number[i : n - 1 + i, j : n - 1 + j].ravel() for i, j in ((0, 0), (0, 1), (1, 1), (1, 0)))
    triangles = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    up = np.concatenate([np.zeros((len(stretches), 1)), np.cumsum((stretches - 1) * SIZE / (n - 1), axis=1)], axis=1)
    u = np.stack([(lateral - 1)[:, None] * x, up[:, np.repeat(np.arange(n), n)]], axis=-1)
    pull = np.stack([np.zeros(len(forces)), forces], axis=1)
    sides = np.concatenate([number[1:-1, 0], number[1:-1, -1]]) if free else np.array([], int)
    loaded = (LoadedBoundary("bottom", number[0], -pull), LoadedBoundary("top", number[-1], pull))
    return Experiment("stand-in", np.stack([x, y], axis=1), triangles, u, loaded, sides, 1.0, TIME)


@pytest.fixture(scope="module")
def uniaxial():
    """A neo-Hookean sheet that contracts freely: the stress is mu (l - 1 / l^2)."""
    stretch = np.linspace(1.04, 1.4, len(TIME))
    force = SIZE * MU * (stretch - stretch**-2)
    return sheet(np.repeat(stretch[:, None], 12, axis=1), stretch**-0.5, force, True)


@pytest.fixture(scope="module")
def layered():
    """Held in width, the upper half twice as stiff: mu (l - 1 / l^3) is the same in both halves."""
    upper = np.linspace(1.02, 1.2, len(TIME))
    stress = 2 * MU * (upper - upper**-3)
    lower = np.array([brentq(lambda s, p=p: MU * (s - s**-3) - p, 1, 3) for p in stress])
    stretches = np.concatenate([np.repeat(lower[:, None], 10, axis=1), np.repeat(upper[:, None], 10, axis=1)], axis=1)
    return sheet(stretches, np.ones(len(TIME)), SIZE * stress, False)


def steady(n=60):
    """Displacements (n, 100, 2) of points that move on at an even pace, with a little jitter."""
    points = np.random.default_rng(0).uniform(0, 40, (100, 2))
    field = np.stack([-0.3 * points[:, 0], points[:, 1]], axis=1) / 40
    jitter = 0.02 * np.random.default_rng(1).normal(size=n)
    return field, (np.arange(n) + jitter)[:, None, None] * 0.08 * field


def test_missing_frames_are_counted():
    _, u = steady()
    kept = np.delete(np.arange(60), [20, 21, 40])
    assert missing_frames(0.2 * np.arange(57), u[kept]) == {20: 2, 38: 1}
    assert missing_frames(0.2 * np.arange(60), u) == {}


def test_a_slip_is_no_missing_frame():
    """A step twice as long, but of another field, is the specimen's own."""
    field, u = steady()
    slip = u.copy()
    slip[30:] += 0.08 * np.stack([field[:, 1], field[:, 0]], axis=1) * 1.5
    assert missing_frames(0.2 * np.arange(60), slip) == {}
    assert missing_frames(np.cumsum(np.linspace(0.1, 0.3, 60)), u) == {}


def test_warp_strains_are_legendre_polynomials():
    x = np.linspace(-1, 1, 9)
    for k in range(ORDER + 1):
        expected = legendre.legval(x, legendre.legint(np.eye(ORDER + 1)[k], lbnd=-1))
        assert np.asarray(integrals(jnp.asarray(x)))[k] == pytest.approx(expected, abs=1e-12)


def test_a_sheet_that_was_bowed_is_flattened(uniaxial):
    """A slope q = s y / L makes the strain q^2 / 2, which is 1 / 3 p_0 + 2 / 3 p_2 of its largest; forces are those of the
    flat sheet, whose length and height the seen ones are not."""
    s = 0.1
    y = uniaxial.points[:, 1] - SIZE / 2
    lost = s**2 / 6 * y**3 / (SIZE / 2) ** 2  # integral of q^2 / 2
    move = np.stack([np.zeros_like(y), lost], axis=1)
    seen = replace(uniaxial, points=uniaxial.points - move, displacements=uniaxial.displacements + move)
    amplitudes = np.zeros(2 * (ORDER + 1))
    amplitudes[ORDER + 1], amplitudes[ORDER + 3] = s**2 / 6, s**2 / 3
    addition = Addition(InitialWarp(), tuple(amplitudes), ())
    flat, bowed, wrong = (
        Chain(equilibrium(e, 12.0), BASIS).residual(MATERIAL.c, additions)
        for e, additions in ((uniaxial, ()), (seen, (addition,)), (seen, ()))
    )
    size = np.abs(wrong - flat).max()
    assert np.abs(bowed - flat).max() < 0.03 * size


def test_section_forces_of_a_uniform_sheet(uniaxial):
    found = model_errors.section_forces(uniaxial, MATERIAL)
    assert found == pytest.approx(np.repeat(model_errors.force(uniaxial)[:, None], found.shape[1], axis=1), rel=2e-3)


def test_a_material_is_transferred_with_one_factor(uniaxial):
    learnt = NamedModel(ModelName.BASE, [MATERIAL.scaled(0.5).to_dict()])
    model = measured_transfer.transfer(uniaxial, [learnt], 10.0, 12.0).model(ModelName.BASE)
    assert model.factor == pytest.approx(2.0, rel=5e-3)
    assert model.errors.scored.force < 5e-3
    assert model.errors.scored.lower_over_upper == pytest.approx(1.0, abs=1e-6)


def test_the_strength_of_relaxation_is_transferred_with_its_own_factor(uniaxial):
    """A force with twice the overstress that was learnt."""
    learnt = material(Addition(Viscosity(), (0.2,), (3.0,)))
    pull = model_errors.section_forces(uniaxial, learnt.scaled(1.5, 2.0)).mean(axis=1)
    forces = np.stack([np.zeros(len(pull)), pull], axis=1)
    loaded = tuple(replace(b, force=sign * forces) for b, sign in zip(uniaxial.loaded, (-1, 1), strict=True))
    _, factors = measured_transfer.transferred(
        replace(uniaxial, loaded=loaded), learnt, Split.of(uniaxial, 13.0), 12.0, strength=True
    )
    assert factors == pytest.approx({"stiffness": 1.5, "relaxation": 2.0}, rel=2e-2)


@pytest.mark.parametrize("base", ["neo-Hooke", "positive"])
def test_on_one_ramp_relaxation_is_seen_beside_neo_hooke_alone(uniaxial, base):
    """An energy of I1 of any shape can soften with strain as a branch relaxes with time."""
    learnt = material(Addition(Viscosity(), (0.5,), (3.0,)))
    pull = model_errors.section_forces(uniaxial, learnt).mean(axis=1)
    forces = np.stack([np.zeros(len(pull)), pull], axis=1)
    loaded = tuple(replace(b, force=sign * forces) for b, sign in zip(uniaxial.loaded, (-1, 1), strict=True))
    e = replace(uniaxial, loaded=loaded)
    problem, fit = base_fit.prepare([e], [all_rows], 12.0, base=base)
    found = next(s for s in score_tests.score(problem, fit, [Viscosity()]) if s.effect.name == Viscosity.name)
    fit = effect_fit.refit(problem, fit.c, (Addition(Viscosity(), (0.0,), (3.0,)),))
    if base == "neo-Hooke":
        assert found.adjusted < 1e-6
        assert fit.additions[0].amplitudes[0] == pytest.approx(0.5, abs=0.05)
        assert fit.errors[0][0] < 0.1
    else:
        assert found.status == "absorbed"
        assert fit.errors[0][0] > 1.0


def test_scaling_a_material_scales_its_stress(uniaxial):
    """beta in 1/MPa falls as the stiffness rises, so that the volume ratio stays."""
    soft = material(Addition(Compressibility(), (0.2,)))
    assert model_errors.section_forces(uniaxial, soft.scaled(3.0)) == pytest.approx(
        3 * model_errors.section_forces(uniaxial, soft), rel=1e-9
    )
    assert ExtendedModel.from_dict(json.loads(json.dumps(soft.to_dict()))).additions == soft.additions


def test_the_stiffer_half_is_located(layered):
    found = measured_map.stiffness_map(layered, [MATERIAL], 10.0, 8.0, 8.0)
    y = layered.points[:, 1]
    values = np.array(found.map)
    inner = np.abs(layered.points[:, 0] - SIZE / 2) < SIZE / 4
    assert np.median(values[inner & (y < 0.3 * SIZE)]) == pytest.approx(1.0, abs=0.1)
    assert np.median(values[inner & (y > 0.7 * SIZE)]) == pytest.approx(2.0, abs=0.2)
    scored = found.errors.scored
    assert scored.after.force < 0.2 * scored.before.force
    assert measured_results.MapResult.from_dict(json.loads(json.dumps(found.to_dict()))) == found


def test_increments_are_fitted_or_scored(uniaxial):
    split = Split.of(uniaxial, 13.0)
    assert (split.fitted ^ split.scored).all()
    assert TIME[split.fitted].max() <= 13.0 < TIME[split.scored].min()
    with pytest.raises(errors.ConfigError, match="increments are before 2 s"):
        Split.of(uniaxial, 2.0)


def test_pictures_are_not_compared_across_a_gap():
    time = 0.2 * np.arange(100)
    time[51:] += 0.4
    frames = np.array(groups(time, 10)).reshape(-1, 5)
    assert (frames - frames[:, [2]] == [-3, -1, 0, 1, 3]).all()
    assert len(set(frames.ravel())) == frames.size
    assert np.ptp(time[frames], axis=1).max() < 1.3


def test_what_grows_as_a_cubic_drops_out_of_the_difference():
    times = np.array([[0.0, 0.4, 0.8, 1.3], [2.0, 2.4, 2.8, 3.2]])
    at = np.array([0.6, 2.6])
    cubic = np.polynomial.Polynomial([1.0, -2.0, 0.5, 0.3])
    weights = interpolation(at, times)
    assert (weights * cubic(times)).sum(axis=1) == pytest.approx(cubic(at), abs=1e-12)
    assert weights[1] == pytest.approx([-1 / 16, 9 / 16, 9 / 16, -1 / 16])


def steps(folder):
    return measured.Steps(folder, measured.SheetStudy(), False, lambda text: None)


def test_a_step_is_made_once(tmp_path):
    made = []
    for _ in range(2):
        result = steps(tmp_path).step("one", RivalResult, lambda: RivalResult(made.append(1) or []))
    assert result.models == [] and result.seconds == 0.0 and len(made) == 1


def test_absent_data_are_named_before_anything_is_made(tmp_path, monkeypatch):
    from studies.importers import measured_data

    def absent(name):
        raise errors.DataNotFoundError(f"data file {name} not found")

    monkeypatch.setattr(measured_data, "sheet", absent)
    with pytest.raises(errors.DataNotFoundError, match="Soft_Homo"):
        measured.measured(quick=True, output=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def relaxing(e):
    """The sheet pulled with the forces of neo-Hooke and a branch that relaxes."""
    pull = model_errors.section_forces(e, material(Addition(Viscosity(), (0.5,), (3.0,)))).mean(axis=1)
    forces = np.stack([np.zeros(len(pull)), pull], axis=1)
    loaded = tuple(replace(b, force=sign * forces) for b, sign in zip(e.loaded, (-1, 1), strict=True))
    return replace(e, loaded=loaded)


@pytest.mark.slow
def test_a_sheet_that_relaxes_is_learnt(uniaxial, monkeypatch):
    """Of four effects the one that is there stays, and predicts what comes after the limit."""
    names = ("viscoelasticity", "stiffness gradient", "lens distortion", "out-of-plane motion")
    monkeypatch.setattr(measured_loop, "EFFECTS", tuple(measured_loop.BY_NAME[name] for name in names))
    monkeypatch.setattr(measured_loop, "NESTED", {})
    result = measured_loop.learn(relaxing(uniaxial), 13.0, 12.0, lambda text: None)
    assert "viscoelasticity" in result.closest
    assert set(result.taken_out) | set(result.closest) | set(result.not_testable) == set(names)
    assert SheetResult.from_dict(json.loads(json.dumps(result.to_dict()))) == result
    before, after = (one.errors.scored.force for one in (result.model(ModelName.BASE), result.final))
    assert after < 0.2 * before and after < 0.01
    without = next(line for line in result.without if line.effect == "viscoelasticity")
    assert without.force_scored > 5 * after
    assert {row[0] for row in tables.effect_table(result)[1]} == set(names)
    assert len(tables.variant_table(result)[1]) == 3 + 1 + len(measured_loop.SPLINES)
    fits = len(result.leave_one_out)
    assert fits == (TIME <= 13.0).sum()
    assert tables.kept(result, "viscoelasticity") == f"{fits} of {fits}"
    assert after <= tables.spread(result)["force"][1]
    assert all(model.relaxes for name in (ModelName.RETAINED, ModelName.MEAN) for model in result.model(name).models)


def test_motion_out_of_plane_is_a_share_of_the_whole_loading(uniaxial):
    """Fitted to the first increments, whose last one is its unit, it is as much larger at the end as the displacements are."""
    early = uniaxial.select(np.arange(5))
    models = sheet_models.SheetModels(uniaxial, early, Split.of(uniaxial, 10.0), 12.0, 10.0, None)
    growth = np.sqrt((uniaxial.displacements[-1] ** 2).mean() / (early.displacements[-1] ** 2).mean())
    assert models.growth == pytest.approx(growth)
    (back,) = models.of_early((Addition(OutOfPlane(), (0.01 * growth,)),))
    assert back.amplitudes == pytest.approx((0.01,))
    seen = [
        np.asarray(OutOfPlane().displacements(Chain(equilibrium(e, 12.0), BASIS).data, e.displacements, (m,), ()))
        for e, m in ((uniaxial, 0.01 * growth), (early, 0.01))
    ]
    assert seen[0][:5] == pytest.approx(seen[1], abs=1e-12)


def test_one_family_of_fibres_is_started_where_two_were():
    general = Addition(measured_loop.BY_NAME["two fibre families"], (0.1,), (0.4, 0.3))
    special = measured_loop.BY_NAME["one fibre family"]
    starts = leave_one_out.special_starts(general, special)
    assert [(*one.amplitudes, *one.shape) for one in starts] == [
        pytest.approx(start) for start in ((0.2, 0.4), (0.1, 0.1), (0.1, 0.7))
    ]
    (closed,) = leave_one_out.special_starts(replace(general, shape=(0.4, 0.0)), special)
    F = np.array([[[1.3, 0.1], [0.0, 0.9]]])
    stresses = [a.effect.stress(None, F, 0.0, a.amplitudes, a.shape)
                for a in (replace(general, shape=(0.4, 0.0)), closed)]  # fmt: skip
    np.testing.assert_allclose(*stresses, rtol=1e-12)  # two families that have closed up to one are that one
    (still,) = leave_one_out.special_starts(general, measured_loop.BY_NAME["stiffness gradient"])
    assert still.shape == () and not any(still.amplitudes)


def test_the_mean_of_models_predicts_the_mean_of_their_forces(uniaxial):
    """Too soft and too stiff by as much: the mean is right, each alone is not."""
    split = Split.of(uniaxial, 13.0)
    soft, stiff = MATERIAL.scaled(0.8), MATERIAL.scaled(1.2)
    alone, both = (model_errors.prediction(uniaxial, models, split, 12.0) for models in ([soft], [soft, stiff]))
    assert alone.errors.scored.force == pytest.approx(0.2, rel=0.02)
    assert both.errors.scored.force < 5e-3
    assert np.mean(both.sections) == pytest.approx(1.0, abs=2e-3)


def test_a_finer_base_must_validate_as_well():
    known = measured_loop.Base(1, None, 10.0, ForceAndField(0.02, 0.01))
    assert known.validates(known)
    assert not measured_loop.Base(5, None, 0.0, ForceAndField(0.05, 0.005)).validates(known)
    assert measured_loop.Base(2, None, 0.0, ForceAndField(0.01, 0.01)).validates(known)


def test_what_fits_but_predicts_worse_is_no_explanation():
    base, better, worse = (
        ErrorsOfParts(*[ModelErrors(force, field, 0.0, 0.0, 1.0)] * 2)
        for force, field in ((0.05, 0.04), (0.01, 0.02), (0.13, 0.01))
    )
    assert measured_loop.predicts(base, better)
    assert not measured_loop.predicts(base, worse)
