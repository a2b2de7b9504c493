r"""Classical hyperelastic laws with free parameters: what people know beside a network.

In: in-plane F (..., 2, 2) of an incompressible sheet and parameters (q,). Out: P (..., 2, 2) = d psi / dF and its derivative by the
parameters, both exact (JAX), in the unit of the moduli. Sources: Mooney 1940 and Rivlin 1948; Yeoh 1993; Ogden 1972, with
mu the initial shear modulus; Arruda and Boyce 1993, five terms; Gent 1996. Limits of extension N and Jm enter a fit by their
reciprocals, which are 0 for a chain without a limit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.equations.kinematics import invariants

Array = NDArray[np.float64]
Energy = Callable[[Any, Any], Any]  # of F (2, 2) and parameters (q,)
CHUNK = 4096  # states that are evaluated at once, so that a law is compiled once
EQUAL = 1e-14  # keeps the root of equal stretches differentiable
NO_LIMIT = 1e-6  # least reciprocal of a limit of extension
EIGHT_CHAINS = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)
STATES = 25  # of each principal logarithmic strain, at which stability is checked


@dataclass(frozen=True)
class Parameter:
    """start: of a fit, in initial shear moduli where it is a modulus. reciprocal: a fit works with 1 / value."""

    name: str
    start: float
    modulus: bool = True
    reciprocal: bool = False

    def value(self, fitted: float) -> float:
        """As it is reported; infinite for a limit that was not seen."""
        if not self.reciprocal:
            return fitted
        return 1 / fitted if fitted > 1.001 * NO_LIMIT else np.inf


@dataclass(frozen=True)
class Law:
    """psi(F, parameters), MPa; differentiable by JAX."""

    name: str
    energy: Energy
    parameters: tuple[Parameter, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters."""
        return tuple(p.name for p in self.parameters)

    @property
    def moduli(self) -> NDArray[np.bool_]:
        """Which parameters (q,) the stress is proportional to, taken together."""
        return np.array([p.modulus for p in self.parameters])

    @property
    def lower(self) -> Array:
        """Bounds (q,) of a fit."""
        return np.array([NO_LIMIT if p.reciprocal else -np.inf for p in self.parameters])

    def start(self, shear_modulus: float, largest: float) -> Array:
        """Start (q,) of a fit. shear_modulus: a guess, MPa; largest: I1 - 3 of the data, within which no limit lies."""
        scale = [
            shear_modulus * p.start if p.modulus else min(p.start, 0.3 / largest) if p.reciprocal else p.start
            for p in self.parameters
        ]
        return np.array(scale)

    def stress(self, F: Array, parameters: Array) -> Array:
        """P (..., 2, 2) at F (..., 2, 2)."""
        return self.stress_and_sensitivity(F, parameters)[0]

    def stress_and_sensitivity(self, F: Array, parameters: Array) -> tuple[Array, Array]:
        """P (..., 2, 2) and dP / d parameters (q, ..., 2, 2) at F (..., 2, 2)."""
        flat, p = F.reshape(-1, 2, 2), jnp.asarray(parameters, float)
        n, q = len(flat), len(self.parameters)
        padded = np.concatenate([flat, np.broadcast_to(np.eye(2), (-n % CHUNK, 2, 2))])
        parts = [_evaluated(self.energy, jnp.asarray(part), p) for part in padded.reshape(-1, CHUNK, 2, 2)]
        P = np.concatenate([np.asarray(part[0]) for part in parts])[:n]
        slopes = np.concatenate([np.asarray(part[1]) for part in parts])[:n]
        return P.reshape(F.shape), np.moveaxis(slopes, -1, 0).reshape(q, *F.shape)

    def stability(self, parameters: Array, tops: tuple[float, float]) -> float:
        """Least eigenvalue of d2 psi / d(ln stretch)2, MPa, at plane states with invariants up to `tops`; positive: stable
        in the sense of Drucker (Hill 1958), as finite-element programs check it."""
        reach = float(np.log(max(tops)) / 2)
        line = np.linspace(-reach, reach, STATES)
        e1, e2 = np.meshgrid(line, line)
        e = np.stack([e1.ravel(), e2.ravel()], axis=1)
        squares = np.exp(2 * np.column_stack([e, -e.sum(axis=1)]))
        inside = (squares.sum(axis=1) <= tops[0]) & ((1 / squares).sum(axis=1) <= tops[1])
        hessians = np.asarray(_hessians(self.energy, jnp.asarray(e), jnp.asarray(parameters, float)))
        return float(np.linalg.eigvalsh(hessians[inside])[:, 0].min())


@partial(jax.jit, static_argnums=0)
def _evaluated(energy: Energy, F: Any, p: Any) -> tuple[Any, Any]:
    stress = jax.grad(energy)
    return jax.vmap(lambda f: (stress(f, p), jax.jacfwd(lambda q: stress(f, q))(p)))(F)


@partial(jax.jit, static_argnums=0)
def _hessians(energy: Energy, e: Any, p: Any) -> Any:
    return jax.vmap(jax.hessian(lambda one: energy(jnp.diag(jnp.exp(one)), p)))(e)


def squared_stretches(F: Any) -> tuple[Any, Any, Any]:
    """Squares of the principal stretches of an incompressible sheet, F (2, 2); in the plane in closed form."""
    C = F.T @ F
    mean, half = 0.5 * (C[0, 0] + C[1, 1]), 0.5 * (C[0, 0] - C[1, 1])
    root = jnp.sqrt(half**2 + C[0, 1] ** 2 + EQUAL)
    return mean + root, mean - root, 1 / (C[0, 0] * C[1, 1] - C[0, 1] ** 2)


def neo_hooke(F: Any, p: Any) -> Any:
    """mu/2 (I1 - 3), p = (mu,)."""
    return p[0] / 2 * (invariants(F)[0] - 3)


def mooney_rivlin(F: Any, p: Any) -> Any:
    """c10 (I1 - 3) + c01 (I2 - 3), p = (c10, c01)."""
    I1, I2 = invariants(F)
    return p[0] * (I1 - 3) + p[1] * (I2 - 3)


def yeoh(F: Any, p: Any) -> Any:
    """c10 (I1 - 3) + c20 (I1 - 3)^2 + c30 (I1 - 3)^3, p = (c10, c20, c30)."""
    x = invariants(F)[0] - 3
    return p[0] * x + p[1] * x**2 + p[2] * x**3


def ogden(F: Any, p: Any) -> Any:
    """sum over terms of 2 mu / alpha^2 sum (stretch^alpha - 1), p = (mu, alpha) of every term in turn."""
    squares = squared_stretches(F)
    terms = range(0, len(p), 2)
    return sum(2 * p[k] / p[k + 1] ** 2 * sum(s ** (p[k + 1] / 2) - 1 for s in squares) for k in terms)


def arruda_boyce(F: Any, p: Any) -> Any:
    """mu sum c_k / N^(k-1) (I1^k - 3^k), p = (mu, 1 / N)."""
    I1 = invariants(F)[0]
    return p[0] * sum(c * p[1] ** (k - 1) * (I1**k - 3**k) for k, c in enumerate(EIGHT_CHAINS, 1))


def gent(F: Any, p: Any) -> Any:
    """-mu Jm / 2 ln(1 - (I1 - 3) / Jm), p = (mu, 1 / Jm)."""
    return -p[0] / (2 * p[1]) * jnp.log1p(-p[1] * (invariants(F)[0] - 3))


CLASSICAL_LAWS = (
    Law("neo-Hooke", neo_hooke, (Parameter("mu", 1.0),)),
    Law("Mooney-Rivlin", mooney_rivlin, (Parameter("c10", 0.4), Parameter("c01", 0.1))),
    Law("Yeoh", yeoh, (Parameter("c10", 0.5), Parameter("c20", 0.0), Parameter("c30", 0.0))),
    Law("Ogden, one term", ogden, (Parameter("mu", 1.0), Parameter("alpha", 2.2, modulus=False))),
    Law(
        "Ogden, two terms",
        ogden,
        (
            Parameter("mu1", 0.8),
            Parameter("alpha1", 2.2, modulus=False),
            Parameter("mu2", 0.2),
            Parameter("alpha2", -2.0, modulus=False),
        ),
    ),
    Law("Arruda-Boyce", arruda_boyce, (Parameter("mu", 1.0), Parameter("N", 0.05, False, True))),
    Law("Gent", gent, (Parameter("mu", 1.0), Parameter("Jm", 0.02, False, True))),
)
