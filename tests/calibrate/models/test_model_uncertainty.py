"""Bands of the curves of a diagnosis: first-order changes against the equilibrium solved anew, closed forms, files."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from diagnosed_materials import MU, STRETCH, found

from calibrate.effects.effect import FORMULA_ERROR
from calibrate.equations.deformation_modes import MODES
from calibrate.errors import FitError, ModelFileError
from calibrate.models.diagnosed_law import DiagnosedLaw
from calibrate.models.extended_model import ExtendedModel
from calibrate.models.model_uncertainty import Competitor, ModelUncertainty
from studies.reports.prediction.diagnosed_bands import variances
from studies.reports.prediction.predicted_curves import predict

LAWS = {
    "isotropic": (("second invariant", (0.05,), ()),),
    "oblique fibres": (("one fibre family", (0.2,), (0.6, 1.0, 0.1)),),
    "compressible": (("compressibility", (0.05,), ()),),
    "relaxing": (("viscoelasticity", (0.5,), (3.0,)), ("compressibility", (0.05,), ())),
}


def moved(model: ExtendedModel, share: float) -> ExtendedModel:
    """With a softer base, and stronger effects."""
    additions = tuple(replace(a, amplitudes=tuple((1 + share) * v for v in a.amplitudes)) for a in model.additions)
    bent = np.linspace(1.0, 2.0, len(model.c))
    return replace(model, c=model.c * (1 - share * bent), additions=additions)


@pytest.mark.parametrize(
    ("name", "mode"),
    [pytest.param(n, m, marks=[pytest.mark.slow] * ((n, m) == ("relaxing", "uniaxial"))) for n in LAWS for m in MODES],
)
def test_first_order_changes_are_those_of_the_equilibrium_solved_anew(name, mode):
    """What is left falls with the square of the change."""
    model, x = found(*LAWS[name]), np.linspace(1.0, 1.8, 33)
    law = DiagnosedLaw(model, duration=5.0)
    errors = []
    for share in (0.02, 0.01):
        other = DiagnosedLaw(moved(model, share), duration=5.0)
        first = law.changes(mode, x, law.directions[0], [other])[0]
        whole = other.homogeneous(mode, x, law.directions[0])[1] - law.homogeneous(mode, x, law.directions[0])[1]
        errors.append(np.abs(first - whole).max() / np.abs(whole).max())
    if errors[0] > 1e-6:  # not linear in the change
        assert errors[0] < 0.05
        assert errors[1] / errors[0] == pytest.approx(0.5, abs=0.1)


def test_the_variance_of_a_base_alone_is_its_closed_form():
    """Of a neo-Hookean modulus with a standard deviation of 3 %, a level with 2 %, and an explanation with 10 % more at a probability of a quarter."""
    model = found()
    other = Competitor(0.25, 1.1 * model.c, ())
    known = ModelUncertainty(0.03 * model.c[:, None], (other,), 0.02, 0.05)
    model = replace(model, uncertainty=known)
    curves = {curve.mode: curve for curve in predict(DiagnosedLaw(model))}
    for mode, power in {"uniaxial": -2, "equibiaxial": -5, "pure_shear": -3}.items():
        curve = curves[mode]
        stress = MU * (curve.stretch - curve.stretch**power)
        beyond = np.maximum(np.sqrt((curve.invariants[:, 0] - 3) / 2.0) - 1, 0.0)  # known to I1 = 5
        share = np.sqrt(0.03**2 + 0.02**2 + 0.25 * 0.1**2 + (0.05 * beyond) ** 2)
        np.testing.assert_allclose(curve.deviation, share * stress, rtol=1e-6, atol=1e-12)
        assert beyond.max() > 0.1


def test_an_effect_is_wrong_by_the_error_of_a_formula_and_later_than_the_test_by_more():
    model = found(("viscoelasticity", (0.5,), (3.0,)))
    known = ModelUncertainty(np.zeros((len(model.c) + 2, 0)), last_time=2.0)
    x, law = STRETCH, DiagnosedLaw(model, duration=5.0)
    stress = law.homogeneous("pure_shear", x)[1]
    slow = DiagnosedLaw(model).homogeneous("pure_shear", x)[1]
    parts = variances(law, known, "pure_shear", x, "", stress, np.zeros(len(x)))
    np.testing.assert_allclose(np.sqrt(parts["formula"]), FORMULA_ERROR * (stress - slow), rtol=1e-3, atol=1e-6)
    late = np.maximum(5.0 * (x - 1) / 2.0 - 1, 0.0)
    np.testing.assert_allclose(np.sqrt(parts["extrapolation"]), FORMULA_ERROR * late * stress, rtol=1e-9, atol=1e-12)


def test_a_file_holds_it_and_a_stiffer_batch_has_the_same_shares(tmp_path):
    model = found(("second invariant", (0.05,), ()), ("compressibility", (0.05,), ()))
    rng, n = np.random.default_rng(0), len(model.c)
    root = np.concatenate([0.01 * model.c[:, None] * rng.standard_normal((n, 3)), 0.001 * rng.standard_normal((2, 3))])
    other = Competitor(0.1, 0.9 * model.c, found(("upturn", (0.01,), ())).additions)
    model = replace(model, uncertainty=ModelUncertainty(root, (other,), 0.01, 0.03, 12.0))
    model.save(tmp_path / "model.json")
    again = ExtendedModel.load(tmp_path / "model.json")
    np.testing.assert_array_equal(again.uncertainty.root, root)
    assert (again.uncertainty.last_time, again.uncertainty.error) == (12.0, 0.03)
    assert again.uncertainty.competitors[0].names == ("upturn",)
    both = zip(predict(DiagnosedLaw(again)), predict(DiagnosedLaw(again.scaled(3.0))), strict=True)
    for one, stiffer in both:
        np.testing.assert_allclose(stiffer.stress, 3 * one.stress, rtol=1e-9)
        np.testing.assert_allclose(stiffer.deviation, 3 * one.deviation, rtol=1e-5)
    assert again.only(again.additions[:1]).uncertainty is None  # that of another model


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("root", [[1.0], [2.0]], "needs 32 rows"),
        ("level_deviation", -1.0, "not negative"),
        ("competitors", [{"probability": 2.0, "coefficients": [], "additions": []}], "probability"),
    ],
)
def test_a_wrong_uncertainty_is_named(tmp_path, key, value, said):
    model = found()
    model = replace(model, uncertainty=ModelUncertainty(np.zeros((len(model.c), 1))))
    content = model.to_dict()
    content["uncertainty"][key] = value
    (tmp_path / "model.json").write_text(json.dumps(content))
    with pytest.raises(ModelFileError, match=said):
        ExtendedModel.load(tmp_path / "model.json")


@pytest.mark.parametrize("name", ["oblique fibres", "relaxing"])
def test_the_sign_of_a_column_of_the_root_does_not_matter(name):
    """However large it is: parameters enter to first order, shapes too."""
    model = found(*LAWS[name])
    rows, k = len(model.c) + sum(len(a.amplitudes) + len(a.shape) for a in model.additions), len(model.c) + 1
    x, law = np.linspace(1.0, 1.5, 11), DiagnosedLaw(model, duration=5.0)
    stress = law.homogeneous("pure_shear", x, law.directions[0])[1]
    parts = []
    for sign in (1.0, -1.0, 10.0):
        root = np.zeros((rows, 1))
        root[k] = 3.5 * sign
        known = ModelUncertainty(root)
        parts.append(variances(law, known, "pure_shear", x, law.directions[0], stress, np.zeros(len(x)))["parameters"])
    np.testing.assert_allclose(parts[1], parts[0], rtol=0.02)
    np.testing.assert_allclose(parts[2], 100 * parts[0], rtol=0.02)
    assert parts[0][-1] > 0


def test_without_a_finite_stress_there_is_no_band():
    model = found(("one fibre family", (0.2,), (0.0, 1.0, 0.0)))
    stiff = replace(model.additions[0], shape=(0.0, 5000.0, 0.0))
    known = ModelUncertainty(np.zeros((len(model.c) + 4, 0)), (Competitor(0.5, model.c, (stiff,)),))
    with pytest.raises(FitError, match="--stretch"):
        predict(DiagnosedLaw(replace(model, uncertainty=known)), 3.0)
