"""From an Experiment to a model: accuracy, invariance, units, options."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import synthetic
from synthetic import ArrudaBoyce, moved, plate_experiment, renumbered, with_noise

from calibrate import errors
from calibrate.data.experiment import Noise
from calibrate.equations import kinematics
from calibrate.equations.deformation_modes import stretches_to_gradient
from calibrate.fitting.calibrated_range import calibrated_range
from calibrate.fitting.calibration import Options, calibrate, predict_forces, relative_force_error
from calibrate.fitting.stopping import Stop

# an absolute force noise and an isotropic displacement noise: the same in every frame
NOISE = Noise(0.01, 2.5, force_std=0.005)
OPTIONS = Options(layers=(2, 2), starts=6, spacing=12.0)


@cache
def clean():
    return calibrate(plate_experiment(), OPTIONS)


@cache
def noisy():
    return calibrate(with_noise(plate_experiment(), NOISE, 0), OPTIONS)


def homogeneous_error(calibration, energy, factor=1.0):
    """Largest relative error of the mean stress over the three homogeneous modes within the calibrated range."""
    top = calibration.model.calibrated_range["I1"][1]
    found = []
    for mode in ("uniaxial", "equibiaxial", "pure_shear"):
        stretch = np.linspace(1.0, 3.0, 400)
        F = stretches_to_gradient(mode, stretch)
        F = F[(np.asarray(kinematics.invariants_and_derivatives(F)[0])[:, 0] <= top)]
        expected = factor * np.asarray(kinematics.nominal_stress(energy, F))[:, 0, 0]
        found.append(abs(calibration.model.nominal_stress(F)[:, 0, 0].sum() / expected.sum() - 1))
    return max(found)


def test_clean_data_give_the_material():
    calibration = clean()
    assert homogeneous_error(calibration, ArrudaBoyce()) < 0.003
    assert relative_force_error(calibration.predicted_forces, calibration.measured_forces) < 1e-3
    assert np.isnan(calibration.reduced_chi_square)
    assert calibration.model.unit == "MPa"


def test_noisy_data_give_the_material_and_a_chi_square_of_one():
    calibration = noisy()
    assert homogeneous_error(calibration, ArrudaBoyce()) < 0.01
    rows = calibration.imbalance[0].size * len(calibration.imbalance)
    assert abs(calibration.reduced_chi_square - 1) < 5 * np.sqrt(2 / rows)


def test_weights_of_a_fit_are_not_negative():
    for calibration in (clean(), noisy()):
        model = calibration.model
        assert (model.parameters[model.architecture.nonnegative] >= 0).all()


@pytest.mark.parametrize("change", [moved, renumbered], ids=["rigid motion", "renumbering"])
def test_calibration_ignores_rigid_motion_and_numbering(change):
    """Losses agree to 1e-6; the convex spline, a global optimum, gives the same stress."""
    before = noisy()
    after = calibrate(change(before.experiment), OPTIONS)
    assert after.loss == pytest.approx(before.loss, rel=1e-6)
    stretch = np.linspace(1.05, 2.2, 20)
    for mode in ("uniaxial", "equibiaxial", "pure_shear"):
        one, other = (c.model.homogeneous(mode, stretch) for c in (before, after))
        np.testing.assert_allclose(other, one, rtol=2e-3)


def test_unknown_thickness_identifies_stiffness_times_thickness():
    """A plate of 2 mm: forces double. Without the thickness the model carries the factor 2 and says N/mm."""
    thin = plate_experiment()
    loaded = tuple(replace(b, force=2 * b.force) for b in thin.loaded)
    known = calibrate(replace(thin, thickness=2.0, loaded=loaded), OPTIONS)
    unknown = calibrate(replace(thin, thickness=None, loaded=loaded), OPTIONS)
    assert (known.model.unit, unknown.model.unit) == ("MPa", "N/mm")
    assert homogeneous_error(known, ArrudaBoyce()) < 0.003
    assert homogeneous_error(unknown, ArrudaBoyce(), factor=2.0) < 0.003


def test_paper_loss_on_clean_data():
    calibration = calibrate(plate_experiment(linear=True), replace(OPTIONS, loss="paper"))
    assert homogeneous_error(calibration, ArrudaBoyce()) < 0.003
    assert np.isnan(calibration.reduced_chi_square)


def test_dependent_scaling_runs_slsqp_on_the_full_data():
    options = replace(OPTIONS, loss="paper", scaling="dependent", layers=(1,), starts=1)
    calibration = calibrate(plate_experiment(n_increments=1, n_theta=24, n_radial=4, linear=True), options)
    assert calibration.spline is None
    assert len(calibration.losses) == 1
    assert (calibration.model.parameters[calibration.model.architecture.nonnegative] >= 0).all()


def test_calibrated_range_is_an_area_weighted_quantile():
    system = clean().system
    values = np.asarray(kinematics.invariants_and_derivatives(system.deformation_gradients)[0])[..., 0]
    low, high = calibrated_range(system, quantile=0.9)["I1"]
    share = np.mean((values <= high) @ system.areas) / system.areas.sum()
    assert low == 3.0
    assert share == pytest.approx(0.9, abs=0.01)
    assert calibrated_range(system, quantile=1.0)["I1"][1] == pytest.approx(values.max())


def test_predicted_forces_and_residuals_belong_together():
    calibration = clean()
    forces, residuals = predict_forces(calibration.system, calibration.model)
    fields = calibration.system.fields
    for column in np.flatnonzero(fields.boundary >= 0):
        boundary = calibration.experiment.loaded[fields.boundary[column]]
        error = residuals[:, [column, fields.n_fields + column]]
        np.testing.assert_allclose(forces[boundary.name] - boundary.force, error, atol=1e-12)
    np.testing.assert_allclose(residuals.reshape(len(residuals), 2, -1), calibration.imbalance, atol=1e-12)


def test_unmeasured_force_components_are_left_out():
    plate = plate_experiment()
    forces = [plate.loaded[0].force * [1.0, np.nan], plate.loaded[1].force * np.nan]
    half = replace(plate, loaded=tuple(replace(b, force=f) for b, f in zip(plate.loaded, forces, strict=True)))
    calibration = calibrate(half, OPTIONS)
    assert homogeneous_error(calibration, ArrudaBoyce()) < 0.003
    assert np.isfinite(calibration.summary()["relative_force_error"])


def test_progress_and_summary():
    calls = []
    plate = synthetic.plate_experiment()
    calibration = calibrate(plate, OPTIONS, lambda done, total: calls.append((done, total)))
    assert calls == [(i + 1, plate.n_increments) for i in range(plate.n_increments)]
    summary = calibration.summary()
    assert summary["options"]["inputs"] == "I1"
    assert summary["reduced_chi_square"] is None
    assert summary["losses_of_starts"] == sorted(summary["losses_of_starts"])
    assert calibration.reason in tuple(Stop)


def test_reversed_forces_are_refused():
    plate = plate_experiment()
    with pytest.raises(errors.ForceSignError):
        calibrate(replace(plate, loaded=tuple(replace(b, force=-b.force) for b in plate.loaded)), OPTIONS)


@pytest.mark.parametrize(
    "option",
    [
        {"inputs": "I3"},
        {"layers": ()},
        {"layers": (4, -1)},
        {"loss": "papier"},
        {"scaling": "thawed"},
        {"spacing": 0.0},
        {"spacing": float("nan")},
        {"starts": 0},
        {"passes": 0},
    ],
    ids=str,
)
def test_impossible_options_are_refused(option):
    with pytest.raises(errors.ConfigError):
        Options(**option)
