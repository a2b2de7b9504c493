"""Tensors by their components are tensors: every operation beside NumPy's, and derivatives through all of them."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from calibrate.equations.tensors import Tensors, cofactor, det, inverse, product

RNG = np.random.default_rng(0)
A, B = (np.eye(2) + 0.3 * RNG.standard_normal((3, 5, 2, 2)) for _ in range(2))
V, W = (RNG.standard_normal((3, 5, 2)) for _ in range(2))


def pair(values):
    return values[..., 0], values[..., 1]


OPERATIONS = {
    "array": (lambda a, b: a.array, A),
    "sum": (lambda a, b: (a + b).array, A + B),
    "difference": (lambda a, b: (a - b).array, A - B),
    "multiple": (lambda a, b: (a * V[..., 0]).array, A * V[..., 0, None, None]),
    "product": (lambda a, b: (a @ b).array, A @ B),
    "transposed": (lambda a, b: (a.T @ b).array, np.swapaxes(A, -1, -2) @ B),
    "inverse": (lambda a, b: a.inverse.array, np.linalg.inv(A)),
    "cofactor": (lambda a, b: a.cofactor.array, np.linalg.det(A)[..., None, None] * np.swapaxes(np.linalg.inv(A), -1, -2)),
    "determinant": (lambda a, b: a.det, np.linalg.det(A)),
    "double contraction": (lambda a, b: a.dot(b), (A * B).sum(axis=(-2, -1))),
    "of a vector": (lambda a, b: jnp.stack(a.applied(*pair(V)), axis=-1), np.einsum("...ij,...j->...i", A, V)),
    "dyad": (lambda a, b: Tensors.dyad(pair(V), pair(W)).array, np.einsum("...i,...j->...ij", V, W)),
}  # fmt: skip


@pytest.mark.parametrize("name", OPERATIONS)
def test_operations(name):
    work, expected = OPERATIONS[name]
    np.testing.assert_allclose(work(Tensors.of(A), Tensors.of(B)), expected, atol=1e-13)


def test_of_arrays_at_once():
    np.testing.assert_allclose(product(A, B), A @ B, atol=1e-13)
    np.testing.assert_allclose(inverse(A), np.linalg.inv(A), atol=1e-12)
    np.testing.assert_allclose(cofactor(A), det(A)[..., None, None] * np.swapaxes(np.linalg.inv(A), -1, -2), atol=1e-12)


def test_one_tensor_times_many_is_as_many():
    found = (Tensors.of(jnp.asarray(A)) @ Tensors.of(jnp.asarray(B[0]))).array
    np.testing.assert_allclose(found, A @ B[0], atol=1e-13)


@pytest.mark.parametrize("transform", [jax.jacfwd, jax.jacrev])
def test_derivatives_go_through(transform):
    """d det F / dF is the cofactor; d (F^-1) / dF = -F^-1 dF F^-1."""
    F, dF = A[0, 0], B[0, 0]
    np.testing.assert_allclose(transform(lambda f: Tensors.of(f).det)(F), cofactor(F), atol=1e-12)
    slope = transform(lambda f: Tensors.of(f).inverse.array)(F)
    expected = -np.linalg.inv(F) @ dF @ np.linalg.inv(F)
    np.testing.assert_allclose(np.einsum("ijkl,kl->ij", slope, dF), expected, atol=1e-12)
