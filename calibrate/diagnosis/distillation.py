"""A PANN from the base of a fit: what a diagnosis found, as the network that a calibration would have given; and its bulk modulus.

In: a `Problem` and a `Fit`. Out: a `Model` of I1 and how much worse it meets the training equations than the spline.
The effects in the model are held; the network is fitted to the quadratic loss about the fit, and judged by the exact one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibrate.diagnosis import base_functions
from calibrate.diagnosis import problem as equations
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.problem import Problem
from calibrate.effects.chain import Additions
from calibrate.effects.fibres import fibre_angles
from calibrate.equations.basis import PlaneStrainBasis
from calibrate.equations.reduction import Quadratic
from calibrate.fitting.calibrated_range import calibrated_range, largest_fibre_stretch, mode_ranges
from calibrate.fitting.least_squares import orthonormal
from calibrate.fitting.network_fit import fit_network
from calibrate.models.network_model import Model

LAYERS, STARTS = (4, 4), 8
SHARE, NOISE = 0.01, 4.0  # by which the loss may rise: of itself, or two standard deviations of one chi-square term


@dataclass(frozen=True)
class Distilled:
    """network: PANN of I1. spline_loss, network_loss: whitened squared residual of n_rows training equations."""

    network: Model
    spline_loss: float
    network_loss: float
    n_rows: int

    @property
    def good(self) -> bool:
        """Whether the network meets the data as the spline does."""
        return self.network_loss - self.spline_loss <= max(NOISE, SHARE * self.spline_loss)

    @property
    def chi_squares(self) -> tuple[float, float]:
        """Squared residual an equation, of the network and of the spline."""
        return self.network_loss / self.n_rows, self.spline_loss / self.n_rows


def quadratic(problem: Problem, fit: Fit) -> Quadratic:
    """The training loss as a quadratic form in the spline coefficients, about those of the fit."""
    G = equations.base_columns(problem, fit.chains)[: fit.n_rows]
    target = G @ fit.c - fit.residual[: fit.n_rows]
    return Quadratic(problem.basis, G.T @ G, G.T @ target, float(target @ target), len(target))


def distil(
    problem: Problem,
    fit: Fit,
    layers: tuple[int, ...] = LAYERS,
    n_starts: int = STARTS,
    seed: int = 0,
    level: float | None = None,
) -> Distilled:
    """Fit PANN_I1^layers to the base of a fit. level: by which its stiffness is multiplied; None: as a nominal level asks for. Raises `FitError`."""
    loss = quadratic(problem, fit)
    reach = max(base_functions.trained_top(part.system, part.train.rows) for part in problem.trained)
    architecture, found = fit_network(loss, "I1", layers, fit.c, n_starts, seed, reach=reach)
    exact = equations.residual(problem, found.coefficients, fit.additions)[: fit.n_rows]
    network_loss = float(exact @ exact)
    factor = equations.level_factor(problem, fit.c, fit.additions) if level is None else level
    model = Model(
        replace(architecture, energy_scale=factor * architecture.energy_scale),
        np.asarray(found.parameters),
        problem.parts[0].experiment.stress_unit,
        range_of(problem),
        {"loss": network_loss, "spline_loss": fit.loss, "equations": fit.n_rows},
        bulk_modulus=factor * float(found.coefficients[-1]) if isinstance(problem.basis, PlaneStrainBasis) else None,
        level_is_nominal=problem.level_is_nominal,
    )
    return Distilled(model, fit.loss, network_loss, fit.n_rows)


def range_of(problem: Problem) -> dict[str, tuple[float, float]]:
    """Ends of I1 that the fitted increments reach, in all and near each mode, as `calibrated_range` and `mode_ranges` have them; of several tests that which reaches furthest."""
    found = []
    for part in problem.trained:
        given = part.system, part.train.rows.any(axis=1)
        found.append({"I1": calibrated_range(*given)["I1"], **mode_ranges(*given)})
    return {name: (3.0, max(one[name][1] for one in found)) for name in found[0]}


def fibre_ranges(problem: Problem, additions: Additions) -> dict[str, tuple[float, float]]:
    """{"I4": (1, end)} of the fibres of a model, see `fibre_angles`: what they were stretched by in the fitted increments."""
    found = {}
    for name, angle in fibre_angles(additions).items():
        ends = [largest_fibre_stretch(part.system, part.train.rows.any(axis=1), angle) for part in problem.trained]
        found[name] = (1.0, max(1.0, *ends))
    return found


def bulk_modulus(problem: Problem, fit: Fit) -> tuple[float, float] | None:
    """Bulk modulus of a fit in plane strain and its standard deviation, MPa (N/mm without a thickness); None in plane stress."""
    if not isinstance(problem.basis, PlaneStrainBasis):
        return None
    G = equations.base_columns(problem, fit.chains)
    S = equations.signatures(problem, fit.chains, fit.c, fit.additions) if fit.additions else G[:, :0]
    others = orthonormal(np.concatenate([G[:, :-1], S], axis=1))
    outside = G[:, -1] - others @ (others.T @ G[:, -1])
    return float(fit.c[-1]), float(np.sqrt(max(1.0, fit.reduced_chi_square)) / np.linalg.norm(outside))
