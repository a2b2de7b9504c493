"""Equilibrium of measured fields: internal virtual work against the work of the measured forces.

In: an Experiment, virtual fields, a spline basis. Out: the linear system

    residual[increment] = G[increment] c - load[increment],
    G_(v i, j) = t sum_e A_e P^j_(iJ, e) dv/dX_J,     load = measured force of a loaded boundary, else 0,

one row a virtual field v and component i, in N; c are the spline coefficients of the energy derivatives (MPa).
With unknown thickness t = 1 mm is used and c is stiffness times thickness (N/mm).

In a window of a larger body the section carries an unknown part of the forces: they have no equations. One equation fixes the level, which
the others leave open (if c meets them, so does any multiple): the largest force is taken to be that of its section. Of the model that comes out the
level is that at which all loaded sections together carry the recorded forces of that increment. It is nominal.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import nnls

from calibrate import errors
from calibrate.data.experiment import Experiment
from calibrate.equations import isochoric as plane_strain
from calibrate.equations import kinematics, recovery
from calibrate.equations.basis import Basis, PlaneStrainBasis, SingleBasis, energy_basis, tangent_modulus
from calibrate.equations.tensors import Tensors
from calibrate.equations.virtual_fields import VirtualFields, virtual_fields

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Equilibrium:
    """The virtual-work equations of one Experiment; rows are ordered component-major: all x, then all y.

    linear: displacements are linear in the triangles, as the paper has it, instead of recovered (`recovery`). fixes_level: whether a
    window in a larger body has the equation of its nominal level; not beside a test that knows the level.
    """

    experiment: Experiment
    fields: VirtualFields
    linear: bool = False
    fixes_level: bool = True

    @cached_property
    def gradient(self) -> sp.csr_array:
        """Nodal displacements to gradients (2 n_triangles, n_nodes), 1/mm, at the centroids."""
        function = kinematics.gradient_operator if self.linear else recovery.centroid_gradients
        return function(self.experiment.points, self.experiment.triangles)

    @cached_property
    def areas(self) -> Array:
        """(n_triangles,) mm^2."""
        points, triangles = self.experiment.points, self.experiment.triangles
        if self.linear:
            return kinematics.shape_gradients(points, triangles)[1]
        return recovery.areas(points, triangles, self.experiment.free_nodes)

    @cached_property
    def virtual_gradients(self) -> sp.csr_array:
        """(n_fields, 2 n_triangles): thickness x area x gradient of each virtual field, mm^2."""
        linear = kinematics.gradient_operator(self.experiment.points, self.experiment.triangles)
        weights = np.repeat(self.areas * (self.experiment.thickness or 1.0), 2)
        return sp.csr_array((sp.diags_array(weights) @ (linear @ self.fields.values)).T)

    @cached_property
    def recorded(self) -> Array:
        """Measured force of each row (n_increments, 2 n_fields), N, whether or not the section carries it; NaN where it was not measured, or
        its work is unknown."""
        n = self.fields.n_fields
        loads = np.zeros((self.experiment.n_increments, 2 * n))
        for column in np.flatnonzero(self.fields.boundary >= 0):
            force = self.experiment.loaded[self.fields.boundary[column]].force
            loads[:, column], loads[:, n + column] = force[:, 0], force[:, 1]
        if self.fields.admissible is not None:
            loads[:, ~self.fields.admissible.ravel()] = np.nan
        return loads

    @cached_property
    def level_equation(self) -> NDArray[np.bool_]:
        """The equation (n_increments, 2 n_fields) that fixes a nominal level: of the largest force; none where the level is measured."""
        found = np.zeros(self.recorded.shape, bool)
        if self.experiment.level_is_nominal and self.fixes_level:
            found[np.unravel_index(np.argmax(np.nan_to_num(np.abs(self.recorded))), found.shape)] = True
        return found

    def share_carried(self, forces: Array) -> float:
        """What the sections carry of the recorded forces, along these, in the increment of the largest one: 1 at the nominal level.

        forces: internal virtual work (n_increments, 2 n_fields), N. Raises `FitError` where it is not positive: the strain there is noise.
        """
        increment = int(np.argwhere(self.level_equation)[0, 0])
        recorded = np.nan_to_num(self.recorded[increment]) * np.tile(self.fields.boundary >= 0, 2)
        used = recorded != 0
        share = float(forces[increment, used] @ recorded[used] / (recorded @ recorded))
        if not share > 0:
            raise errors.FitError(
                f"{self.experiment.name}: the level of the stiffness cannot be fixed: in increment {increment + 1}, where the recorded force is "
                "largest, the sections carry it in the other direction, as the strain at the loaded edges is noise; drop rows of points "
                "there (edges.drop_points in a column map)"
            )
        return share

    @cached_property
    def loads(self) -> Array:
        """Right-hand side of each equation (n_increments, 2 n_fields), N; NaN where there is none: of a force that was not measured, or that
        the section does not carry, and inside the specimen between pictures."""
        loaded = np.tile(self.fields.boundary >= 0, 2)
        known = np.ones(self.recorded.shape, bool)
        if self.experiment.level_is_nominal:
            known &= ~loaded | self.level_equation
        known[np.setdiff1d(np.arange(len(known)), self.experiment.pictures)] &= loaded
        return np.where(known, self.recorded, np.nan)

    @cached_property
    def deformation_gradients(self) -> Array:
        """F (n_increments, n_triangles, 2, 2)."""
        return kinematics.deformation_gradients(self.gradient, self.experiment.displacements)

    @cached_property
    def isochoric_gradients(self) -> Array:
        """(n_increments, n_triangles, 2, 2): of which the invariants are taken; F itself where the sheet is incompressible."""
        F = self.deformation_gradients
        return F if self.experiment.plane == "stress" else np.asarray(plane_strain.isochoric(F))

    def matrix(self, basis: Basis, F: Array) -> Array:
        """G (2 n_fields, n_functions) of one increment with F (n_triangles, 2, 2), N per MPa."""
        P, columns = basis.local(F)
        m, q = columns.shape
        indptr = np.arange(0, 2 * m * q + 1, q)
        indices = np.repeat(columns, 2, axis=0).ravel()
        blocks = []
        for i in (0, 1):
            values = P[:, :, i].transpose(0, 2, 1).ravel()
            stress = sp.csr_array((values, indices, indptr), shape=(2 * m, basis.n_functions))
            blocks.append((self.virtual_gradients @ stress).toarray())
        return np.concatenate(blocks)

    def tangent(self, basis: Basis, F: Array, c: Array) -> list[list[sp.csr_array]]:
        """d residual / d displacement of one increment: blocks [i][k] (n_fields, n_nodes), N/mm, at F (m, 2, 2)
        with coefficients c (n_functions,)."""
        return self.stiffness(tangent_modulus(basis, F, c))

    def stiffness(self, tensor: Array) -> list[list[sp.csr_array]]:
        """The same of dP/dF (m, 2, 2, 2, 2), MPa."""
        whole = self.interleaved_stiffness(tensor)
        shape = (self.fields.n_fields, whole.shape[1])
        blocks = [
            sp.csr_array((whole.data[:, ik, 0], whole.indices, whole.indptr), shape=shape, copy=True) for ik in range(4)
        ]
        return [blocks[:2], blocks[2:]]

    def interleaved_stiffness(self, tensor: Array) -> sp.bsr_array:
        """The same, the four blocks of a field and a node one below the other: (4 n_fields, n_nodes), rows (field, i, k)."""
        work = self._virtual_blocks
        by_direction = np.ascontiguousarray(tensor.transpose(0, 2, 1, 3, 4)).reshape(-1, 2, 8)
        values = (work.data @ by_direction[work.indices]).reshape(-1, 4, 2)
        shape = (4 * work.shape[0], work.shape[1])
        return sp.bsr_array((values, work.indices, work.indptr), shape=shape) @ self._gradient_blocks

    @cached_property
    def _virtual_blocks(self) -> sp.bsr_array:
        """`virtual_gradients` with both directions of a triangle side by side."""
        return sp.bsr_array(self.virtual_gradients, blocksize=(1, 2))

    @cached_property
    def _gradient_blocks(self) -> sp.bsr_array:
        """`gradient` with both directions of a triangle one below the other."""
        return sp.bsr_array(self.gradient, blocksize=(2, 1))

    def internal_forces(self, P: Any) -> Array:
        """Internal virtual work (..., 2 n_fields), N, of first Piola-Kirchhoff stresses (..., m, 2, 2), MPa."""
        return virtual_work(self.virtual_gradients, P)

    @cached_property
    def neo_hookean(self) -> Array:
        """Internal virtual work (k, t, 2 n_fields), N, of a neo-Hookean solid with a shear modulus of 1 MPa (or N/mm), and in plane strain of such a bulk modulus."""
        f = Tensors.of(jnp.asarray(self.isochoric_gradients))
        P = (f - f.cofactor * f.det**-3).array
        if self.experiment.plane == "stress":
            return self.internal_forces(P[None])
        F = self.deformation_gradients
        return self.internal_forces(jnp.stack([plane_strain.stress(F, P, 0.0), plane_strain.volumetric(F)]))


def virtual_work(virtual: sp.csr_array | sp.csc_array, stress: Any) -> Array:
    """(..., 2 v), N, of stresses (..., m, 2, 2), MPa; virtual (v, 2 m): thickness x area x gradient of each virtual field, mm^2."""
    shape = np.shape(stress)
    found = np.moveaxis((virtual @ np.asarray(_columns(stress))).reshape(-1, *shape[:-3], 2), 0, -1)
    return found.reshape(*shape[:-3], -1)


@jax.jit
def _columns(stress: Any) -> Any:
    """(2 m, ...) of stresses (..., m, 2, 2): their second index beside the triangle."""
    return jnp.moveaxis(stress, (-3, -1), (0, 1)).reshape(2 * stress.shape[-3], -1)


def equilibrium(experiment: Experiment, spacing: float | None = None) -> Equilibrium:
    """Virtual-work equations on coarse virtual fields, after checking the sign of the forces.

    spacing: of the fields, mm (None: from the noise). Raises `ForceSignError` when the measured forces oppose the
    deformation or do not go with it, `ExperimentError` where nothing moves, `MissingForceError` where every force is
    zero, `ConfigError` for a spacing that leaves no field inside the specimen.
    """
    system = Equilibrium(experiment, virtual_fields(experiment, spacing))
    check_force_sign(system)
    return system


def neo_hooke(basis: Basis, shear_modulus: float = 1.0, bulk_modulus: float = 0.0) -> Array:
    """Coefficients (n_functions,) of a constant psi_k (neo-Hooke for J1: psi_1 = mu / 2), in the unit of the moduli."""
    sites, energy = np.zeros((len(basis.site_inputs), 2)), energy_basis(basis)
    sites[:, energy.k if isinstance(energy, SingleBasis) else 0] = 0.5 * shear_modulus
    c = basis.interpolation @ sites.ravel()
    if isinstance(basis, PlaneStrainBasis):
        c[-1] = bulk_modulus
    return c


def best_neo_hooke(system: Equilibrium, basis: Basis, used: NDArray[np.bool_] | None = None) -> Array:
    """Coefficients (n_functions,) of the neo-Hookean solid with `best_moduli`."""
    return neo_hooke(basis, *best_moduli(system, used))


def best_moduli(system: Equilibrium, used: NDArray[np.bool_] | None = None) -> tuple[float, ...]:
    """Shear modulus, and in plane strain bulk modulus, MPa (or N/mm), of the neo-Hookean solid that fits the measured forces best, of those equations (t, 2 v) that are `used`: start of the weighting."""
    if system.experiment.plane == "stress":
        return (best_shear_modulus(system, used)[0],)
    of_moduli, known = _of_forces(system, used)
    mu, kappa = nnls(of_moduli.T, known)[0]
    return max(mu, 1e-3 * kappa), max(kappa, mu / 3)


def _of_forces(system: Equilibrium, used: NDArray[np.bool_] | None) -> tuple[Array, Array]:
    """`neo_hookean` (k, n), N per MPa, and loads (n,), N, of measured forces that are used; of all measured ones where none of them is."""
    rows = np.tile(system.fields.boundary >= 0, 2)
    known = np.isfinite(system.loads) & rows
    some = known if used is None else known & used
    some = some if some.any() else known
    return system.neo_hookean[:, some], system.loads[some]


def best_shear_modulus(system: Equilibrium, used: NDArray[np.bool_] | None = None) -> tuple[float, float]:
    """Least-squares neo-Hookean modulus, MPa (or N/mm), from the measured forces alone, and their correlation with the
    model's; in plane strain of a solid whose Poisson ratio is a quarter. used: see `best_moduli`."""
    of_moduli, b = _of_forces(system, used)
    a = np.array([1.0, 5 / 3])[: len(of_moduli)] @ of_moduli
    return float(a @ b / (a @ a)), float(a @ b / np.sqrt((a @ a) * (b @ b) + 1e-300))


def _if_noise(e: Experiment) -> str:
    """What to say where the strain is below its scatter, so that noise decides signs; else nothing."""
    signal = e.strain_signal
    if signal.ratio >= 1:
        return ""
    return (
        f". But the strain ({signal.strain:.1%}) is below its scatter between neighbouring triangles ({signal.scatter:.1%}): noise may decide; "
        "pull further, or correlate with larger subsets"
    )


def check_force_sign(system: Equilibrium) -> None:
    """Compare measured forces with those of a neo-Hookean solid under the measured deformation.

    Raises `ExperimentError` where nothing moves, `MissingForceError` where every force is zero, `ForceSignError`.
    """
    e = system.experiment
    if np.ptp(e.displacements, axis=1).max() <= 1e-12 * np.ptp(e.points, axis=0).max():
        raise errors.ExperimentError(
            f"{e.name}: the specimen is not deformed in any increment (its displacements are the same everywhere); check that "
            "displacements, not the reference, were exported"
        )
    if not any(np.nan_to_num(b.force).any() for b in e.loaded):
        raise errors.MissingForceError(
            f"{e.name}: every measured force is zero; check the column of the load cell, or give NaN for what was not measured"
        )
    modulus, correlation = best_shear_modulus(system)
    if modulus < 0 and correlation < -0.3:
        raise errors.ForceSignError(
            f"{e.name}: measured forces oppose the measured deformation (correlation {correlation:.2f}): internal and external "
            f"power have opposite signs; a force is that of the grip ON the specimen, positive along +x, +y; in a column map force.sign turns it{_if_noise(e)}"
        )
    if not modulus > 0 or correlation < 0.3:
        raise errors.ForceSignError(
            f"{e.name}: measured forces and deformation do not belong together (correlation {correlation:.2f}); check which "
            f"boundary carries which force, the synchronisation of images and forces, and their signs{_if_noise(e)}"
        )
