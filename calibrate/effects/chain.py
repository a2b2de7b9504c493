"""The chain from measured displacements to the residual of every virtual-work equation, differentiable in everything.

In: an Experiment, virtual fields, a base model as spline coefficients, and effects with their amplitudes and shapes.
Out: residual (t, 2 v): internal virtual work minus measured force, N, rows ordered as in `Equilibrium`, and its
derivatives by coefficients, amplitudes, shapes and displacements. In plane strain base and effects act on the isochoric part,
as in an incompressible sheet; the bulk modulus is the last coefficient (`calibrate.equations.isochoric`). Compiled code depends on the effects and on the
sizes of the arrays only, so that it serves every experiment of a size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.effects.effect import STAGES, Effect
from calibrate.effects.support.effect_data import Data
from calibrate.effects.support.nodal_derivatives import gradients
from calibrate.equations import isochoric as plane_strain
from calibrate.equations.basis import PlaneStrainBasis, SingleBasis, energy_basis
from calibrate.equations.equilibrium import Equilibrium
from calibrate.equations.kinematics import invariants
from calibrate.equations.splines import DEGREE, polynomial_pieces

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Addition:
    """An effect that is in the model: amplitudes (p,) and the values of its shapes."""

    effect: Effect
    amplitudes: tuple[float, ...]
    shape: tuple[float, ...] = ()


Additions = tuple[Addition, ...]
Parts = tuple[tuple[Effect, ...], tuple[Any, ...], tuple[Any, ...]]  # effects, their amplitudes, their shapes


def ordered(additions: Additions) -> Additions:
    """From the material to the camera, the order in which effects act on the stress, and against which displacements and
    loads are corrected."""
    return tuple(sorted(additions, key=lambda a: (STAGES.index(a.effect.stage), a.effect.name)))


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Arrays:
    """What the compiled functions read. measured (t, 2, b): forces of the loaded boundaries, N, zero where unmeasured;

    top: range of the basis. Virtual fields, whose number differs between experiments, are applied outside.
    """

    data: Data
    measured: Any
    top: Any


@dataclass(frozen=True, eq=False)
class Chain:
    """One Experiment's chain with base functions of a single invariant."""

    system: Equilibrium
    basis: SingleBasis | PlaneStrainBasis

    @cached_property
    def data(self) -> Data:
        """The Experiment, prepared for effects."""
        return Data.of(self.system.experiment)

    @cached_property
    def arrays(self) -> Arrays:
        """What the compiled functions read; a force that was not measured is 0."""
        loads = self.system.loads.reshape(len(self.system.loads), 2, -1)[:, :, self.system.fields.boundary >= 0]
        return Arrays(self.data, jnp.asarray(np.nan_to_num(loads)), jnp.asarray(self.energy.top))

    @cached_property
    def virtual(self) -> Array:
        """(v, 2 m): thickness x area x gradient of each virtual field, mm^2."""
        return self.system.virtual_gradients.toarray()

    def work(self, stress: Any) -> Array:
        """Virtual work (..., t, 2 v), N, of stresses (..., t, m, 2, 2)."""
        P = np.asarray(stress)
        flat = np.moveaxis(P, -2, -3).reshape(-1, P.shape[-3] * 2)
        return (flat @ self.virtual.T).reshape(*P.shape[:-3], -1)

    def spread(self, loads: Any) -> Array:
        """Right-hand sides (..., t, 2 v), N, of forces (..., t, 2, b) of the loaded boundaries."""
        given = np.asarray(loads)
        full = np.zeros((*given.shape[:-1], self.system.fields.n_fields))
        full[..., self.system.fields.boundary >= 0] = given
        return full.reshape(*given.shape[:-2], -1)

    def disturbed(self, noise: Array) -> Chain:
        """The same chain with noise (t, n, 2), mm, on the displacements."""
        twin = Chain(self.system, self.basis)
        data = replace(self.data, u=self.data.u + noise)
        twin.__dict__.update(data=data, arrays=replace(self.arrays, data=data))
        return twin

    @property
    def energy(self) -> SingleBasis:
        """The functions of the invariant alone."""
        found = energy_basis(self.basis)
        assert isinstance(found, SingleBasis)
        return found

    @property
    def kind(self) -> tuple[int, int, bool]:
        """Invariant and number of its functions, and whether in plane strain."""
        return self.energy.k, self.energy.n, isinstance(self.basis, PlaneStrainBasis)

    def residual(self, c: Any, additions: Additions = ()) -> Array:
        """Residual (t, 2 v), N, of coefficients c (n,) and effects, in whatever order these are given."""
        return self.work(self.stress(c, additions)) - self.external(additions)

    def stress(self, c: Any, additions: Additions = ()) -> Array:
        """P (t, m, 2, 2), MPa, of coefficients c (n,) and the effects in the model."""
        parts, c = _parts(additions), jnp.asarray(c)
        F = self._deformed(parts)
        return np.asarray(
            _whole(self.kind, c, F, _stages(self.kind, parts[0], self.arrays, c, *_floated(parts), F)[-1])
        )

    def external(self, additions: Additions = ()) -> Array:
        """Loads (t, 2 v), N, as the effects correct them: minus the residual of a material without stiffness."""
        effects, amplitudes, shapes = _parts(additions)
        return self.spread(_external(effects, self.arrays, self.arrays.measured, _floats(amplitudes), _floats(shapes)))

    def noise_shift(self, c: Any, factor: Any) -> Array:
        """Mean change (t, 2 v), N, that displacement noise brings into the residual: second order in the noise.

        factor (n, s): noise as a map of independent normal numbers, see `noise_model.noise_factor`. With v the axes of
        the covariance of a displacement component's gradient in a triangle, the mean stress is P(F) plus half of
        P(F + e v) + P(F - e v) - 2 P(F) for e along x and y (sigma points; Julier and Uhlmann 1997).
        """
        spread = sp.csr_array(self.system.gradient @ factor)
        x, y = spread[0::2], spread[1::2]
        xy = np.asarray((x * y).sum(axis=1)).ravel()
        square = [np.asarray((part * part).sum(axis=1)).ravel() for part in (x, y)]
        covariance = np.stack([np.stack([square[0], xy], axis=1), np.stack([xy, square[1]], axis=1)], axis=1)
        values, vectors = np.linalg.eigh(covariance)
        axes = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
        return self.work(_noise_shift(self.kind, self.arrays, jnp.asarray(c), jnp.asarray(axes)))

    def pulled_back(self, c: Array, additions: Additions, forces: Array) -> Array:
        """K^T forces (t, n, 2) of forces (t, 2 v), N; K: tangent of base and effects in the material, at the displacements that
        additions correct."""
        F, correction = self._corrected(additions)
        virtual = np.asarray(forces).reshape(len(F), 2, -1) @ self.virtual
        stress = jnp.asarray(virtual.reshape(len(F), 2, -1, 2).swapaxes(1, 2))
        dual = np.asarray(self._pulled_stress(jnp.asarray(c), _local(additions), jnp.asarray(F), stress))
        nodal = np.moveaxis(dual, 2, 0).reshape(2 * len(F), -1) @ self.system.gradient
        return correction(np.moveaxis(nodal.reshape(2, len(F), -1), 0, -1)[None])[0]

    def spread_of_noise(self, c: Array, additions: Additions, factor: sp.csr_array) -> list[Array]:
        """K B (2 v, 2 s), N, of every increment, with B the factor (n, s) of the noise and K as in `pulled_back`.

        What an increment has of the noise of others is taken for more of its own.
        """
        F, correction = self._corrected(additions)
        local = _local(additions)
        if local:
            tangents = [self.system.stiffness(modulus) for modulus in self._moduli(c, local, F)]
        else:
            tangents = [self.system.tangent(self.basis, f, c) for f in F]
        rows = np.array(
            [np.concatenate([np.stack([k.toarray() for k in row], axis=-1) for row in blocks]) for blocks in tangents]
        )
        moved = correction(rows.swapaxes(0, 1))
        return [np.hstack([moved[:, i, :, k] @ factor for k in range(2)]) for i in range(len(F))]

    def _moduli(self, c: Array, local: Additions, F: Array) -> Array:
        """dP/dF (t, m, 2, 2, 2, 2), MPa, of base and effects in the material, times the root of 1 + |dP/dF of other increments|^2
        over its own."""
        effects, amplitudes, shapes = _parts(local)
        given, G = (self.kind, effects, self.arrays, jnp.asarray(c)), jnp.asarray(F)
        values = _floats(amplitudes), _floats(shapes)
        stages = _stages(*given, *values, G)
        t, m = F.shape[:2]
        own, others, areas = np.zeros((t, m, 2, 2, 2, 2)), np.zeros(t), self.system.areas[:, None, None]
        units = jnp.broadcast_to(jnp.eye(4).reshape(4, 1, 1, 2, 2), (4, t, m, 2, 2))
        f, df = _law_gradients(self.kind, G), _law_changes(self.kind, G, units)
        base = _base_pushed(self.kind, self.arrays, jnp.asarray(c), f, df)
        together = [[j] for j in range(t)] if any(effect.remembers for effect in effects) else [list(range(t))]
        for some in together:
            only = jnp.zeros((t, 1, 1, 1)).at[np.array(some)].set(1.0)
            dP = _pushed_behind(*given, *values, f, stages, only * df, only * base)
            dP = np.asarray(_whole_changes(self.kind, jnp.asarray(c), G, stages[-1], only * units, dP))
            own[some] = np.moveaxis(dP[:, some].reshape(2, 2, len(some), m, 2, 2), (0, 1), (4, 5))
            sizes = (areas * dP**2).sum(axis=(0, 2, 3, 4))
            sizes[some] = 0.0
            others += sizes
        sizes = (areas[..., None, None] * own**2).sum(axis=(1, 2, 3, 4, 5))
        return own * np.sqrt(1 + others / sizes)[:, None, None, None, None, None]

    def _pulled_stress(self, c: Any, local: Additions, F: Any, stress: Any) -> Any:
        """Duals (t, m, 2, 2) of F of those of the stress, with base and effects in the material."""
        kind, arrays, (effects, amplitudes, shapes) = self.kind, self.arrays, _parts(local)
        f, values = _law_gradients(kind, F), (_floats(amplitudes), _floats(shapes))
        stages = _stages(kind, effects, arrays, c, *values, F)
        whole = jnp.zeros_like(F)
        if kind[-1]:
            whole, stress = _whole_pulled(c, F, stages[-1], stress)
        dual = jnp.zeros_like(F)
        for effect, a, shape, P in reversed(list(zip(effects, *values, stages[:-1], strict=True))):
            if _acts(effect, "stress"):
                own, stress = _stress_pulled(kind, effect, arrays, c, f, P, a, shape, stress)
                dual = dual + own
        dual = dual + _base_pushed(kind, arrays, c, f, stress[None])[0]  # the tangent of the base is symmetric
        return whole + _isochoric_pulled(F, dual) if kind[-1] else dual

    @cached_property
    def gradients(self) -> Any:
        """F (t, m, 2, 2) of the measured displacements."""
        return _gradients(self.data, self.data.u)

    def _deformed(self, parts: Parts) -> Any:
        """F (t, m, 2, 2) at the displacements that effects correct."""
        if not any(_acts(effect, "displacements") for effect in parts[0]):
            return self.gradients
        return _gradients(self.data, _displaced(parts[0], self.arrays, self.data.u, *_floated(parts)))

    def _corrected(self, additions: Additions) -> tuple[Array, Callable[[Array], Array]]:
        """F (t, m, 2, 2) at corrected displacements, and duals (k, t, n, 2) of these to those of the measured ones."""
        parts = _parts(additions)

        def correction(duals: Array) -> Array:
            if not any(_acts(effect, "displacements") for effect in parts[0]):
                return duals
            return np.asarray(_pulled(parts[0], self.arrays, *_floated(parts), jnp.asarray(duals)))

        return np.asarray(self._deformed(parts)), correction

    def signature(self, c: Any, effect: Effect, shape: tuple[float, ...], others: Additions = ()) -> Array:
        """d residual / d amplitude at the null value, (p, t, 2 v), beside effects that are in the model already."""
        null = tuple(p.null for p in effect.amplitudes)
        return self.derivative(c, (*others, Addition(effect, null, shape)))

    def _behind(self, c: Array, additions: Additions) -> tuple[Any, list[Any]]:
        """F, and P of the base and behind every effect; kept, as many effects are tried beside the same ones."""
        key = (c.tobytes(), additions)
        kept = self.__dict__.get("_kept")
        if kept is None or kept[0] != key:
            parts = _parts(additions)
            F = self._deformed(parts)
            kept = key, (F, _stages(self.kind, parts[0], self.arrays, jnp.asarray(c), *_floated(parts), F))
            self.__dict__["_kept"] = kept
        return kept[1]

    def derivative(self, c: Any, additions: Additions) -> Array:
        """d residual / d amplitudes of the last addition, (p, t, 2 v), at the values they have."""
        last, whole = additions[-1], ordered(additions)
        c, place = np.asarray(c, float), next(i for i, one in enumerate(whole) if one is last)
        if last.amplitudes != tuple(p.null for p in last.effect.amplitudes):
            return self._change(c, whole, place, *self._behind(c, whole))
        F, stages = self._behind(c, ordered(additions[:-1]))  # it changes nothing yet
        return self._change(c, whole, place, F, [*stages[: place + 1], *stages[place:]])

    def jacobian(self, c: Any, additions: Additions) -> Array:
        """d residual / d amplitudes and shapes of all additions, (k, t, 2 v): of each its amplitudes, then its shapes."""
        c, whole = np.asarray(c, float), ordered(additions)
        behind = self._behind(c, whole)
        own = {one.effect: self._change(c, whole, i, *behind, shapes=True) for i, one in enumerate(whole)}
        return np.concatenate([own[one.effect] for one in additions])

    def _change(self, c: Array, whole: Additions, place: int, F: Any, stages: list[Any], shapes: bool = False) -> Array:
        """d residual / d amplitudes, and `shapes` behind them, of the effect at a place among all in their order.

        Its direct change of displacements, stress and loads, each pushed through the effects that come after it.
        """
        one, inner, outer = whole[place], _parts(whole[:place]), _parts(whole[place + 1 :])
        effect, a, shape = one.effect, jnp.asarray(one.amplitudes, float), jnp.asarray(one.shape, float)
        arrays, kind, size = self.arrays, self.kind, len(a) + shapes * len(shape)
        data, P, coefficients = arrays.data, stages[place], jnp.asarray(c)
        dF = df = None
        if _acts(effect, "displacements"):
            u = _displaced(outer[0], arrays, data.u, *_floated(outer))
            du, u = _change_of_displacements(effect, shapes, data, u, a, shape), _moved(effect, data, u, a, shape)
            for other, b, s in reversed(list(zip(inner[0], *_floated(inner), strict=True))):
                if _acts(other, "displacements"):
                    du, u = _moved_on(other, data, u, b, s, du), _moved(other, data, u, b, s)
            dF = _change_of_gradients(data, du)
        f = _law_gradients(kind, F)
        acts = _acts(effect, "stress")
        dP = (
            _direct(kind, effect, shapes, arrays, coefficients, f, P, a, shape) if acts else jnp.zeros((size, *f.shape))
        )
        if dF is not None:
            df = _law_changes(kind, F, dF)
            pushed = _pushed(kind, inner[0], arrays, coefficients, *_floated(inner), f, stages[: place + 1], df)
            dP = dP + (_pushed_on(kind, effect, arrays, coefficients, f, P, a, shape, df, pushed) if acts else pushed)
        behind = stages[place + 1 :]
        dP = _pushed_behind(kind, outer[0], arrays, coefficients, *_floated(outer), f, behind, df, dP)
        result = self.work(_whole_changes(kind, coefficients, F, behind[-1], dF, dP))
        if not _acts(effect, "loads"):
            return result
        loads = _external(outer[0], arrays, arrays.measured, *_floated(outer))
        dl, loads = _change_of_loads(effect, shapes, data, loads, a, shape), _loaded(effect, data, loads, a, shape)
        for other, b, s in reversed(list(zip(inner[0], *_floated(inner), strict=True))):
            if _acts(other, "loads"):
                dl, loads = _loaded_on(other, data, loads, b, s, dl), _loaded(other, data, loads, b, s)
        return result - self.spread(dl)


def _floats(values: Any) -> tuple[Any, ...]:
    return tuple(jnp.asarray(v, float) for v in values)


def _parts(additions: Additions) -> Parts:
    """Effects from the material to the camera, their amplitudes and shapes."""
    additions = ordered(additions)
    return (
        tuple(a.effect for a in additions),
        tuple(a.amplitudes for a in additions),
        tuple(a.shape for a in additions),
    )


def _floated(parts: Parts) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
    return _floats(parts[1]), _floats(parts[2])


def _law(kind, arrays, c):
    """The base model's stress (2, 2) at one deformation gradient (2, 2); in plane strain at its isochoric part."""
    k, n, _ = kind
    return partial(base_law, k, n, arrays.top, c)


def _law_gradients(kind, F):
    """What laws and effects take for the deformation gradient (..., 2, 2) of an incompressible sheet."""
    return plane_strain.isochoric(F) if kind[-1] else F


def _law_changes(kind, F, changes):
    """Changes (p, ..., 2, 2) of it by changes of F."""
    if not kind[-1]:
        return changes
    return jax.lax.map(lambda change: jax.jvp(plane_strain.isochoric, (F,), (change,))[1], changes)


def _whole(kind, c, F, P):
    """P (..., 2, 2) of F and the stress of laws and effects."""
    return plane_strain.stress(F, P, c[-1]) if kind[-1] else P


def _whole_changes(kind, c, F, P, dF, dP):
    """Changes (p, ..., 2, 2) of it by changes dP of that stress and dF of F; None: F stays."""
    if not kind[-1]:
        return dP
    if dF is None:
        return plane_strain.stress(F, dP, 0.0)
    whole = lambda F, P: plane_strain.stress(F, P, c[-1])  # noqa: E731
    return jax.lax.map(lambda both: jax.jvp(whole, (F, P), both)[1], (dF, dP))


# Every step of the chain is compiled by itself, so that a model with a new combination of effects compiles nothing.


def _acts(effect: Effect, stage: str) -> bool:
    """Whether an effect changes 'displacements', 'stress' or 'loads'."""
    return getattr(type(effect), stage) is not getattr(Effect, stage)


def _local(additions: Additions) -> Additions:
    return tuple(a for a in additions if a.effect.in_material)


def _displaced(effects, arrays, u, amplitudes, shapes):
    """Displacements (t, n, 2) as every effect corrects measured ones, the camera's first."""
    for effect, a, shape in reversed(list(zip(effects, amplitudes, shapes, strict=True))):
        if _acts(effect, "displacements"):
            u = _moved(effect, arrays.data, u, a, shape)
    return u


def _stages(kind, effects, arrays, c, amplitudes, shapes, F):
    """P (t, m, 2, 2) of the base and behind every effect; in plane strain of their laws at the isochoric part."""
    F = _law_gradients(kind, F)
    stages = [_base_stress(kind, arrays, c, F)]
    for effect, a, shape in zip(effects, amplitudes, shapes, strict=True):
        acts = _acts(effect, "stress")
        stages.append(_stressed_by(kind, effect, arrays, c, F, stages[-1], a, shape) if acts else stages[-1])
    return stages


def _pushed(kind, effects, arrays, c, amplitudes, shapes, F, stages, changes):
    """Changes (p, t, m, 2, 2) of the stress behind every effect by changes of F."""
    stresses = _base_pushed(kind, arrays, c, F, changes)
    return _pushed_behind(kind, effects, arrays, c, amplitudes, shapes, F, stages, changes, stresses)


def _pushed_behind(kind, effects, arrays, c, amplitudes, shapes, F, stages, changes, stresses):
    """The same, from those of the stress before these effects; changes None: F stays."""
    for effect, a, shape, P in zip(effects, amplitudes, shapes, stages[:-1], strict=True):
        if _acts(effect, "stress"):
            stresses = _pushed_on(kind, effect, arrays, c, F, P, a, shape, changes, stresses)
    return stresses


def _external(effects, arrays, loads, amplitudes, shapes):
    """Forces (t, 2, b) as every effect corrects measured ones."""
    for effect, a, shape in reversed(list(zip(effects, amplitudes, shapes, strict=True))):
        if _acts(effect, "loads"):
            loads = _loaded(effect, arrays.data, loads, a, shape)
    return loads


@partial(jax.jit, static_argnums=0)
def _noise_shift(kind, arrays, c, axes):
    F = gradients(arrays.data, arrays.data.u)
    law = jax.vmap(_law(kind, arrays, c))

    def stress(F):
        P = law(_law_gradients(kind, F).reshape(-1, 2, 2)).reshape(F.shape)
        return _whole(kind, c, F, P)

    change = -4.0 * stress(F)
    for q in range(2):
        for i in range(2):
            step = jnp.zeros((axes.shape[0], 2, 2)).at[:, i, :].set(axes[:, :, q])
            change = change + 0.5 * (stress(F + step) + stress(F - step))
    return change


@partial(jax.jit, static_argnums=0)
def _pulled(effects, arrays, amplitudes, shapes, duals):
    """Duals (k, t, n, 2) of corrected displacements as duals of measured ones."""

    def corrected(u):
        return _displaced(effects, replace(arrays, data=replace(arrays.data, u=u)), u, amplitudes, shapes)

    back = jax.vjp(corrected, arrays.data.u)[1]
    return jax.lax.map(lambda dual: back(dual)[0], duals)


_gradients = jax.jit(gradients)


@partial(jax.jit, static_argnums=0)
def _base_stress(kind, arrays, c, F):
    """P (t, m, 2, 2) without effects."""
    return jax.vmap(_law(kind, arrays, c))(F.reshape(-1, 2, 2)).reshape(F.shape)


@partial(jax.jit, static_argnums=(0, 1))
def _stressed_by(kind, effect, arrays, c, F, P, a, shape):
    return effect.stress(arrays.data, F, P, a, shape, _law(kind, arrays, c))


@partial(jax.jit, static_argnums=(0, 1))
def _stress_pulled(kind, effect, arrays, c, F, P, a, shape, stress):
    """Duals of F and of the stress before an effect, of those of the stress behind it."""
    law = _law(kind, arrays, c)
    return jax.vjp(lambda F, P: effect.stress(arrays.data, F, P, a, shape, law), F, P)[1](stress)


@jax.jit
def _whole_pulled(c, F, P, stress):
    """The same of the whole stress in plane strain."""
    return jax.vjp(lambda F, P: plane_strain.stress(F, P, c[-1]), F, P)[1](stress)


@jax.jit
def _isochoric_pulled(F, dual):
    return jax.vjp(plane_strain.isochoric, F)[1](dual)[0]


@partial(jax.jit, static_argnums=0)
def _loaded(effect, data, loads, a, shape):
    return effect.loads(data, loads, a, shape)


@partial(jax.jit, static_argnums=0)
def _base_pushed(kind, arrays, c, F, changes):
    """Changes (p, t, m, 2, 2) of the stress without effects by changes of F."""

    def stress(F):
        return _base_stress(kind, arrays, c, F)

    return jax.lax.map(lambda change: jax.jvp(stress, (F,), (change,))[1], changes)


def _by_values(response, a, shape, shapes):
    """Derivatives (p, ...) of response(a, shape) by amplitudes, and by `shapes` behind them."""
    if not shapes:
        return jnp.moveaxis(jax.jacfwd(lambda a: response(a, shape))(a), -1, 0)
    both = jax.jacfwd(lambda x: response(x[: len(a)], x[len(a) :]))(jnp.concatenate([a, shape]))
    return jnp.moveaxis(both, -1, 0)


@partial(jax.jit, static_argnums=(0, 1, 2))
def _direct(kind, effect, shapes, arrays, c, F, P, a, shape):
    """Changes (p, t, m, 2, 2) of stress by the values of an effect, at fixed displacements."""
    law = _law(kind, arrays, c)
    return _by_values(lambda a, shape: effect.stress(arrays.data, F, P, a, shape, law), a, shape, shapes)


@partial(jax.jit, static_argnums=(0, 1))
def _change_of_loads(effect, shapes, data, loads, a, shape):
    """d forces / d values, (p, t, 2, b)."""
    return _by_values(lambda a, shape: effect.loads(data, loads, a, shape), a, shape, shapes)


@partial(jax.jit, static_argnums=0)
def _loaded_on(effect, data, loads, a, shape, changes):
    """The same behind an effect."""
    correct = lambda f: effect.loads(data, f, a, shape)  # noqa: E731
    return jax.lax.map(lambda change: jax.jvp(correct, (loads,), (change,))[1], changes)


@partial(jax.jit, static_argnums=0)
def _moved(effect, data, u, a, shape):
    return effect.displacements(data, u, a, shape)


@partial(jax.jit, static_argnums=(0, 1))
def _change_of_displacements(effect, shapes, data, u, a, shape):
    """d u / d values, (p, t, n, 2)."""
    return _by_values(lambda a, shape: effect.displacements(data, u, a, shape), a, shape, shapes)


@partial(jax.jit, static_argnums=0)
def _moved_on(effect, data, u, a, shape, changes):
    """The same behind an effect."""
    correct = lambda u: effect.displacements(data, u, a, shape)  # noqa: E731
    return jax.lax.map(lambda change: jax.jvp(correct, (u,), (change,))[1], changes)


@jax.jit
def _change_of_gradients(data, changes):
    """d F (p, t, m, 2, 2) of changes (p, t, n, 2) of the displacements."""
    return jax.lax.map(lambda change: gradients(data, change) - jnp.eye(2), changes)


@partial(jax.jit, static_argnums=(0, 1))
def _pushed_on(kind, effect, arrays, c, F, P, a, shape, changes, stresses):
    """The same behind an effect, from changes of F (None: none, and far less to do) and of the stress before it."""
    law = _law(kind, arrays, c)

    def stress(F, P):
        return effect.stress(arrays.data, F, P, a, shape, law)

    if changes is None:
        return jax.lax.map(lambda change: jax.jvp(partial(stress, F), (P,), (change,))[1], stresses)
    return jax.lax.map(lambda both: jax.jvp(stress, (F, P), both)[1], (changes, stresses))


def base_law(k: int, n: int, top: Any, c: Any, f: Any) -> Any:
    """In-plane P (2, 2), MPa, at f (2, 2) of psi_k(J_k) with spline coefficients c (n,), as `SingleBasis` has it."""
    pieces = jnp.asarray(polynomial_pieces(n)[0])

    def energy_input(f):
        values = invariants(f)
        return values[0] - 3.0 if k == 0 else values[1] ** 1.5 - 3.0**1.5

    J, dJ = jax.value_and_grad(energy_input)(f)
    s = jnp.sqrt(jnp.clip(J / top, 1e-12, 1.0)) * (n - DEGREE)
    first = jnp.clip(jnp.floor(s).astype(int), 0, n - DEGREE - 1)
    t = s - first
    values = jnp.stack([jnp.ones_like(t), t, t * t, t * t * t]) @ pieces[first]
    return (values @ jax.lax.dynamic_slice(c, (first,), (DEGREE + 1,))) * dJ
