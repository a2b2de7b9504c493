"""`equigap calibrate`: what it writes, what it says, and what it refuses."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from functools import cache

import jax
import numpy as np
import pytest
from synthetic import ArrudaBoyce, plate_experiment, with_noise

from calibrate.data.experiment import Experiment, LoadedBoundary, Noise
from calibrate.equations.basis import basis_for
from calibrate.equations.equilibrium import equilibrium
from calibrate.errors import ConfigError
from calibrate.fitting.calibration import Options, calibrate
from calibrate.models import pann
from calibrate.models.network_model import Model
from studies.cli import main
from studies.commands import calibrate as calibration
from studies.output.alerts import Severity
from studies.output.findings import Finding
from studies.reports.alert_table import merged
from studies.reports.calibration import figures as calibration_figures
from studies.reports.calibration import fit_review as reviews
from studies.reports.calibration import report, tables
from studies.reports.calibration.fit_findings import FitCode, findings, held_out
from studies.reports.headline import Reason

NOISE = Noise(0.01, 3.0, 1e-3, 1e-3)
FAST = ("--layers", "2", "--starts", "3")


@cache
def noisy(n_increments=5):
    return with_noise(plate_experiment(ArrudaBoyce(), n_increments=n_increments), NOISE, 1)


@cache
def view(known=True):
    experiment = noisy() if known else replace(noisy(), noise=None)
    return reviews.review(calibrate(experiment, Options(layers=(2,), starts=3)))


@pytest.fixture
def run(tmp_path, capsys, monkeypatch):
    """Run the command on an experiment: exit code, folder, what was printed. Draws one figure unless told."""

    def command(experiment, *words, folder="out", figures=("starts",)):
        monkeypatch.setattr(report, "FIGURES", {name: calibration_figures.FIGURES[name] for name in figures})
        path = tmp_path / "experiment.npz"
        if experiment is not None:
            experiment.save(path)
        code = main(["calibrate", str(path), "-o", str(tmp_path / folder), *FAST, *words])
        said = capsys.readouterr()
        return code, tmp_path / folder, said.out + said.err

    return command


# --- the command ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stated", [None, "estimated"])
def test_noise_that_nobody_stated_is_found_from_the_equations(run, stated):
    """Whatever an import took it for: here a hundredth."""
    little = replace(NOISE, displacement_std=1e-4)
    estimate = {"noise": {"displacement": "total", "total": {"std": 1e-4, "correlation_length": 3.0}}}
    changes = {"noise": None} if stated is None else {"noise": little, "provenance": estimate}
    code, folder, said = run(replace(noisy(), **changes))
    assert code == 0, said
    assert "N203" in said and "N201" not in said
    results = json.loads((folder / "report.json").read_text())["results"]
    assert 0.7 < results["reduced_chi_square"] < 1.4


def test_noise_that_is_stated_is_taken_as_stated(run):
    code, _, said = run(replace(noisy(), noise=NOISE.scaled(0.5)))
    assert code == 0 and "N203" not in said and "N206" in said


def test_stated_noise_is_that_of_the_whole_test_whatever_is_held_out(run, monkeypatch):
    """Its part of the pattern is that at the largest deformation, which may be held out."""
    stated, judged = replace(NOISE, pattern_std=0.02), []
    monkeypatch.setattr(calibration, "review", lambda *given: judged.append(given[1]) or reviews.review(*given))
    code, _, said = run(replace(noisy(), noise=stated), "--hold-out", "last:0.5")
    assert code == 0, said
    assert judged[0].noise == stated


def test_points_too_uneven_to_find_the_noise_are_no_obstacle(run):
    """Fields 1.4 distances of the points apart would be more than the points."""
    graded = plate_experiment(ArrudaBoyce(), n_increments=3, n_theta=96, n_radial=6)
    code, _, said = run(replace(with_noise(graded, NOISE, 1), noise=None))
    assert code == 0 and "N201" in said


def test_what_headline_and_numbers_both_say_is_told_once_and_as_severe():
    far = Finding("calibration", FitCode.FAR_ABOVE_NOISE, {"reduced_chi_square": 500.0, "loss_is_weighted": True})
    reason = Finding("headline", Reason.ABOVE_NOISE, {"reduced_chi_square": 500.0}, True)
    (one,) = merged([reason], [far])
    assert one.text == far.text and one.alert.severity is Severity.SERIOUS
    assert merged([reason], []) == [reason] and merged([], [far]) == [far]


def test_everything_is_written(run):
    shown = ("curves", "starts")  # each is drawn below
    code, folder, said = run(replace(noisy(), time=np.linspace(2, 10, 5)), figures=shown)
    assert code == 0, said
    model = Model.load(folder / "model.json")
    assert model.unit == "MPa"
    assert model.architecture.layers == (2,)
    assert all((folder / f"{name}.png").stat().st_size > 5000 for name in shown)
    assert (folder / "report.html").read_text().count("<figure>") == len(shown)
    manifest = json.loads((folder / "report.json").read_text())
    assert manifest["seed"] == 0
    assert manifest["results"]["unit"] == "MPa"
    assert set(manifest["outputs"]) == {"report.html", "model.json", "forces.csv", "curves.png", "starts.png"}
    points = manifest["results"]["curve_points"]
    assert all(p["low_95"] < p["stress"] < p["high_95"] for p in points)
    assert {p["calibrated"] for p in points} == {True, False}
    assert model.uncertainty.covariance.shape == (model.architecture.n_parameters,) * 2
    assert str(folder / "report.html") in said
    laws = manifest["results"]["classical_laws"]
    assert laws["verdict"] == "enough" and {law["reason"] for law in laws["laws"]} == {"converged"}
    chains = next(law for law in laws["laws"] if law["law"] == "Arruda-Boyce")
    assert chains["bic_difference"] < 0 and chains["stability"] > 0 and chains["held_out_force_error"] is None
    assert chains["force_error"] == pytest.approx(manifest["results"]["relative_force_error"], abs=2e-3)
    assert "cannot tell them apart" in said and "It is enough." in said
    lines = (folder / "forces.csv").read_text().splitlines()
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    measured = np.array([float(row["right_x_measured"]) for row in rows])
    assert measured == pytest.approx(noisy().loaded[1].force[:, 0])
    predicted = np.array([float(row["right_x_predicted"]) for row in rows])
    assert predicted == pytest.approx(measured, rel=0.05)
    assert [float(row["time"]) for row in rows] == pytest.approx(np.linspace(2, 10, 5))


def test_quick_takes_fewer_increments_and_starts_and_without_thickness_the_unit_is_another(run):
    code, folder, said = run(replace(noisy(9), thickness=None), "--quick")
    assert code == 0
    results = json.loads((folder / "report.json").read_text())["results"]
    assert results["options"]["starts"] == 3
    assert f"{calibration.QUICK_PICTURES} increments" in said
    assert Model.load(folder / "model.json").unit == "N/mm" and "N/mm" in said


# --- held-out increments --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("choice", "held"),
    [("last", 2), ("last:0.5", 2), ("random:0.4", 2), ("last:0.01", 1), ("random:0.99", 4)],
)
def test_hold_out_leaves_increments_on_both_sides(choice, held):
    fitted = calibration.held_in(noisy(), choice, 0)
    assert (~fitted).sum() == held
    if choice.startswith("last"):
        assert fitted[:-held].all()
    assert np.array_equal(fitted, calibration.held_in(noisy(), choice, 0))


@pytest.mark.parametrize("choice", ["first", "last:2", "last:x", "random:0", "last:nan", "half:left"])
def test_hold_out_is_checked(choice):
    with pytest.raises(ConfigError, match="--hold-out"):
        calibration.held_in(noisy(), choice, 0)


def test_hold_out_needs_two_increments():
    with pytest.raises(ConfigError, match="at least 2"):
        calibration.held_in(noisy().select([0]), "last", 0)


def test_held_out_increments_do_not_touch_the_model(run):
    """Spoiling the held-out forces changes their score and nothing else."""
    spoiled = tuple(LoadedBoundary(b.name, b.nodes, b.force.copy()) for b in noisy().loaded)
    for b in spoiled:
        b.force[-2:] *= 1.2
    _, first, _ = run(noisy(), "--hold-out", "last:0.4", folder="first")
    _, second, _ = run(replace(noisy(), loaded=spoiled), "--hold-out", "last:0.4", folder="second")
    models = [Model.load(folder / "model.json") for folder in (first, second)]
    assert np.array_equal(models[0].parameters, models[1].parameters)
    results = [json.loads((folder / "report.json").read_text())["results"] for folder in (first, second)]
    errors = [r["held_out"]["relative_force_error"] for r in results]
    assert errors[0] < 0.05
    assert errors[1] == pytest.approx(1 - 1 / 1.2, abs=0.05)
    assert results[0]["held_out"]["increments"] == 2
    assert results[1]["held_out"]["chi_square_per_equation"] > 2 * results[0]["held_out"]["chi_square_per_equation"]


@pytest.mark.parametrize(("forces", "equilibrium"), [(1.0, 4.0), (1.3, 1.0), (1.0, 1.0)])
def test_held_out_increments_are_judged_by_forces_and_by_equilibrium(forces, equilibrium):
    """What is said to be worse is what is worse: forces may be predicted where equilibrium inside is not, and the other way round."""
    fitted = np.arange(noisy().n_increments) < 4
    scaled = {name: np.where(fitted[:, None], f, forces * f) for name, f in view().forces.items()}
    found = held_out(replace(view(), fitted=fitted, forces=scaled, chi_square=np.where(fitted, 1.0, equilibrium)))
    assert found.data["forces_worse"] == (forces != 1)
    assert found.data["equilibrium_worse"] == (equilibrium != 1)
    assert found.data["fitted_chi_square"] == 1.0


# --- refusals -------------------------------------------------------------------------------------------------


def test_unknown_option_in_a_config_names_the_nearest(run, tmp_path):
    config = tmp_path / "options.toml"
    config.write_text("layer = [4, 4]\n")
    code, folder, said = run(noisy(), "--config", str(config))
    assert code == 2
    assert "'layer'" in said and "layers?" in said
    assert not folder.exists()


def test_config_is_read_and_the_command_line_wins(run, tmp_path):
    config = tmp_path / "options.toml"
    config.write_text('layers = [4, 4]\nspacing = 14.0\nhold_out = "last"\n')
    code, folder, said = run(noisy(), "--config", str(config))
    assert code == 0, said
    results = json.loads((folder / "report.json").read_text())["results"]
    assert results["options"]["layers"] == [2]
    assert results["options"]["spacing"] == 14.0
    assert results["held_out"]["increments"] == 2


@pytest.mark.parametrize(
    ("words", "key"),
    [
        (("--layers", "4;4"), "4;4"),
        (("--layers", "0"), "layers"),
        (("--inputs", "I3"), "I3"),
        (("--spacing", "-3"), "--spacing"),
        (("--hold-out", "first"), "--hold-out"),
        (("--los", "paper"), "--loss?"),
        (("--scaling", "dependent"), "give loss 'paper' too"),
    ],
)
def test_bad_options_end_in_one_line(run, words, key):
    code, folder, said = run(noisy(), *words)
    assert code == 2
    assert key in said
    assert len(said.strip().splitlines()) == 1
    assert not folder.exists()


def test_missing_and_wrong_files(run, tmp_path):
    for content in (None, "not an archive"):
        if content:
            (tmp_path / "experiment.npz").write_text(content)
        code, folder, said = run(None)
        assert code == 2 and "experiment.npz" in said
        assert not folder.exists()


def test_nothing_is_overwritten_silently(run):
    code, folder, _ = run(noisy())
    before = (folder / "model.json").read_bytes()
    code, _, said = run(noisy(), "--spacing", "14")
    assert code == 2
    assert "--overwrite" in said
    assert (folder / "model.json").read_bytes() == before
    code, _, _ = run(noisy(), "--spacing", "14", "--overwrite")
    assert code == 0
    assert json.loads((folder / "report.json").read_text())["results"]["options"]["spacing"] == 14.0
    assert (folder / "model.json").read_bytes() != before


def test_the_same_command_in_a_complete_folder_computes_nothing(run, monkeypatch):
    _, folder, first = run(noisy())
    monkeypatch.setattr("studies.commands.calibrate.fit_network", lambda *given: pytest.fail("fitted again"))
    code, _, said = run(noisy())
    assert code == 0
    assert f"{folder} is complete; --overwrite makes it again" in said
    assert first.splitlines()[-1] in said


def test_a_run_is_known_by_what_it_reads_wherever_it_is_called_from(run, monkeypatch, tmp_path):
    run(noisy())
    monkeypatch.setattr("studies.commands.calibrate.fit_network", lambda *given: pytest.fail("fitted again"))
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", "experiment.npz", "-o", "out", *FAST]) == 0


# --- the numbers behind the report ----------------------------------------------------------------------------


@pytest.mark.parametrize("inputs", ["I1", "I2", "I1I2"])
def test_coefficients_stand_for_the_model(inputs):
    system = equilibrium(plate_experiment(), 12.0)
    F = system.deformation_gradients
    basis = basis_for(inputs, F.reshape(-1, 2, 2))
    scales = tuple(1 / np.nan_to_num(basis.site_inputs, nan=1.0).max(axis=0))
    architecture = pann.Architecture(inputs, (4, 4), scales)
    model = Model(architecture, np.asarray(architecture.random_start(jax.random.key(0))))
    by_basis = system.matrix(basis, F[-1]) @ reviews.coefficients(model, basis)
    by_model = system.internal_forces(model.nominal_stress(F[-1]))
    assert by_basis == pytest.approx(by_model, abs=2e-3 * np.abs(by_model).max())


def test_chi_square_is_one_where_the_noise_is_stated_right():
    assert view().calibration.reduced_chi_square == pytest.approx(1, abs=0.35)
    assert view().chi_square.mean() == pytest.approx(1, abs=0.35)
    assert findings(view())[0].code is FitCode.AS_NOISE


def test_chi_square_of_the_review_is_that_of_the_fit():
    """The review weighs with the final model, the fit with the one before: nearly the same."""
    fit = view().calibration
    rows = np.isfinite(view().residuals).sum()
    assert view().chi_square.mean() * rows == pytest.approx(fit.loss, rel=0.05)


def test_underestimated_noise_is_said():
    experiment = replace(noisy(), noise=Noise(NOISE.displacement_std / 5, 3.0, 2e-4, 2e-4))
    found = reviews.review(calibrate(experiment, Options(layers=(2,), starts=3)))
    assert found.calibration.reduced_chi_square > 10
    assert findings(found)[0].code is FitCode.FAR_ABOVE_NOISE


def test_unknown_noise_is_said():
    assert view(False).chi_square is None
    assert findings(view(False))[0].code is FitCode.NOISE_UNKNOWN
    assert len(tables.force_table(view(False))[0]) == len(tables.force_table(view())[0]) - 1


def test_force_table_is_the_error_of_the_forces():
    columns, rows = tables.force_table(view())
    assert [row[:2] for row in rows] == [["left", "x"], ["left", "y"], ["right", "x"], ["right", "y"]]
    error = view().forces["left"][:, 0] - view().measured["left"][:, 0]
    assert rows[0][columns.index("rms error, N")] == pytest.approx(np.sqrt(np.mean(error**2)))
    assert rows[0][columns.index("expected from noise, N")] == pytest.approx(
        np.sqrt(np.mean(view().force_deviation("left", 0) ** 2))
    )


def test_largest_stretch_ends_the_calibrated_range():
    model, top = view().model, view().model.calibrated_range["I1"][1]
    stretch = model.largest_stretch("uniaxial")
    assert stretch**2 + 2 / stretch == pytest.approx(top, rel=2e-3)
    assert model.largest_stretch("equibiaxial") < stretch


def test_initial_modulus_is_that_of_the_material():
    slope = 2 * sum(k * c / 21.49 ** (k - 1) * 3 ** (k - 1) for k, c in enumerate((1 / 2, 1 / 20, 11 / 1050), 1))
    assert reviews.initial_shear_modulus(view().model) == pytest.approx(0.2698 * slope, rel=0.05)


# --- figures --------------------------------------------------------------------------------------------------


def one_component(experiment: Experiment) -> Experiment:
    """Only the x-forces are known, and the left grip has none."""
    loaded = []
    for b in experiment.loaded:
        force = b.force.copy()
        force[:, 1] = np.nan
        if b.name == "left":
            force[:] = np.nan
        loaded.append(LoadedBoundary(b.name, b.nodes, force))
    return replace(experiment, loaded=tuple(loaded))


@pytest.mark.parametrize("name", list(calibration_figures.FIGURES))
@pytest.mark.parametrize("known", [True, False])
def test_every_figure_draws_whatever_is_known(name, known, tmp_path):
    draw = calibration_figures.FIGURES[name]
    draw(view(known)).savefig(tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 3000


def test_figures_of_a_poor_record(tmp_path):
    """One increment, one force component on one side, no thickness."""
    experiment = replace(one_component(noisy()), thickness=None).select([4])
    found = reviews.review(calibrate(experiment, Options(layers=(2,), starts=3)))
    for name, draw in calibration_figures.FIGURES.items():
        draw(found).savefig(tmp_path / f"{name}.png")
    assert [row[:2] for row in tables.force_table(found)[1]] == [["right", "x"]]


def test_residual_map_points_at_the_fault():
    """A force that is 5 % off shows up at its edge, far above the noise."""
    loaded = tuple(replace(b, force=b.force * (1.05 if b.name == "right" else 1)) for b in noisy().loaded)
    found = reviews.review(calibrate(replace(noisy(), loaded=loaded), Options(layers=(2,), starts=3)))
    white = np.abs(found.residuals / found.deviations).mean(axis=0)
    rows = {found.row("left", 0), found.row("right", 0)}
    assert int(np.argmax(white)) in rows
