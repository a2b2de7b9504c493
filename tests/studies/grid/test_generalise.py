"""The study of generalisation: what the camera sees, forces predicted, coverage, ambiguity, verdicts, its files."""

import json
from dataclasses import asdict, replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from study_stand_in import parsed

from calibrate.equations.deformation_modes import MODES, stretches_to_gradient
from calibrate.equations.unseen_strip import window_equilibrium
from calibrate.fitting.calibration import predict_forces
from calibrate.fitting.uncertainty import coefficients_and_slopes
from calibrate.models import pann
from calibrate.models.network_model import Model
from forward.materials import Carroll
from meshes.shapes import signed_distance
from studies.accuracy.metrics import ArrudaBoyceTruth
from studies.grid.claims import ClaimVerdict
from studies.grid.generalise import calibrated_set, coverage, statements, windows
from studies.grid.generalise.calibrated_set import CalibratedSet, Prediction, stretches
from studies.grid.generalise.force_prediction import fine_basis, predicted_test
from studies.grid.generalise.generalise_results import GeneraliseResults, true_stress
from studies.grid.generalise.generalise_settings import CROSS, MEASURED, SETS, SHEETS, SIZES, GeneraliseSettings
from studies.grid.generalise.generalise_study import GENERALISE
from studies.grid.generalise.statements import GeneraliseStatement, judge
from studies.grid.report import Page, write

SETTINGS = replace(GeneraliseSettings(), seeds=(0,), truths=("arruda_boyce",))


class Affine:
    """A forward solution of a specimen stretched evenly; forces of neo-Hooke of 0.4 MPa, 30 mm wide, 1 mm thick."""

    def __init__(self, stretch=np.array([1.2, 1.8])):
        self.stretch, self.thickness, self.time, self.description = stretch, 1.0, np.arange(1.0, len(stretch) + 1), {}
        force = 30 * 0.4 * (stretch - stretch**-2)
        self.reactions = {
            side: np.column_stack([sign * force, 0 * force]) for side, sign in (("left", -1), ("right", 1))
        }

    def evaluate(self, points):
        return np.array([points * [s - 1, s**-0.5 - 1] for s in self.stretch])


@pytest.fixture(scope="module")
def system():
    mesh = windows.camera_mesh("TTf", 2.5, 400)
    return window_equilibrium(windows.observe(Affine(), mesh, "TTf", {}), 2.5, 5.0)


known_stress = cache(true_stress)


def made_up(tests, inputs, layers, scores, factor=1.0, width=0.0, loss=1.0, truth="arruda_boyce"):
    """A calibration whose stresses are `factor` times the truth, its starts `width` times the truth apart."""
    found = {}
    for mode in MODES:
        stress = known_stress(truth, mode, SETTINGS.end_I1)
        found[mode] = Prediction(*(list(f * stress) for f in (factor, factor - width, factor + width)))
    return CalibratedSet(tests, inputs, layers, loss, [1.0], 1.0, {"converged": 1}, 0.1, scores, found)


def results_of(make, settings=SETTINGS):
    """Results with `make(tests, inputs, layers)` for every calibration; a set covers more the more tests it has."""
    results = GeneraliseResults(None, settings)
    every = [make(t, i, s) for t in settings.sets for i in settings.inputs for s in settings.sizes]
    results.__dict__["calibrations"] = {(truth, seed): every for truth in settings.truths for seed in settings.seeds}
    cells = {name: np.arange(72).reshape(12, 6) < 3 * k + 3 for k, name in enumerate((*SHEETS, CROSS))}
    states = {name: coverage.States(np.zeros((1, 2)), c, np.array([5.0, 5.0])) for name, c in cells.items()}
    results.__dict__["states"] = dict.fromkeys(settings.truths, states)
    return results


@pytest.mark.parametrize("name", [*SHEETS, CROSS])
def test_the_region_of_interest_is_a_margin_away_from_the_outline(name):
    shape = windows.specimen(name)
    inside = windows.seen(shape, 2.5)
    np.testing.assert_allclose(signed_distance(inside.outline(), shape.outline()), 2.5, atol=0.02)
    assert inside.holes() == shape.holes()


def test_only_rims_of_holes_are_free(system):
    experiment = system.experiment
    levels = np.min(
        [hole.level(experiment.points[experiment.free_nodes]) for hole in windows.specimen("TTf").holes()], axis=0
    )
    np.testing.assert_allclose(levels, 1.0, atol=1e-6)


@pytest.mark.parametrize("inputs", ["I1", "I2", "I1I2"])
def test_forces_on_the_fine_basis_are_those_of_the_network(system, inputs):
    architecture = pann.Architecture(inputs, (4,), (0.2, 0.05), 0.3)
    theta = np.abs(np.random.default_rng(1).normal(size=architecture.n_parameters))
    basis = fine_basis(inputs, [system])
    force = predicted_test(system, basis)
    c, _ = coefficients_and_slopes(architecture, basis, theta)
    expected, _ = predict_forces(system, Model(architecture, theta))
    np.testing.assert_allclose(force.matrix @ c, (expected["right"] - expected["left"])[:, 0] / 2, rtol=1e-4)
    np.testing.assert_allclose(
        force.measured, 12.0 * (system.experiment.time * 0 + Affine().stretch - Affine().stretch ** -2)
    )


def test_r2_of_a_force_is_one_where_it_is_met_and_zero_at_its_mean(system):
    force = predicted_test(system, fine_basis("I1", [system]))
    c = np.linalg.lstsq(force.matrix, force.measured)[0]
    assert force.score(c) == pytest.approx(1.0)
    mean = np.linalg.lstsq(force.matrix, np.full(2, force.measured.mean()))[0]
    assert force.score(mean) == pytest.approx(0.0, abs=1e-9)


def test_uniaxial_tension_covers_one_angle_and_sets_cover_more_together():
    mesh = windows.camera_mesh("UT", 2.5, 200)
    strip = windows.observe(Affine(np.linspace(1.2, 4.0, 12)), mesh, "UT", {})
    found = coverage.states(window_equilibrium(strip, 0.0), 17.0)
    assert found.cells.any(axis=0).tolist() == [True, *5 * [False]]
    assert found.limits[0] == pytest.approx(4.0**2 + 2 / 4.0)
    other = ~found.cells
    assert coverage.coverage([found.cells, other]) == 1.0
    back = coverage.from_arrays(coverage.to_arrays({"UT": found}))["UT"]
    np.testing.assert_array_equal(back.cells, found.cells)


@pytest.mark.parametrize("mode", MODES)
def test_true_stresses(mode):
    """Arruda-Boyce as written for the accuracy of models; Carroll by hand in principal stretches."""
    stretch = stretches(mode, 17.0)
    F = stretches_to_gradient(mode, stretch)
    x, y = F[:, 0, 0], F[:, 1, 1]
    I1, I2 = x**2 + y**2 + 1 / (x * y) ** 2, (x * y) ** 2 + 1 / x**2 + 1 / y**2
    law = Carroll()
    first, second = law.a + 4 * law.b * I1**3, law.c / (2 * np.sqrt(I2))
    expected = 2 * (x - 1 / (x**3 * y**2)) * (first + second * y**2)
    np.testing.assert_allclose(true_stress("carroll", mode, 17.0), expected, atol=1e-10)
    slope = ArrudaBoyceTruth()(np.column_stack([I1, I2]))[:, 0]
    np.testing.assert_allclose(true_stress("arruda_boyce", mode, 17.0), 2 * (x - 1 / (x**3 * y**2)) * slope, atol=1e-10)


def test_ambiguity_is_half_the_width_of_the_band():
    results = results_of(lambda *keys: made_up(*keys, {}))
    same = [made_up("UT", "I1", (4, 4), {}) for _ in range(3)]
    assert results.ambiguity("arruda_boyce", same, "uniaxial") == 0
    apart = [made_up("UT", "I1", (4, 4), {}, factor) for factor in (0.9, 1.0, 1.1)]
    assert results.ambiguity("arruda_boyce", apart, "uniaxial") == pytest.approx(0.1)
    assert results.ambiguity("arruda_boyce", apart, "uniaxial", beyond="UT") == pytest.approx(0.1)
    wide = [made_up("UT", "I1", (4, 4), {}, width=0.2)]
    assert results.ambiguity("arruda_boyce", wide, "equibiaxial") == pytest.approx(0.2)
    assert results.error("arruda_boyce", apart[0], "pure_shear") == pytest.approx(0.1)


def verdicts(results):
    return {one.statement: one.verdict for one in judge(results, "arruda_boyce")}


def test_statements_are_refuted_by_a_model_that_is_always_right():
    """Where everything is predicted perfectly, coverage changes nothing, nothing fails, and no network is too small or large."""
    perfect = dict.fromkeys((*SHEETS, CROSS), 1.0)
    found = verdicts(results_of(lambda *keys: made_up(*keys, perfect)))
    refuted = {name for name, verdict in found.items() if verdict is ClaimVerdict.REFUTED}
    assert refuted == {
        GeneraliseStatement.RICH_COVERAGE_BETTER, GeneraliseStatement.RICH_COVERAGE_CLEARER, GeneraliseStatement.PS_ALONE, GeneraliseStatement.FEW_HOLES, GeneraliseStatement.SECOND_UNPHYSICAL,
        GeneraliseStatement.LARGE_OVERFIT, GeneraliseStatement.SMALL_LACK,
    }  # fmt: skip
    assert found[GeneraliseStatement.FIRST_SANE] is ClaimVerdict.CONFIRMED


def test_statements_are_confirmed_by_results_as_the_paper_has_them():
    def make(tests, inputs, layers):
        rich = SETS.index(tests) / len(SETS)
        on_ut = 0.3 if tests in ("PS", "TTa", "TTb") else 1.0
        others = {"UT+TTd": 1.0}.get(tests, 0.997) - 0.002 * (inputs != "I1I2") - 0.005 * (layers == (16, 16))
        scores = dict.fromkeys((*SHEETS, CROSS), others) | {"UT": min(on_ut, others)}
        factor = 3.5 if inputs == "I2" else 1.4 - 0.4 * rich
        return made_up(tests, inputs, layers, scores, factor, 0.3 - 0.2 * rich, 2.0 if layers == (1,) else 1.0)

    settings = SETTINGS
    results = results_of(make, settings)
    assert set(verdicts(results).values()) == {ClaimVerdict.CONFIRMED}


def test_a_part_of_the_sets_judges_nothing():
    few = replace(SETTINGS, sets=("UT", "PS"))
    assert set(verdicts(results_of(lambda *keys: made_up(*keys, {}), few)).values()) == {ClaimVerdict.NOT_STUDIED}
    assert set(statements.RULES_OF) == set(GeneraliseStatement)


def test_the_paper_has_180_calibrations_and_the_cross_makes_210():
    own = [tests for tests in SETS if CROSS not in tests]
    assert len(own) * 3 * len(SIZES) == 180
    assert len(SETS) * 3 * len(SIZES) == 210


def test_files_are_read_back(tmp_path):
    one = made_up("UT+PS", "I1I2", (4, 4), {"UT": 0.9})
    path = tmp_path / "case.json"
    path.write_text(json.dumps(calibrated_set.to_file([one])))
    assert calibrated_set.load(path) == [one]
    (tmp_path / "run.json").write_text(json.dumps({"settings": asdict(SETTINGS)}))
    assert GeneraliseSettings.read(tmp_path) == SETTINGS


def test_seeds_of_measured_sheets_are_refused(refused):
    refused("generalise", "--measured", "--seeds", "3", key="leave --seeds out")


def test_options():
    assert parsed("generalise", "--quick", "--seeds", "2")["seeds"] == 2
    assert GENERALISE.name == "generalise"
    assert len(list(GENERALISE.default.cases)) == 2 * 5 * 3


@pytest.mark.parametrize(
    ("changes", "is_reduced"),
    [({}, False), ({"seeds": (0,)}, True), ({"seeds": (0,), "truths": (MEASURED,)}, False)],
)
def test_a_run_with_the_seeds_of_the_default_is_no_reduced_one(tmp_path, changes, is_reduced):
    """Nor is one on measured tests, which have the noise that they have."""
    settings = replace(GeneraliseSettings(), sets=("UT",), inputs=("I1",), sizes=((1,),), as_width=False, **changes)
    results = SimpleNamespace(settings=settings, folder=tmp_path, inputs=list)
    write(results, Page("", "", [], settings.enough_seeds))
    assert ("A reduced run" in (tmp_path / "report.html").read_text()) == is_reduced
