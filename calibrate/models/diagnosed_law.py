"""Homogeneous tests of the material that a diagnosis found: base and effects of the material, in plane stress, loaded for the first time.

In: an `ExtendedModel`. Out: `DiagnosedLaw`, which gives deformation and nominal stress over stretch, by the links of the diagnosis itself. Uniaxial tests are free to
contract and to shear: P = diag(P11, 0) is solved for the lateral stretch and for the shear that oblique fibres need.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from calibrate.effects.chain import Addition, Additions, ordered
from calibrate.effects.chain.linearisation import Constants
from calibrate.effects.chain.quantities import STRESS, TIME, Base
from calibrate.effects.chain.stages import law_stages
from calibrate.effects.compressibility import Compressibility
from calibrate.effects.fibres import fibre_angles
from calibrate.effects.mullins import Mullins
from calibrate.equations.basis import PlaneStrainBasis, SingleBasis, energy_basis
from calibrate.equations.deformation_modes import largest_stretch, stretches_to_gradient
from calibrate.errors import FitError
from calibrate.models.extended_model import ExtendedModel

Array = NDArray[np.float64]
Residual = Callable[[jax.Array], jax.Array]
STEPS = 128  # of a material with a memory, between which curves are interpolated
ITERATIONS, HALVINGS, SMALL = 40, 12, 1e-10  # of Newton's method; residual over the stress along the pull
LITTLE = 0.01  # stretch of fibres, from which they are stretched at all
FREE = "uniaxial"  # mode without lateral grips


@dataclass(frozen=True)
class _History:
    """What effects of the material read of a test. time (t,): s."""

    time: Any


@dataclass(frozen=True, eq=False)
class DiagnosedLaw:
    """duration: s in which a pull at constant speed reaches the end of its curve; None: infinitely slow, so that nothing relaxes any more."""

    model: ExtendedModel
    duration: float | None = None

    @cached_property
    def of_material(self) -> Additions:
        """Effects that show in a first loading; in plane strain also the compressibility, which is in the base there."""
        found = [a for a in self.model.additions if a.effect.of_material and not a.is_null]
        if isinstance(self.model.basis, PlaneStrainBasis):
            found.append(Addition(Compressibility(), (1 / float(self.model.c[-1]),), ()))
        return tuple(a for a in ordered(tuple(found)) if not isinstance(a.effect, Mullins))

    @property
    def directions(self) -> tuple[str, ...]:
        """'' for an isotropic material, else the axes of the test that it is pulled along."""
        return ("x", "y") if fibre_angles(self.of_material) else ("",)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Effects of camera, load cell and specimen."""
        return tuple(a.effect.name for a in self.model.additions if not a.effect.of_material)

    @property
    def largest_invariant(self) -> float:
        """I1, or I2 of a base of that, to which the model is calibrated."""
        base = self._base
        known = (3.0**1.5 + base.top) ** (2 / 3) if base.k else 3.0 + base.top
        return known if base.k else self.model.calibrated_range.get("I1", (3.0, known))[1]

    def largest_stretch(self, mode: str) -> float:
        """Largest stretch of a mode within the calibrated range, of an isotropic and incompressible material."""
        return largest_stretch(mode, self.largest_invariant, self._base.k)

    def beyond(self, invariants: Array, F: Array) -> Array:
        """(k,): share by which the strain is beyond what was fitted, not positive within; of (I1, I2) (k, 2), and of fibres stretched by F (k, 2, 2)."""
        I = invariants[:, self._base.k]
        found = np.sqrt(np.maximum(I - 3.0, 0.0) / max(self.largest_invariant - 3.0, 1e-12)) - 1
        for name, angle in fibre_angles(self.model.additions).items():
            end = self.model.calibrated_range.get(name, (1.0, np.inf))[1]
            stretch = np.linalg.norm(F @ np.array([np.cos(angle), np.sin(angle)]), axis=-1)
            found = np.maximum(found, (stretch - 1) / max(np.sqrt(end) - 1, LITTLE) - 1)
        return np.asarray(found)

    @cached_property
    def _base(self) -> SingleBasis:
        basis = energy_basis(self.model.basis)
        assert isinstance(basis, SingleBasis)
        return basis

    @cached_property
    def _drawn(self) -> Additions:
        return tuple(a for a in self.of_material if self.duration or a.effect.stage != "relaxation")

    def homogeneous(self, mode: str, stretch: Array, direction: str = "") -> tuple[Array, Array]:
        """In-plane F (k, 2, 2), and nominal stress (k,) along the pull in the unit of the model, at rising stretches (k,) from 1.

        Raises `FitError` where a uniaxial test has no equilibrium.
        """
        x = np.asarray(stretch, dtype=np.float64)
        if not self._remembers:
            return self._loaded(mode, x, direction)
        steps = np.linspace(1.0, float(x.max()), STEPS + 1)
        F, P = (PchipInterpolator(steps, values) for values in self._loaded(mode, steps, direction))
        return F(x), P(x)

    @property
    def _remembers(self) -> bool:
        return any(a.effect.remembers for a in self._drawn)

    def _loaded(self, mode: str, x: Array, direction: str) -> tuple[Array, Array]:
        """The same, with one step of a history to each stretch."""
        loaded, time = x > 1.0, self._times(x)
        along, across = _axes(direction)
        given = stretches_to_gradient(mode, x[loaded])[:, [along, across]][:, :, [along, across]]
        F, P = np.tile(np.eye(2), (len(x), 1, 1)), np.zeros(len(x))
        F[loaded] = self._free(given, time, along, across) if mode == FREE else given
        P[loaded] = np.asarray(self._P(jnp.asarray(F[loaded]), time))[:, along, along]
        return F, P

    def _times(self, x: Array) -> jax.Array:
        """Of stretches above 1, s."""
        return jnp.asarray((x[x > 1.0] - 1) / (x.max() - 1) * (self.duration or 1.0))

    def changes(self, mode: str, stretch: Array, direction: str, others: Sequence[DiagnosedLaw]) -> Array:
        """(o, k): by how much the nominal stress along the pull of others differs, to first order in what it changes of a free lateral stretch. Raises `FitError` where one of
        them has none.

        At the deformation of this law another has stresses P across the pull; the free deformation moves until they are gone: dP11 = P11 - A K^-1 P, with A
        and K the slopes of the stress along and across by the free lateral stretch and shear.
        """
        x = np.asarray(stretch, dtype=np.float64)
        remembers = any(law._remembers for law in (self, *others))
        steps = np.linspace(1.0, float(x.max()), STEPS + 1) if remembers else x
        F, time = jnp.asarray(self._loaded(mode, steps, direction)[0][steps > 1.0]), self._times(steps)
        along, across = _axes(direction)

        def parts(P: Any) -> Any:
            return jnp.stack([P[:, along, along], P[:, across, across], P[:, along, across]], axis=1)

        own = parts(self._P(F, time))
        changes = np.array([parts(law._P(F, time)) - own for law in others]).reshape(len(others), len(own), 3)
        found = np.zeros((len(others), len(steps)))
        found[:, steps > 1.0] = changes[..., 0]
        if mode == FREE:
            slopes = self._slopes(F, time, along, across, parts)
            found[:, steps > 1.0] -= _released(slopes, changes[..., 1:], self._remembers)
        if not np.isfinite(found).all():
            raise FitError(
                f"up to a stretch of {x.max():.3g} an explanation that competes has no finite stress, so that there is no band; give a smaller one: "
                "equigap predict FILE --stretch"
            )
        return np.asarray(PchipInterpolator(steps, found, axis=1)(x)) if remembers else found

    def _slopes(self, F: jax.Array, time: jax.Array, along: int, across: int, parts: Callable[[Any], Any]) -> Array:
        """(t, 3, 2), or (t, 3, t, 2) of a material that remembers, of stresses along and across the pull by lateral stretch and shear."""

        def stress(unknown: jax.Array) -> Any:
            moved = F.at[:, across, across].set(unknown[:, 0]).at[:, along, across].set(unknown[:, 1])
            return parts(self._P(moved, time))

        unknown = jnp.stack([F[:, across, across], F[:, along, across]], axis=1)
        if self._remembers:
            return np.asarray(jax.jacfwd(stress)(unknown))
        ones = jnp.zeros_like(unknown)
        columns = [jax.jvp(stress, (unknown,), (ones.at[:, k].set(1.0),))[1] for k in range(2)]
        return np.asarray(jnp.stack(columns, axis=-1))

    def _P(self, F: jax.Array, time: jax.Array) -> jax.Array:
        """(t, 2, 2) at F (t, 2, 2) and times (t,), s."""
        basis = self._base
        constants = Constants(_History(time), jnp.asarray(basis.top), jnp.asarray(self.model.c[: basis.n]))  # type: ignore[arg-type]
        name, stages = law_stages(Base(basis.k, basis.n, False), self._drawn)
        quantities: dict[str, Any] = {name: F[:, None], TIME: time}
        for stage in stages:
            given = stage.inputs(quantities), constants.of(stage.link), stage.parameters
            quantities[stage.writes] = stage.link(*given)
        P: jax.Array = quantities[STRESS][:, 0]
        return P

    def _free(self, F: Array, time: jax.Array, along: int, across: int) -> Array:
        """F (t, 2, 2) with the lateral stretch and the shear at which nothing but the stress along the pull is left."""
        start = jnp.asarray(F)

        def at(unknown: jax.Array) -> jax.Array:
            return start.at[:, across, across].set(unknown[:, 0]).at[:, along, across].set(unknown[:, 1])

        def residual(unknown: jax.Array) -> jax.Array:
            P = self._P(at(unknown), time)
            return jnp.stack([P[:, across, across], P[:, along, across]], axis=1)

        unknown = jnp.stack([start[:, across, across], jnp.zeros(len(F))], axis=1)
        small = SMALL * float(jnp.abs(self._P(start, time)).max())
        if float(jnp.abs(residual(unknown)).max()) <= small:
            return F  # of an isotropic and incompressible material
        found = _solved(residual, unknown, small, self._remembers)
        if found is None:
            raise FitError(
                f"a uniaxial test to a stretch of {F[:, along, along].max():.3g} has no equilibrium found with this material; "
                "give a smaller one: equigap predict FILE --stretch"
            )
        return np.asarray(at(found))


def _axes(direction: str) -> tuple[int, int]:
    """Along the pull, and across."""
    return (1, 0) if direction == "y" else (0, 1)


def _released(slopes: Array, across: Array, coupled: bool) -> Array:
    """A K^-1 P (o, t) of stresses across (o, t, 2), see `DiagnosedLaw.changes`. coupled: whether one step depends on those before."""
    o, t = across.shape[:2]
    try:
        if not coupled:
            moved = np.linalg.solve(slopes[:, 1:], np.moveaxis(across, 0, -1))
            return np.asarray(np.einsum("tk,tko->ot", slopes[:, 0], moved))
        K, A = slopes[:, 1:].reshape(2 * t, 2 * t), slopes[:, 0].reshape(t, 2 * t)
        return np.asarray((A @ np.linalg.solve(K, across.reshape(o, 2 * t).T)).T)
    except np.linalg.LinAlgError:  # nothing holds the free sides
        return np.full((o, t), np.nan)


def _solved(residual: Residual, unknown: jax.Array, small: float, coupled: bool) -> jax.Array | None:
    """Zero of a residual (t, 2) of unknowns (t, 2), the first of them positive, by Newton's method with halved steps; None where there is none to be found.

    coupled: whether one step depends on those before.
    """
    residual = jax.jit(residual)
    step_of = jax.jit(_whole_step if coupled else _step_of_each, static_argnums=0)
    r = residual(unknown)
    for _ in range(ITERATIONS):
        if float(jnp.abs(r).max()) <= small:
            return unknown
        step = step_of(residual, unknown, r)
        for halving in range(HALVINGS):
            tried = unknown - step / 2**halving
            new = residual(tried)
            finite = bool(jnp.isfinite(new).all() & (tried[:, 0] > 0).all())
            if finite and float((new**2).sum()) < float((r**2).sum()):
                break
        else:
            return None
        unknown, r = tried, new
    return None


def _whole_step(residual: Residual, unknown: jax.Array, r: jax.Array) -> jax.Array:
    n = unknown.size
    return jnp.linalg.solve(jax.jacfwd(residual)(unknown).reshape(n, n), r.reshape(n)).reshape(unknown.shape)


def _step_of_each(residual: Residual, unknown: jax.Array, r: jax.Array) -> jax.Array:
    ones = jnp.zeros_like(unknown)
    columns = [jax.jvp(residual, (unknown,), (ones.at[:, k].set(1.0),))[1] for k in range(2)]
    return jnp.linalg.solve(jnp.stack(columns, axis=-1), r[..., None])[..., 0]
