"""A calibration, polished: the network of the equilibrium gap in, the polished one with its covariance out, or the first and why it was kept.

The rule: the polished model is kept if the polish converged to a lower chi-square and, where increments were held out, their replay with the motion of the grips as measured
has no larger chi-square than before, both by the weights of the unpolished model.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from calibrate.data.experiment import Experiment
from calibrate.equations.basis import PlaneStrainBasis
from calibrate.errors import ConfigError
from calibrate.fitting.calibration import Calibration, predict_forces, relative_force_error
from calibrate.fitting.uncertainty import parameter_uncertainty
from calibrate.models.network_model import Model
from forward.errors import ConvergenceError, LoadingError, MaterialError
from studies.polish.polishing import Polished, polish
from studies.polish.replay_equations import Equations, ReplayedTest
from studies.polish.varied_law import NetworkLaw
from studies.reports.calibration.polish_record import Kept, PolishRecord, ReplayErrors


def polished(calibration: Calibration, held_out: Experiment | None = None) -> tuple[Calibration, PolishRecord]:
    """Polish the network of a calibration. held_out: increments that judge it.

    Raises `ConfigError` for what cannot be polished: plane strain, the paper's loss, a level that is nominal.
    """
    _check(calibration)
    started = time.perf_counter()
    test, law = ReplayedTest(calibration.experiment), _law(calibration)
    try:
        found = polish(test, law)
        whole = _judged(calibration, test, found, held_out)
    except (ConvergenceError, MaterialError, LoadingError) as error:
        whole = PolishRecord(Kept.NO_EQUILIBRIUM, calibration.model, detail=str(error))
    whole = replace(whole, seconds=time.perf_counter() - started)
    if whole.kept is not Kept.POLISHED or whole.model is None:
        return calibration, whole
    model = replace(whole.model, fit={**whole.model.fit, "polish": whole.to_dict()})
    return _with_model(calibration, model), replace(whole, model=model)


def _check(calibration: Calibration) -> None:
    experiment = calibration.experiment
    if experiment.plane != "stress":
        raise ConfigError(
            f"{experiment.name}: --polish replays thin sheets in plane stress, not plane {experiment.plane}; leave it out"
        )
    if calibration.options.loss != "weighted":
        raise ConfigError("--polish weighs by the noise, which --loss paper does not; use --loss weighted")
    if experiment.level_is_nominal:
        raise ConfigError(
            f"{experiment.name}: the section does not carry the recorded forces, which --polish has to meet; leave it out"
        )


def _law(calibration: Calibration) -> NetworkLaw:
    assert not isinstance(calibration.basis, PlaneStrainBasis)
    return NetworkLaw(calibration.model, calibration.basis)


def _judged(calibration: Calibration, test: ReplayedTest, found: Polished, held_out: Experiment | None) -> PolishRecord:
    """The record, by the rule above."""
    law = found.after.point.law
    assert isinstance(law, NetworkLaw)
    model = _with_covariance(law, found.after, test.noise_is_known)
    reached = replace(found.after, weights=found.before.weights)
    record = PolishRecord(
        Kept.POLISHED,
        calibration.model,
        model,
        found.iterations,
        _errors(test, found.before),
        _errors(test, reached),
    )
    if not found.reason.is_success:
        return replace(record, kept=Kept.NOT_CONVERGED, detail=str(found.reason))
    if not reached.chi_square < found.before.chi_square:
        return replace(record, kept=Kept.NO_GAIN)
    if held_out is None:
        return record
    judge = ReplayedTest(held_out)
    before = judge.linearised(judge.start(_law(calibration)))
    after = judge.linearised(judge.start(law))
    after = replace(after, weights=before.weights)
    worse = after.chi_square > before.chi_square
    return replace(record, kept=Kept.WORSE if worse else Kept.POLISHED, held_before=_errors(judge, before),
                   held_after=_errors(judge, after))  # fmt: skip


def _with_covariance(law: NetworkLaw, found: Equations, noise_is_known: bool) -> Model:
    G, residual = found.rows
    quadratic = law.quadratic(G, residual + G @ law.coefficients)
    model = law.model
    spread = parameter_uncertainty(quadratic, model.architecture, model.parameters, noise_is_known)
    return replace(model, uncertainty=spread)


def _errors(test: ReplayedTest, found: Equations) -> ReplayErrors:
    n, measured = len(test.experiment.points), test.experiment.displacements
    free = test.boundary.judged
    field = (measured[-1] - found.point.displacements[-1, :n])[free]
    force = relative_force_error({"all": test.forces(found.point)}, {"all": test.measured_forces})
    return ReplayErrors(found.chi_square, found.weights.size, force, float(np.sqrt((field**2).mean())))


def _with_model(calibration: Calibration, model: Model) -> Calibration:
    """The calibration with another model, judged by its own equations."""
    system, weights = calibration.system, calibration.weights
    assert weights is not None
    forces, residuals = predict_forces(system, model)
    white = weights(np.nan_to_num(residuals))
    loss = float(white @ white)
    freedom = max(1, weights.size - model.architecture.n_parameters)
    known = not np.isnan(calibration.reduced_chi_square)
    return replace(
        calibration, model=model, predicted_forces=forces, imbalance=residuals.reshape(len(residuals), 2, -1), loss=loss,
        reduced_chi_square=loss / freedom if known else np.nan, attenuation=1.0,
    )  # fmt: skip
