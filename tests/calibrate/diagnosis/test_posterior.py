"""What a diagnosis leaves uncertain of its material, against the joint normal posterior and the material itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discoveries import C01, explained, nothing

from calibrate.diagnosis import problem as equations
from calibrate.diagnosis.evidence.priors import read_priors
from calibrate.diagnosis.evidence.signatures import prior_deviations
from calibrate.diagnosis.replayed.parameter_spread import Columns
from calibrate.effects.chain import Addition
from calibrate.models.diagnosed_law import DiagnosedLaw
from studies.reports.discovery.model_files import extended
from studies.reports.prediction.predicted_curves import predict

RECORD = dict.fromkeys(("command", "settings", "inputs", "versions", "revision"), "")


def undetected():
    """The second invariant in the plate of an I1 material."""
    return next(one for one in nothing().uncertainty.competitors if one.names == ("second invariant",))


def test_an_effect_that_is_not_seen_is_as_large_as_test_and_prior_allow():
    found, one = nothing(), undetected()
    problem, fit, (addition,) = found.problem, found.final, undetected().additions
    columns, L = Columns.of(problem, fit), prior_deviations(problem, addition.effect, read_priors())
    S = equations.signature(problem, fit.chains, fit.c, (Addition(addition.effect, (0.0,)),)) * L
    X = np.hstack([columns.J, S])
    precision = X.T @ X / columns.dispersion
    precision[-1, -1] += 1.0
    covariance = np.linalg.inv(precision)
    mean = -covariance @ X.T @ fit.residual / columns.dispersion
    assert addition.amplitudes[0] == pytest.approx(L[0] * np.sqrt(mean[-1] ** 2 + covariance[-1, -1]), rel=1e-5)
    assert 0 < one.probability < 0.5
    assert not any(name == "stiffness gradient" for other in found.uncertainty.competitors for name in other.names)


def test_the_base_makes_up_for_it_where_the_test_sees_it():
    """With the base that it comes with it changes the equations much less than without."""
    found, one = nothing(), undetected()
    before = equations.residual(found.problem, found.final.c, ())
    together = equations.residual(found.problem, one.c, one.additions) - before
    alone = equations.residual(found.problem, found.final.c, one.additions) - before
    assert np.linalg.norm(together) < 0.3 * np.linalg.norm(alone)
    assert np.linalg.norm(together) < 2.0 * np.sqrt(
        nothing().final.reduced_chi_square
    )  # a posterior deviation, or less


@pytest.mark.parametrize("found", [explained, nothing], ids=["Mooney-Rivlin", "Arruda-Boyce"])
def test_bands_open_in_modes_that_the_test_does_not_hold(found):
    model = extended(found(), "", RECORD)
    bands = {curve.mode: curve for curve in predict(DiagnosedLaw(model))}
    shares = {mode: curve.deviation_at(curve.limit) / curve.stress_at(curve.limit) for mode, curve in bands.items()}
    assert all(0 < share < 0.2 for share in shares.values())
    without = replace(model, uncertainty=replace(model.uncertainty, competitors=()))
    narrow = {curve.mode: curve for curve in predict(DiagnosedLaw(without))}
    for mode, curve in bands.items():
        assert (curve.deviation >= narrow[mode].deviation - 1e-12).all()
    if found is nothing:
        wider = {mode: (bands[mode].deviation[50] / narrow[mode].deviation[50]) for mode in bands}
        assert wider["equibiaxial"] > wider["uniaxial"]


def test_the_bands_hold_the_material():
    """Mooney and Rivlin's, to three standard deviations in the fitted range."""
    for curve in predict(DiagnosedLaw(extended(explained(), "", RECORD))):
        x = curve.stretch
        c10 = 0.1
        b = x ** {"uniaxial": -0.5, "equibiaxial": 1.0, "pure_shear": 0.0}[curve.mode]
        c = 1 / (x * b)
        along = 2 * c10 * x + 2 * C01 * x * (b**2 + c**2)
        truth = along - (2 * c10 * c + 2 * C01 * c * (x**2 + b**2)) * c / x
        inside = curve.calibrated & (x > 1)
        assert (np.abs(curve.stress - truth)[inside] < 3 * curve.deviation[inside]).all(), curve.mode


def test_another_form_of_an_effect_is_fitted_and_weighed():
    """The logarithm of the second invariant, against least squares with all columns at once."""
    found = explained()
    one = next(c for c in found.uncertainty.competitors if c.names == ("logarithm of the second invariant",))
    problem, fit = found.problem, found.final
    before, after = (float(r @ r) for r in (fit.residual, equations.residual(problem, one.c, one.additions)))
    odds = -0.5 * (after - before) / max(1.0, fit.reduced_chi_square)  # at displacements with their noise
    assert np.log(one.probability / (1 - one.probability)) == pytest.approx(odds, rel=0.1)
    assert odds < -10  # a fine plate tells the forms apart
    law = DiagnosedLaw(extended(found, "", RECORD))
    x = np.linspace(1.0, 1.3, 31)
    (c01,), (c2,) = found.final.additions[0].amplitudes, one.additions[0].amplitudes
    assert 0.5 * 3 * c01 < c2 < 3 * 3 * c01  # d psi / d I2 = c2 / I2, about c01 in the test
    wider = {mode: np.abs(law.changes(mode, x, "", [replace(law, model=replace(law.model, c=one.c, additions=one.additions))])[0][-1]) for mode in ("uniaxial", "equibiaxial")}  # fmt: skip
    assert wider["equibiaxial"] > wider["uniaxial"]
