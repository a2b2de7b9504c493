"""The replay that a diagnosis is judged by: the level is that of the law, bands cover, and a model that is wrong on what was held out is no explanation."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from calibrate import errors
from calibrate.data.experiment import Experiment, Noise
from calibrate.data.load_record import LoadRecord
from calibrate.diagnosis import base_fit
from calibrate.diagnosis.base_functions import first_guess
from calibrate.diagnosis.discovery import discover
from calibrate.diagnosis.evidence.levels import StiffnessLevel
from calibrate.diagnosis.evidence.own_effects import OwnEffect
from calibrate.diagnosis.evidence.priors import read_priors
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.replayed.averaged import averaged
from calibrate.diagnosis.replayed.band import ALTERNATIVES
from calibrate.diagnosis.replayed.checked_replay import NoReplayCheck, Replayed
from calibrate.diagnosis.replayed.few_effects import FewModel
from calibrate.diagnosis.replayed.observations import ReplayErrors
from calibrate.diagnosis.replayed.parameter_spread import Directions, Spread, spread_of
from calibrate.diagnosis.replayed.replay_verdict import judged_by_replay, replayed_level, stiffness_level
from calibrate.diagnosis.replayed.updating import Updated
from calibrate.diagnosis.selection import Discovery, Verdict
from calibrate.diagnosis.selection.rounds import Doubt
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from calibrate.effects.chain.true_surface import is_expressed, true_surface
from calibrate.effects.stiffness_gradient import StiffnessGradient
from calibrate.equations import noise_covariance
from calibrate.equations.basis import SingleBasis
from calibrate.equations.equilibrium import neo_hooke as neo_hooke_coefficients
from calibrate.models.extended_model import ExtendedModel
from forward.loading import Loading
from forward.materials import ArrudaBoyce, MooneyRivlin
from forward.sheet.plane_stress import solve
from meshes import PlateWithHole, quads, triangles
from studies.replay.compared_test import ComparedTest, ReplayedModel
from studies.replay.model_law import law_of, material_law
from studies.replay.replay_check import FiniteElementCheck, _Check
from studies.replay.replay_rows import Layout, sheet_rows, smooth_weights
from studies.replay.replayed_experiment import replay
from studies.replay.twin_replay import twin_replay
from studies.synthetic import camera
from studies.synthetic.camera_disturbances import LensDistortion, MagnificationDrift, OutOfPlane, Rotation
from studies.synthetic.disturbances import observe
from studies.synthetic.load_cell_disturbances import ForceDrift, ForceOffset, StiffnessDrift

PLATE = PlateWithHole(half_length=30, half_width=15, far_size=1.5, hole_radius=5, hole_size=0.8)
NOISE = Noise(3e-3, 2.0, 5e-4, 1e-3)  # mm, of 12
SEVENTH = 1.07
BY_NAME = {effect.name: effect for effect in CATALOGUE}
FEW = tuple(BY_NAME[name] for name in ("second invariant", "stiffness gradient", "force offset"))
MOONEY, CHAINS = MooneyRivlin(0.1, 0.03), ArrudaBoyce()


@cache
def solution(second: bool):
    """Of a Mooney-Rivlin sheet, or of one of the first invariant alone; no mesh of a replay."""
    return solve(
        quads(PLATE, quarter=True), MOONEY if second else CHAINS, Loading.clamped(PLATE.loaded, 12.0), 6
    ).mirrored()


@cache
def exact(second: bool) -> Experiment:
    return camera.observe(solution(second), triangles(PLATE, n_nodes=250), name="plate")


def noisy(clean: Experiment, seed: int, noise: Noise = NOISE) -> Experiment:
    rng = np.random.default_rng(seed)
    u = noise_covariance.sample(noise_covariance.noise_factor(clean, noise), rng, clean.n_increments)
    loaded = []
    for b in clean.loaded:
        deviation = noise.force_deviation(b.force)
        loaded.append(replace(b, force=b.force + deviation * rng.standard_normal(b.force.shape)))
    return replace(clean, displacements=clean.displacements + u, loaded=tuple(loaded), noise=noise)


@cache
def found(second: bool, seed: int = 0) -> Discovery:
    """The diagnosis of a noisy test, every third increment held out, judged by its replay."""
    return discover(
        [noisy(exact(second), seed)], HoldOut("every", 3), effects=FEW, fitted=False, replay=twin_replay,
        check=FiniteElementCheck(),
    )  # fmt: skip


def stiffer(one: Discovery, factor: float) -> Discovery:
    """With a final model that was fitted a factor too stiff."""
    last = one.rounds[-1]
    (second,) = last.fit.additions
    more = replace(second, amplitudes=(factor * second.amplitudes[0],))
    fit = replace(last.fit, c=factor * last.fit.c, additions=(more,))
    return replace(one, rounds=(*one.rounds[:-1], replace(last, fit=fit)))


def with_forces(one: Discovery, factor: float) -> Discovery:
    """With forces of the increments held out that are a factor larger."""
    (part,) = one.problem.parts
    held = ~part.train.rows.any(axis=1)
    e = part.experiment
    loaded = tuple(replace(b, force=np.where(held[:, None], factor, 1.0) * b.force) for b in e.loaded)
    system = replace(part.system, experiment=replace(e, loaded=loaded))
    return replace(one, problem=replace(one.problem, parts=(replace(part, chain=replace(part.chain, system=system)),)))


# --- level ----------------------------------------------------------------------------------------------------


def test_the_level_of_a_model_that_is_too_stiff_is_found_from_replayed_forces():
    """By its factor, as forces are proportional to the stiffness; fields and errors at the level stay as they were."""
    own, scaled = found(True).replay_check, FiniteElementCheck()(stiffer(found(True), SEVENTH))
    assert scaled.final.level.factor * SEVENTH == pytest.approx(own.final.level.factor, rel=1e-4)
    assert scaled.final.judged.force == pytest.approx(own.final.judged.force, rel=1e-2)
    assert scaled.final.levels_disagree and not own.final.levels_disagree
    assert abs(own.final.level.factor - 1) < 3 * own.final.deviation


def test_neo_hooke_beside_few_effects_has_its_own_level_and_its_errors():
    """Made stiffer: the same errors, and the level of the forces is in its coefficients. One that cannot be solved is said."""
    one = found(True)
    neo_hooke = first_guess([(part.assembled, part.train.rows) for part in one.problem.trained])
    few = [FiniteElementCheck().few_effects(one, factor * neo_hooke, (), read_priors()) for factor in (1.0, SEVENTH)]
    own, stiffer_one = (part.neo_hooke for part in few)
    assert isinstance(own, Replayed) and isinstance(stiffer_one, Replayed)
    assert few[1].c == pytest.approx(few[0].c, rel=1e-4)
    assert stiffer_one.judged.force == pytest.approx(own.judged.force, rel=1e-2)
    assert stiffer_one.judged.field == pytest.approx(own.judged.field, rel=1e-2)
    assert replayed_level(one, own, few[0].c, ()) == own.level.factor
    nothing = FiniteElementCheck().few_effects(one, 0 * neo_hooke, (), read_priors())
    assert isinstance(nothing, NoReplayCheck) and nothing.reason
    assert replayed_level(one, nothing, one.final.c, ()) == 1.0


def test_a_base_without_an_equilibrium_has_a_stand_in_and_keeps_its_level():
    """One that softens until it pushes back."""
    last = found(True).rounds[-1]
    fit = replace(last.fit, c=np.linspace(2 * last.fit.c.mean(), -last.fit.c.mean(), len(last.fit.c)))
    one = replace(found(True), rounds=(*found(True).rounds[:-1], replace(last, fit=fit)))
    check = FiniteElementCheck()(one)
    assert check.stand_ins == (False, True)
    judged = judged_by_replay(one, check)
    assert stiffness_level(judged, judged.final) == 1.0
    assert stiffness_level(judged, judged.base) == check.base.level.factor != 1.0


def test_a_reading_that_is_missing_takes_its_increment_out_and_no_force():
    """Where others are there; and where it is the only one that was held out, the force of all is unknown there."""
    whole = exact(True)
    forces = [b.force.copy() for b in whole.loaded]
    for force in forces:
        force[1] = np.nan
    broken = replace(whole, loaded=tuple(replace(b, force=f) for b, f in zip(whole.loaded, forces, strict=True)))
    layouts = []
    for test in (whole, broken):
        problem, _ = base_fit.prepare([test], [HoldOut("every", 3).training])
        layouts.append(ComparedTest(problem.parts[0]).layout)
    assert layouts[1].sides == layouts[0].sides and layouts[0].sides
    assert set(layouts[0].chosen) - set(layouts[1].chosen) == {1}
    judged = np.ones(len(whole.points), bool)
    assert Layout.of(broken, np.array([1]), judged).sides == () != Layout.of(broken, np.array([0]), judged).sides


def test_where_the_grips_prescribe_every_point_there_are_no_fields_to_judge_by():
    """As of a homogeneous test: no combination of cosines, and no few effects by the displacements."""
    assert not len(smooth_weights(exact(True).points, np.zeros(len(exact(True).points), bool)))
    assert len(smooth_weights(exact(True).points, np.arange(len(exact(True).points)) < 5)) == 5


# --- bands ----------------------------------------------------------------------------------------------------


def test_noise_of_grips_field_and_load_cells_makes_the_residual_of_the_true_law():
    """Whitened by the covariance of the rows its squares are those of normal numbers; held as if it were exact it would not be."""
    clean, found_squares, without_grips = exact(False), [], []
    law, noise = material_law(CHAINS, "", clean), replace(NOISE, force_std_relative=1e-4, force_std=1e-4)
    for seed in range(3):
        test = noisy(clean, seed, noise).select([2, 5])
        made = replay(test, law, check_mesh=False)
        layout = Layout.of(test, np.arange(2), made.judged)
        rows = sheet_rows(test, layout, made, np.arange(2), True)
        residual = (rows.measured - rows.replayed).ravel()
        found_squares.append(residual @ np.linalg.solve(rows.noise, residual) / len(residual))
        forces = np.tile(layout.is_force, 2)
        cells = noise.force_deviation(rows.measured.ravel())
        without_grips.append(np.mean((residual / cells)[forces] ** 2))
    n = 3 * len(residual)
    assert np.mean(found_squares) == pytest.approx(1.0, abs=4 * np.sqrt(2 / n))
    assert np.mean(without_grips) > 1.5


@pytest.mark.slow
@pytest.mark.parametrize("second", [False, True])
def test_bands_cover(second):
    """Of eight draws of noise none is outside of a band that a right model leaves once in a hundred; chi-squares are on average no larger than their degrees of freedom."""
    checks = [found(second, seed).replay_check for seed in range(8)]
    assert not any(one.judgement.outside for one in checks)
    for kind in ("force", "field"):
        tests = [getattr(one.judgement, kind) for one in checks]
        degrees = sum(test.degrees for test in tests)
        assert sum(test.value for test in tests) < degrees + 3 * np.sqrt(2 * degrees)


def errors_of_linearisation(nodes: int) -> np.ndarray:
    """Of the change of forces and of fields by another c01, relative to the difference of two replays."""
    test = replace(
        camera.observe(solution(True), triangles(PLATE, n_nodes=nodes), name="plate").select([2, 5]), noise=NOISE
    )
    problem, fit = base_fit.prepare([test], [HoldOut("every", 2).training])
    compared = ComparedTest(problem.parts[0])
    before, after = ((Addition(BY_NAME["second invariant"], (c01,)),) for c01 in (0.03, 0.033))
    rows, changes = compared.replayed(ReplayedModel(0.8 * fit.c, before), True)
    other, _ = compared.replayed(ReplayedModel(0.8 * fit.c, after), False)
    expected = other.replayed - rows.replayed
    wrong = changes.of(changes.stress(0.8 * fit.c, after) - changes.stress(0.8 * fit.c, before)) - expected
    kinds = compared.layout.is_force, ~compared.layout.is_force
    return np.array([np.linalg.norm(wrong[:, kind]) / np.linalg.norm(expected[:, kind]) for kind in kinds])


def test_a_change_of_the_law_changes_the_forces_as_a_replay_with_it_does():
    assert errors_of_linearisation(250)[0] < 0.01


@pytest.mark.slow
def test_and_the_fields_the_nearer_the_finer_the_camera():
    """Stresses are those of the camera's triangles: of second order in their size."""
    coarse, fine = errors_of_linearisation(250), errors_of_linearisation(1000)
    assert (fine < coarse / 2).all()
    assert fine[1] < 0.1


def test_amplitudes_are_as_uncertain_as_the_fit_says():
    spread = spread_of(found(True).problem, found(True).final)
    own = np.linalg.norm(spread.root[-1])
    assert own == pytest.approx(found(True).final.errors[0][0], rel=0.2)
    c, additions = spread.directions.moved(len(spread.directions.sizes) - 1)
    assert additions[0].amplitudes[0] > found(True).final.additions[0].amplitudes[0]
    np.testing.assert_array_equal(c, found(True).final.c)


def test_few_effects_that_compete_are_in_the_bands_of_each_other():
    """With and without the second invariant, 3 to 1: each differs from the other by as much, and its band holds that by the probability of the other. One without an equilibrium says so, and is in no band."""
    one = found(True)
    fits = [(one.final.c, one.final.additions), (one.base.c, ()), (0 * one.base.c, ())]
    errors = ReplayErrors(0.01, 0.01)
    spreads = [Spread(Directions.of(c, additions, c[:, None], 1.0), np.zeros((1 + len(additions), 1))) for c, additions in fits]  # fmt: skip
    sets = [(("second invariant",), 0.6), ((), 0.2), (("compressibility",), 0.2)]
    models = [FewModel(*of, Updated(s, errors, errors, True, 6)) for of, s in zip(sets, spreads, strict=True)]
    few = _Check(one).of_few(models)
    own, other = (model.updated.check for model in few[:2])
    change = own.final.rows.residual - other.final.rows.residual
    assert np.abs(change).max() > 0
    np.testing.assert_allclose(own.band.parts[ALTERNATIVES], 0.25 * np.outer(change, change), atol=1e-15)
    np.testing.assert_allclose(other.band.parts[ALTERNATIVES], 0.75 * np.outer(change, change), atol=1e-15)
    assert own.alternatives == ((),) and other.alternatives == (("second invariant",),)
    assert isinstance(few[2].updated, NoReplayCheck) and few[2].updated.reason
    both = averaged([(model.probability, model.updated.check) for model in few[:2]])
    mean = 0.75 * own.final.rows.residual + 0.25 * other.final.rows.residual
    forces = own.final.rows.judged & own.final.rows.is_force
    assert both.judged == pytest.approx(np.linalg.norm(mean[forces]) / np.linalg.norm(own.final.rows.measured[forces]))
    assert both.smooth < max(check.smooth[1] for check in (own, other)) and averaged([(1.0, own)]) is None


# --- verdict --------------------------------------------------------------------------------------------------


def test_a_right_explanation_stays_one_and_is_replayed_better_than_the_base():
    one, check = found(True), found(True).replay_check
    assert one.verdict is Verdict.EXPLAINED and one.named == ("second invariant",)
    assert check.held_out and not check.judgement.speaks_against
    before, after = check.smooth
    assert after < 0.5 * before
    assert after < check.expected.field


def test_a_model_that_is_wrong_on_what_was_held_out_is_no_explanation():
    """Forces that are 3 % larger there alone, which no parameter explains."""
    one = with_forces(found(True), 1.03)
    judged = judged_by_replay(one, FiniteElementCheck()(one))
    assert judged.verdict is Verdict.NOT_EXPLAINED
    assert (judged.named, judged.closest) == ((), ("second invariant",))
    assert Doubt.OUTSIDE_BAND in judged.confirmation.doubts
    assert judged_by_replay(found(True), found(True).replay_check).verdict is Verdict.EXPLAINED


def test_a_model_that_is_replayed_worse_than_the_base_is_no_improvement():
    """The wrong sign of the second invariant, of which the equations are not asked again."""
    last = found(True).rounds[-1]
    wrong = replace(last.fit, additions=(Addition(BY_NAME["second invariant"], (-0.02,)),), c=1.3 * last.fit.c)
    one = replace(found(True), rounds=(*found(True).rounds[:-1], replace(last, fit=wrong)))
    check = FiniteElementCheck()(one)
    assert check.judgement.worse
    assert Doubt.WORSE_REPLAY in judged_by_replay(one, check).confirmation.doubts


def test_what_cannot_be_replayed_says_why_and_changes_no_verdict():
    last = found(True).rounds[-1]
    thick = replace(last.fit, additions=(Addition(BY_NAME["3D effect of thickness"], (0.1,)),))
    one = replace(found(True), rounds=(*found(True).rounds[:-1], replace(last, fit=thick)))
    check = FiniteElementCheck()(one)
    assert isinstance(check, NoReplayCheck) and "3D effect of thickness" in check.reason
    judged = judged_by_replay(one, check)
    assert judged.verdict is one.verdict and judged.replay_check is check
    expressed = {name for name, effect in BY_NAME.items() if is_expressed(effect)}
    assert {"lens distortion", "image rotation", "force offset", "initial warp"} <= expressed
    assert not {"unmeasured strip", "3D effect of thickness", "second invariant"} & expressed


# --- what the camera does --------------------------------------------------------------------------------------

AMPLITUDES = {
    "lens distortion": (0.01,),
    "image rotation": (0.02,),
    "out-of-plane motion": (0.004,),
    "force offset": (0.5,),
    "force drift": (0.1,),
    "magnification drift": (0.004,),
    "stiffness or gain drift": (-0.02,),
}


def of_camera(name):
    """The effect that undoes a disturbance of `SEEN`; a lens about the middle of the specimen."""
    effect = BY_NAME[name]
    return Addition(effect, AMPLITUDES[name], (0.0,) * len(effect.shapes))


SEEN = (
    ForceOffset(0.5),
    LensDistortion(0.01),
    OutOfPlane(0.004),
    Rotation(0.02),
    ForceDrift(0.1),
    MagnificationDrift(0.004),
    StiffnessDrift(-0.02),
)


@pytest.mark.parametrize("disturbance", SEEN, ids=lambda one: one.name)
def test_effects_of_camera_and_load_cell_are_taken_out_before_a_replay(disturbance):
    """What is left of the true law is the error of the mesh, as without them; left in they leave ten times as much of the force."""
    seen = observe(solution(False), PLATE, triangles(PLATE, n_nodes=250), [disturbance], name="plate")
    true = true_surface(seen, (of_camera(disturbance.name),))
    law = material_law(CHAINS, "", seen)
    exactly, corrected, left_in = (replay(e.select([5]), law, check_mesh=False) for e in (exact(False), true, seen))
    assert corrected.field_error[-1] == pytest.approx(exactly.field_error[-1], rel=1e-2)
    assert corrected.force_error < 1e-4
    assert left_in.force_error > 10 * corrected.force_error


@pytest.mark.parametrize("disturbance", SEEN, ids=lambda one: one.name)
def test_the_replay_of_a_model_takes_its_camera_out_of_the_test_it_was_fitted_to(disturbance):
    """Of another test, of which the camera may be another, it does not."""
    seen = observe(solution(False), PLATE, triangles(PLATE, n_nodes=250), [disturbance], name="plate").select([5])
    camera_too = of_camera(disturbance.name)
    null = Addition(BY_NAME["initial warp"], (0.0,) * len(BY_NAME["initial warp"].amplitudes))
    c = neo_hooke_coefficients(SingleBasis(0, 20.0), 0.4)
    model = ExtendedModel(SingleBasis(0, 20.0), c, (camera_too, null), ((0.0,), (0.0,) * len(null.amplitudes)), "MPa")
    own = replace(model, training=({"name": seen.name, "fingerprint": seen.fingerprint},))
    known, unknown = (law_of(one, seen) for one in (own, model))
    assert (known.taken_out, known.left_out) == ((camera_too,), ())
    assert (unknown.taken_out, unknown.left_out) == ((), (disturbance.name,))
    np.testing.assert_array_equal(
        replay(seen, known, check_mesh=False).experiment.displacements, true_surface(seen, (camera_too,)).displacements
    )
    exactly = replay(exact(False).select([5]), unknown, check_mesh=False)
    corrected, left_in = (
        abs(replay(seen, law, check_mesh=False).force_error - exactly.force_error) for law in (known, unknown)
    )
    assert left_in > 10 * corrected


def test_the_record_is_corrected_with_the_forces_of_the_pictures():
    """It is on the clock of the forces: a lag moves the pictures, and where these go beyond it, there is none."""
    seen = replace(exact(False), time=np.arange(1.0, 7.0))
    times = np.arange(0.0, 8.0)
    forces = np.stack([np.concatenate([0 * b.force[:1], b.force, b.force[-1:]]) for b in seen.loaded])
    seen = replace(seen, record=LoadRecord(times, forces))
    turned, late, later = (Addition(BY_NAME[name], (a,), shape) for name, a, shape in
                           (("image rotation", 0.02, ()), ("lag between force and image", 0.5, (1.0,)), ("lag between force and image", 1.5, (1.0,))))  # fmt: skip
    drift = Addition(BY_NAME["force drift"], (0.1,), ())
    softer = Addition(BY_NAME["stiffness or gain drift"], (-0.02,), ())
    rubbing = Addition(BY_NAME["friction in the load train"], (0.3, 0.0), ())
    for acting in (turned, drift, softer, rubbing):
        true = true_surface(seen, (acting,))
        for boundary, force in zip(true.loaded, true.record.force, strict=True):
            np.testing.assert_allclose(force[1:-1], boundary.force, rtol=1e-12, atol=1e-12)
    true = true_surface(seen, (turned,))
    assert np.abs(true.record.force - seen.record.force).max() > 0.01 * np.abs(forces).max()
    moved = true_surface(seen, (late,))
    np.testing.assert_allclose(moved.time, seen.time + 0.5)
    np.testing.assert_array_equal(moved.record.force, seen.record.force)
    assert true_surface(seen, (later,)).record is None


def test_what_is_left_of_a_corrected_noisy_test_is_its_noise():
    lens = of_camera("lens distortion")
    seen = observe(solution(False), PLATE, triangles(PLATE, n_nodes=250), SEEN[1:2], name="plate")
    true = true_surface(noisy(seen, 0), (lens,))
    one = replay(true.select([2, 5]), material_law(CHAINS, "", true), check_mesh=False)
    assert one.field_error[-1] == pytest.approx(true.noise.displacement_std, rel=0.25)
    assert true.noise.displacement_std == pytest.approx(NOISE.displacement_std, rel=0.02)


def test_effects_of_the_material_change_nothing_of_what_was_measured():
    test = noisy(exact(False), 0)
    same = true_surface(test, (Addition(BY_NAME["second invariant"], (0.02,)),))
    np.testing.assert_array_equal(same.displacements, test.displacements)
    assert same.noise == test.noise


def test_one_increment_leaves_nothing_to_judge():
    """Its level is fitted to the only force: an error of 0 % would be no prediction."""
    parts = (SimpleNamespace(experiment=SimpleNamespace(n_increments=1)),)
    found = FiniteElementCheck()(SimpleNamespace(problem=SimpleNamespace(parts=parts)))
    assert isinstance(found, NoReplayCheck)
    assert "one increment" in found.reason


def judging(*own):
    """Rows of two tests, each a force and a displacement, that may judge a joint model beside what the tests have for themselves."""
    checked = _Check(SimpleNamespace(own=own))
    checked.tests = [SimpleNamespace(part=SimpleNamespace(experiment=SimpleNamespace(name=name))) for name in "ab"]
    rows = SimpleNamespace(test=np.array([0, 0, 1, 1]), is_force=np.array([True, False, True, False]))
    return checked._judges(rows).tolist()


def test_a_replay_is_judged_by_the_tests_that_lack_nothing_it_lacks():
    """What stands in for something excuses no test, or a wrong model would be judged by none; of a level the forces alone do not judge."""
    gradient = OwnEffect(StiffnessGradient(), ("a", "b"), 1.0, 0.0, (0.1, 0.1), ((0.0, 0.0), (0.2, 0.0)), ((0.01, 0.01),) * 2, 3.0)  # fmt: skip
    level = OwnEffect(StiffnessLevel(), ("b",), 1.0, 0.0, (0.1,), ((0.01,),), ((0.001,),), 3.0)
    assert judging() == [True] * 4
    assert judging(gradient) == [True, True, False, False]
    assert judging(replace(gradient, own=0.5)) == [True] * 4
    assert judging(replace(gradient, own=0.0, common=1.0)) == [False] * 4
    assert judging(replace(gradient, prior=(0.05, 0.05))) == [True] * 4
    assert judging(level) == [True, True, False, True]


@pytest.mark.parametrize(
    ("name", "amplitudes", "shape"),
    [
        ("subset smoothing", (30.0,), (0.1,)),
        ("camera tilt", (3.0, 3.0), (0.1,)),
        ("out-of-plane motion", (-1.0,), (0.1,)),
    ],
)
def test_a_correction_that_leaves_no_test_names_the_effect(name, amplitudes, shape):
    """Triangles turned inside out, or displacements as of pixels: the points are right, it is the effect that is too large."""
    effect = BY_NAME[name]
    addition = Addition(effect, amplitudes[: len(effect.amplitudes)], shape[: len(effect.shapes)])
    with pytest.raises(errors.ExperimentError, match=f"plate, corrected for {name}, is no test that could be"):
        true_surface(exact(True), (addition,))
