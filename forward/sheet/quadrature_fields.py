"""Fields of values at the Gauss points of a sheet's cells, q in each: functions for state variables, compiled expressions."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from forward._dolfinx import QUADRATURE_DEGREE, basix, dolfinx
from forward.compilation import compiled_expression

Array = NDArray[np.float64]


def quadrature_function(domain: Any, shape: tuple[int, ...]) -> Any:
    """A function (zero) of values of `shape` at the Gauss points."""
    element = basix.ufl.quadrature_element(domain.basix_cell(), shape, degree=QUADRATURE_DEGREE)
    return dolfinx.fem.Function(dolfinx.fem.functionspace(domain, element))


def quadrature_expression(value: Any, domain: Any) -> Any:
    """Compiled UFL `value` at the Gauss points of a mesh."""
    points, _ = basix.make_quadrature(domain.basix_cell(), QUADRATURE_DEGREE)
    return compiled_expression(value, points)


def evaluate(expression: Any, domain: Any) -> Array:
    """Values (cells, q, ...) of a compiled expression in the cells of this rank, ghosts included."""
    return expression.eval(domain, np.arange(len(domain.geometry.dofmaps[0]), dtype=np.int32))


def get_values(function: Any) -> Array:
    """Values (cells, q, ...) of a function at the Gauss points."""
    shape = (*function.function_space.dofmap.list.shape, *function.ufl_shape)
    values = function.x.array.reshape(-1, function.function_space.dofmap.bs)
    return values[function.function_space.dofmap.list].reshape(shape)


def set_values(function: Any, values: Array) -> None:
    """Give a function at the Gauss points its values (cells, q, ...)."""
    bs = function.function_space.dofmap.bs
    function.x.array.reshape(-1, bs)[function.function_space.dofmap.list.ravel()] = values.reshape(-1, bs)
