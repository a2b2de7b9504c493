"""Classical laws fitted to the equations of a calibration with its weights, and how much worse each is than the network.

In: a calibration with the weighted loss. Out: `Comparison`: parameters of least squares of the whitened residual (exact derivatives,
bounds where a limit of extension has one), chi-square and Bayesian information criterion (Schwarz 1978) of each law and of the network
under the same weights, those of the network's loss. A fit that did not converge is in it, and says so.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calibrate.equations.equilibrium import Equilibrium
from calibrate.equations.reduction import stiffness_factor
from calibrate.equations.weights import Weights
from calibrate.errors import FitError
from calibrate.fitting.calibration import Calibration
from calibrate.fitting.stopping import Stop
from calibrate.models.classical_laws import CLASSICAL_LAWS, Law

Array = NDArray[np.float64]
TOLD_APART = 10.0  # difference of the criterion that counts as very strong (Kass and Raftery 1995)
EVALUATIONS = 100  # of a fit, at most
READING = 1e-4  # of the loads: no reading of a test with unknown noise is better
AT_REST = (3.001, 3.001)  # invariants
SINGULAR = 1e-7  # of the largest singular value, below which a combination of parameters changes nothing


class Verdict(StrEnum):
    """Whether the data can tell the network from the classical laws."""

    ENOUGH = "enough"  # a classical law is as good
    BETTER = "better"  # a classical law is better by more than its fewer parameters
    TOLD_APART = "told apart"
    NONE_FITTED = "none fitted"


class StressLaw(Protocol):
    """What can be fitted: P (..., 2, 2) and its derivatives (q, ..., 2, 2) at F (..., 2, 2) and parameters (q,)."""

    def stress_and_sensitivity(self, F: Array, parameters: Array) -> tuple[Array, Array]: ...


@dataclass(frozen=True)
class LeastSquares:
    """parameters (q,) with the covariance (q, q) of unit noise; chi_square: of the fit to so many equations."""

    parameters: Array
    chi_square: float
    equations: int
    reason: Stop
    covariance: Array = field(repr=False)


@dataclass(frozen=True)
class ClassicalFit:
    """A law with its parameters as they are fitted (reciprocal limits), the stiffness put right for noise.

    stability: see `Law.stability`, over that at rest.
    """

    law: Law
    found: LeastSquares
    stability: float

    @property
    def reason(self) -> Stop:
        """Why the fit ended."""
        return self.found.reason

    @property
    def values(self) -> dict[str, float]:
        """Parameters as they are reported."""
        return {p.name: p.value(float(x)) for p, x in zip(self.law.parameters, self.found.parameters, strict=True)}

    def deviations(self, scale: float = 1.0) -> Array:
        """Standard deviations (q,) of `values`; of a reciprocal to first order. scale: variance of the whitened noise; of what the law leaves where that is more,
        as of the bands of a network."""
        left = self.found.chi_square / max(self.found.equations - len(self.found.parameters), 1)
        fitted = np.sqrt(max(scale, left) * np.diag(self.found.covariance))
        reciprocal = np.array([p.reciprocal for p in self.law.parameters])
        return np.where(reciprocal, fitted / self.found.parameters**2, fitted)

    def internal_forces(self, system: Equilibrium) -> Array:
        """Internal virtual work (t, 2 v), N."""
        return np.asarray(internal_forces(self.law, system, self.found.parameters)[0])


@dataclass(frozen=True)
class Candidate:
    """name: of a law, or 'network'. chi_square, criterion: those of the network taken off, over the scale. fit: None for the network."""

    name: str
    numbers: float
    chi_square: float
    criterion: float
    fit: ClassicalFit | None


@dataclass(frozen=True)
class Comparison:
    """scale: chi-square an equation of the best candidate, by which all are divided (at least 1 where the noise is known, else what errors of
    `READING` of the loads leave)."""

    equations: int
    scale: float
    network: Candidate
    laws: tuple[Candidate, ...]

    @property
    def converged(self) -> tuple[Candidate, ...]:
        """Laws whose fit converged, the best first."""
        found = [c for c in self.laws if c.fit is not None and c.fit.reason.is_success]
        return tuple(sorted(found, key=lambda c: c.criterion))

    @property
    def alike(self) -> tuple[Candidate, ...]:
        """Laws that these data cannot tell from the best law."""
        found = self.converged
        return tuple(c for c in found[1:] if c.criterion - found[0].criterion <= TOLD_APART)

    @property
    def verdict(self) -> Verdict:
        """Of the best law against the network."""
        if not self.converged:
            return Verdict.NONE_FITTED
        best = self.converged[0]
        if best.criterion > TOLD_APART:
            return Verdict.TOLD_APART
        return Verdict.BETTER if max(best.chi_square, best.criterion) < -TOLD_APART else Verdict.ENOUGH


def fit_law(
    law: StressLaw, system: Equilibrium, weights: Weights, start: Array, lower: Array | float = -np.inf
) -> LeastSquares:
    """Parameters of least weighted residual above `lower` (q,), from `start` (q,)."""
    loads = np.nan_to_num(system.loads)

    def evaluate(p: Array) -> tuple[Array, Array]:
        forces, *slopes = internal_forces(law, system, p)
        return weights(forces - loads), weights(np.array(slopes)).T

    return least_squares_fit(evaluate, weights.size, start, lower)


def internal_forces(law: StressLaw, system: Equilibrium, parameters: Array) -> Array:
    """Internal virtual work (1 + q, t, 2 v), N, of a law, then its derivatives by each parameter (q,). An increment after the other, as all at once would
    not stay in the processor's cache."""
    found = []
    for F in system.deformation_gradients:
        P, slopes = law.stress_and_sensitivity(F, parameters)
        found.append(system.internal_forces(np.concatenate([P[None], slopes])))
    return np.stack(found, axis=1)


def least_squares_fit(
    evaluate: Callable[[Array], tuple[Array, Array]], size: int, start: Array, lower: Array | float = -np.inf
) -> LeastSquares:
    """evaluate: residual (size,) and its derivatives (size, q) at parameters (q,); above `lower` (q,), from `start` (q,).

    Raises `FitError` where the residual at the start is not finite.
    """
    last: list[tuple[Array, Array, Array]] = []

    def evaluated(p: Array) -> tuple[Array, Array, Array]:
        if not last or not np.array_equal(last[0][0], p):
            last[:] = [(p.copy(), *evaluate(p))]
        return last[0]

    if not np.isfinite(evaluated(start)[1]).all():
        raise FitError(
            "a classical law has no finite stress at the largest strains of this test: they cannot be right. Look at its picture; leave wrong points out ([mask] of a "
            "column map), and check the edges that were given ([edges])"
        )
    found = least_squares(
        lambda p: evaluated(p)[1], start, lambda p: evaluated(p)[2], bounds=(lower, np.inf), x_scale="jac",
        xtol=1e-10, ftol=1e-10, gtol=1e-10, max_nfev=EVALUATIONS,
    )  # fmt: skip
    reason = Stop.CONVERGED if found.success else Stop.ITERATION_LIMIT
    if not np.isfinite(found.x).all():
        reason = Stop.NOT_FINITE
    return LeastSquares(found.x, float(2 * found.cost), size, reason, _covariance(found.jac))


def _covariance(J: Array) -> Array:
    """(q, q) of parameters with the derivatives J (n, q) of unit noise; the variance of those that a combination changes which nothing sees is infinite, as of two terms that are one."""
    sizes = np.linalg.norm(J, axis=0)
    scale = np.where(sizes > 0, sizes, 1.0)
    _, s, V = np.linalg.svd(J / scale, full_matrices=False)
    unseen = s <= SINGULAR * s[0]
    found = (V[~unseen].T / s[~unseen] ** 2) @ V[~unseen] / np.outer(scale, scale)
    involved = (np.abs(V[unseen]) > np.sqrt(SINGULAR)).any(axis=0)
    found[np.diag(involved)] = np.inf
    return np.asarray(found)


def compare(calibration: Calibration, laws: Sequence[Law] = CLASSICAL_LAWS) -> Comparison | None:
    """Every law against the network; None where there is nothing to compare by: the paper's loss, or plane strain."""
    system, weights = calibration.system, calibration.weights
    if weights is None or system.experiment.plane != "stress":
        return None
    b = weights(np.nan_to_num(system.loads))
    network, mu = _network(calibration, weights, b)
    tops = tuple(calibration.model.calibrated_range[k][1] for k in ("I1", "I2"))
    largest = max(float((system.isochoric_gradients**2).sum((-1, -2)).max()), tops[0]) - 2
    fits = []
    for law in laws:
        fit = fit_law(law, system, weights, law.start(mu, largest), law.lower)
        fits.append(_raised(law, fit, system, weights, b, (tops[0], tops[1])))
    spread = calibration.model.uncertainty
    assert spread is not None
    return ranked(network, spread.effective_parameters, fits, len(b), spread.noise_is_known, float(b @ b))


def _network(calibration: Calibration, weights: Weights, b: Array) -> tuple[float, float]:
    """Chi-square of the network at its best level, and its initial shear modulus."""
    system, model = calibration.system, calibration.model
    a = weights(system.internal_forces(model.nominal_stress(system.deformation_gradients)))
    mu = float(2 * model.derivatives(np.array([[3.0, 3.0]])).sum())
    return float(b @ b - (a @ b) ** 2 / (a @ a)), mu


def _raised(
    law: Law, fit: LeastSquares, system: Equilibrium, weights: Weights, b: Array, tops: tuple[float, float]
) -> ClassicalFit:
    """With the stiffness that noise attenuates put right, see `stiffness_factor`, and the stability of the law."""
    a = weights(internal_forces(law, system, fit.parameters)[0])
    factor = np.where(law.moduli, stiffness_factor(float(b @ b), float(a @ b)), 1.0)
    p, covariance = factor * fit.parameters, fit.covariance * np.outer(factor, factor)
    share = law.stability(p, tops) / abs(law.stability(p, AT_REST))
    return ClassicalFit(law, replace(fit, parameters=p, covariance=covariance), share)


def ranked(
    network: float, numbers: float, fits: list[ClassicalFit], equations: int, known: bool, loads: float
) -> Comparison:
    """network: its chi-square; numbers: its effective parameters; known: whether the noise is; loads: chi-square of no stress at all."""
    pairs = [(network, numbers), *((f.found.chi_square, len(f.law.parameters)) for f in fits if f.reason.is_success)]
    best = [chi / (equations - k) for chi, k in pairs if equations > k] or [1.0]
    scale = max(min(best), 1.0 if known else READING**2 * loads / equations)
    criterion: Callable[[float, float], float] = lambda chi, k: chi / scale + k * np.log(equations)  # noqa: E731
    laws = [
        Candidate(
            f.law.name,
            len(f.law.parameters),
            (f.found.chi_square - network) / scale,
            criterion(f.found.chi_square, len(f.law.parameters)) - criterion(network, numbers),
            f,
        )
        for f in fits
    ]
    return Comparison(equations, scale, Candidate("network", numbers, 0.0, 0.0, None), tuple(laws))
