"""Curves of a network with a bulk modulus: least energy in three dimensions, and the standard deviation by differences."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from skip_network import MU, neo_hooke

from calibrate.equations.deformation_modes import MODES
from calibrate.errors import ConfigError
from calibrate.models.compressible_sheet import compressible_deviation, compressible_sheet, sheet_stress
from calibrate.models.parameter_covariance import Uncertainty
from studies.reports.prediction.predicted_curves import findings, predict

KAPPA, STRETCH = 2.0, np.array([0.7, 1.0, 1.3, 2.0])
MODEL = replace(neo_hooke(), bulk_modulus=KAPPA)


def least_energy(mode: str, x: float) -> float:
    """Of mu / 2 (J^(-2/3) I1 - 3) + kappa / 2 (J - 1)^2 over the stretches that are free: the thickness, in a uniaxial test the width."""

    def energy(free):
        width = {"uniaxial": free[-1], "equibiaxial": x, "pure_shear": 1.0}[mode]
        J = x * width * free[0]
        return MU / 2 * (J ** (-2 / 3) * (x**2 + width**2 + free[0] ** 2) - 3) + KAPPA / 2 * (J - 1) ** 2

    start = np.full(2 if mode == "uniaxial" else 1, x**-0.5)
    return float(minimize(energy, start, method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-16}).fun)


@pytest.mark.parametrize("mode", MODES)
def test_the_stress_is_the_slope_of_the_least_energy(mode):
    h, pulls = 1e-3, 2 if mode == "equibiaxial" else 1
    expected = [(least_energy(mode, x + h) - least_energy(mode, x - h)) / (2 * h * pulls) for x in STRETCH]
    np.testing.assert_allclose(compressible_sheet(MODEL, mode, STRETCH).stress, expected, atol=2e-5)
    stiff = replace(MODEL, bulk_modulus=1e7)
    np.testing.assert_allclose(
        compressible_sheet(stiff, mode, STRETCH).stress, MODEL.homogeneous(mode, STRETCH), atol=1e-6
    )


@pytest.mark.parametrize("mode", MODES)
def test_the_deviation_is_that_of_modulus_and_bulk_modulus(mode):
    factor, std, h = np.zeros((4, 1)), 0.002, 1e-4
    factor[-1] = std
    known = replace(MODEL, uncertainty=Uncertainty(factor, 1.0, 1.0, True), bulk_modulus_deviation=0.1)

    def stress(skip=0.0, kappa=0.0):
        parameters = MODEL.parameters.copy()
        parameters[-1] += skip
        return compressible_sheet(
            replace(MODEL, parameters=parameters, bulk_modulus=KAPPA + kappa), mode, STRETCH
        ).stress

    by_skip, by_kappa = (stress(skip=h) - stress(skip=-h)) / (2 * h), (stress(kappa=h) - stress(kappa=-h)) / (2 * h)
    expected = np.hypot(std * by_skip, 0.1 * by_kappa)
    np.testing.assert_allclose(compressible_deviation(known, mode, STRETCH), expected, rtol=1e-5, atol=1e-9)
    assert compressible_deviation(MODEL, mode, STRETCH) is None


def test_a_network_without_a_bulk_modulus_has_no_compressible_curves():
    with pytest.raises(ConfigError, match="no bulk modulus; draw its curves at constant volume"):
        compressible_sheet(neo_hooke(), "uniaxial", STRETCH)


def test_predicted_curves_are_those_of_the_compressible_sheet():
    """A bulk modulus of some seven shear moduli softens the curves by more than 5 %; the reader is told."""
    curves = predict(MODEL, 2.0, 11)
    for curve in curves:
        np.testing.assert_array_equal(curve.stress, compressible_sheet(MODEL, curve.mode, curve.stretch).stress)
        assert (curve.stress[1:] < 0.95 * MODEL.homogeneous(curve.mode, curve.stretch)[1:]).all()
    assert "bulk modulus (2 MPa)" in next(f.text for f in findings(MODEL, curves) if f.alert.code == "P518")


def test_a_sheet_has_the_volume_change_of_its_model():
    for mode in MODES:
        np.testing.assert_array_equal(
            sheet_stress(MODEL, mode, STRETCH), compressible_sheet(MODEL, mode, STRETCH).stress
        )
        np.testing.assert_array_equal(sheet_stress(neo_hooke(), mode, STRETCH), neo_hooke().homogeneous(mode, STRETCH))
