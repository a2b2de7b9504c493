"""From an Experiment to a Model: the one path that the command line, the studies and the tests use.

In: an Experiment and `Options`. Out: `Calibration` with the model, its residuals, forces predicted and measured,
and a loss that is a reduced chi-square where the noise is known.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.data.experiment import Experiment
from calibrate.equations import reduction
from calibrate.equations.basis import Basis, basis_for, energy_basis
from calibrate.equations.equilibrium import Equilibrium, best_shear_modulus, equilibrium
from calibrate.equations.inputs import INPUT_SETS
from calibrate.equations.weights import Weights
from calibrate.fitting import network_fit, paper_loss, uncertainty
from calibrate.fitting.calibrated_range import calibrated_range, mode_ranges
from calibrate.models import pann
from calibrate.models.network_model import Model

Array = NDArray[np.float64]
LOSSES = ("weighted", "paper")
STRAIN_PASSES = 6  # of the weighting in plane strain, where the first bulk modulus may be far off


@dataclass(frozen=True)
class Options:
    """How to calibrate. inputs and layers: PANN_inputs^layers. loss: 'weighted' (virtual fields, noise) or 'paper'.

    scaling: the paper's C_F, 'frozen' or 'dependent'. spacing: of the virtual fields, mm (None: from the noise).
    starts, seed: random starts of the network. passes: of the weighting. Raises `ConfigError` for what cannot be.
    """

    inputs: str = "I1"
    layers: tuple[int, ...] = (4, 4)
    loss: str = "weighted"
    scaling: str = "frozen"
    spacing: float | None = None
    starts: int = 20
    seed: int = 0
    passes: int = 2

    def __post_init__(self) -> None:
        if self.loss not in LOSSES:
            raise errors.ConfigError(f"loss '{self.loss}' unknown; choose one of {', '.join(LOSSES)}")
        if self.scaling not in paper_loss.SCALINGS:
            raise errors.ConfigError(f"scaling '{self.scaling}' unknown; choose one of {paper_loss.SCALINGS}")
        if self.scaling != "frozen" and self.loss != "paper":
            raise errors.ConfigError(
                f"scaling '{self.scaling}' is of the paper's loss; give loss 'paper' too, or leave it out"
            )
        if self.starts < 1 or self.passes < 1:
            raise errors.ConfigError("starts and passes must be at least 1")
        if self.spacing is not None and not self.spacing > 0:
            raise errors.ConfigError(f"spacing of the virtual fields must be positive, not {self.spacing} mm")
        pann.Architecture(self.inputs, tuple(self.layers))


@dataclass(frozen=True)
class Calibration:
    """Result of `calibrate`.

    model: the PANN. spline: coefficients of the convex spline it was distilled from (None for SLSQP).
    losses: of all starts. reduced_chi_square: of the model as it is, over equations minus parameters, NaN where the noise is unknown.
    attenuation: factor by which the stiffness was raised, as noise in the strain lowers it; 1 without noise. dead_network: the
    energy is a straight line although a convex one that bends meets the data clearly better.
    predicted_forces, measured_forces: {boundary: (n_increments, 2)} N.
    imbalance (n_increments, 2, n_fields): unexplained virtual work of the virtual fields, N. weights: of the equations in the loss; None for the paper's.
    """

    experiment: Experiment
    options: Options
    model: Model
    basis: Basis
    spline: Array | None
    losses: Array
    loss: float
    reduced_chi_square: float
    reason: str
    predicted_forces: dict[str, Array]
    measured_forces: dict[str, Array]
    imbalance: Array
    system: Equilibrium = field(repr=False)
    attenuation: float = 1.0
    dead_network: bool = False
    weights: Weights | None = field(default=None, repr=False)

    def summary(self) -> dict[str, Any]:
        """Numbers for a manifest."""
        spread = self.model.uncertainty
        return {
            "experiment": self.experiment.name,
            "options": asdict(self.options),
            "loss": self.loss,
            "losses_of_starts": np.sort(self.losses).tolist(),
            "reduced_chi_square": None if np.isnan(self.reduced_chi_square) else self.reduced_chi_square,
            "relative_force_error": relative_force_error(self.predicted_forces, self.measured_forces),
            "calibrated_range": {k: list(v) for k, v in self.model.calibrated_range.items()},
            "reason": self.reason,
            "attenuation": self.attenuation,
            "dead_network": self.dead_network,
            "bulk_modulus": self.model.bulk_modulus,
            "bulk_modulus_deviation": self.model.bulk_modulus_deviation,
            "uncertainty": None
            if spread is None
            else {
                "effective_parameters": spread.effective_parameters,
                "covariance_multiplied_by": spread.scale,
                "is_lower_bound": spread.is_lower_bound,
            },
        }


def relative_force_error(predicted: dict[str, Array], measured: dict[str, Array]) -> float:
    """Root of sum (predicted - measured)^2 / sum measured^2 over every measured component.

    predicted, measured: {boundary: (n_increments, 2)} N, NaN where not measured.
    """
    a = np.concatenate([predicted[name].ravel() for name in predicted])
    b = np.concatenate([measured[name].ravel() for name in predicted])
    known = np.isfinite(b)
    return float(np.linalg.norm((a - b)[known]) / np.linalg.norm(b[known]))


def predict_forces(system: Equilibrium, model: Model) -> tuple[dict[str, Array], Array]:
    """Forces {boundary: (n_increments, 2)} N from the measured displacements, none along an edge that slides, and all
    residuals (n_increments, 2 n_fields), N."""
    work = system.internal_forces(model.nominal_stress(system.deformation_gradients, system.experiment.plane))
    n = system.fields.n_fields
    forces = {}
    for column in np.flatnonzero(system.fields.boundary >= 0):
        boundary = system.experiment.loaded[system.fields.boundary[column]]
        forces[boundary.name] = np.stack([work[:, column], work[:, n + column]], axis=1) * boundary.held
    return forces, work - system.loads


def at_level(system: Equilibrium, model: Model) -> Model:
    """The model with the stiffness of its level, see `Equilibrium.share_carried`. Raises `FitError` where the sections pull against the
    record."""
    if not system.experiment.level_is_nominal:
        return model
    stress = model.nominal_stress(system.deformation_gradients, system.experiment.plane)
    share = system.share_carried(system.internal_forces(stress))
    architecture = replace(model.architecture, energy_scale=model.architecture.energy_scale / share)
    bulk, deviation = model.bulk_modulus, model.bulk_modulus_deviation
    return replace(
        model,
        architecture=architecture,
        bulk_modulus=None if bulk is None else bulk / share,
        bulk_modulus_deviation=None if deviation is None else deviation / share,
    )


def calibrate(
    experiment: Experiment, options: Options = Options(), progress: Callable[[int, int], None] | None = None
) -> Calibration:
    """Identify a PANN from one Experiment.

    progress: called with (done, total) increments while the equations are assembled. Raises `ForceSignError`,
    `FitError`, `ConfigError` for the paper's loss in plane strain, `MissingForceError` where it is asked for with
    dependent scaling and a force was not measured, and the errors of `calibrate.equations.equilibrium.equilibrium`.
    """
    if options.loss == "paper" and experiment.plane == "strain":
        raise errors.ConfigError(
            f"{experiment.name}: the paper's loss is one of plane stress; calibrate with loss 'weighted'"
        )
    system = equilibrium(experiment, options.spacing)
    basis = basis_for(options.inputs, system.deformation_gradients.reshape(-1, 2, 2), plane=experiment.plane)
    if options.loss == "paper" and options.scaling == "dependent":
        return _calibrate_slsqp(system, basis, options)
    if options.loss == "paper":
        quadratic = paper_loss.reduced(paper_loss.nodal_system(experiment), basis)
        spline, weighted = network_fit.convex_spline(quadratic, options.inputs), None
        known = False
    else:
        assembled = reduction.assemble(system, basis, progress)
        passes = options.passes if experiment.plane == "stress" else max(options.passes, STRAIN_PASSES)
        weighted = network_fit.reweighted_spline(assembled, options.inputs, passes)
        quadratic, spline = weighted.loss, weighted.coefficients
        known = assembled.noise_is_known
    architecture, result = network_fit.fit_network(
        quadratic, options.inputs, options.layers, spline, options.starts, options.seed
    )
    confidence, bulk, factor, loss = None, None, 1.0, result.loss
    if weighted is not None:
        confidence = uncertainty.parameter_uncertainty(quadratic, architecture, result.parameters, known)
        right = reduction.corrected(quadratic, result.coefficients, weighted.weights_c, [assembled])
        if experiment.plane == "strain":
            deviation = uncertainty.bulk_modulus_deviation(quadratic, architecture, result.parameters, confidence)
            bulk = _bulk_modulus(experiment, float(right[-1]), deviation * float(right[-1] / result.coefficients[-1]))
        largest = int(np.argmax(np.abs(result.coefficients[: energy_basis(basis).n_functions])))
        factor = float(right[largest] / result.coefficients[largest])
        loss = quadratic.loss(right)
        architecture = replace(architecture, energy_scale=factor * architecture.energy_scale)
    freedom = max(1, quadratic.n_rows - architecture.n_parameters)
    return _collect(
        system,
        basis,
        options,
        architecture,
        result.parameters,
        spline,
        result.losses,
        result.loss,
        loss / freedom if known else np.nan,
        result.reasons[int(np.nanargmin(result.losses))],
        confidence,
        bulk,
        factor,
        result.dead,
        None if weighted is None else weighted.weights,
    )


def _bulk_modulus(experiment: Experiment, value: float, deviation: float) -> tuple[float, float]:
    if not value > 0:
        raise errors.FitError(
            f"{experiment.name}: the bulk modulus found is not positive ({value:.3g} {experiment.stress_unit}); is the "
            "test in plane strain, and does its volume change by more than noise?"
        )
    return value, deviation


def _calibrate_slsqp(system: Equilibrium, basis: Basis, options: Options) -> Calibration:
    """The paper's loss with its dependent scaling, SLSQP on the full data from random starts."""
    nodal = paper_loss.nodal_system(system.experiment)
    inputs = np.nan_to_num(basis.site_inputs)
    scales = 1.0 / np.maximum(np.abs(inputs).max(axis=0), 1e-300)
    level = best_shear_modulus(system)[0] * float(np.max(1.0 / scales[list(INPUT_SETS[options.inputs])]))
    architecture = pann.Architecture(options.inputs, tuple(options.layers), (float(scales[0]), float(scales[1])), level)
    loss = paper_loss.full_loss(nodal, architecture, options.scaling)
    keys = jax.random.split(jax.random.key(options.seed), options.starts)
    fits = [paper_loss.slsqp(loss, architecture, np.asarray(architecture.random_start(k))) for k in keys]
    best = min(fits, key=lambda f: f.loss)
    losses = np.array([f.loss for f in fits])
    return _collect(
        system, basis, options, architecture, best.parameters, None, losses, best.loss, np.nan, best.message
    )


def _collect(
    system: Equilibrium,
    basis: Basis,
    options: Options,
    architecture: pann.Architecture,
    parameters: Array,
    spline: Array | None,
    losses: Array,
    loss: float,
    reduced_chi_square: float,
    reason: str,
    confidence: uncertainty.Uncertainty | None = None,
    bulk: tuple[float, float] | None = None,
    attenuation: float = 1.0,
    dead_network: bool = False,
    weights: Weights | None = None,
) -> Calibration:
    experiment = system.experiment
    bulk_modulus, deviation = bulk or (None, None)
    model = Model(
        architecture,
        parameters,
        experiment.stress_unit,
        calibrated_range(system) | mode_ranges(system),
        {"loss": loss, "reason": reason, "options": asdict(options)},
        {"experiment": experiment.name, **experiment.provenance},
        confidence,
        bulk_modulus,
        deviation,
        experiment.level_is_nominal,
    )
    model = at_level(system, model)
    forces, residuals = predict_forces(system, model)
    return Calibration(
        experiment,
        options,
        model,
        basis,
        spline,
        losses,
        loss,
        reduced_chi_square,
        reason,
        forces,
        {b.name: b.force for b in experiment.loaded},
        residuals.reshape(len(residuals), 2, -1),
        system,
        attenuation,
        dead_network,
        weights,
    )
