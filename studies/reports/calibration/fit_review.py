"""What a calibration explains and what it leaves: the numbers behind its report.

In: a Calibration and the whole Experiment, of which some increments may have been held out. Out: `Review` with
predicted forces, the residual of every virtual-work equation and, where the noise is known, how large these
should be.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from calibrate.data.experiment import Experiment
from calibrate.equations.basis import Basis, PlaneStrainBasis, basis_for
from calibrate.equations.deformation_modes import MODES
from calibrate.equations.equilibrium import Equilibrium, best_moduli, equilibrium
from calibrate.equations.noise_covariance import cholesky_factor
from calibrate.equations.reduction import assemble
from calibrate.fitting.calibration import Calibration, predict_forces, relative_force_error
from calibrate.fitting.classical_fit import Comparison
from calibrate.fitting.noise.noise_check import NoiseCheck
from calibrate.fitting.uncertainty import coefficients_and_slopes
from calibrate.models.json_file import MEASURED, NOMINAL
from calibrate.models.network_model import Model
from calibrate.models.parameter_covariance import Z95
from studies.reports.calibration.polish_record import PolishRecord
from studies.reports.prediction.predicted_curves import ROUND_OFF, calibrated_stretch

Array = NDArray[np.float64]
Progress = Callable[[int, int], None]
WELL_LOADED = 0.1  # of the largest force
SAME_LOSS, SAME_CHI_SQUARE = 1e-3, 4.0  # relative, or where the loss is a chi-square: two standard deviations


@dataclass(frozen=True)
class HeldOut:
    """Errors on increments that were held out. chi_square_per_equation: None where the noise is unknown."""

    increments: int
    relative_force_error: float
    chi_square_per_equation: float | None


@dataclass(frozen=True)
class Review:
    """A calibration seen on all increments of its experiment.

    fitted (n_increments,): whether the increment was used for the fit. forces: {boundary: (n_increments, 2)} N,
    predicted from the measured displacements. residuals, deviations (n_increments, rows): internal minus external
    virtual work and its standard deviation from the noise, N; chi_square (n_increments,): per equation, 1 where
    noise is all there is. The last two are None where the noise is unknown. classical: classical laws beside the network, where they were fitted.
    polish: what it did, where it was asked for. noise: what was found of it, where nobody stated it.
    """

    calibration: Calibration
    experiment: Experiment
    system: Equilibrium
    fitted: NDArray[np.bool_]
    forces: dict[str, Array]
    residuals: Array
    deviations: Array | None
    chi_square: Array | None
    neo_hooke_error: float
    classical: Comparison | None = None
    polish: PolishRecord | None = None
    noise: NoiseCheck | None = None

    @property
    def model(self) -> Model:
        """The calibrated model."""
        return self.calibration.model

    @property
    def measured(self) -> dict[str, Array]:
        """Measured forces {boundary: (n_increments, 2)}, N; NaN where not measured."""
        return {b.name: b.force for b in self.experiment.loaded}

    def force_error(self, increments: NDArray[np.bool_]) -> float:
        """Relative force error over some of the increments."""
        return relative_force_error(
            {name: f[increments] for name, f in self.forces.items()},
            {name: f[increments] for name, f in self.measured.items()},
        )

    @cached_property
    def classical_forces(self) -> dict[str, Array]:
        """{law: (n_increments, rows)}: internal virtual work of every classical law on the fields of loaded boundaries, N."""
        rows = np.tile(self.system.fields.boundary >= 0, 2)
        fits = [one.fit for one in self.classical.laws] if self.classical else []
        return {fit.law.name: fit.internal_forces(self.system)[:, rows] for fit in fits if fit is not None}

    @property
    def held_out(self) -> HeldOut | None:
        """Errors on the increments that were held out; None where none were."""
        held = ~self.fitted
        if not held.any():
            return None
        chi_square = None if self.chi_square is None else float(self.chi_square[held].mean())
        return HeldOut(int(held.sum()), self.force_error(held), chi_square)

    @property
    def fitted_chi_square(self) -> float | None:
        """Chi-square per equation on the fitted increments, with the noise weights of the final model; None where noise is unknown."""
        return None if self.chi_square is None else float(self.chi_square[self.fitted].mean())

    @property
    def expected_loss(self) -> float | None:
        """Loss that noise alone would leave: equations less parameters; None where the noise is unknown, or the loss has no weights."""
        found = self.calibration
        if found.weights is None or np.isnan(found.reduced_chi_square):
            return None
        return float(found.weights.size - self.model.architecture.n_parameters)

    @property
    def same_loss(self) -> float:
        """Difference of losses below which two starts count as alike."""
        chi_square = self.calibration.reduced_chi_square
        if np.isfinite(chi_square):
            return SAME_CHI_SQUARE * max(1.0, chi_square)
        return SAME_LOSS * abs(float(np.nanmin(self.calibration.losses)))

    @property
    def starts_alike(self) -> int:
        """Number of starts that ended as low as the best."""
        losses = self.calibration.losses
        return int((losses <= np.nanmin(losses) + self.same_loss).sum())

    def summary(self) -> dict[str, Any]:
        """Numbers for a manifest."""
        return {
            **self.calibration.summary(),
            "initial_shear_modulus": initial_shear_modulus(self.model),
            "initial_shear_modulus_deviation": modulus_deviation(self.model),
            "curve_points": curve_points(self.model),
            "unit": self.model.unit,
            "level": NOMINAL if self.model.level_is_nominal else MEASURED,
            "section_shares": section_shares(self),
            "neo_hooke_force_error": self.neo_hooke_error,
            "starts_alike": self.starts_alike,
            "held_out": None if self.held_out is None else asdict(self.held_out),
        }

    def row(self, name: str, component: int) -> int:
        """Row of the equation of a loaded boundary and component (0: x, 1: y)."""
        index = [b.name for b in self.experiment.loaded].index(name)
        column = int(np.flatnonzero(self.system.fields.boundary == index)[0])
        return component * self.system.fields.n_fields + column

    def force_deviation(self, name: str, component: int) -> Array | None:
        """Standard deviation (n_increments,) of predicted minus measured force that the noise explains, N."""
        return None if self.deviations is None else self.deviations[:, self.row(name, component)]


def review(
    calibration: Calibration,
    experiment: Experiment | None = None,
    fitted: NDArray[np.bool_] | None = None,
    progress: Progress | None = None,
) -> Review:
    """Evaluate a calibration on all increments of `experiment` (None: on those it was fitted to).

    progress: called with (done, total) increments while the covariance of the residuals is computed.
    """
    if experiment is None or fitted is None or experiment is calibration.experiment:
        experiment, system = calibration.experiment, calibration.system
        fitted = np.ones(experiment.n_increments, bool)
    else:
        system = equilibrium(experiment, calibration.system.fields.spacing)
    forces, residuals = predict_forces(system, calibration.model)
    deviations, chi_square = _expected(system, calibration, residuals, progress)
    return Review(
        calibration, experiment, system, fitted, forces, residuals, deviations, chi_square,
        _neo_hooke_error(calibration.system),
    )  # fmt: skip


def coefficients(model: Model, basis: Basis) -> Array:
    """Spline coefficients (n_functions,) of the energy derivatives of `model`."""
    found = coefficients_and_slopes(model.architecture, basis, np.asarray(model.parameters))[0]
    if isinstance(basis, PlaneStrainBasis):
        found[-1] = model.bulk_modulus
    return found


def _expected(
    system: Equilibrium, calibration: Calibration, residuals: Array, progress: Progress | None
) -> tuple[Array | None, Array | None]:
    noise = system.experiment.noise
    if noise is None or noise.displacement_std == 0:
        return None, None
    F = system.deformation_gradients
    basis = basis_for(calibration.options.inputs, F.reshape(-1, 2, 2), plane=system.experiment.plane)
    seen = assemble(system, basis).noise_at(coefficients(calibration.model, basis))
    deviations, chi_square = np.empty_like(residuals), np.empty(len(F))
    for i, residual in enumerate(residuals):
        covariance, known = seen.increment(i), np.isfinite(residual)
        deviations[i] = np.sqrt(np.diag(covariance))
        white = solve_triangular(cholesky_factor(covariance[np.ix_(known, known)]), residual[known], lower=True)
        chi_square[i] = np.mean(white**2)
        if progress:
            progress(i + 1, len(F))
    return deviations, chi_square


def _neo_hooke_error(system: Equilibrium) -> float:
    """Relative force error of the best neo-Hookean solid: what one number would do, or two in plane strain."""
    rows = np.tile(system.fields.boundary >= 0, 2)
    forces = np.tensordot(best_moduli(system), system.neo_hookean[..., rows], 1)
    return relative_force_error({"all": forces}, {"all": system.loads[:, rows]})


def section_shares(view: Review) -> dict[str, tuple[float, float]]:
    """{boundary: (smallest, largest)} of what the section carries over what the machine recorded, at the level of the model.

    Along the pull, of increments with at least `WELL_LOADED` of the largest force. Where the level is nominal, they are 1 on average in its increment.
    """
    found = {}
    for name, force in view.measured.items():
        k = int(np.argmax(np.nanmax(np.abs(force), axis=0, initial=0.0)))
        size = np.abs(np.nan_to_num(force[:, k]))
        used = (size >= WELL_LOADED * size.max()) & (size > 0)
        if used.any():
            shares = view.forces[name][used, k] / force[used, k]
            found[name] = (float(shares.min()), float(shares.max()))
    return found


def initial_shear_modulus(model: Model) -> float:
    """mu = 2 (psi_1 + psi_2) at rest, MPa or N/mm."""
    return float(2 * model.derivatives(np.array([[3.0, 3.0]])).sum())


def modulus_deviation(model: Model) -> float | None:
    """Standard deviation of the initial shear modulus, MPa or N/mm; None where it is unknown."""
    found = model.deviation(np.array([3.0, 3.0]), np.array([2.0, 2.0]))
    return None if found is None else float(found)


def curve_points(model: Model, shares: tuple[float, ...] = (0.25, 0.5, 0.75, 1.0, 1.25)) -> list[dict[str, Any]]:
    """Stress with its 95 % band at `shares` of the calibrated range of stretch - 1, in each homogeneous mode.

    calibrated: whether the data have states near the mode as far as that. standard_deviation, low_95 and high_95 are None where the model has no uncertainty.
    """
    result = []
    for mode in MODES:
        limit = calibrated_stretch(model, mode) * (1 + ROUND_OFF)
        stretch = 1 + (model.largest_stretch(mode) - 1) * np.array(shares)
        stress, deviation = model.homogeneous(mode, stretch), model.homogeneous_deviation(mode, stretch)
        for k in range(len(shares)):
            size = None if deviation is None else float(deviation[k])
            result.append({
                "mode": mode, "stretch": float(stretch[k]), "stress": float(stress[k]), "standard_deviation": size,
                "low_95": None if size is None else float(stress[k]) - Z95 * size,
                "high_95": None if size is None else float(stress[k]) + Z95 * size,
                "calibrated": bool(stretch[k] <= limit),
            })  # fmt: skip
    return result
