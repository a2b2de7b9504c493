"""The tangent of the solid in one process, factorised by PARDISO (MKL)."""

from __future__ import annotations

import copy
import ctypes
import functools
import importlib.util
import sys
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from forward.errors import LinearSolverError
from forward.solid.block_sparsity import block_pattern, block_places, scalar_pattern
from forward.solid.element import Solid
from forward.solid.linear_solver import ACCURACY
from meshes.mesh import Array

SYMMETRIC = -2  # PARDISO's name; it counts the negative pivots, and takes no longer than the positive definite kind
ANALYSE, FACTORISE, SOLVE, RELEASE = 11, 22, 33, -1
OUT_OF_MEMORY = (-2, -9)
# conjugate gradients: relative residual to be reached, and iterations allowed, with a new factor and with a kept one
FRESH, KEPT = (1e-7, 30), (1e-6, 16)


def pardiso_installed() -> bool:
    """Whether the package pypardiso is there."""
    return importlib.util.find_spec("pypardiso") is not None


@functools.cache
def _pardiso() -> Any:
    """PARDISO, to be copied for each factor: pypardiso searches folders for it, which takes half a second.

    Loaded here and not above: MKL is absent on some machines, and in the way of MUMPS on many ranks.
    """
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
        blocks = block_pattern(solid.dofs, n)
        self._place = block_places(blocks, solid.dofs)
        self.matrix = scalar_pattern(blocks)
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
