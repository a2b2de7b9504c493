"""Links from the deformation gradients of the material to the stress by the measured places of the reference."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import jax.numpy as jnp

from calibrate.effects.chain.linearisation import Constants
from calibrate.effects.chain.link import Link, Parameters
from calibrate.effects.chain.links_of_motion import Inputs, OfEffect
from calibrate.effects.chain.quantities import (
    CURVED,
    DEFORMATION,
    ELASTIC,
    PLACES,
    STRESS,
    STRESS_BESIDE,
    THINNING,
    TIME,
    VOLUME,
    Base,
)
from calibrate.effects.compressibility import Compressibility
from calibrate.effects.effect import Effect
from calibrate.effects.finite_thickness import Thickness
from calibrate.effects.permanent_set import PermanentSet
from calibrate.effects.support.effect_data import Data
from calibrate.effects.support.nodal_derivatives import reference_gradients
from calibrate.effects.support.stiffness_over_place import stiffness_over_place
from calibrate.effects.unmeasured_strip import UnmeasuredStrip
from calibrate.equations import isochoric
from calibrate.equations.tensors import Tensors

SAME, FARTHEST, FOUND = (
    1e-9,
    0.3,
    0.02,
)  # steps of a volume ratio: none; at most, over J; the last one, beyond which J was not found


@dataclass(frozen=True)
class BaseStress(Link):
    """P of the base model."""

    base: Base
    remembered: ClassVar[bool] = True
    reads: ClassVar[tuple[str, ...]] = (DEFORMATION,)
    writes: ClassVar[str] = STRESS
    uses_coefficients: ClassVar[bool] = True

    def __call__(self, inputs: Inputs, constants: Constants, parameters: Parameters) -> Any:
        return self.base.stress(constants, *inputs)


@dataclass(frozen=True)
class ChangedStress(OfEffect):
    """P as an effect changes it."""

    reads: ClassVar[tuple[str, ...]] = (DEFORMATION, STRESS)
    writes: ClassVar[str] = STRESS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        F, P = inputs
        return self.effect.stress(constants, F, P, *parameters[0])


@dataclass(frozen=True)
class RelaxedStress(Link):
    """P as effects change it in time, each from what is elastic; a spring of its own is as stiff, from place to place, as `fields` say, whose parameters come behind."""

    effects: tuple[Effect, ...]
    fields: tuple[Effect, ...] = ()
    reads: ClassVar[tuple[str, ...]] = (DEFORMATION, STRESS, TIME)
    writes: ClassVar[str] = STRESS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        F, P, time = inputs
        data = replace(constants, time=time)
        n = len(self.effects)
        fields = ((field, *given) for field, given in zip(self.fields, parameters[n:], strict=True))
        place = stiffness_over_place(constants, P.shape[1], fields)[:, None, None]
        total = P
        for effect, given in zip(self.effects, parameters[:n], strict=True):
            change = effect.stress(data, F, P, *given) - P
            total = total + (change * place if effect.has_spring else change)
        return total


@dataclass(frozen=True)
class FormedAnew(OfEffect):
    """P with chains that are formed anew in the deformed state; energies: what else the law of these chains is made of, whose
    parameters come behind those of the effect."""

    effect: PermanentSet
    energies: tuple[Effect, ...]
    base: Base
    reads: ClassVar[tuple[str, ...]] = (DEFORMATION, STRESS)
    writes: ClassVar[str] = STRESS
    uses_coefficients: ClassVar[bool] = True

    def __call__(self, inputs: Inputs, constants: Constants, parameters: Parameters) -> Any:
        F, P = inputs

        def law(F: Any, formed: Any) -> Any:
            back = Tensors.of(formed).inverse
            stress = self.base.stress(constants, (Tensors.of(F) @ back).array)
            found = (Tensors.of(stress) @ back.T).array
            for effect, (a, shape) in zip(self.energies, parameters[1:], strict=True):
                found = found + effect.stress_formed(constants.data, F, formed, a, shape)
            return found

        return self.effect.reformed(F, P, parameters[0][0], law)


@dataclass(frozen=True)
class VolumeRatio(OfEffect):
    """J, nearer to that at which the faces are free of stress, by the secant through the J before it; at first by the slope of neo-Hooke."""

    effect: Compressibility
    base: Base
    reads: ClassVar[tuple[str, ...]] = (DEFORMATION, STRESS, VOLUME)
    writes: ClassVar[str] = VOLUME
    uses_coefficients: ClassVar[bool] = True

    def __call__(self, inputs: Inputs, constants: Constants, parameters: Parameters) -> Any:
        F, P, volume = inputs
        a, (J, before, excess_before) = parameters[0][0], jnp.moveaxis(volume, -1, 0)
        excess = self.effect.excess(F, P, J, a)
        step, fall = J - before, excess_before - excess
        steep = (jnp.abs(step) > SAME) & (fall / jnp.where(jnp.abs(step) > SAME, step, 1.0) > 0.0)
        slope = jnp.where(
            steep, fall / jnp.where(steep, step, 1.0), self.effect.slope(F, a, self.base.modulus(constants))
        )
        return jnp.stack([J + jnp.clip(excess / slope, -FARTHEST * J, FARTHEST * J), J, excess], axis=-1)


@dataclass(frozen=True)
class StressAtVolume(Link):
    """P of F, of that at J^(-1/3) F; NaN where J was not found."""

    reads: ClassVar[tuple[str, ...]] = (STRESS, VOLUME)
    writes: ClassVar[str] = STRESS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        P, volume = inputs
        J = jnp.where(jnp.abs(volume[..., 0] - volume[..., 1]) < FOUND, volume[..., 0], jnp.nan)
        return P / jnp.cbrt(J)[..., None, None]


@dataclass(frozen=True)
class PlaneStrainStress(Link):
    """P of F and of the stress that an incompressible sheet has at its isochoric part."""

    reads: ClassVar[tuple[str, ...]] = (CURVED, STRESS)
    writes: ClassVar[str] = STRESS
    uses_coefficients: ClassVar[bool] = True

    def __call__(self, inputs: Inputs, constants: Constants, parameters: Parameters) -> Any:
        F, P = inputs
        return isochoric.stress(F, P, constants.c[-1])


@dataclass(frozen=True)
class MeanStress(OfEffect):
    """P as the mean over the thickness, of that of the mean deformation."""

    effect: Thickness
    reads: ClassVar[tuple[str, ...]] = (STRESS, ELASTIC, CURVED, THINNING, PLACES)
    writes: ClassVar[str] = STRESS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        P, F, mean, thinning, places = inputs
        return self.effect.mean_stress(constants, P, F, mean, thinning, places, parameters[0][0])


@dataclass(frozen=True)
class WithStrip(OfEffect):
    """P with the load that the strip carries."""

    effect: UnmeasuredStrip
    reads: ClassVar[tuple[str, ...]] = (STRESS, STRESS_BESIDE)
    writes: ClassVar[str] = STRESS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        P, beside = inputs
        return P + self.effect.share(constants, parameters[0][0])[:, None, None] * beside


@dataclass(frozen=True)
class MeasuredReference(Link):
    """P by the measured places of the reference: det A P A^-T (Piola transformation)."""

    reads: ClassVar[tuple[str, ...]] = (STRESS, PLACES)
    writes: ClassVar[str] = STRESS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        P, places = inputs
        A = Tensors.of(reference_gradients(constants, places))
        return (Tensors.of(P) @ A.cofactor).array
