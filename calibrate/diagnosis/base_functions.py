"""Functions that the base models of a diagnosis are non-negative sums of: psi_1 as splines of sqrt(I1 - 3).

In: a basis and the largest I1 - 3 of the fitted increments. Out: columns of coefficients, and a smoothness prior on them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from calibrate.equations.basis import DEGREE, PlaneStrainBasis, SingleBasis, Spline, energy_basis, polyconvex
from calibrate.equations.equilibrium import Equilibrium
from calibrate.equations.reduction import Assembled

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SPLINES = 24  # of the base
STIFFENING = 0.1  # prior: by how much psi_1 may grow from one spline to the next, over its value at rest


def first_guess(assembled: Sequence[Assembled]) -> Array:
    """Coefficients (n_functions,) of neo-Hooke with the mean of the moduli that fit each experiment's forces, of those that have any."""
    loaded = (a for a in assembled if np.isfinite(a.system.loads[:, np.tile(a.system.fields.boundary >= 0, 2)]).any())
    return np.mean([a.first_guess() for a in loaded], axis=0)


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


def smoothness(base: str, n: int, bulk: int = 0) -> Array:
    """(n - 1, n + bulk): weights to the changes of psi_1 from one spline to the next, and to no bulk modulus."""
    if bulk:
        return np.pad(smoothness(base, n), ((0, 0), (0, bulk)))
    return np.eye(n)[1:] if base == "convex" else np.eye(n)[1:] - np.eye(n)[:-1]
