"""Polish: parameters to their stated uncertainty on another mesh, exact data stay, latent grips, held-out data judge, failures are named."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import chi2

from calibrate.data.experiment import Experiment, Noise
from calibrate.errors import ConfigError
from calibrate.fitting.calibration import Calibration, Options, calibrate
from calibrate.fitting.stopping import Stop
from calibrate.models.classical_laws import CLASSICAL_LAWS
from calibrate.models.network_model import Model
from forward.loading import Loading
from forward.materials import ArrudaBoyce
from forward.sheet.plane_stress import solve
from meshes import quads, triangles
from meshes.known_specimens import SPECIMENS
from studies import cli
from studies.accuracy.metrics import ArrudaBoyceTruth, agreement
from studies.polish import polished_calibration, polishing
from studies.polish.polished_calibration import polished
from studies.polish.polishing import Polished, polish
from studies.polish.replay_equations import Equations, ReplayedTest
from studies.polish.varied_law import FittedLaw
from studies.reports.calibration.polish_record import Kept
from studies.synthetic import camera

PLATE = SPECIMENS["plate_with_hole"]()
LAW = next(law for law in CLASSICAL_LAWS if law.name == "Arruda-Boyce")
TRUE = np.array([ArrudaBoyce().mu, 1 / ArrudaBoyce().N])
TOPS = (3.0, 3.0)
DEVICE = camera.Camera(camera.GaussianField(4.0, 256), relative_noise=2e-4, length_scale=200.0, force_noise=1e-3)
SEEDS = range(5)


@cache
def clean(nodes: int = 250, pull: float = 20.0) -> Experiment:
    """A plate with a hole of biquadratic quads of its own, seen without noise."""
    solution = solve(quads(PLATE, quarter=True), ArrudaBoyce(), Loading.clamped(PLATE.loaded, pull), 3).mirrored()
    return camera.observe(solution, triangles(PLATE, n_nodes=nodes), name="plate")


@cache
def noisy(seed: int) -> Experiment:
    return camera.record(clean(), DEVICE, seed)


def law(parameters: np.ndarray = TRUE) -> FittedLaw:
    return FittedLaw(LAW, np.asarray(parameters), TOPS, (0,))


@cache
def equations(seed: int) -> tuple[ReplayedTest, Equations]:
    """About the true law, with the motion of the grips as measured."""
    test = ReplayedTest(noisy(seed))
    return test, test.linearised(test.start(law()))


def squared_pull(found: Equations) -> float:
    """Squared distance of the best parameters from the true ones, by their own covariance."""
    G, residual = found.rows
    step = np.linalg.lstsq(G, residual)[0]
    return float((G @ step) @ (G @ step))


def test_parameters_of_a_law_are_met_to_their_uncertainty_on_another_mesh():
    start, squares = law(TRUE * [1.05, 0.8]), []
    for seed in SEEDS[:3]:
        found = polish(ReplayedTest(noisy(seed)), start)
        assert found.reason is Stop.CONVERGED
        G, _ = found.after.rows
        off = G @ (found.after.point.law.coefficients - TRUE)
        squares.append(float(off @ off))
    assert sum(squares) < chi2.ppf(0.999, 2 * len(squares))


def test_grips_that_are_noisy_do_not_bias():
    """By the covariance with latent grips, errors are as stated; with the grips as measured they are many times that."""
    latent, exact = [], []
    for seed in SEEDS:
        test, found = equations(seed)
        weights = test.weights(np.zeros_like(found.held), np.isfinite(found.residual))
        latent.append(squared_pull(found))
        exact.append(squared_pull(replace(found, weights=weights)))
    low, high = chi2.ppf([0.001, 0.999], 2 * len(latent))
    assert low < sum(latent) < high
    assert sum(exact) > 3 * high


def test_the_residual_is_chi_square_at_the_true_law():
    found = [equations(seed)[1] for seed in SEEDS]
    low, high = chi2.ppf([0.001, 0.999], sum(one.weights.size for one in found))
    assert low < sum(one.chi_square for one in found) < high


def test_a_reading_of_both_sides_by_one_cell_counts_once():
    """The camera reads left and right by one cell: what the left says once the right is known is nothing."""
    both = noisy(0)
    left = next(i for i, b in enumerate(both.loaded) if b.name == "left")
    forces = [b.force for b in both.loaded]

    def information(force: np.ndarray) -> np.ndarray:
        loaded = tuple(replace(b, force=force if i == left else forces[i]) for i, b in enumerate(both.loaded))
        test = ReplayedTest(replace(both, loaded=loaded))
        G, _ = test.linearised(test.start(law())).rows
        return G.T @ G

    one_cell, unread = information(forces[left]), information(np.full_like(forces[left], np.nan))
    assert np.allclose(one_cell, unread, rtol=1e-6)
    two_cells = information(forces[left] * [[1.001, 1.0], [0.999, 1.0], [1.0005, 1.0]])
    assert two_cells[0, 0] > 1.1 * one_cell[0, 0]


def test_exact_data_move_the_true_law_by_less_than_noise_does():
    exact = replace(clean(), noise=noisy(0).noise)
    found = polish(ReplayedTest(exact), law())
    G, _ = found.after.rows
    step = G @ (found.after.point.law.coefficients - TRUE)
    assert float(step @ step) < 0.3**2  # standard deviations: what the discretisation does


def test_the_motion_of_the_grips_is_estimated_better_than_measured():
    test, found = equations(0)
    point = test.moved(found, law())
    held = test.boundary.held[: len(clean().points)].any(axis=1)
    true = clean().displacements[:, held]
    before, after = (np.sqrt(((d[:, held] - true) ** 2).mean()) for d in (noisy(0).displacements, point.motion))
    assert after < 0.95 * before
    assert point.objective == pytest.approx(found.chi_square, rel=0.02)  # the latent motion is eliminated


def test_noise_in_common_enters_the_weights():
    common = camera.record(clean(), replace(DEVICE, reference_noise=4e-4), 1)
    found = (test := ReplayedTest(common)).linearised(test.start(law()))
    low, high = chi2.ppf([0.001, 0.999], found.weights.size)
    assert low < found.chi_square < high
    ignored = replace(common, noise=noisy(0).noise)
    alone = ReplayedTest(ignored)
    assert alone.linearised(alone.start(law())).chi_square > high


@cache
def calibration(seed: int = 0):
    return calibrate(noisy(seed), Options(layers=(4,), starts=3))


@pytest.mark.slow
def test_a_polish_removes_what_the_triangles_of_the_camera_do_to_a_network():
    """Data without noise, weighted as if there were some."""
    exact = calibrate(replace(clean(), noise=noisy(0).noise), Options(layers=(4,), starts=8))
    found, record = polished(exact)
    limit = found.model.calibrated_range["I1"][1]
    before, after = (
        max(abs(s.bias) for s in agreement(m, ArrudaBoyceTruth(), limit)) for m in (exact.model, found.model)
    )
    assert record.kept is Kept.POLISHED
    assert after < 0.3 * before
    assert (found.model.parameters[found.model.architecture.nonnegative] >= 0).all()
    assert found.model.uncertainty is not None
    assert found.model.uncertainty.factor.shape == exact.model.uncertainty.factor.shape


def stiffer_model(start: Calibration) -> Calibration:
    """By 10 %."""
    architecture = replace(start.model.architecture, energy_scale=1.1 * start.model.architecture.energy_scale)
    return replace(start, model=replace(start.model, architecture=architecture))


def test_what_makes_held_out_data_worse_is_not_kept():
    """The held-out increments are of a material that is 10 % stiffer, as the unpolished model is."""
    held = noisy(1)
    stiffer = replace(held, loaded=tuple(replace(b, force=1.1 * b.force) for b in held.loaded))
    stiff = stiffer_model(calibration())
    found, record = polished(stiff, stiffer)
    assert record.kept is Kept.WORSE
    assert found.model is stiff.model
    same, kept = polished(stiff, held)
    assert kept.kept is Kept.POLISHED
    assert same.model is not stiff.model


def test_the_same_residual_by_looser_weights_is_no_gain():
    start = calibration()
    test = ReplayedTest(start.experiment)
    before = test.linearised(test.start(polished_calibration._law(start)))
    louder = ReplayedTest(replace(start.experiment, noise=start.experiment.noise.scaled(2)), test.observed)
    loose = replace(before, weights=louder.weights(before.held, np.isfinite(before.residual)))
    assert loose.chi_square < 0.9 * before.chi_square
    record = polished_calibration._judged(start, test, Polished(before, loose, Stop.CONVERGED, 1), None)
    assert record.kept is Kept.NO_GAIN


def test_a_model_that_cannot_be_solved_is_named():
    start = calibration()
    limp = replace(start, model=replace(start.model, parameters=np.zeros_like(start.model.parameters)))
    found, record = polished(limp)
    assert record.kept is Kept.NO_EQUILIBRIUM
    assert "no stiffness" in record.detail
    assert found.model is limp.model


def test_a_polish_that_does_not_converge_is_not_kept(monkeypatch):
    monkeypatch.setattr(polishing, "ITERATIONS", 1)
    stiff = stiffer_model(calibration())
    found, record = polished(stiff)
    assert record.kept is Kept.NOT_CONVERGED
    assert record.detail == str(Stop.ITERATION_LIMIT)
    assert found.model is stiff.model


def test_what_cannot_be_polished_is_refused():
    start = calibration()
    for changed, word in (
        (replace(start, experiment=replace(noisy(0), plane="strain")), "plane stress"),
        (replace(start, options=replace(start.options, loss="paper")), "--loss weighted"),
        (replace(start, experiment=replace(noisy(0), provenance={"rim": True})), "section"),
    ):
        with pytest.raises(ConfigError, match=word):
            polished(changed)


def test_the_command_writes_the_polished_model(tmp_path, capsys):
    noisy(0).save(tmp_path / "plate.npz")
    words = [
        "calibrate",
        str(tmp_path / "plate.npz"),
        "--polish",
        "--layers",
        "4",
        "--starts",
        "3",
        "-o",
        str(tmp_path / "out"),
    ]
    assert cli.main([*words, "--hold-out", "every:3"]) == 0
    told = capsys.readouterr().out
    assert "Polished on the test" in told
    model = Model.load(tmp_path / "out" / "model.json")
    assert model.fit["polish"]["held_after"]["chi_square"] <= model.fit["polish"]["held_before"]["chi_square"]
    manifest = json.loads((tmp_path / "out" / "report.json").read_text())
    assert manifest["results"]["polish"]["kept"] == "polished"
    assert "chi-square of the replay per equation" in (tmp_path / "out" / "report.html").read_text()
    assert Noise(0.04, 4.0, 1e-3 / np.sqrt(3)) == noisy(0).noise
