"""Errors of a model on the training equations, or on those held out, and when one model is better than another.

In: a `Problem`, a base and effects. Out: `Misfit`; of several models the deviance, minus twice the log-likelihood.

What was measured are displacements, and the equations are functions of them that follow the model: one that is stiffer, as rubber that relaxes is at an instant, makes larger errors of the same noise. The likelihood is
that of the displacements, so that the determinant of what a model makes of them does not enter. With r the variance of its noise, what is left beyond noise, D, is not in proportion to r and is the same for all. In
weights of its own the variance of residuals is

    (min(r, 2 r_base) + D) / r,   D the smallest of all models.

An effect makes at most twice the noise of the base, or one that is stiff and not there would make as much as it likes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.problem import Part, Problem
from calibrate.effects.chain import Additions
from calibrate.equations.weights import Weights

Array = NDArray[np.float64]
AMPLIFIED = 2.0  # variance of noise in the equations, that an effect may add to


@dataclass(frozen=True)
class Misfit:
    """Errors of a model on some equations.

    force: norm of force errors over norm of measured forces, NaN where no force is among the equations. field: norm of the virtual
    work that fields without a load leave, over the same. chi_square: whitened squared residual an equation; rows: equations.
    noise: what the squares of force and field are expected to be from noise alone. log_determinant: of the covariance behind
    chi_square, an equation.
    """

    force: float
    field: float
    chi_square: float
    rows: int
    noise: tuple[float, float] = (0.0, 0.0)
    log_determinant: float = 0.0

    def outside_noise(self, noise: tuple[float, float]) -> tuple[float, float]:
        """Squares of force and field minus those of noise."""
        return self.force**2 - noise[0], self.field**2 - noise[1]

    def to_dict(self) -> dict[str, Any]:
        """As files hold it."""
        return {
            "force_error": self.force,
            "field_error": self.field,
            "chi_square_per_equation": self.chi_square,
            "equations": self.rows,
        }


def misfit(problem: Problem, c: Array, additions: Additions, held: bool, beside_own: bool = False) -> Misfit | None:
    """Errors of coefficients c (n,) and effects on the training equations, or on those held out (None where there are none). beside_own: force and field without what each of several
    tests has for itself."""
    parts = [(part, part.held if held else part.train) for part in problem.parts]
    sums = [_sums(part, weights, c, additions, beside_own) for part, weights in parts if weights.size]
    if not sums:
        return None
    force, field, measured, chi, determinant, forces, n = map(float, np.sum([one.numbers for one in sums], axis=0))
    noise = np.sum([one.noise for one in sums], axis=0)
    size = max(measured, 1e-300)
    of_force = float(np.sqrt(force / size)) if forces else float("nan")
    expected = float(noise[0] / size), float(noise[1] / size)
    return Misfit(of_force, float(np.sqrt(field / size)), chi / n, int(n), expected, determinant / n)


@dataclass(frozen=True)
class _Sums:
    """numbers (7,): squares of force, field and measured forces, chi-square, log determinant, force equations, equations.
    noise (2,): variance of the noise in forces and fields."""

    numbers: Sequence[float]
    noise: Sequence[float]


def _sums(part: Part, weights: Weights, c: Array, additions: Additions, beside_own: bool) -> _Sums:
    """Sums over the equations of one experiment."""
    whole, load = part.own_residual(c, part.valid(additions)), np.nan_to_num(part.system.recorded)
    r = part.beside_own_effects(whole) if beside_own else whole
    loaded = np.broadcast_to(np.tile(part.system.fields.boundary >= 0, 2), r.shape)
    forces = weights.rows & loaded & ~part.system.level_equation
    # where only fields without a load are used, errors are relative to all forces
    of_size = forces if forces.any() else np.isfinite(part.system.recorded) & loaded
    numbers = (
        float((r[forces] ** 2).sum()),
        float((r[weights.rows & ~loaded] ** 2).sum()),
        float((load[of_size] ** 2).sum()),
        float((weights(whole) ** 2).sum()),
        weights.log_determinant,
        float(forces.sum()),
        float(weights.size),
    )
    return _Sums(
        numbers,
        (float(weights.variance[loaded & ~part.system.level_equation].sum()), float(weights.variance[~loaded].sum())),
    )


def is_larger(before: Misfit, after: Misfit | None, worse: float) -> bool:
    """Whether errors grow by more than the factor `worse` and what noise may make of them."""
    if after is None:
        return False
    own = after.outside_noise(_noise_of(before, after))
    usual = before.outside_noise(before.noise)
    return bool(np.nansum(own) > worse**2 * max(np.nansum(usual), 0.0) + sum(before.noise))


def is_better(before: Misfit, after: Misfit) -> bool:
    """Whether an error falls, outside noise, as some effects amplify it; and the model is likelier."""
    own, usual = after.outside_noise(_noise_of(before, after)), before.outside_noise(before.noise)
    left = np.array([before.chi_square, after.chi_square])
    old, new = left / residual_variances(left, [1.0, amplification(before, after)])
    return bool(new < old) and any(a < b for a, b in zip(own, usual, strict=True))


def amplification(before: Misfit, after: Misfit) -> float:
    """Variance of the noise that a model makes of the same displacements, over that of the model before."""
    return float(np.exp(after.log_determinant - before.log_determinant))


def _noise_of(before: Misfit, after: Misfit) -> tuple[float, float]:
    """Noise that the errors of a model are allowed: its own, but no more than `AMPLIFIED` times that of the model before.

    A stiff effect makes the noise in its own forces as large as it likes.
    """
    force, field = (min(own, AMPLIFIED * usual) for own, usual in zip(after.noise, before.noise, strict=True))
    return force, field


def residual_variances(chi_square: ArrayLike, noise: ArrayLike, of_base: float = 1.0) -> Array:
    """(m,) of models, over the noise of each. chi_square (m,): of each, an equation; noise (m,), of_base: variance of the noise that they and the base make, in any unit."""
    left, noise = np.asarray(chi_square, float), np.asarray(noise, float)
    allowed = np.minimum(noise, AMPLIFIED * of_base)
    return np.asarray((allowed + max(float((noise * left - allowed).min()), 0.0)) / noise)


def deviances(fits: Sequence[Fit]) -> Array:
    """(m,) of fits of the same equations, of what no I1 energy can absorb. The first is the base."""
    noise = np.exp([(fit.log_determinant - fits[0].log_determinant) / fit.n_rows for fit in fits])
    return np.array([fit.free_loss for fit in fits]) / residual_variances([f.reduced_chi_square for f in fits], noise)
