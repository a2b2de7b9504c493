r"""The rule by which a replay judges a model, fixed before any trial or sheet was judged by it.

In: rows of measured minus replayed, of the base and of the final model, each at its own level, and the covariance V of the final model's errors.
Out: `Judgement`.

**Within its band**: with the rows e that were held out, forces and smooth fields each by themselves,

.. math:: \chi^2 = e^T V^{-1} e

is compared with Fisher's F, as if the noise had been estimated (`residual_tests.ChiSquare`). The model is outside of its band where twice the smaller of
both p is below `LEVEL` (Bonferroni).

**Worse than the base**: by what both replays have in common, noise and the errors of the mesh, of covariance V_n. With r the whitened residuals of both and d their difference, a right model has
|r_1|^2 - |r_0|^2 normal with mean -|d|^2 and standard deviation 2 |d|. Worse is what is above zero and above what happens once in a hundred.
It is also worse where its force error grows by more than noise, and is above the error of a load cell of class 0.5 (ISO 7500-1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from calibrate.diagnosis.replayed.band import discretisation
from calibrate.diagnosis.replayed.observations import Observations, ReplayErrors
from calibrate.diagnosis.residual_tests import ChiSquare
from calibrate.effects.effect import FORMULA_ERROR
from calibrate.equations.noise_covariance import cholesky_factor

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
LEVEL = 0.01  # of the test against the band
ONE_IN_A_HUNDRED = 2.326  # standard deviations, one-sided
LOAD_CELL = 0.005  # of the forces
FAR = 2.0  # factor on what a replay misses of what was fitted, above which it is no rival


@dataclass(frozen=True)
class Judgement:
    """force, field: chi-squares of what was held out against the band (None where there is no such row). worse: than the base."""

    force: ChiSquare | None
    field: ChiSquare | None
    worse: bool

    @property
    def p_value(self) -> float:
        """Of both tests together."""
        tests = [test for test in (self.force, self.field) if test is not None]
        return min(1.0, max(len(tests), 1) * min((test.p_value for test in tests), default=1.0))

    @property
    def outside(self) -> bool:
        """Whether the replay leaves its band."""
        return self.p_value < LEVEL

    @property
    def speaks_against(self) -> bool:
        """Whether the model is no explanation."""
        return self.outside or self.worse


def judge(
    base: Observations,
    final: Observations,
    covariance: Array,
    noise_is_known: bool = True,
) -> Judgement:
    """covariance (N, N): of the residuals of the final model, see `band`. Where the noise is not known, nothing is outside of a band, and worse is what
    has a larger force error than the base, above that of a load cell."""
    where = final.judged & final.judging
    if not where.any():
        return Judgement(None, None, False)
    if not noise_is_known:
        old, new = (ReplayErrors.of(rows, where).force for rows in (base, final))
        return Judgement(None, None, bool(new > max(old, LOAD_CELL)))
    force, field = (_chi_square(final.residual, covariance, where & kind) for kind in (final.is_force, ~final.is_force))
    return Judgement(force, field, base is not final and is_worse(base, final, where))


def is_worse(base: Observations, final: Observations, where: Mask) -> bool:
    """Whether the final model predicts rows (N,) worse than the base, beyond noise and the errors of the mesh."""
    covariance = final.noise + discretisation(final)
    lower = cholesky_factor(covariance[np.ix_(where, where)])
    before, after = (scipy.linalg.solve_triangular(lower, rows.residual[where], lower=True) for rows in (base, final))
    apart = float(np.linalg.norm(after - before))
    rise = float(after @ after - before @ before)
    if rise > max(0.0, 2 * ONE_IN_A_HUNDRED * apart - apart**2):
        return True
    old, new = (ReplayErrors.of(rows, where).force for rows in (base, final))
    forces = where & final.is_force
    size = float((final.measured[forces] ** 2).sum())
    noise = float(np.diag(covariance)[forces].sum()) / size if size > 0 else 0.0
    return bool(new > LOAD_CELL and new**2 > max(old**2 - noise, 0.0) + 2 * noise)


def misses_more(one: ReplayErrors, other: ReplayErrors, noise: float) -> bool:
    """Whether a model misses forces or fields by more than another by an amount that matters: forces by more than the error of a load cell, fields by more than noise, mm,
    of a displacement adds to the other's error."""
    return bool(one.force > max(other.force, LOAD_CELL) or one.field**2 > other.field**2 + noise**2)


def is_rival(one: Observations, final: Observations) -> bool:
    """Whether a competing explanation, replayed, misses what was fitted by no more than `FAR` times what the final model does: forces, of which either may miss the error of a formula, and fields. Equations of equilibrium take measured strains,
    with which a model may agree whose own deformation is another."""
    where = final.may_judge(~final.held)
    mine, own = (ReplayErrors.of(rows, where) for rows in (one, final))
    return not (mine.force > FAR * max(own.force, FORMULA_ERROR) or mine.field > FAR * own.field)


def _chi_square(residual: Array, covariance: Array, where: Mask) -> ChiSquare | None:
    if not where.any():
        return None
    white = scipy.linalg.solve_triangular(
        cholesky_factor(covariance[np.ix_(where, where)]), residual[where], lower=True
    )
    return ChiSquare(float(white @ white), int(where.sum()))
