"""What a diagnosis leaves uncertain of its material, against the joint normal posterior and the material itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from discoveries import C01, explained, nothing

from calibrate.diagnosis import problem as equations
from calibrate.diagnosis.evidence import posterior
from calibrate.diagnosis.evidence.explanations import Alternatives
from calibrate.diagnosis.evidence.posterior import uncertainty_of
from calibrate.diagnosis.evidence.priors import read_priors
from calibrate.diagnosis.evidence.signatures import prior_deviations
from calibrate.diagnosis.replayed.parameter_spread import Columns, covariance_root
from calibrate.effects.chain import Addition
from calibrate.models.diagnosed_law import DiagnosedLaw
from calibrate.models.model_uncertainty import Kind, ModelUncertainty
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
    if found is nothing:
        wider = {mode: (bands[mode].deviation[50] / narrow[mode].deviation[50]) for mode in bands}
        assert wider["equibiaxial"] > wider["uniaxial"] > 1


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
    """The logarithm of the second invariant, against least squares with the columns of base and form at once."""
    found = explained()
    one = next(c for c in found.uncertainty.competitors if c.kind is Kind.FORM)
    problem, fit = found.problem, found.final
    columns, (c2,) = Columns.of(problem, fit), one.additions[0].amplitudes
    n = columns.base.shape[1]
    S = equations.signature(problem, fit.chains, fit.c, (Addition(one.additions[0].effect, (0.0,)),))
    X, rest = (
        np.hstack([columns.J[:, :n], S]),
        fit.residual - columns.J[:, n] * fit.additions[0].amplitudes[0] / columns.scale[0],
    )
    free = -np.linalg.lstsq(X, rest, rcond=None)[0]
    change = np.linalg.lstsq(columns.base, one.c - fit.c, rcond=None)[0]
    assert (columns.weights + change > -1e-9 * columns.weights.max()).all()  # the base stays one
    left = rest + X @ np.append(change, c2)
    assert (columns.weights + free[:-1] > 0).all()  # nothing is at its bound, so that free least squares are the same
    assert c2 == pytest.approx(free[-1], rel=1e-6)
    odds = -0.5 * float(left @ left - fit.residual @ fit.residual) / columns.dispersion
    assert np.log(one.probability / (1 - one.probability)) == pytest.approx(odds, rel=1e-6)
    assert odds < -10  # a fine plate tells the forms apart
    assert (
        0.5 * 3 * fit.additions[0].amplitudes[0] < c2 < 3 * 3 * fit.additions[0].amplitudes[0]
    )  # d psi / d I2 = c2 / I2


def test_another_form_has_no_negative_amplitude():
    """Of a residual that asks for one it has none."""
    found = explained()
    problem, columns = found.problem, Columns.of(found.problem, found.final)
    (form,) = posterior._of_other_forms(problem, columns)
    (one,) = form.additions
    S = equations.signature(problem, columns.fit.chains, columns.fit.c, (replace(one, amplitudes=(0.0,)),))
    moved = replace(columns.fit, residual=columns.fit.residual + 2 * one.amplitudes[0] * S[:, 0])
    (none,) = posterior._of_other_forms(problem, replace(columns, fit=moved))
    assert none.additions[0].amplitudes == (0.0,) and one.amplitudes[0] > 0


def test_without_fits_of_the_explanations_no_effect_is_weighed_that_is_not_seen():
    provisional = replace(explained().weighing, fitted=False)
    assert provisional.is_provisional
    found = uncertainty_of(replace(explained(), weighing=provisional), read_priors())
    assert not any(one.kind is Kind.UNSEEN for one in found.competitors)
    assert not replace(provisional, significant=False).is_provisional


def test_probabilities_that_round_off_takes_past_1_are_read_back():
    found = nothing()
    explanations = [replace(one, probability=1.0 + 4e-16) for one in found.weighing.alternatives.explanations if "second invariant" in one.names]  # fmt: skip
    sure = replace(found.weighing, alternatives=Alternatives(tuple(explanations)))
    known = uncertainty_of(replace(found, weighing=sure), read_priors())
    assert known is not None
    again = ModelUncertainty.from_dict(known.to_dict("MPa"), len(found.final.c), ())
    assert max(one.probability for one in again.competitors) == 1.0


def test_a_base_without_stiffness_has_no_uncertainty():
    """As of a strain that is all noise: no unknown changes its residual. What nothing constrains is held."""
    found = nothing()
    base = replace(found.final, c=np.zeros_like(found.final.c))
    none = replace(found, rounds=(replace(found.rounds[0], fit=base),))
    assert uncertainty_of(none, read_priors()) is None
    assert covariance_root(np.zeros((3, 3))).shape == (3, 0)
