"""Functions that the base models of a diagnosis are non-negative sums of: psi_1 as splines of sqrt(I1 - 3).

In: a basis and the largest I1 - 3 of the fitted increments. Out: columns of coefficients, and a prior on them: rubber is nearly neo-Hookean where
strains are small, and the further they reach, the more psi_1 may differ from its value at rest. Without it, a base of one ramp takes up relaxation, softening
and whatever else grows with the load.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from calibrate.equations.basis import DEGREE, PlaneStrainBasis, SingleBasis, Spline, energy_basis, polyconvex
from calibrate.equations.equilibrium import Equilibrium
from calibrate.equations.reduction import Assembled
from calibrate.fitting.least_squares import orthonormal

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SPLINES = 24  # of the base
# prior of psi_1 over its value at rest, a function of q = sqrt(I1 - 3): standard deviations of its slope at rest, and of how much the slope changes over a unit
# of q; q is 0.17 at a strain of 10 %, 1.4 at a stretch of 2
SLOPE, CURVATURE = 0.5, 0.5


def first_guess(tests: Sequence[tuple[Assembled, Mask]]) -> Array:
    """Coefficients (n_functions,) of neo-Hooke with the mean of the moduli that fit each experiment's forces, of those that have any. tests: with the equations (t, 2 v) fitted."""
    loaded = (
        (a, used)
        for a, used in tests
        if np.isfinite(a.system.loads[:, np.tile(a.system.fields.boundary >= 0, 2)]).any()
    )
    return np.mean([a.first_guess(used) for a, used in loaded], axis=0)


def trained_top(system: Equilibrium, mask: Mask) -> float:
    """Largest I1 - 3 in the increments used for fitting."""
    F = system.isochoric_gradients[mask.any(axis=1)]
    return float(polyconvex(F)[0][..., 0].max())


def base_cone(basis: SingleBasis | PlaneStrainBasis, base: str, top: float, n: int = SPLINES) -> Array:
    """(n_functions, n): psi_1 of which the base models are non-negative sums; constant beyond I1 - 3 = top.

    Cubic splines in sqrt(I1 - 3); fewer than four functions are straight lines between n points, and one is neo-Hooke. In plane
    strain one more column, the bulk modulus.
    """
    if isinstance(basis, PlaneStrainBasis):
        energy = energy_basis(basis)
        assert isinstance(energy, SingleBasis)
        return scipy.linalg.block_diag(base_cone(energy, base, top, n), np.eye(1))
    x = basis.site_inputs[:, basis.k]
    along = np.sqrt(np.minimum(x / top, 1.0))
    values = Spline(n).matrix(along) if n > DEGREE else _hats(along, n)
    if base == "convex":
        values = np.cumsum(values[:, ::-1], axis=1)[:, ::-1]
    sites = np.zeros((n, len(x), 2))
    sites[:, :, basis.k] = values.T
    return basis.interpolation @ sites.reshape(n, -1).T


def _hats(x: Array, n: int) -> Array:
    """(m, n): straight lines between n even points of [0, 1]; 1 everywhere where there is but one."""
    if n == 1:
        return np.ones((len(x), 1))
    return np.stack([np.interp(x, np.linspace(0, 1, n), row) for row in np.eye(n)], axis=1)


def prior_rows(basis: SingleBasis | PlaneStrainBasis, c: Array, top: float, stiffness: float) -> Array:
    """(m, n_functions), 1 / MPa: rows P of a normal prior on coefficients c, -2 ln p(c) = |P c|^2 up to a constant.

    psi_1 over its value at rest is an integrated Wiener process of q with a slope at rest of its own (Wahba 1978), by differences between the sites of the splines up to
    I1 - 3 = top. stiffness: psi_1 at rest, MPa; where the coefficients c (n_functions,) at hand are larger, as they are near locking, changes may be as many times
    larger. None for the bulk modulus.
    """
    energy = energy_basis(basis)
    q = np.sqrt(energy.site_inputs[:, 0])
    slopes = (np.eye(len(q))[1:] - np.eye(len(q))[:-1]) / np.diff(q)[:, None]
    bends = np.diff(slopes, axis=0) / np.sqrt(0.5 * (q[2:] - q[:-2]))[:, None]
    values = np.maximum(c[: len(q)], stiffness)
    scale = np.concatenate([0.5 * (values[:1] + values[1:2]), (values[:-2] + values[1:-1] + values[2:]) / 3])
    rows = np.concatenate([slopes[:1] / SLOPE, bends / CURVATURE]) / scale[:, None]
    rows = rows[np.append(0.0, q[1:-1]) < np.sqrt(top)]
    return np.pad(rows, ((0, 0), (0, basis.n_functions - len(q))))


def on_cone(rows: Array, cone: Array) -> Array:
    """As many rows (r, n) as are independent on a cone (n, k), which weigh its coefficients as the rows (m, n) do: others would count as degrees of freedom, and hold nothing."""
    return orthonormal(rows @ cone).T @ rows
