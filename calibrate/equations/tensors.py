"""2 x 2 tensors (..., 2, 2) in JAX, by their components: far faster than a factorisation of each.

Where several operations follow each other, `Tensors` keeps the components apart until the last one: compiled loops over such arrays take half of the time of those over
arrays (..., 2, 2), and from ten thousand tensors on derivatives a fifth (`python -m benchmarks.tensor_components`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp


@dataclass(frozen=True, eq=False)
class Tensors:
    """Components (...) of tensors (..., 2, 2)."""

    xx: Any
    xy: Any
    yx: Any
    yy: Any

    @classmethod
    def of(cls, F: Any) -> Tensors:
        """Of an array (..., 2, 2)."""
        return cls(F[..., 0, 0], F[..., 0, 1], F[..., 1, 0], F[..., 1, 1])

    @property
    def array(self) -> Any:
        """(..., 2, 2)."""
        parts = jnp.broadcast_arrays(self.xx, self.xy, self.yx, self.yy)
        apart = jax.lax.optimization_barrier(tuple(parts))  # else compilers may work all four out for each of them
        return jnp.stack(apart, axis=-1).reshape(*parts[0].shape, 2, 2)

    @property
    def T(self) -> Tensors:
        """Transposed."""
        return Tensors(self.xx, self.yx, self.xy, self.yy)

    @property
    def det(self) -> Any:
        """Determinant (...)."""
        return self.xx * self.yy - self.xy * self.yx

    @property
    def cofactor(self) -> Tensors:
        """d det F / dF = det F F^-T."""
        return Tensors(self.yy, -self.yx, -self.xy, self.xx)

    @property
    def inverse(self) -> Tensors:
        """F^-1."""
        return self.cofactor.T * (1.0 / self.det)

    def __add__(self, other: Tensors) -> Tensors:
        return Tensors(self.xx + other.xx, self.xy + other.xy, self.yx + other.yx, self.yy + other.yy)

    def __sub__(self, other: Tensors) -> Tensors:
        return self + other * -1.0

    def __mul__(self, factor: Any) -> Tensors:
        """Each times its own number (...)."""
        return Tensors(self.xx * factor, self.xy * factor, self.yx * factor, self.yy * factor)

    def __matmul__(self, other: Tensors) -> Tensors:
        return Tensors(
            self.xx * other.xx + self.xy * other.yx,
            self.xx * other.xy + self.xy * other.yy,
            self.yx * other.xx + self.yy * other.yx,
            self.yx * other.xy + self.yy * other.yy,
        )

    def dot(self, other: Tensors) -> Any:
        """A : B (...)."""
        return self.xx * other.xx + self.xy * other.xy + self.yx * other.yx + self.yy * other.yy

    def applied(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Both components (...) of A v, of a vector with components x and y."""
        return self.xx * x + self.xy * y, self.yx * x + self.yy * y

    @classmethod
    def dyad(cls, left: tuple[Any, Any], right: tuple[Any, Any]) -> Tensors:
        """a (x) b of vectors by their components."""
        return cls(left[0] * right[0], left[0] * right[1], left[1] * right[0], left[1] * right[1])


def det(F: Any) -> Any:
    """Determinant (...)."""
    return F[..., 0, 0] * F[..., 1, 1] - F[..., 0, 1] * F[..., 1, 0]


def cofactor(F: Any) -> Any:
    """d det F / dF = det F F^-T, (..., 2, 2)."""
    return Tensors.of(F).cofactor.array


def inverse(F: Any) -> Any:
    """F^-1 (..., 2, 2)."""
    return Tensors.of(F).inverse.array


def product(A: Any, B: Any) -> Any:
    """A B (..., 2, 2) of tensors (..., 2, 2)."""
    return (Tensors.of(A) @ Tensors.of(B)).array
