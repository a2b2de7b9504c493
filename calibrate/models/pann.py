r"""Physics-augmented neural network (PANN): a convex, non-decreasing strain energy of the invariants.

With inputs J1 = I1bar and/or J2 = I2bar^(3/2), shifted and scaled by constants s (1 / range of the data),

    x_i = s_i (J_i - J_i(F = I)),                                       J1(I) = 3, J2(I) = 3^(3/2)
    z_1 = softplus(W_1 x + b_1),   z_k = softplus(W_k z_(k-1) + b_k),
    psi = energy_scale * (w . z_K + v . x)  -  its value at x = 0.

All W_k, w and v are >= 0, the b_k are free; softplus is convex and increasing. psi is therefore convex and
component-wise non-decreasing in (I1bar, I2bar^(3/2)), hence polyconvex (Hartmann and Neff 2003), and zero at
F = I, where the plane-stress (or incompressible) reduction also makes the stress vanish. `v` is the skip
connection. An output bias has no gradient and is left out. After Linden et al. 2023 (J. Mech. Phys. Solids).

PANN_I^N is written by `inputs` ("I1", "I2", "I1I2") and `layers` N, e.g. (4, 4).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.equations.inputs import INPUT_SETS, REFERENCE

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Architecture:
    """What a PANN is before it is fitted. `scales` (2,): 1 / range of (J1, J2). `energy_scale`: MPa, or N/mm.

    Raises `ConfigError` for unknown inputs, or layers that are no positive whole numbers.
    """

    inputs: str = "I1"
    layers: tuple[int, ...] = (4, 4)
    scales: tuple[float, float] = (1.0, 1.0)
    energy_scale: float = 1.0

    def __post_init__(self) -> None:
        if self.inputs not in INPUT_SETS:
            raise errors.ConfigError(f"inputs '{self.inputs}' unknown; choose one of {', '.join(INPUT_SETS)}")
        if not self.layers or any(int(n) != n or n < 1 for n in self.layers):
            raise errors.ConfigError(f"layers {self.layers}: give positive whole numbers, such as 4,4")

    @property
    def n_inputs(self) -> int:
        """Number of inputs: 1 or 2."""
        return len(INPUT_SETS[self.inputs])

    @property
    def shapes(self) -> list[tuple[int, int]]:
        """(outputs, inputs) of each hidden layer."""
        widths = (self.n_inputs, *self.layers)
        return [(b, a) for a, b in pairwise(widths)]

    @property
    def n_parameters(self) -> int:
        """Length of the parameter vector: W_k and b_k of each layer, w, v."""
        return sum(a * b + a for a, b in self.shapes) + self.layers[-1] + self.n_inputs

    @property
    def nonnegative(self) -> NDArray[np.bool_]:
        """Which entries (n_parameters,) of the parameter vector must be >= 0 (all but the biases)."""
        parts = []
        for a, b in self.shapes:
            parts += [np.ones(a * b, bool), np.zeros(a, bool)]
        parts += [np.ones(self.layers[-1], bool), np.ones(self.n_inputs, bool)]
        return np.concatenate(parts)

    def unpack(self, parameters):
        """Vector (n_parameters,) to ([(W_k, b_k)], w, v)."""
        hidden, i = [], 0
        for a, b in self.shapes:
            hidden.append((parameters[i : i + a * b].reshape(a, b), parameters[i + a * b : i + a * b + a]))
            i += a * b + a
        n = self.layers[-1]
        return hidden, parameters[i : i + n], parameters[i + n :]

    def random_start(self, key: jax.Array) -> jax.Array:
        """A random parameter vector (n_parameters,) that keeps the bounds; `key` is a JAX random key."""
        keys = jax.random.split(key, 2 * len(self.shapes) + 2)
        parts = []
        for k, (a, b) in enumerate(self.shapes):
            parts.append(jax.random.uniform(keys[2 * k], (a * b,), maxval=2.0 / b))
            # spreads the kinks of the softplus over the range of the data
            parts.append(jax.random.uniform(keys[2 * k + 1], (a,), minval=-2.0, maxval=0.5))
        parts.append(jax.random.uniform(keys[-2], (self.layers[-1],), maxval=1.0 / self.layers[-1]))
        parts.append(jax.random.uniform(keys[-1], (self.n_inputs,), maxval=1.0))
        return jnp.concatenate(parts)


def polyconvex_inputs(invariants: jax.Array) -> jax.Array:
    """(I1, I2) (2,) to (J1, J2) = (I1, I2^(3/2)) (2,)."""
    return jnp.stack([invariants[0], invariants[1] ** 1.5])


def _network(architecture: Architecture, parameters: jax.Array, x: jax.Array) -> jax.Array:
    hidden, w, v = architecture.unpack(parameters)
    z = x
    for W, b in hidden:
        z = jax.nn.softplus(W @ z + b)
    return w @ z + v @ x


def energy(architecture: Architecture, parameters: jax.Array, invariants: jax.Array) -> jax.Array:
    """Strain energy (scalar, MPa or N/mm) at one pair of invariants (I1, I2) (2,)."""
    index = jnp.array(INPUT_SETS[architecture.inputs])
    shift = jnp.asarray(REFERENCE)
    x = (jnp.asarray(architecture.scales) * (polyconvex_inputs(invariants) - shift))[index]
    rest = _network(architecture, parameters, jnp.zeros_like(x))
    return architecture.energy_scale * (_network(architecture, parameters, x) - rest)


def energy_derivatives(architecture: Architecture, parameters: jax.Array, invariants: jax.Array) -> jax.Array:
    """d psi / d(I1, I2) (..., 2), MPa or N/mm, at invariants (..., 2)."""
    flat = invariants.reshape(-1, 2)
    derivative = jax.vmap(jax.grad(lambda i: energy(architecture, parameters, i)))(flat)
    return derivative.reshape(invariants.shape)
