"""The tangent of the solid in PETSc's matrix over the ranks, factorised by MUMPS."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from forward._dolfinx import PETSc, dolfinx, ufl
from forward.compilation import compiled_form
from forward.errors import LinearSolverError
from forward.solid.element import Solid
from forward.solid.linear_solver import ACCURACY
from meshes.mesh import Array

OUT_OF_MEMORY = (-8, -9, -11, -13, -14, -15, -17, -20)
CHUNK = 256  # hexes whose matrices are held at a time


class Mumps:
    """PETSc's matrix over the ranks, factorised by MUMPS."""

    name = "mumps"

    def __init__(self, solid: Solid, V: Any, held: NDArray[np.bool_]) -> None:
        self.solid, self.V, self.negative = solid, V, -1
        dx = ufl.dx(metadata={"quadrature_degree": 0})
        pattern = ufl.inner(ufl.TrialFunction(V), ufl.TestFunction(V)) * dx
        self.A = dolfinx.fem.petsc.create_matrix(compiled_form(pattern))
        self.A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        owned = V.dofmap.index_map.size_local
        self._held = np.flatnonzero(held.ravel()[: 3 * owned]).astype(np.int32)
        self.b, self.x = self.A.createVecLeft(), self.A.createVecRight()
        self._ghosted = dolfinx.la.vector(V.dofmap.index_map, 3)
        self.ksp = self._factoriser()

    def step(self, u: Array, q: Array, jump: Array, fresh: bool) -> Array | None:
        """See `LinearSolver.step`. Raises `LinearSolverError` for want of memory."""
        self.A.zeroEntries()
        rhs = self._ghosted
        rhs.array[:] = 0
        blocks = rhs.array.reshape(-1, 3)
        for first in range(0, self.solid.n_cells, CHUNK):
            last = min(first + CHUNK, self.solid.n_cells)
            matrices, forces = self.solid.matrices(first, last, u, q)
            for dofs, matrix in zip(self.solid.dofs[first:last], matrices, strict=True):
                self.A.setValuesBlockedLocal(dofs, dofs, matrix, PETSc.InsertMode.ADD_VALUES)
            np.subtract.at(blocks, self.solid.dofs[first:last].ravel(), forces.reshape(-1, 3))
        self.A.assemble()
        rhs.scatter_reverse(dolfinx.la.InsertMode.add)
        owned = self.b.getLocalSize()
        self.b.setArray(rhs.array[:owned])
        self.x.setArray(jump.ravel()[:owned])
        start = self.A.getOwnershipRange()[0]
        self.A.zeroRowsColumns(self._held + start, 1.0, self.x, self.b)
        self.ksp.solve(self.b, self.x)
        if self.ksp.getConvergedReason() < 0:  # type: ignore[operator]
            code = self.ksp.getPC().getFactorMatrix().getMumpsInfog(1)
            self.ksp.destroy()  # PETSc does not forget the failure, and would refuse the next factor as well
            self.ksp = self._factoriser()
            if code in OUT_OF_MEMORY:
                raise LinearSolverError(f"MUMPS ran out of memory (its error {code}); use more ranks or a coarser mesh")
            return None
        residual = self.A.createVecLeft()
        self.A.mult(self.x, residual)
        residual.axpy(-1.0, self.b)
        if not residual.norm() <= ACCURACY * self.b.norm():
            return None
        rhs.array[:owned] = self.x.getArray(readonly=True)
        rhs.scatter_forward()
        return rhs.array.reshape(-1, 3).copy()

    def _factoriser(self) -> Any:
        ksp = PETSc.KSP().create(self.V.mesh.comm)
        ksp.setType("preonly")
        ksp.setOperators(self.A)
        pc = ksp.getPC()
        pc.setType("cholesky")
        pc.setFactorSolverType("mumps")
        pc.setFactorSetUpSolverType()
        pc.getFactorMatrix().setMumpsIcntl(14, 60)
        return ksp
