"""Homogeneous tests of the material that a diagnosis found: base and effects of the material, in plane stress.

In: an `ExtendedModel`. Out: `DiagnosedLaw`, which gives nominal stress over stretch as a network model does, by the links of the diagnosis itself. Uniaxial tests are free to
contract and to shear: P = diag(P11, 0) is solved for the lateral stretch and for the shear that oblique fibres need.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.effects.chain import Additions, ordered
from calibrate.effects.chain.linearisation import Constants
from calibrate.effects.chain.quantities import STRESS, TIME, Base
from calibrate.effects.chain.stages import law_stages
from calibrate.equations.basis import SingleBasis, energy_basis
from calibrate.equations.deformation_modes import largest_stretch, stretches_to_gradient
from calibrate.models.extended_model import ExtendedModel
from studies.errors import OptionError

Array = NDArray[np.float64]
ITERATIONS, HALVINGS, SMALL = 40, 12, 1e-10  # of Newton's method; residual over the stress along the pull
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
        """Effects that are drawn."""
        return tuple(a for a in ordered(self.model.additions) if a.effect.of_material and not a.is_null)

    @property
    def relaxes(self) -> bool:
        """Whether the stress depends on speed."""
        return any(a.effect.stage == "relaxation" for a in self.of_material)

    @property
    def directions(self) -> tuple[str, ...]:
        """'' for an isotropic material, else the axes of the test that it is pulled along."""
        return ("x", "y") if any("fibre" in a.effect.name for a in self.of_material) else ("",)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Effects of camera, load cell and specimen."""
        return tuple(a.effect.name for a in self.model.additions if not a.effect.of_material)

    @property
    def lacks_bulk_modulus(self) -> bool:
        """Whether the model has one that the curves leave out: that of tests in plane strain."""
        return self.model.plane == "strain"

    def largest_stretch(self, mode: str) -> float:
        """Largest stretch of a mode within the calibrated range of I1."""
        return largest_stretch(mode, self.model.calibrated_range.get("I1", (3.0, 3.0 + self._base.top))[1])

    @cached_property
    def _base(self) -> SingleBasis:
        basis = energy_basis(self.model.basis)
        assert isinstance(basis, SingleBasis)
        return basis

    def _P(self, F: jax.Array, time: jax.Array) -> jax.Array:
        """(t, 2, 2) at F (t, 2, 2) and times (t,), s."""
        drawn = tuple(a for a in self.of_material if self.duration or a.effect.stage != "relaxation")
        basis = self._base
        constants = Constants(_History(time), jnp.asarray(basis.top), jnp.asarray(self.model.c[: basis.n]))  # type: ignore[arg-type]
        name, stages = law_stages(Base(basis.k, basis.n, False), drawn)
        quantities: dict[str, Any] = {name: F[:, None], TIME: time}
        for stage in stages:
            given = stage.inputs(quantities), constants.of(stage.link), stage.parameters
            quantities[stage.writes] = stage.link(*given)
        P: jax.Array = quantities[STRESS][:, 0]
        return P

    def homogeneous(self, mode: str, stretch: Array, direction: str = "") -> Array:
        """Nominal stress (k,) along the pull at rising stretches (k,), in the unit of the model, see `duration`. Raises `OptionError` where a uniaxial test has no equilibrium."""
        x = np.asarray(stretch, dtype=np.float64)
        loaded = x > 1.0
        speed = (x.max() - 1) / (self.duration or 1.0)
        time = jnp.asarray((x[loaded] - 1) / speed)
        F = stretches_to_gradient(mode, x[loaded])
        along, across = (1, 0) if direction == "y" else (0, 1)
        F = F[:, [along, across]][:, :, [along, across]]
        if mode == FREE:
            F = self._free(F, time, along, across)
        result = np.zeros(len(x))
        result[loaded] = np.asarray(self._P(jnp.asarray(F), time))[:, along, along]
        return result

    def _free(self, F: Array, time: jax.Array, along: int, across: int) -> Array:
        """F (t, 2, 2) with the lateral stretch and the shear at which nothing but the stress along the pull is left."""
        start = jnp.asarray(F)

        def at(unknown: jax.Array) -> jax.Array:
            return start.at[:, across, across].set(unknown[:, 0]).at[:, along, across].set(unknown[:, 1])

        def residual(unknown: jax.Array) -> jax.Array:
            P = self._P(at(unknown), time)
            return jnp.stack([P[:, across, across], P[:, along, across]], axis=1)

        unknown = jnp.stack([start[:, across, across], jnp.zeros(len(F))], axis=1)
        r = residual(unknown)
        size = float(jnp.abs(self._P(start, time)).max())
        if float(jnp.abs(r).max()) <= SMALL * size:
            return F  # of an isotropic and incompressible material
        residual, slope = jax.jit(residual), jax.jit(jax.jacfwd(residual))
        for _ in range(ITERATIONS):
            if float(jnp.abs(r).max()) <= SMALL * size:
                return np.asarray(at(unknown))
            n = unknown.size
            step = jnp.linalg.solve(slope(unknown).reshape(n, n), r.reshape(n)).reshape(unknown.shape)
            for halving in range(HALVINGS):
                tried = unknown - step / 2**halving
                new = residual(tried)
                if bool(jnp.isfinite(new).all() & (tried[:, 0] > 0).all()) and float((new**2).sum()) < float(
                    (r**2).sum()
                ):
                    break
            else:
                break
            unknown, r = tried, new
        raise OptionError(
            f"a uniaxial test to a stretch of {F[:, along, along].max():.3g} has no equilibrium found with this material; give a smaller --stretch"
        )
