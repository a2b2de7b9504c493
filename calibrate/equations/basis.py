"""Fixed spline bases for the energy derivatives: what makes every quadratic loss a small quadratic form.

The displacements are data, so the invariants are fixed, and the stress P = psi_1 dJ1/dF + psi_2 dJ2/dF with
J1 = I1, J2 = I2^(3/2) is linear in psi_k = d psi / dJ_k. Writing psi_k in a cubic B-spline basis makes the
residual linear in a few coefficients, however fine the mesh.

- one input: functions of s = sqrt((J - J(I)) / range), uniform knots in s (dense where the data are);
- both inputs: tensor products in the Hencky norm and the Lode angle of the logarithmic strain;
- in plane strain: either of them at the isochoric part, and the bulk modulus as one more coefficient.

Any model enters by interpolation: `coefficients(psi at sites)`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import jax
import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.equations import isochoric as plane_strain
from calibrate.equations import kinematics
from calibrate.equations.inputs import INPUT_SETS, REFERENCE, hencky_to_lode, lode_to_hencky, polyconvex
from calibrate.equations.splines import DEGREE, Spline

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SingleBasis:
    """psi_k(J_k) for one input k (0: J1, 1: J2); `top`: largest J_k - J_k(I) covered."""

    k: int
    top: float
    n: int = 32

    @cached_property
    def spline(self) -> Spline:
        """The splines of s, on [0, 1]."""
        return Spline(self.n)

    @property
    def n_functions(self) -> int:
        """Number of coefficients."""
        return self.n

    @property
    def input_tops(self) -> tuple[float, float]:
        """Largest J_k - J_k(I) covered."""
        return self.top, self.top

    @cached_property
    def site_inputs(self) -> Array:
        """(J1, J2) - rest (n, 2) at which a model is sampled; the other input is not used (NaN)."""
        inputs = np.full((self.n, 2), np.nan)
        inputs[:, self.k] = self.top * self.spline.sites**2
        return inputs

    @cached_property
    def interpolation(self) -> Array:
        """(n_functions, n_sites * 2): psi at the sites, [site, k] raveled, to coefficients."""
        inverse = np.linalg.inv(self.spline.matrix(self.spline.sites))
        full = np.zeros((self.n, self.n, 2))
        full[:, :, self.k] = inverse
        return full.reshape(self.n, -1)

    def local(self, F: Array) -> tuple[Array, NDArray[np.int64]]:
        """Stress of the functions that are not zero: P (m, q, 2, 2) at F (m, 2, 2), and their columns (m, q)."""
        J, dJ = polyconvex(F)
        values, first = self.spline.local(self._s(J))
        return (
            values[:, :, None, None] * dJ[:, None, self.k],
            first[:, None] + np.arange(DEGREE + 1),
        )

    def second(self, F: Array, c: Array) -> tuple[Array, Array]:
        """psi_k (m, 2) and d psi_k / dJ_l (m, 2, 2) at F (m, 2, 2), of coefficients c (n,)."""
        J, _ = polyconvex(F)
        s = self._s(J)
        psi, hessian = np.zeros_like(J), np.zeros((*J.shape, 2))
        psi[:, self.k] = self.spline.matrix(s) @ c
        hessian[:, self.k, self.k] = self.spline.matrix(s, 1) @ c / (2 * self.top * np.maximum(s, 0.02))
        return psi, hessian

    def _s(self, J: Array) -> Array:
        return np.sqrt(np.clip(J[:, self.k] / self.top, 0.0, 1.0))


@dataclass(frozen=True)
class TensorBasis:
    """psi_1 and psi_2 as tensor splines in Hencky norm (0 to `top`) and Lode angle (-pi/6 to pi/6).

    input_tops: largest J_k - J_k(I) of the data; the norm and angle of many sites lie far beyond.
    """

    top: float
    n_norm: int = 14
    n_angle: int = 7
    input_tops: tuple[float, float] = (np.inf, np.inf)

    @cached_property
    def splines(self) -> tuple[Spline, Spline]:
        """Of the Hencky norm, and of the Lode angle."""
        return Spline(self.n_norm, 0.0, self.top), Spline(self.n_angle, -np.pi / 6, np.pi / 6)

    @property
    def n_functions(self) -> int:
        """Number of coefficients: those of psi_1, then those of psi_2."""
        return 2 * self.n_norm * self.n_angle

    @cached_property
    def site_inputs(self) -> Array:
        """(J1, J2) - rest (n_sites, 2) at which a model is sampled: at each norm every angle."""
        norm, angle = np.meshgrid(*(s.sites for s in self.splines), indexing="ij")
        stretch = np.exp(lode_to_hencky(norm.ravel(), angle.ravel()))
        I1 = (stretch**2).sum(axis=1)
        I2 = (stretch**-2.0).sum(axis=1)
        return np.stack([I1, I2**1.5], axis=1) - REFERENCE

    @cached_property
    def interpolation(self) -> Array:
        """(n_functions, n_sites * 2): psi at the sites, [site, k] raveled, to coefficients."""
        inverse = np.kron(*(np.linalg.inv(s.matrix(s.sites)) for s in self.splines))
        n = len(inverse)
        full = np.zeros((2, n, n, 2))
        full[0, :, :, 0] = full[1, :, :, 1] = inverse
        return full.reshape(2 * n, -1)

    def local(self, F: Array) -> tuple[Array, NDArray[np.int64]]:
        """Stress of the functions that are not zero: P (m, q, 2, 2) at F (m, 2, 2), and their columns (m, q)."""
        _, dJ = polyconvex(F)
        values, columns = self._values(F)
        n = self.n_norm * self.n_angle
        P = np.concatenate([values[:, :, None, None] * dJ[:, None, k] for k in (0, 1)], axis=1)
        return P, np.concatenate([columns, columns + n], axis=1)

    def second(self, F: Array, c: Array) -> tuple[Array, Array]:
        """psi_k (m, 2) at F (m, 2, 2), of coefficients c (n,); the second derivatives are taken as zero (used for
        weights only)."""
        values, columns = self._values(F)
        n = self.n_norm * self.n_angle
        psi = np.stack([(values * c[k * n + columns]).sum(axis=1) for k in (0, 1)], axis=1)
        return psi, np.zeros((len(F), 2, 2))

    def _values(self, F: Array) -> tuple[Array, NDArray[np.int64]]:
        norm, angle = hencky_to_lode(F)
        (a, i), (b, j) = self.splines[0].local(norm), self.splines[1].local(angle)
        values = (a[:, :, None] * b[:, None, :]).reshape(len(F), -1)
        offsets = np.arange(DEGREE + 1)
        columns = (i[:, None] + offsets)[:, :, None] * self.n_angle + (j[:, None] + offsets)[:, None, :]
        return values, columns.reshape(len(F), -1)


@dataclass(frozen=True)
class PlaneStrainBasis:
    """The energy of the isochoric part in a basis of its own, and last the bulk modulus, see `calibrate.equations.isochoric`."""

    energy: SingleBasis | TensorBasis

    @property
    def n_functions(self) -> int:
        """Number of coefficients, that of the bulk modulus included."""
        return self.energy.n_functions + 1

    @property
    def input_tops(self) -> tuple[float, float]:
        """Largest J_k - J_k(I) covered, of the isochoric part."""
        return self.energy.input_tops

    @property
    def site_inputs(self) -> Array:
        """(J1, J2) - rest (n_sites, 2) of the isochoric part at which a model is sampled."""
        return self.energy.site_inputs

    @cached_property
    def interpolation(self) -> Array:
        """(n_functions, n_sites * 2): as of the energy, without a bulk modulus."""
        return np.pad(self.energy.interpolation, ((0, 1), (0, 0)))

    def local(self, F: Array) -> tuple[Array, NDArray[np.int64]]:
        """Stress of the functions that are not zero: P (m, q, 2, 2) at F (m, 2, 2), and their columns (m, q); last the
        stress of a unit bulk modulus."""
        P, columns = self.energy.local(np.asarray(plane_strain.isochoric(F)))
        P = np.asarray(plane_strain.stress(F[:, None], P, 0.0))
        last = np.full((len(F), 1), self.n_functions - 1)
        volumetric = np.asarray(plane_strain.volumetric(F))[:, None]
        return np.concatenate([P, volumetric], axis=1), np.concatenate([columns, last], axis=1)


Basis = SingleBasis | TensorBasis | PlaneStrainBasis


def energy_basis(basis: Basis) -> SingleBasis | TensorBasis:
    """The functions of the invariants alone."""
    return basis.energy if isinstance(basis, PlaneStrainBasis) else basis


def basis_for(inputs: str, F: Array, n: int = 32, plane: str = "stress") -> Basis:
    """The basis that covers the deformation gradients F (m, 2, 2) for a PANN with `inputs`.

    n: functions of a single input. plane: 'stress' or 'strain'. Raises `ConfigError` for unknown inputs.
    """
    if inputs not in INPUT_SETS:
        raise errors.ConfigError(f"inputs '{inputs}' unknown; choose one of {', '.join(INPUT_SETS)}")
    if plane == "strain":
        basis = basis_for(inputs, np.asarray(plane_strain.isochoric(F)), n)
        assert not isinstance(basis, PlaneStrainBasis)
        return PlaneStrainBasis(basis)
    if inputs == "I1I2":
        tops = 1.02 * polyconvex(F)[0].max(axis=0)
        return TensorBasis(1.02 * float(hencky_to_lode(F)[0].max()), input_tops=(float(tops[0]), float(tops[1])))
    k = INPUT_SETS[inputs][0]
    return SingleBasis(k, 1.05 * float(polyconvex(F)[0][:, k].max()), n)


def nominal_stress(basis: Basis, F: Array, c: Array) -> Array:
    """P (m, 2, 2) of coefficients c (n_functions,) at F (m, 2, 2), MPa."""
    P, columns = basis.local(F)
    return np.einsum("mqij,mq->mij", P, c[columns])


def tangent_modulus(basis: Basis, F: Array, c: Array) -> Array:
    """dP/dF (m, 2, 2, 2, 2) of coefficients c at F (m, 2, 2), MPa."""
    if isinstance(basis, PlaneStrainBasis):
        f, energy = np.asarray(plane_strain.isochoric(F)), basis.energy
        stress = nominal_stress(energy, f, c)
        return np.asarray(_plane_strain_modulus(F, stress, tangent_modulus(energy, f, c[:-1]), c[-1]))
    psi, second = basis.second(F, c)
    values, first = map(np.asarray, kinematics.invariants_and_derivatives(F))
    hessians = np.asarray(kinematics.invariant_hessians(F)).reshape(-1, 2, 16)
    # J2 = I2^(3/2): chain rule from I2
    inner = np.stack([np.ones(len(F)), 1.5 * np.sqrt(values[:, 1])], axis=1)
    curvatures = second * inner[:, :, None] * inner[:, None]
    curvatures[:, 1, 1] += psi[:, 1] * 0.75 / np.sqrt(values[:, 1])
    slopes = first.reshape(-1, 2, 4)
    tensor = ((psi * inner)[:, None] @ hessians).reshape(-1, 4, 4) + slopes.swapaxes(1, 2) @ (curvatures @ slopes)
    return tensor.reshape(-1, 2, 2, 2, 2)


@jax.jit
def _plane_strain_modulus(F, stress, modulus, bulk_modulus):
    """dP/dF (m, 2, 2, 2, 2) of F (m, 2, 2), P0 (m, 2, 2) and dP0/df (m, 2, 2, 2, 2) of the isochoric part."""

    def one(f, p, a):
        along = lambda g: a.reshape(4, 4) @ (plane_strain.isochoric(g) - plane_strain.isochoric(f)).ravel()  # noqa: E731
        return jax.jacfwd(lambda g: plane_strain.stress(g, p + along(g).reshape(2, 2), bulk_modulus))(f)

    return jax.vmap(one)(F, stress, modulus)
