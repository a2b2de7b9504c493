r"""What is observed of a sheet's equilibrium, and how it changes with the law and with the motion of what is held.

In: a sheet at the equilibrium u, weights w of the displacements in an observation w . u, or the side on which a force is observed. Out: its virtual
field v, with which the observation changes by

.. math:: \delta y = v^T \delta f + (w + K v) \cdot \delta d,

where f(u, theta) are the nodal forces, delta f what a change of the law adds to them, K = df/du, and d the displacements of what is held. By the implicit
function theorem v is one solve with the factor of K at the equilibrium, whatever changes (adjoint method; Oberai, Gokhale and
Feijoo 2003, Inverse Problems 19):

.. math:: K_{ff} v_f = -w_f - K_{fh} v_h,

v = 0 on what is held for displacements, 1 on the side for its force. f: free, h: held. K is symmetric, as there is an energy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from forward import interpolation
from forward._dolfinx import MPI, PETSc, dolfinx
from forward.errors import ConvergenceError
from forward.materials import Material
from forward.sheet.inelastic_problem import InelasticProblem
from forward.sheet.plane_stress_problem import PlaneStressProblem
from forward.sheet.thin_sheet import Sheet
from meshes import Mesh

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class VirtualFields:
    """Of r observations: values v (r, n, 2); held (r, n, 2): K v where displacements are prescribed, 0 elsewhere, N per mm of v."""

    values: Array
    held: Array


class Adjoint(PlaneStressProblem):
    """A problem on one process that gives the virtual fields of observations at its present displacements. Its tangent is symmetric."""

    _fixed: NDArray[np.bool_]
    _whole: Any

    def _prepare_adjoint(self, held: NDArray[np.bool_]) -> None:
        self._fixed = held
        self._whole = dolfinx.fem.petsc.create_matrix(self.problem.J)

    def virtual_fields(self, weights: Array, on_held: Array) -> VirtualFields:
        """At the present equilibrium, of observations with weights w (r, n, 2) and values v (r, n, 2) where held, 0 elsewhere."""
        stiffness = self._factorise()
        order, fixed = self.nodes, self._fixed[self.nodes].ravel()
        count, size = len(weights), 2 * len(order)
        held = on_held[:, order].reshape(count, size)
        coupling = sp.csr_array(stiffness[fixed])
        right = -(weights[:, order].reshape(count, size) + (coupling.T @ held[:, fixed].T).T)
        right[:, fixed] = 0.0
        found = self._solved(right) + held
        forces = np.zeros_like(found)
        forces[:, fixed] = (coupling @ found.T).T
        return VirtualFields(self._to_mesh(found), self._to_mesh(forces))

    def _factorise(self) -> sp.csr_array:
        """Assemble and factorise the tangent at the present displacements; the whole of it (2 n, 2 n), without supports."""
        for matrix, supports in ((self.problem.A, [s.bc for s in self.supports]), (self._whole, [])):
            matrix.zeroEntries()
            dolfinx.fem.petsc.assemble_matrix(matrix, self.problem.J, bcs=supports)
            matrix.assemble()
        solver = self.problem.solver.getKSP()
        solver.setOperators(self.problem.A)
        solver.setUp()
        rows, columns, values = self._whole.getValuesCSR()
        return sp.csr_array((values, columns, rows), shape=self._whole.getSize())

    def _solved(self, right: Array) -> Array:
        """K^-1 of right-hand sides (r, 2 n), all at once."""
        size, count = right.shape[1], len(right)
        columns: Any = np.asfortranarray(right.T)
        given = PETSc.Mat().createDense((size, count), array=columns, comm=self.comm)
        found = PETSc.Mat().createDense((size, count), comm=self.comm)
        found.setUp()
        self.problem.solver.getKSP().getPC().getFactorMatrix().matSolve(given, found)
        return np.ascontiguousarray(found.getDenseArray().T)

    def _to_mesh(self, local: Array) -> Array:
        """(r, 2 n) in DOLFINx's order to (r, n, 2) in the mesh's."""
        found = np.empty((len(local), len(self.nodes), 2))
        found[:, self.nodes] = local.reshape(len(local), -1, 2)
        return found


class AdjointSheet(Adjoint):
    """A sheet of a material of both invariants."""

    def __init__(
        self, mesh: Mesh, material: Material, thickness: float, held: NDArray[np.bool_], values: Array
    ) -> None:
        super().__init__(mesh, material, thickness, held, values, 1e-9, 25)
        self._prepare_adjoint(held)

    def equilibrium(self, load_factor: float, start: Array) -> Array:
        """Displacements (n, 2), mm, at a load factor by Newton's method from `start` (n, 2). Raises `ConvergenceError`."""
        self.unknowns = (start,)
        outcome = self.solve(load_factor)
        if not outcome.converged:
            raise ConvergenceError(f"no equilibrium at {load_factor:.4g} of the load: {outcome.text}")
        return self.displacements


class AdjointLaw(InelasticProblem, Adjoint):
    """The elastic and incompressible part of a sheet: base, energies and fields beside it, without what remembers or changes its volume."""

    def __init__(self, mesh: Mesh, sheet: Sheet, held: NDArray[np.bool_], values: Array) -> None:
        super().__init__(mesh, sheet.elastic, held, values, 1e-9, 25, MPI.COMM_WORLD)
        self._prepare_adjoint(held)


def force_operator(mesh: Mesh) -> sp.csr_array:
    """Operator (2 n, 4 q m), mm: a stress (m, q, 2, 2) at the q Gauss points of each cell, flattened, to nodal forces (n, 2) of a sheet of unit thickness."""
    slopes, _, weights = interpolation.gauss_points(mesh)
    m, q, nodes, _ = slopes.shape
    weighted = slopes * weights.reshape(m, q)[:, :, None, None]  # (m, q, node, J)
    shape = (m, q, nodes, 2, 2)  # cell, point, node, i, J
    rows = np.broadcast_to(2 * mesh.cells[:, None, :, None, None] + np.arange(2)[:, None], shape)
    columns = np.broadcast_to(np.arange(4 * q * m).reshape(m, q, 1, 2, 2), shape)
    values = np.broadcast_to(weighted[:, :, :, None, :], shape)
    return sp.csr_array((values.ravel(), (rows.ravel(), columns.ravel())), shape=(2 * len(mesh.points), 4 * q * m))


def gradients(mesh: Mesh, u: Array) -> Array:
    """In-plane deformation gradient (q m, 2, 2) at the Gauss points, from displacements (n, 2), mm."""
    slopes, _, _ = interpolation.gauss_points(mesh)
    return (np.eye(2) + np.einsum("mqnj,mni->mqij", slopes, u[mesh.cells])).reshape(-1, 2, 2)
