"""Linear solvers of the solid: a state and prescribed steps in, the Newton step of the displacement out.

`Pardiso` (MKL, package pypardiso) serves one process and is several times faster; `Mumps` serves any number of
ranks. Both factorise the symmetric condensed tangent, and both have their result checked.
"""

from __future__ import annotations

import ctypes
import importlib.util
import sys
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from forward._dolfinx import JIT_OPTIONS, PETSc, dolfinx, ufl
from forward.element import Solid
from forward.errors import LinearSolverError
from meshes.mesh import Array

SYMMETRIC = -2  # PARDISO's name; it counts the negative pivots, and takes no longer than the positive definite kind
ANALYSE, FACTORISE, SOLVE, RELEASE = 11, 22, 33, -1
OUT_OF_MEMORY = (-2, -9)
ACCURACY = 1e-6  # of a linear solve; the nonlinear iteration forgives more, a broken factor gives 1 and above
CHUNK = 256


class LinearSolver(Protocol):
    """name; negative: negative pivots of the last factor, -1 if unknown."""

    name: str
    negative: int

    def step(self, u: Array, q: Array, jump: Array) -> Array | None:
        """Step du (n, 3), mm, from u (n, 3), q (m, 4), where held components move by `jump` (n, 3).

        None if the factorisation broke down.
        """


def pardiso_installed() -> bool:
    """Whether the package pypardiso is there."""
    return importlib.util.find_spec("pypardiso") is not None


class Pardiso:
    """Upper triangle in compressed rows, filled by the element loop; the analysis is done once."""

    name = "pardiso"

    def __init__(self, solid: Solid, n: int, held: NDArray[np.bool_]) -> None:
        from pypardiso import PyPardisoSolver

        self.solid, self.negative = solid, -1
        self._fixed = np.ascontiguousarray(held.ravel(), np.uint8)
        blocks = _block_pattern(solid.dofs, n)
        self._place = _places(blocks, solid.dofs)
        self.matrix = _scalar_pattern(blocks)
        self._rows = self.matrix.indptr.astype(np.int64)
        self._pardiso = PyPardisoSolver(mtype=SYMMETRIC)
        self._pardiso.set_iparm(1, 1)
        self._pardiso.set_iparm(2, 2)  # nested dissection
        self._pardiso.set_iparm(35, 1)  # numbers from zero
        self._analysed = False

    def step(self, u: Array, q: Array, jump: Array) -> Array | None:
        values, rhs = self.matrix.data, np.zeros(u.size)
        values[:] = 0
        jump = np.ascontiguousarray(jump.ravel())
        self.solid.assemble(u, q, self._rows, self._place, self._fixed, jump, values, rhs)
        held = self._fixed.astype(bool)
        values[self._rows[:-1][held]] = 1.0
        rhs[held] = jump[held]
        if not self._analysed:
            error = self._call(ANALYSE)
            if error:
                raise LinearSolverError(f"PARDISO cannot analyse the matrix (error {error}); use a coarser mesh")
            self._analysed = True
        x = np.zeros_like(rhs)
        error = self._call(FACTORISE)
        if error in OUT_OF_MEMORY:
            raise LinearSolverError("PARDISO ran out of memory; use a coarser mesh, fewer layers or more ranks")
        if error or self._call(SOLVE, rhs, x) or not _accurate(self._times(x), rhs):
            return None
        self.negative = int(self._pardiso.iparm[22])
        return x.reshape(u.shape)

    def _call(self, phase: int, b: Array | None = None, x: Array | None = None) -> int:
        """One call of MKL; returns its error number."""
        A, p, error = self.matrix, self._pardiso, ctypes.c_int32(0)
        numbers, reals = ctypes.POINTER(ctypes.c_int32), ctypes.POINTER(ctypes.c_double)
        none = np.zeros(1)

        def integer(value: int) -> Any:
            return ctypes.byref(ctypes.c_int32(value))

        p._mkl_pardiso(
            p.pt.ctypes.data_as(ctypes.POINTER(ctypes.c_int64)), integer(1), integer(1), integer(p.mtype),
            integer(phase), integer(A.shape[0]), A.data.ctypes.data_as(reals), A.indptr.ctypes.data_as(numbers),
            A.indices.ctypes.data_as(numbers), none.ctypes.data_as(numbers), integer(1),
            p.iparm.ctypes.data_as(numbers), integer(0), (none if b is None else b).ctypes.data_as(reals),
            (none if x is None else x).ctypes.data_as(reals), ctypes.byref(error),
        )  # fmt: skip
        return error.value

    def _times(self, x: Array) -> Array:
        A = self.matrix
        return A @ x + A.T @ x - A.data[A.indptr[:-1]] * x

    def __del__(self) -> None:
        if getattr(self, "_analysed", False) and not sys.is_finalizing():
            self._call(RELEASE)


class Mumps:
    """PETSc's matrix over the ranks, factorised by MUMPS."""

    name = "mumps"

    def __init__(self, solid: Solid, V: Any, held: NDArray[np.bool_]) -> None:
        self.solid, self.V, self.negative = solid, V, -1
        dx = ufl.dx(metadata={"quadrature_degree": 0})
        pattern = ufl.inner(ufl.TrialFunction(V), ufl.TestFunction(V)) * dx
        self.A = dolfinx.fem.petsc.create_matrix(dolfinx.fem.form(pattern, jit_options=JIT_OPTIONS))
        self.A.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        owned = V.dofmap.index_map.size_local
        self._held = np.flatnonzero(held.ravel()[: 3 * owned]).astype(np.int32)
        self.b, self.x = self.A.createVecLeft(), self.A.createVecRight()
        self._ghosted = dolfinx.la.vector(V.dofmap.index_map, 3)
        self.ksp = PETSc.KSP().create(V.mesh.comm)
        self.ksp.setType("preonly")
        self.ksp.setOperators(self.A)
        pc = self.ksp.getPC()
        pc.setType("cholesky")
        pc.setFactorSolverType("mumps")
        pc.setFactorSetUpSolverType()
        pc.getFactorMatrix().setMumpsIcntl(14, 60)

    def step(self, u: Array, q: Array, jump: Array) -> Array | None:
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
            return None
        residual = self.A.createVecLeft()
        self.A.mult(self.x, residual)
        residual.axpy(-1.0, self.b)
        if not residual.norm() <= ACCURACY * self.b.norm():
            return None
        rhs.array[:owned] = self.x.getArray(readonly=True)
        rhs.scatter_forward()
        return rhs.array.reshape(-1, 3).copy()


def _accurate(found: Array, rhs: Array) -> bool:
    return bool(np.linalg.norm(found - rhs) <= ACCURACY * np.linalg.norm(rhs))


def _block_pattern(dofs: NDArray[np.int32], n: int) -> sp.csr_matrix:
    """Upper triangle (n, n) of which blocks share a hex; columns sorted, the diagonal always there."""
    rows = np.repeat(np.arange(len(dofs)), dofs.shape[1])
    touches = sp.csr_matrix((np.ones(dofs.size, np.int32), (rows, dofs.ravel())), (len(dofs), n))
    pattern = sp.triu(touches.T @ touches, format="csr")
    pattern.sort_indices()
    return pattern


def _places(blocks: sp.csr_matrix, dofs: NDArray[np.int32]) -> NDArray[np.int32]:
    """(m, 27, 27): place of the pair's block in the block row of the smaller one."""
    n = blocks.shape[0]
    keys = np.repeat(np.arange(n, dtype=np.int64), np.diff(blocks.indptr)) * n + blocks.indices
    places = np.empty((len(dofs), dofs.shape[1], dofs.shape[1]), np.int32)
    for first in range(0, len(dofs), CHUNK):
        cells = dofs[first : first + CHUNK].astype(np.int64)
        low = np.minimum(cells[:, :, None], cells[:, None, :])
        high = np.maximum(cells[:, :, None], cells[:, None, :])
        places[first : first + CHUNK] = np.searchsorted(keys, low * n + high) - blocks.indptr[low]
    return places


def _scalar_pattern(blocks: sp.csr_matrix) -> sp.csr_matrix:
    """Upper triangle of the matrix with 3 x 3 blocks."""
    n = blocks.shape[0]
    lengths = np.diff(blocks.indptr)
    row_lengths = (3 * lengths[:, None] - np.arange(3)).ravel()
    indptr = np.concatenate([[0], np.cumsum(row_lengths)])
    if indptr[-1] >= 2**31:
        raise LinearSolverError(
            f"{indptr[-1]} entries are more than PARDISO's 32-bit numbers hold; use MUMPS on more ranks"
        )
    columns = (3 * blocks.indices[:, None] + np.arange(3)).astype(np.int32)
    indices = np.empty(indptr[-1], np.int32)
    for i in range(3):
        keep = np.ones(columns.shape, bool)
        keep[blocks.indptr[:-1], :i] = False
        owner = np.repeat(np.arange(n), 3 * lengths)[keep.ravel()]
        starts = indptr[3 * owner + i]
        within = np.arange(len(owner)) - np.repeat(np.cumsum(row_lengths[i::3]) - row_lengths[i::3], row_lengths[i::3])
        indices[starts + within] = columns.ravel()[keep.ravel()]
    return sp.csr_matrix((np.zeros(indptr[-1]), indices, indptr.astype(np.int32)), (3 * n, 3 * n))
