"""Compiled Q2-P1 hexes: a mesh and a material in; nodal forces, pressure steps and condensed tangents out.

The integration over a hex is `element.c`, for any material; stress and tangent at a point are derived from the
material's energy in UFL and compiled by FFCx. Both are kept by `forward.compilation`.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shutil
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any

import cffi
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from forward._dolfinx import MPI, dolfinx, ufl
from forward.compilation import FLAGS, FOLDER, compilation, compiled_expression
from forward.errors import ForwardError
from forward.materials import Material
from meshes.extrusion import HEX_NODES, hex_shape_gradients, hex_shapes
from meshes.mesh import Array

SOURCE = Path(__file__).with_name("element.c")
POINTS_1D, WEIGHTS_1D = np.polynomial.legendre.leggauss(3)
GAUSS = np.array([(x, y, z) for z in POINTS_1D for y in POINTS_1D for x in POINTS_1D])
WEIGHTS = np.array([a * b * c for a in WEIGHTS_1D for b in WEIGHTS_1D for c in WEIGHTS_1D])
CENTRE = int(np.flatnonzero((HEX_NODES == 0).all(axis=1))[0])
PRESSURES = 4
DOFS = 81
DECLARATIONS = """
typedef void (*point_law)(double*, const double*, const double*, const double*, const int*, const uint8_t*, void*);
typedef struct {
  int32_t n_cells; const double* points; const int32_t* geometry; const int32_t* dofs; const double* gradients;
  const double* shapes; const double* weights; int32_t centre; double kappa; const double* parameters; point_law law;
} solid_t;
int32_t solid_forces(const solid_t*, const double* u, const double* q, double* forces, double* sums);
void solid_pressure_step(const solid_t*, const double* u, const double* q, const double* du, double* dq);
void solid_matrices(const solid_t*, int32_t first, int32_t last, const double* u, const double* q, double* matrices,
                    double* forces);
void solid_assemble(const solid_t*, const double* u, const double* q, const int64_t* rows, const int32_t* place,
                    const uint8_t* fixed, const double* jump, double* values, double* rhs);
void symmetric_product(int32_t n, const int32_t* rows, const int32_t* columns, const double* values, const double* x,
                       double* y);
"""


def isochoric_invariants(F: Any) -> tuple[Any, Any]:
    """I1 and I2 in UFL of the isochoric part of a deformation gradient (3, 3)."""
    J, C = ufl.det(F), F.T * F
    I1 = ufl.tr(C)
    return J ** (-2 / 3) * I1, J ** (-4 / 3) * (I1**2 - ufl.tr(C * C)) / 2


def point_law(F: Any, p: Any, material: Material, parameters: Any) -> Any:
    """UFL vector (54,): P = d W / d F (9), and the upper triangle of its derivative (45), W = psi + p (J - 1)."""
    F = ufl.variable(F)
    invariants = isochoric_invariants(F)
    I1, I2 = (ufl.variable(x) for x in invariants)
    psi = material.energy(I1, I2, parameters)
    slopes = [ufl.diff(psi, x) for x in (I1, I2)]
    curvatures = [[ufl.diff(slope, x) for x in (I1, I2)] for slope in slopes]
    first = [ufl.diff(x, F) for x in invariants]
    second = [ufl.diff(x, F) for x in first]
    J = ufl.det(F)
    cofactor = ufl.diff(J, F)
    P = slopes[0] * first[0] + slopes[1] * first[1] + p * cofactor
    pairs = [(i, j) for i in range(3) for j in range(3)]
    change = ufl.diff(cofactor, F)

    def tangent(i, j, k, l) -> Any:
        value = p * change[i, j, k, l]
        for a in range(2):
            value += slopes[a] * second[a][i, j, k, l]
            for b in range(2):
                value += curvatures[a][b] * first[a][i, j] * first[b][k, l]
        return value

    upper = [(m, n) for m in range(9) for n in range(m, 9)]
    return ufl.as_vector([P[ij] for ij in pairs] + [tangent(*pairs[m], *pairs[n]) for m, n in upper])


class Solid:
    """The hexes of one rank.

    domain: DOLFINx mesh of triquadratic hexes; dofmap (m, 27) displacement blocks of its owned cells and
    geometry (m, 27), both in DOLFINx's order; n_blocks: local blocks, ghosts included.
    """

    def __init__(
        self, domain: Any, dofmap: NDArray[np.int32], order: NDArray[np.int64], material: Material, kappa: float
    ) -> None:
        cells = domain.topology.index_map(3).size_local
        to_local = np.argsort(order)
        self.dofs = np.ascontiguousarray(dofmap[:cells][:, to_local], np.int32)
        geometry = np.asarray(domain.geometry.dofmaps[0])[:cells][:, to_local]
        self.geometry = np.ascontiguousarray(geometry, np.int32)
        self.points = np.ascontiguousarray(domain.geometry.x, np.float64)
        self.parameters = np.array(material.parameters, np.float64)
        self._gradients = np.ascontiguousarray(hex_shape_gradients(GAUSS).transpose(0, 2, 1))
        self._shapes = np.ascontiguousarray(hex_shapes(GAUSS))
        self._weights = WEIGHTS.copy()
        self._law, law = compiled_law(domain, material)
        self._lib, self._ffi = library(domain.comm)
        self._c = self._ffi.new(
            "solid_t*",
            {
                "n_cells": cells,
                "points": self._pointer(self.points),
                "geometry": self._pointer(self.geometry),
                "dofs": self._pointer(self.dofs),
                "gradients": self._pointer(self._gradients),
                "shapes": self._pointer(self._shapes),
                "weights": self._pointer(self._weights),
                "centre": CENTRE,
                "kappa": kappa,
                "parameters": self._pointer(self.parameters),
                "law": self._ffi.cast("point_law", law),
            },
        )

    @property
    def n_cells(self) -> int:
        """Number of hexes."""
        return len(self.dofs)

    def forces(self, u: Array, q: Array) -> tuple[Array, float, int]:
        """Nodal forces (n, 3), N, not summed over ranks; squared volume error, mm^3; number of inverted hexes.

        u (n, 3): displacements, mm; q (m, 4): pressure coefficients, MPa and MPa/mm.
        """
        forces, sums = np.zeros_like(u), np.zeros(1)
        bad = self._lib.solid_forces(self._c, *map(self._pointer, (u, q, forces, sums)))
        return forces, float(sums[0]), int(bad)

    def pressure_step(self, u: Array, q: Array, du: Array) -> Array:
        """Step (m, 4) of the pressure that goes with the displacement step du (n, 3), mm, from u, q."""
        dq = np.empty_like(q)
        self._lib.solid_pressure_step(self._c, *map(self._pointer, (u, q, du, dq)))
        return dq

    def matrices(self, first: int, last: int, u: Array, q: Array) -> tuple[Array, Array]:
        """Condensed tangents (k, 81, 81), N/mm, and forces (k, 81), N, of the hexes first <= c < last."""
        matrices, forces = np.empty((last - first, DOFS, DOFS)), np.empty((last - first, DOFS))
        self._lib.solid_matrices(self._c, first, last, *map(self._pointer, (u, q, matrices, forces)))
        return matrices, forces

    def assemble(
        self,
        u: Array,
        q: Array,
        rows: NDArray[np.int64],
        place: NDArray[np.int32],
        fixed: NDArray[np.uint8],
        jump: Array,
        values: Array,
        rhs: Array,
    ) -> None:
        """Add the condensed tangent's upper triangle to `values` and minus the force to `rhs`; see `element.c`."""
        arrays: tuple[NDArray[Any], ...] = (u, q, rows, place, fixed, jump, values, rhs)
        self._lib.solid_assemble(self._c, *map(self._pointer, arrays))

    def product(self, matrix: sp.csr_matrix, x: Array) -> Array:
        """A x (n,) of the symmetric A whose upper triangle is `matrix` (n, n), columns rising, diagonal present."""
        y = np.empty_like(x)
        arrays: tuple[NDArray[Any], ...] = (matrix.indptr, matrix.indices, matrix.data, x, y)
        self._lib.symmetric_product(len(x), *map(self._pointer, arrays))
        return y

    def _pointer(self, array: NDArray[Any]) -> Any:
        kind = {"f": "double*", "i": f"int{8 * array.itemsize}_t*", "u": "uint8_t*"}[array.dtype.kind]
        assert array.flags.c_contiguous and (array.dtype.kind != "f" or array.itemsize == 8)
        return self._ffi.cast(kind, array.ctypes.data)


def compiled_law(domain: Any, material: Material) -> tuple[Any, int]:
    """The compiled expression of `point_law` (to be kept alive) and the address of its function."""
    W = dolfinx.fem.functionspace(domain, ("DG", 0, (10,)))
    state = dolfinx.fem.Function(W)
    parameters = dolfinx.fem.Constant(domain, np.array(material.parameters))
    F = ufl.as_matrix([[state[3 * i + j] for j in range(3)] for i in range(3)])
    law = point_law(F, state[9], material, parameters)
    expression = compiled_expression(law, np.full((1, 3), 0.5))
    function = expression.ufcx_expression.tabulate_tensor_float64
    return expression, int(cffi.FFI().cast("uintptr_t", function))


def library(comm: Any = MPI.COMM_WORLD) -> tuple[Any, Any]:
    """Compiled `element.c` and its cffi interface; compiled once per processor kind and version of the source."""
    digest = hashlib.sha256((SOURCE.read_text() + DECLARATIONS + " ".join(FLAGS)).encode()).hexdigest()[:16]
    name = f"equigap_element_{digest}"
    problem = None
    if comm.rank == 0 and not list(FOLDER.glob(f"{name}.*.so")):
        try:
            with compilation():
                _compile(FOLDER, name, FLAGS)
        except ForwardError as error:
            problem = error
    problem = comm.bcast(problem)
    if problem is not None:
        raise problem
    module = _load(next(FOLDER.glob(f"{name}.*.so")), name)
    return module.lib, module.ffi


def _compile(cache: Path, name: str, flags: list[str]) -> None:
    """Compile beside the cache, then move, so that another process sees the whole library or none."""
    ffi = cffi.FFI()
    ffi.cdef(DECLARATIONS)
    ffi.set_source(name, SOURCE.read_text(), extra_compile_args=flags)
    cache.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=cache) as folder:
        built = Path(ffi.compile(tmpdir=folder))
        target = cache / built.name
        shutil.copy2(built, Path(folder) / "ready")
        os.replace(Path(folder) / "ready", target)


def _load(path: Path, name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


__all__ = ["CENTRE", "GAUSS", "PRESSURES", "Solid", "compiled_law", "isochoric_invariants", "library"]
