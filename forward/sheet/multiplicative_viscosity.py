r"""Finite viscoelasticity with a multiplicative split F = Fe Fi (Reese and Govindjee 1998): a step at many points at once, in plane stress.

A branch is neo-Hookean and incompressible, and so is its flow: with :math:`b = F A F^T, A = C_i^{-1}, \det b = 1`,

.. math:: \tau = \mu \operatorname{dev} b, \qquad -\tfrac12 (L_v b) b^{-1} = \tau / (2 \eta), \qquad \eta = \mu t_r .

A step dt flows for dt / 2 at the F before it, and for dt / 2 at the F after it (Strang 1968). At one F the exponential map keeps the principal axes of the trial
state :math:`b_{tr} = F A F^T`, and the principal logarithmic strains :math:`\epsilon_k`, whose sum is zero, follow over a time s from

.. math:: \epsilon_k + \frac{s}{2 t_r} \Big(e^{2 \epsilon_k} - \tfrac13 \sum_m e^{2 \epsilon_m}\Big) = \epsilon_k^{tr},

the minimum of a strictly convex function, by Newton's method. That is of first order in s; twice that of two halves less that of the whole is of second, as the step is.
P33 = 0 of the whole law leaves :math:`\mu (b - b_{33} 1)` of a branch in the plane.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from forward.errors import MaterialError

Array = NDArray[np.float64]
ITERATIONS, TOLERANCE = 60, 1e-8  # of a strain; the error of a converged step of Newton is its square
EQUAL = 1e-5  # relative difference of two eigenvalues below which their limit is taken: both errors are then 1e-10


@dataclass(frozen=True)
class MaxwellBranch:
    """A spring of shear modulus mu, MPa, in series with a dashpot; tau: its relaxation time at small strain, s. Raises `MaterialError`."""

    mu: float
    tau: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.mu) and math.isfinite(self.tau) and self.mu >= 0 and self.tau > 0):
            raise MaterialError(
                f"viscous branch: mu = {self.mu} MPa, tau = {self.tau} s; give finite numbers, mu >= 0, tau > 0"
            )


@dataclass(frozen=True)
class BranchStep:
    """End of a step: first Piola-Kirchhoff stress P (..., 2, 2), MPa, dP/dF (..., 2, 2, 2, 2), and the in-plane A (..., 2, 2)."""

    stress: Array
    tangent: Array
    past: Array


def flowed(branch: MaxwellBranch, F: Array, past: Array, duration: float) -> Array:
    """In-plane A (..., 2, 2) after `duration`, s, at F (..., 2, 2), from `past` (..., 2, 2); NaN where no strains are found."""
    F, past = _components(F), _components(past)
    squares, axes = _principal(_pushed(F, past))
    strains, _, found = _flow(np.log(squares) / 2, duration / (2 * branch.tau))
    strains[:, ~found] = np.nan
    return _points(_pushed(_inverse(F), _tensor(np.exp(2 * strains), axes)))


def step(branch: MaxwellBranch, F: Array, past: Array, duration: float) -> BranchStep:
    """From `past`, the in-plane A (..., 2, 2) before the step, `flowed` for half of it, to F (..., 2, 2), in `duration`, s.

    Where F is not finite or no strains are found the stress is NaN, so that the step fails.
    """
    F, past = _components(F), _components(past)
    finite = np.isfinite(F).all(axis=(0, 1)) & (_determinant(np.nan_to_num(F)) != 0)
    F = np.where(finite, F, np.eye(2).reshape(2, 2, *[1] * finite.ndim))
    squares, axes = _principal(_pushed(F, past))
    strains, slopes, found = _flow(np.log(squares) / 2, duration / (4 * branch.tau))
    e, e3 = np.exp(2 * strains), np.exp(-2 * strains.sum(axis=0))
    kirchhoff = branch.mu * (e - e3)
    stiffness = branch.mu * (e[:, None] * slopes + e3 * slopes.sum(axis=0)) / squares
    inverse = _inverse(F)
    tau = _tensor(kirchhoff, axes)
    stress = np.einsum("ik...,jk...->ij...", tau, inverse)
    change = _derivative_by_trial(kirchhoff, stiffness, squares, axes)
    by_F = np.einsum("ikmq...,qn...->ikmn...", change, 2 * np.einsum("qr...,rn...->qn...", F, past))
    tangent = np.einsum("ikmn...,jk...->ijmn...", by_F, inverse) - np.einsum("in...,jm...->ijmn...", stress, inverse)
    stress[:, :, ~(finite & found)] = np.nan
    return BranchStep(_points(stress), _points(tangent, 4), _points(_pushed(inverse, _tensor(e, axes))))


def _flow(trial: Array, c: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    """In-plane strains (2, ...) from those of the trial state, their derivatives (2, 2, ...) by them, and whether they were found."""
    whole, by_whole, found = _implicit(trial, c)
    middle, by_middle, first = _implicit(trial, c / 2)
    end, by_end, second = _implicit(middle, c / 2)
    slopes = 2 * np.einsum("ij...,jk...->ik...", by_end, by_middle) - by_whole
    return 2 * end - whole, slopes, found & first & second


def _implicit(trial: Array, c: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    """The same in one step, of first order."""
    x, y = trial
    change = np.full_like(x, np.inf)
    for _ in range(ITERATIONS):
        ex, ey, ez = np.exp(2 * x), np.exp(2 * y), np.exp(-2 * (x + y))
        mean = (ex + ey + ez) / 3
        to_x, to_y = 2 * c / 3 * (ex - ez), 2 * c / 3 * (ey - ez)
        J = np.stack([1 + 2 * c * ex - to_x, -to_y, -to_x, 1 + 2 * c * ey - to_y]).reshape(2, 2, *x.shape)
        slopes = _inverse(J)
        if change.max(initial=0.0) <= TOLERANCE:
            break
        off_x, off_y = x + c * (ex - mean) - trial[0], y + c * (ey - mean) - trial[1]
        dx, dy = slopes[0, 0] * off_x + slopes[0, 1] * off_y, slopes[1, 0] * off_x + slopes[1, 1] * off_y
        x, y = x - dx, y - dy
        change = np.maximum(np.abs(dx), np.abs(dy))
    return np.stack([x, y]), slopes, change <= TOLERANCE


def _derivative_by_trial(values: Array, stiffness: Array, squares: Array, axes: Array) -> Array:
    """d tau_ij / d b_kl (2, 2, 2, 2, ...) of an isotropic function: values (2, ...), their derivatives (2, 2, ...) by squares (2, ...)."""
    gap = squares[1] - squares[0]
    equal = gap <= EQUAL * squares[1]
    limit = (stiffness[0, 0] - stiffness[0, 1] + stiffness[1, 1] - stiffness[1, 0]) / 2
    turn = np.where(equal, limit, (values[1] - values[0]) / np.where(equal, 1.0, gap))
    dyads = np.einsum("ia...,ja...->aij...", axes, axes)
    along = np.einsum("akl...,aij...->ijkl...", np.einsum("ab...,bkl...->akl...", stiffness, dyads), dyads)
    mixed = np.einsum("i...,j...->ij...", axes[:, 0], axes[:, 1])
    mixed = (mixed + np.swapaxes(mixed, 0, 1)) / 2
    return along + np.einsum("ij...,kl...->ijkl...", 2 * turn * mixed, mixed)


def _principal(b: Array) -> tuple[Array, Array]:
    """Principal values (2, ...), the smaller first, and axes (2, 2, ...), in columns, of positive definite tensors (2, 2, ...)."""
    difference, shear = (b[0, 0] - b[1, 1]) / 2, (b[0, 1] + b[1, 0]) / 2
    larger = (b[0, 0] + b[1, 1]) / 2 + np.hypot(difference, shear)
    angle = np.arctan2(shear, difference) / 2
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([_determinant(b) / larger, larger]), np.stack([-sin, cos, cos, sin]).reshape(b.shape)


def _components(tensors: Array) -> Array:
    """(2, 2, ...) of (..., 2, 2): sums over few components of many points are fast in this order."""
    return np.ascontiguousarray(np.moveaxis(tensors, (-2, -1), (0, 1)))


def _points(components: Array, order: int = 2) -> Array:
    """Back, of a tensor of an order."""
    return np.ascontiguousarray(np.moveaxis(components, range(order), range(-order, 0)))


def _pushed(F: Array, A: Array) -> Array:
    """F A F^T."""
    return np.einsum("ik...,jk...->ij...", np.einsum("ik...,kj...->ij...", F, A), F)


def _determinant(A: Array) -> Array:
    return A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]


def _inverse(A: Array) -> Array:
    """Of tensors (2, 2, ...)."""
    return np.stack([A[1, 1], -A[0, 1], -A[1, 0], A[0, 0]]).reshape(A.shape) / _determinant(A)


def _tensor(values: Array, axes: Array) -> Array:
    """Of principal values (2, ...)."""
    return np.einsum("ia...,ja...->ij...", values * axes, axes)
