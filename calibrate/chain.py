"""The chain from measured displacements to the residual of every virtual-work equation, differentiable in everything.

In: an Experiment, virtual fields, a base model as spline coefficients, and effects with their amplitudes and shapes.
Out: residual (t, 2 v): internal virtual work minus measured force, N, rows ordered as in `Equilibrium`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.basis import DEGREE, SingleBasis, _pieces
from calibrate.effects.effect import Data, Effect
from calibrate.equilibrium import Equilibrium
from calibrate.kinematics import invariants

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Addition:
    """An effect that is in the model: amplitudes (p,) and the values of its shapes."""

    effect: Effect
    amplitudes: tuple[float, ...]
    shape: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Chain:
    """One Experiment's chain with base functions of a single invariant."""

    system: Equilibrium
    basis: SingleBasis

    @cached_property
    def data(self) -> Data:
        return Data.of(self.system.experiment)

    @cached_property
    def virtual(self) -> Any:
        """(v, m, 2): thickness x area x gradient of each virtual field, mm^2."""
        dense = self.system.virtual_gradients.toarray()
        return jnp.asarray(dense.reshape(len(dense), -1, 2))

    @cached_property
    def measured(self) -> Any:
        """Measured forces (t, 2, v), N; zero where there is none, and where it was not measured."""
        loads = self.system.loads.reshape(len(self.system.loads), 2, -1)
        return jnp.asarray(np.nan_to_num(loads))

    @cached_property
    def carries_load(self) -> Any:
        return jnp.asarray(self.system.fields.boundary >= 0)

    def residual(self, c: Any, effects: tuple[Effect, ...] = (), amplitudes: Any = (), shapes: Any = ()) -> Any:
        """Residual (t, 2 v), N, of coefficients c (n,), each effect with amplitudes (p,) and shape (q,)."""
        u = self.data.u
        for effect, a, shape in zip(effects, amplitudes, shapes, strict=True):
            u = effect.displacements(self.data, u, a, shape)
        F = gradients(self.data, u)
        law = partial(base_law, self.basis.k, self.basis.n, self.basis.top, c)
        P = jax.vmap(law)(F.reshape(-1, 2, 2)).reshape(F.shape)
        loads = self.measured
        for effect, a, shape in zip(effects, amplitudes, shapes, strict=True):
            P = effect.stress(self.data, F, P, a, shape, law)
            loads = effect.loads(self.data, loads, self.carries_load, a, shape)
        work = jnp.einsum("vmj,tmij->tiv", self.virtual, P)
        return (work - loads).reshape(len(work), -1)

    def signature(self, c: Any, effect: Effect, shape: tuple[float, ...], others: tuple[Addition, ...] = ()) -> Array:
        """d residual / d amplitude at the null value, (p, t, 2 v), beside effects that are in the model already."""
        null = jnp.array([p.null for p in effect.amplitudes])
        effects = (*(o.effect for o in others), effect)
        known = [jnp.array(o.amplitudes) for o in others]
        shapes = (*(jnp.array(o.shape) for o in others), jnp.array(shape))

        def residual(a):
            return self.residual(c, effects, (*known, a), shapes)

        return np.moveaxis(np.asarray(jax.jacfwd(residual)(null)), -1, 0)


def gradients(data: Data, u: Any) -> Any:
    """F (t, m, 2, 2) of displacements (t, n, 2)."""
    return jnp.eye(2) + jnp.einsum("tmki,mkj->tmij", u[:, data.triangles], data.slopes)


def base_law(k: int, n: int, top: float, c: Any, f: Any) -> Any:
    """In-plane P (2, 2) at f (2, 2) of psi_k(J_k) with spline coefficients c (n,), as `SingleBasis` has it."""
    pieces = jnp.asarray(_pieces(n)[0])

    def energy_input(f):
        values = invariants(f)
        return values[0] - 3.0 if k == 0 else values[1] ** 1.5 - 3.0**1.5

    J, dJ = jax.value_and_grad(energy_input)(f)
    s = jnp.sqrt(jnp.clip(J / top, 1e-12, 1.0)) * (n - DEGREE)
    first = jnp.clip(jnp.floor(s).astype(int), 0, n - DEGREE - 1)
    t = s - first
    values = jnp.stack([jnp.ones_like(t), t, t * t, t * t * t]) @ pieces[first]
    return (values @ jax.lax.dynamic_slice(c, (first,), (DEGREE + 1,))) * dJ
