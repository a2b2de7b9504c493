"""Elementary functions of what an energy may be given: UFL expressions, numbers, arrays of NumPy or JAX (by the array API)."""

from __future__ import annotations

from typing import Any

import numpy as np


def logarithm(x: Any) -> Any:
    """Natural logarithm."""
    return _ufl().ln(x) if _is_form(x) else _functions(x).log(x)


def arc_cosine(x: Any) -> Any:
    """Angle from 0 to pi."""
    return _ufl().acos(x) if _is_form(x) else _functions(x).acos(x)


def cosine(x: Any) -> Any:
    """Cosine of an angle."""
    return _ufl().cos(x) if _is_form(x) else _functions(x).cos(x)


def piecewise(x: Any, limit: float, below: Any, above: Any) -> Any:
    """`below` where x < limit, else `above`; both must be finite everywhere, with their derivatives."""
    if _is_form(x):
        return _ufl().conditional(_ufl().lt(x, limit), below, above)
    return _functions(x).where(x < limit, below, above)


def at_least(x: Any, limit: float) -> Any:
    """The larger of x and limit."""
    return piecewise(x, limit, 0 * x + limit, x)


def _is_form(x: Any) -> bool:
    return hasattr(x, "ufl_shape")


def _ufl() -> Any:
    from forward._dolfinx import ufl

    return ufl


def _functions(x: Any) -> Any:
    return x.__array_namespace__() if hasattr(x, "__array_namespace__") else np
