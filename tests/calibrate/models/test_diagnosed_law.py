"""Curves of the material that a diagnosis found, against closed forms and quadrature that share no code with it."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from diagnosed_materials import MU, STRETCH, found
from scipy.optimize import brentq, minimize
from viscous_states import nominal_stress

from calibrate.effects import FORMS
from calibrate.effects.chain import Addition
from calibrate.equations.basis import PlaneStrainBasis
from calibrate.equations.deformation_modes import MODES
from calibrate.errors import FitError
from calibrate.models.diagnosed_law import DiagnosedLaw
from studies import cli
from studies.reports.prediction.predicted_curves import predict


@pytest.mark.parametrize("mode", MODES)
def test_without_effects_it_is_the_closed_form_of_the_base(mode):
    power = {"uniaxial": -2, "equibiaxial": -5, "pure_shear": -3}[mode]
    law = DiagnosedLaw(found())
    assert law.directions == ("",)
    np.testing.assert_allclose(
        law.homogeneous(mode, STRETCH)[1], MU * (STRETCH - STRETCH**power), rtol=1e-9, atol=1e-12
    )


@pytest.mark.parametrize("mode", MODES)
def test_a_second_invariant_is_that_of_mooney_and_rivlin(mode):
    c01, x = 0.05, STRETCH
    b = x ** {"uniaxial": -0.5, "equibiaxial": 1.0, "pure_shear": 0.0}[mode]
    c = 1 / (x * b)
    along = MU * x + 2 * c01 * x * (
        b**2 + c**2
    )  # d psi / d stretch at a fixed lateral one, less the pressure that frees the faces
    free = MU * c + 2 * c01 * c * (x**2 + b**2)
    P = DiagnosedLaw(found(("second invariant", (c01,), ()))).homogeneous(mode, x)[1]
    np.testing.assert_allclose(P, along - free * c / x, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("mode", MODES)
def test_its_logarithm_is_that_of_gent_and_thomas(mode):
    """psi = mu / 2 (I1 - 3) + c2 ln(I2 / 3): at every stretch that of Mooney and Rivlin with c01 = c2 / I2."""
    c2, x = 0.2, STRETCH[1:]
    b = x ** {"uniaxial": -0.5, "equibiaxial": 1.0, "pure_shear": 0.0}[mode]
    c = 1 / (x * b)
    c01 = c2 / (x**2 * b**2 + b**2 * c**2 + c**2 * x**2)
    along, free = MU * x + 2 * c01 * x * (b**2 + c**2), MU * c + 2 * c01 * c * (x**2 + b**2)
    plain = found()
    law = DiagnosedLaw(replace(plain, additions=(Addition(FORMS[0], (c2,)),), errors=((0.0,),)))
    np.testing.assert_allclose(law.homogeneous(mode, STRETCH)[1][1:], along - free * c / x, rtol=1e-9, atol=1e-12)


def test_a_history_does_not_depend_on_the_points_that_are_drawn():
    for effect in (
        ("permanent set", (0.1,), ()),
        ("viscoelasticity", (0.8,), (1.5,)),
        ("Payne softening", (0.3,), (0.2,)),
    ):
        law = DiagnosedLaw(found(effect), 4.0)
        few, many = (law.homogeneous("uniaxial", np.linspace(1, 2, n))[1] for n in (3, 301))
        np.testing.assert_allclose(few, many[[0, 150, 300]], rtol=1e-9)


def test_in_plane_strain_the_bulk_modulus_of_the_base_is_that_of_the_curves():
    beta, model = 0.2, found()
    strain = replace(model, basis=PlaneStrainBasis(model.basis), c=np.append(model.c, 1 / beta))
    P = DiagnosedLaw(strain).homogeneous("uniaxial", STRETCH)[1]
    np.testing.assert_allclose(
        P, DiagnosedLaw(found(("compressibility", (beta,), ()))).homogeneous("uniaxial", STRETCH)[1]
    )


@pytest.mark.parametrize("mode", MODES)
def test_a_relaxing_material_at_constant_speed_is_that_of_the_convolution(mode):
    g, tau, duration = 0.8, 1.5, 4.0
    model = found(("viscoelasticity", (g,), (tau,)))
    P = DiagnosedLaw(model, duration).homogeneous(mode, STRETCH)[1]
    for i in (20, 60, 100):
        t = duration * (STRETCH[i] - 1)
        assert P[i] == pytest.approx(nominal_stress(mode, MU, g, tau, 1 / duration, t)[0], rel=2e-3)
    slow, fast = (DiagnosedLaw(model, some).homogeneous(mode, STRETCH)[1] for some in (None, 1e-4))
    np.testing.assert_allclose(fast[1:] / slow[1:], 1 + g, rtol=1e-3)


@pytest.mark.parametrize("beta", [0.05, 0.5])
def test_a_compressible_material_has_the_lateral_stretch_of_least_energy(beta):
    def slopes(
        a: float, b: float
    ) -> tuple[float, float]:  # of mu / 2 (J^(-2/3) I1 - 3) + kappa / 2 (J - 1)^2 by a and b
        J, I1 = a * b * b, a * a + 2 * b * b
        pressure = (J - 1) / beta - MU / 3 * J ** (-5 / 3) * I1
        return MU * J ** (-2 / 3) * a + pressure * b * b, MU * J ** (-2 / 3) * 2 * b + pressure * 2 * a * b

    P = DiagnosedLaw(found(("compressibility", (beta,), ()))).homogeneous("uniaxial", STRETCH)[1]
    for i in (25, 60, 100):
        a = float(STRETCH[i])
        b = brentq(lambda b, a=a: slopes(a, b)[1], 0.5, 1.0)
        assert P[i] == pytest.approx(slopes(a, b)[0], rel=2e-3)


def test_oblique_fibres_shear_a_sheet_that_is_free_to():
    k, angle = 0.3, 0.5

    def energy(
        a: float, free: np.ndarray
    ) -> float:  # mu / 2 (I1 - 3) + k / 2 (I4 - 1)^2 in incompressible plane stress
        F = np.array([[a, free[1]], [0.0, free[0]]])
        C = F.T @ F
        M = np.array([np.cos(angle), np.sin(angle)])
        return float(MU / 2 * (np.trace(C) + 1 / np.linalg.det(C) - 3) + k / 2 * (M @ C @ M - 1) ** 2)

    def least(a: float) -> float:
        return float(minimize(lambda free: energy(a, free), [a**-0.5, 0.0], tol=1e-14, method="Nelder-Mead").fun)

    law = DiagnosedLaw(found(("one fibre family", (k,), (angle, 0.0, 0.0))))
    (F, P), h = law.homogeneous("uniaxial", STRETCH, "x"), 1e-3
    for i in (30, 100):
        a = float(STRETCH[i])
        assert P[i] == pytest.approx((least(a + h) - least(a - h)) / (2 * h), rel=1e-4)
    turned = DiagnosedLaw(found(("one fibre family", (k,), (np.pi / 2 - angle, 0.0, 0.0))))
    np.testing.assert_allclose(turned.homogeneous("uniaxial", STRETCH, "y")[1], P, rtol=1e-8, atol=1e-12)
    curve = next(
        c for c in predict(law, 2.0) if c.name == "uniaxial_along_x"
    )  # the range ends where I1 of the sheared sheet does
    C = np.swapaxes(F, 1, 2) @ F
    np.testing.assert_allclose(curve.invariants[:, 0], np.trace(C, axis1=1, axis2=2) + 1 / np.linalg.det(C), rtol=1e-9)
    np.testing.assert_array_equal(curve.calibrated, curve.invariants[:, 0] <= 5.0)
    assert curve.limit == curve.stretch[curve.calibrated][-1] < 1.9
    assert not np.allclose(law.homogeneous("uniaxial", STRETCH, "y")[1], P, rtol=0.05)


def test_a_curve_that_is_not_at_rest_at_its_sides_is_refused(monkeypatch):
    monkeypatch.setattr("calibrate.models.diagnosed_law.ITERATIONS", 2)
    law = DiagnosedLaw(found(("one fibre family", (0.3,), (0.3, 0.0, 0.0))))
    with pytest.raises(FitError, match="predict FILE --stretch"):
        law.homogeneous("uniaxial", np.linspace(1, 4, 31))


def test_the_command_draws_both_directions_and_says_what_is_not_drawn(tmp_path: Path, capsys) -> None:
    fibres = ("one fibre family", (0.3,), (0.0, 0.0, 0.0))
    relaxing, offset = ("viscoelasticity", (0.8,), (1.5,)), ("force offset", (0.1,), ())
    found(fibres, relaxing, offset).save(tmp_path / "model.json")
    assert cli.main(["predict", str(tmp_path / "model.json"), "-o", str(tmp_path / "out"), "--points", "11"]) == 0
    said = capsys.readouterr().out
    assert "infinitely slow pull" in said
    assert "not of the material: force offset" in said
    rows = list(csv.DictReader((tmp_path / "out" / "curves.csv").read_text().splitlines()[1:]))
    ends = {row["mode"]: float(row["nominal_stress_MPa"]) for row in rows}
    assert set(ends) == {f"{mode}_along_{axis}" for mode in MODES for axis in "xy"}
    assert ends["uniaxial_along_x"] > 1.2 * ends["uniaxial_along_y"]
    assert (tmp_path / "out" / "curves.png").exists()
    words = ["predict", str(tmp_path / "model.json"), "--duration", "2", "--points", "11", "-o", str(tmp_path / "fast")]
    assert cli.main(words) == 0
    assert "constant speed that reaches its end after 2 s" in capsys.readouterr().out
    found().save(tmp_path / "elastic.json")
    assert cli.main(["predict", str(tmp_path / "elastic.json"), "--duration", "2", "-o", str(tmp_path / "no")]) == 2
    assert "does not relax" in capsys.readouterr().err


def test_fibres_that_were_not_stretched_are_extrapolated_from_rest():
    """Along x, where I1 is still within the range; along y, across them, the range is that of I1."""
    model = found(("one fibre family", (0.2,), (0.0, 1.0, 0.0)))
    across = replace(model, calibrated_range={"I1": (3.0, 5.0), "I4": (1.0, 1.0)})
    curves = {curve.name: curve for curve in predict(DiagnosedLaw(across))}
    assert curves["uniaxial_along_x"].limit < 1.02
    assert not curves["pure_shear_along_x"].calibrated[curves["pure_shear_along_x"].stretch > 1.02].any()
    assert curves["uniaxial_along_y"].limit > 1.5
    reached = replace(model, calibrated_range={"I1": (3.0, 5.0), "I4": (1.0, 1.3**2)})
    along = {curve.name: curve for curve in predict(DiagnosedLaw(reached))}["uniaxial_along_x"]
    assert along.limit == pytest.approx(1.3, abs=0.01)


def test_a_model_beside_itself_is_the_same_along_both_axes(tmp_path):
    found(("one fibre family", (0.2,), (0.4, 1.0, 0.0))).save(tmp_path / "model.json")
    words = [
        "predict",
        str(tmp_path / "model.json"),
        "--against",
        str(tmp_path / "model.json"),
        "-o",
        str(tmp_path / "out"),
    ]
    assert cli.main(words) == 0
    lines = [line for line in (tmp_path / "out" / "curves.csv").read_text().splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    assert {row["mode"] for row in rows} >= {"uniaxial_along_x", "uniaxial_along_y"}
    for row in rows:
        assert float(row["compared"]) == pytest.approx(float(row["nominal_stress_MPa"]), abs=1e-9)
