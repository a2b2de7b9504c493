"""Chi-square tests of the residual that need no candidate: by place and time, and on equations held out.

In: a `Problem`, in part a `Fit`. Out: directions of the whitened residual (N, k), and the prediction test of Chow (1960).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy import stats

from calibrate.diagnosis.problem import Part, Problem
from calibrate.effects.chain import Additions, Chain
from calibrate.equations.discretisation_error import REMAINDER
from calibrate.equations.weights import Weights
from calibrate.fitting.least_squares import orthonormal, residual_outside

Array = NDArray[np.float64]
PLACE_COSINES, TIME_COSINES = 3, 4  # over each side of a specimen, over its increments
SCALE_ERROR = 0.05  # relative, of the standard deviation of the noise
DOUBTFUL = 0.1  # variance of a discrepancy over that of noise, from which a direction says nothing of noise


class ChiSquare(NamedTuple):
    """A chi-square and its degrees of freedom."""

    value: float
    degrees: int

    @property
    def p_value(self) -> float:
        """Probability of one as large from noise alone, whose standard deviation is known to `SCALE_ERROR`: of Fisher's F, as if that had
        been estimated from so many values."""
        n = max(self.degrees, 1)
        return float(stats.f.sf(self.value / n, n, 0.5 / SCALE_ERROR**2))


class Misfits(NamedTuple):
    """Three tests of the residual: of all equations; of the part that no discretisation error could change; of the part that varies
    slowly over specimen and increments, see `smooth_disturbances`."""

    everything: ChiSquare
    certain: ChiSquare
    smooth: ChiSquare

    @property
    def p_value(self) -> float:
        """Probability of a misfit as large, if there is nothing but noise, from all three (Bonferroni).

        The weights allow for discretisation errors of a size that they seldom have, so that `everything` alone is too
        forgiving; an effect that acts as these errors do is not seen in `certain`; a small one that acts everywhere alike
        is lost in the noise of many equations, but not in `smooth`.
        """
        return min(1.0, 3 * min(test.p_value for test in self))


def misfits(problem: Problem, residual: Array, columns: Array) -> Misfits:
    """Of a fit to the problem, with its whitened residual (N,) and orthonormal columns (N, k), what it can adjust."""
    uncertain = problem.padded(uncertain_directions([part.train for part in problem.trained]))
    smooth = smooth_disturbances(problem)
    smooth = orthonormal(smooth - columns @ (columns.T @ smooth))
    return Misfits(
        ChiSquare(*residual_outside(residual, columns)),
        ChiSquare(*residual_outside(residual, np.concatenate([columns, uncertain], axis=1))),
        ChiSquare(float(((smooth.T @ residual) ** 2).sum()), smooth.shape[1]),
    )


def kinematic_errors(problem: Problem, chains: Sequence[Chain], c: Array, additions: Additions) -> list[Array]:
    """Whitened changes (N,) of the residual: of the base when the triangles are taken for linear again, or what a twin may be wrong by; and those of `formula_errors`.

    Each is a standard deviation of what the recovered kinematics still miss. Its effect on an amplitude is added to that of
    noise, because errors of neighbouring edges are less independent than the weights assume, and those of the effect's own
    gradients are not among them.
    """
    of_base = [p.assembled.linear_change @ c if p.twin is None else REMAINDER * p.twin for p in problem.trained]
    return [problem.whiten(of_base), *formula_errors(problem, chains, c, additions)]


def formula_errors(problem: Problem, chains: Sequence[Chain], c: Array, additions: Additions) -> list[Array]:
    """Whitened changes (N,) of the residual: of effects when gradients at the nodes, which they continue to an edge or differentiate again, are means of those around, or what the twin knows
    of them is wrong; and of effects when their formulas are wrong by the next order that is left out. Both are in proportion to the effects."""
    found = []
    for change in (Chain.with_mean_gradients, Chain.with_doubted_formulas) if additions else ():
        found.append([change(chain).residual(c, additions) - chain.residual(c, additions) for chain in chains])
    return [problem.whiten(one) for one in found]


def smooth_disturbances(problem: Problem) -> Array:
    """Whitened disturbances (N, k) of no particular kind that vary slowly over a specimen and its increments.

    Forces on every loaded boundary, and body forces as cosines over the specimen; both as cosines over the increments.
    """
    return problem.padded(scipy.linalg.block_diag(*[part.train(_smooth_forces(part)).T for part in problem.trained]))


def rough_dispersion(problem: Problem, r: Array) -> float:
    """Mean square of the part of a residual (N,) that no smooth disturbance explains, at least 1: of noise, and not of an effect that the model lacks."""
    n = len(r) - len(problem.prior)
    left, degrees = residual_outside(r[:n], smooth_disturbances(problem)[:n])
    return max(1.0, left / max(degrees, 1))


def _smooth_forces(part: Part) -> Array:
    """Nodal forces (k, t, 2 v) on the virtual fields of one experiment."""
    boundary = part.system.fields.boundary
    loaded = np.array([boundary == b for b in range(len(part.experiment.loaded))], float)
    return _over_increments(part, np.concatenate([_body_cosines(part, PLACE_COSINES), loaded]))


def _body_cosines(part: Part, n: int) -> Array:
    """Forces (n^2, v) that body forces as cosines over the specimen make on every virtual field."""
    system, points = part.system, part.experiment.points
    nodal = np.bincount(part.experiment.triangles.ravel(), np.repeat(system.areas / 3, 3), len(points))
    size = np.asarray(system.fields.values.T @ nodal).ravel()
    total = np.asarray(system.fields.values.sum(axis=0)).ravel()
    x = (np.asarray(system.fields.values.T @ points) / total[:, None] - points.min(axis=0)) / np.ptp(points, axis=0)
    k = np.arange(n)
    cosines = [np.cos(np.pi * np.multiply.outer(x[:, i], k)) for i in range(2)]
    return np.einsum("v,vk,vl->klv", size, *cosines).reshape(-1, len(size))


def _over_increments(part: Part, places: Array) -> Array:
    """Forces (p, v) as cosines over the increments, in both directions (k, t, 2 v)."""
    n, v = len(part.system.loads), places.shape[1]
    t = (np.arange(n) + 0.5) / n
    times = np.cos(np.pi * np.multiply.outer(np.arange(min(TIME_COSINES, n)), t))
    values = np.einsum("st,ij,pv->psijtv", times, np.eye(2), places)
    return np.moveaxis(values, -2, -3).reshape(-1, n, 2 * v)


def uncertain_directions(weights: Sequence[Weights]) -> Array:
    """Directions (N, k) in which a discretisation error may be as large as noise, for rows of several parts."""
    return scipy.linalg.block_diag(*[w.uncertain_directions(DOUBTFUL) for w in weights])


def prediction_test(problem: Problem, c: Array, additions: Additions) -> ChiSquare | None:
    """How much |r|^2 rises beyond the noise when the equations held out are fitted too, and for how many of them.

    Chi-square distributed with as many degrees of freedom if the model (coefficients c (n,) and effects) predicts them within
    noise, the uncertainty of its parameters included (Chow 1960). Coefficients that only the equations held out see are
    free. None: nothing is held out, or nothing that what was fitted predicts.
    """
    used = [part for part in problem.parts if part.held.size]
    if not used:
        return None
    parts = [*problem.trained, *(part for part in used if not part.train.size)]
    whole = [(part, _columns(problem, part, c, additions), part.residual(c, part.valid(additions))) for part in parts]
    train = [(part.train, values, r) for part, values, r in whole if part.train.size]
    every = [
        (weights, values, r)
        for part, values, r in whole
        for weights in ([part.together()] if part.together else [part.train, part.held])
        if weights.size
    ]
    (before, n_before), (after, n_after) = (_left(some) for some in (train, every))
    return ChiSquare(max(after - before, 0.0), n_after - n_before) if n_after > n_before else None


def _columns(problem: Problem, part: Part, c: Array, additions: Additions) -> Array:
    """Derivatives (n + k, t, 2 v) of the residual of one experiment by base, amplitudes and shapes; zero of effects of other tests."""
    own = part.valid(additions)
    G = np.array([part.system.matrix(problem.basis, F) for F in part.system.deformation_gradients])
    if not additions:
        return np.moveaxis(G, -1, 0)
    here = np.concatenate([np.full(len(a.amplitudes) + len(a.shape), a in own) for a in additions])
    S = np.zeros((len(here), *G.shape[:2]))
    if own:
        S[here] = part.chain.jacobian(c, own)
    return np.concatenate([np.moveaxis(G, -1, 0), S])


def _left(parts: Sequence[tuple[Weights, Array, Array]]) -> tuple[float, int]:
    """Chi-square and degrees of freedom that columns (k, t, 2 v) and uncertain directions leave of the residuals (t, 2 v) of several
    experiments."""
    columns = np.concatenate([weights(values).T for weights, values, _ in parts])
    residual = np.concatenate([weights(r) for weights, _, r in parts])
    doubt = uncertain_directions([weights for weights, _, _ in parts])
    return residual_outside(residual, np.concatenate([columns, doubt], axis=1))
