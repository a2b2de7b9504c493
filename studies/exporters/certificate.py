"""How far an exported law is from its model: largest errors of energy, stress and tangent at random states within the range of its invariants.

In: a law and the derivatives of the energy that the exported code computes. Out: `Errors`, relative to the largest value.
States: in-plane deformation gradients with random stretches in every ratio from uniaxial over pure shear to equi-biaxial tension, turned
at random, with both invariants inside the range.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.equations.kinematics import invariant_hessians, invariants_and_derivatives
from studies.exporters import reference
from studies.exporters.material_law import MaterialLaw

Array = NDArray[np.float64]
Derivatives = Callable[[Array, Array], Array]
STATES, SEED = 200, 0
STEP = 1e-5  # of differences


@dataclass(frozen=True)
class Errors:
    """Largest errors over the largest values, at so many states; energy None where there is none to compare."""

    energy: float | None
    stress: float
    tangent: float
    states: int
    evaluated_by: str


def random_states(law: MaterialLaw, n: int = STATES, seed: int = SEED) -> Array:
    """F (n, 2, 2) with both invariants in their range, in any mode."""
    rng, found = np.random.default_rng(seed), np.empty((0, 2, 2))
    reach = max(law.stretches.values())
    while len(found) < n:
        first = 1 + (reach - 1) * rng.uniform(size=n)
        stretches = np.zeros((n, 2, 2))
        stretches[:, 0, 0], stretches[:, 1, 1] = first, first ** rng.uniform(-0.5, 1.0, n)
        F = _turns(rng, n) @ stretches @ _turns(rng, n)
        values = np.asarray(invariants_and_derivatives(jnp.asarray(F))[0])
        found = np.concatenate([found, F[(values <= np.asarray(law.top)).all(axis=1)]])
    return found[:n]


def errors_of_derivatives(law: MaterialLaw, derivatives: Derivatives, evaluated_by: str, n: int = STATES) -> Errors:
    """Of code that computes (W, W1, W2, W11, W12, W22) (6, n) at invariants (n,), (n,), in incompressible plane stress."""
    F, energy, stress, tangent = expected(law, n)
    values, first = map(np.asarray, invariants_and_derivatives(jnp.asarray(F)))
    second = np.asarray(invariant_hessians(jnp.asarray(F)))
    W, W1, W2, W11, W12, W22 = derivatives(values[:, 0], values[:, 1])
    slopes, curvature = np.stack([W1, W2], 1), np.array([[W11, W12], [W12, W22]])
    P = np.einsum("nk,nkij->nij", slopes, first)
    A = np.einsum("nk,nkijab->nijab", slopes, second)
    A += np.einsum("kln,nkij,nlab->nijab", curvature, first, first)
    return Errors(
        relative(W, energy),
        relative(P, stress),
        relative(A, tangent),
        n,
        evaluated_by,
    )


def errors_of_stress(law: MaterialLaw, stress: Callable[[Array], Array], evaluated_by: str, n: int = STATES) -> Errors:
    """Of a sheet's stress P (n, 2, 2) at F (n, 2, 2); its tangent by differences."""
    F, _, P, A = expected(law, n)
    ways = STEP * np.eye(4).reshape(4, 2, 2)
    columns = [(stress(F + way) - stress(F - way)) / (2 * STEP) for way in ways]
    tangent = np.stack(columns, axis=-1).reshape(A.shape)
    return Errors(None, relative(stress(F), P), relative(tangent, A), n, evaluated_by)


@lru_cache(maxsize=8)
def expected(law: MaterialLaw, n: int) -> tuple[Array, Array, Array, Array]:
    """Random states F (n, 2, 2), and energy (n,), stress (n, 2, 2) and tangent (n, 2, 2, 2, 2) of the model there."""
    F = random_states(law, n)
    W, P = reference.point_energy_and_stress(law.stress, F)
    return F, W, P, reference.point_tangent(law.stress, F)


def relative(found: Array, expected: Array) -> float:
    """Largest difference over the largest expected value."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def _turns(rng: np.random.Generator, n: int) -> Array:
    a = rng.uniform(0, 2 * np.pi, n)
    return np.moveaxis(np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]), -1, 0)
