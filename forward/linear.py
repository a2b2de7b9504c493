"""Linear solvers of the solid: a state and prescribed steps in, the Newton step of the displacement out.

`Pardiso` (MKL, package pypardiso) serves one process and is several times faster; `Mumps` serves any number of
ranks. Both factorise the symmetric condensed tangent, and both check the residual of their result in float64.
"""

from __future__ import annotations

import copy
import ctypes
import functools
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
MUMPS_OUT_OF_MEMORY = (-8, -9, -11, -13, -14, -15, -17, -20)
# conjugate gradients: relative residual to be reached, and iterations allowed, with a new factor and with a kept one
FRESH, KEPT = (1e-7, 30), (1e-6, 16)
ACCURACY = 1e-6  # of a linear solve; the nonlinear iteration forgives more, a broken factor gives 1 and above
CHUNK = 256


class LinearSolver(Protocol):
    """name; negative: negative pivots of the last factor, -1 if unknown."""

    name: str
    negative: int

    def step(self, u: Array, q: Array, jump: Array, fresh: bool) -> Array | None:
        """Step du (n, 3), mm, from u (n, 3), q (m, 4), where held components move by `jump` (n, 3).

        fresh: whether the state has changed too much since the last step to use its factor again. None if it fails.
        Raises `LinearSolverError` for want of memory.
        """


def pardiso_installed() -> bool:
    """Whether the package pypardiso is there."""
    return importlib.util.find_spec("pypardiso") is not None


@functools.cache
def _pardiso() -> Any:
    """PARDISO, to be copied for each factor: pypardiso searches folders for it, which takes half a second."""
    from pypardiso import PyPardisoSolver

    return PyPardisoSolver(mtype=SYMMETRIC)


class Pardiso:
    """Upper triangle in compressed rows, filled by the element loop, solved by conjugate gradients in float64.

    Their preconditioner is a PARDISO factor in float32: half the time and memory of one in float64, and exact enough
    that two or three iterations do. It is kept for the later Newton iterations of a load step, where a few more do.
    Where that fails (an indefinite tangent, say), the tangent is factorised in float64.
    """

    name = "pardiso"

    def __init__(self, solid: Solid, n: int, held: NDArray[np.bool_]) -> None:
        self.solid, self.negative = solid, -1
        self._fixed = np.ascontiguousarray(held.ravel(), np.uint8)
        blocks = _block_pattern(solid.dofs, n)
        self._place = _places(blocks, solid.dofs)
        self.matrix = _scalar_pattern(blocks)
        self._rows = self.matrix.indptr.astype(np.int64)
        self._factor: _Factor | None = None

    def step(self, u: Array, q: Array, jump: Array, fresh: bool) -> Array | None:
        """See `LinearSolver.step`. Raises `LinearSolverError` for want of memory."""
        values, rhs = self.matrix.data, np.zeros(u.size)
        values[:] = 0
        jump = np.ascontiguousarray(jump.ravel())
        self.solid.assemble(u, q, self._rows, self._place, self._fixed, jump, values, rhs)
        held = self._fixed.astype(bool)
        values[self._rows[:-1][held]] = 1.0
        rhs[held] = jump[held]
        x = None if fresh else self._conjugate_gradients(rhs, *KEPT)
        if x is None and self._factorise(np.float32):
            x = self._conjugate_gradients(rhs, *FRESH)
        if x is None and self._factorise(np.float64):
            x = self._direct(rhs)
        return None if x is None else x.reshape(u.shape)

    def _factorise(self, kind: type) -> bool:
        """Factor of the present matrix; whether it came about (and is positive definite, in float32)."""
        if self._factor is None or self._factor.kind is not kind:
            self._factor = None  # releases the memory of the other kind
            self._factor = _Factor(self.matrix, kind)
        made = self._factor.update(self.matrix)
        self.negative = self._factor.negative
        return made and (kind is np.float64 or self.negative == 0)

    def _conjugate_gradients(self, rhs: Array, accuracy: float, limit: int) -> Array | None:
        """Solution to a relative residual of `accuracy`, or None if `limit` iterations do not reach it."""
        factor = self._factor
        if factor is None or factor.kind is not np.float32 or self.negative:
            return None
        x, r = np.zeros_like(rhs), rhs.copy()
        goal = accuracy * np.linalg.norm(rhs)
        d, rz = np.zeros_like(rhs), 1.0
        for _ in range(limit):
            z = factor.solve(r)
            before, rz = rz, float(r @ z)
            if not rz > 0:
                break
            d = z + (rz / before) * d
            Ad = self.solid.product(self.matrix, d)
            curvature = float(d @ Ad)
            if not curvature > 0:
                break
            x += (rz / curvature) * d
            r -= (rz / curvature) * Ad
            if np.linalg.norm(r) <= goal:
                true = np.linalg.norm(self.solid.product(self.matrix, x) - rhs)
                return x if true <= 2 * goal else None
        return None

    def _direct(self, rhs: Array) -> Array | None:
        assert self._factor is not None
        x = self._factor.solve(rhs)
        error = np.linalg.norm(self.solid.product(self.matrix, x) - rhs)
        return x if error <= ACCURACY * np.linalg.norm(rhs) else None


class _Factor:
    """PARDISO's factor of a symmetric matrix, float32 or float64; the pattern is analysed once."""

    def __init__(self, matrix: sp.csr_matrix, kind: type) -> None:
        self.kind, self.negative = kind, -1
        self._pattern = (matrix.indptr, matrix.indices)
        self._values = np.empty(matrix.nnz, kind) if kind is np.float32 else matrix.data
        self._pardiso = copy.copy(_pardiso())
        self._pardiso.pt, self._pardiso.iparm = np.zeros(64, np.int64), np.zeros(64, np.int32)
        for name, value in ((1, 1), (2, 2), (28, int(kind is np.float32)), (35, 1)):  # nested dissection; from zero
            self._pardiso.set_iparm(name, value)
        error = self._call(ANALYSE)
        if error:
            raise LinearSolverError(f"PARDISO cannot analyse the matrix (error {error}); use a coarser mesh")

    def update(self, matrix: sp.csr_matrix) -> bool:
        """Factorise; whether it worked. Raises `LinearSolverError` without memory."""
        if self.kind is np.float32:
            self._values[:] = matrix.data
        error = self._call(FACTORISE)
        if error in OUT_OF_MEMORY:
            raise LinearSolverError("PARDISO ran out of memory; use a coarser mesh, fewer layers or more ranks")
        self.negative = int(self._pardiso.iparm[22])
        return error == 0

    def solve(self, rhs: Array) -> Array:
        """Solution (n,) in float64, as exact as the factor."""
        scale = float(np.abs(rhs).max()) or 1.0
        b: NDArray[Any] = (rhs / scale).astype(self.kind)
        x = np.zeros_like(b)
        if self._call(SOLVE, b, x):
            x[:] = np.nan  # is seen by whoever checks the residual
        return x.astype(np.float64) * scale

    def _call(self, phase: int, b: NDArray[Any] | None = None, x: NDArray[Any] | None = None) -> int:
        """One call of MKL; returns its error number."""
        p, error = self._pardiso, ctypes.c_int32(0)
        numbers = ctypes.POINTER(ctypes.c_int32)
        indptr, indices = self._pattern
        none = np.zeros(1)

        def integer(value: int) -> Any:
            return ctypes.byref(ctypes.c_int32(value))

        def address(array: NDArray[Any]) -> Any:
            return array.ctypes.data_as(ctypes.c_void_p)

        p._mkl_pardiso(
            p.pt.ctypes.data_as(ctypes.POINTER(ctypes.c_int64)), integer(1), integer(1), integer(p.mtype),
            integer(phase), integer(len(indptr) - 1), address(self._values), indptr.ctypes.data_as(numbers),
            indices.ctypes.data_as(numbers), none.ctypes.data_as(numbers), integer(1),
            p.iparm.ctypes.data_as(numbers), integer(0), address(none if b is None else b),
            address(none if x is None else x), ctypes.byref(error),
        )  # fmt: skip
        return error.value

    def __del__(self) -> None:
        if not sys.is_finalizing():
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
            if code in MUMPS_OUT_OF_MEMORY:
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
