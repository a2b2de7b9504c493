"""Links from what is measured to the deformation gradients of the material, and to the loads on it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import jax.numpy as jnp

from calibrate.effects.chain.link import Link, Parameters
from calibrate.effects.chain.quantities import (
    CURVED,
    CURVED_BESIDE,
    DEFORMATION,
    DISPLACEMENTS,
    ELASTIC,
    GRADIENTS,
    LOADS,
    MEASURED,
    PLACES,
    THINNING,
    VOLUME,
)
from calibrate.effects.effect import Effect
from calibrate.effects.finite_thickness import Thickness
from calibrate.effects.support.effect_data import Data
from calibrate.effects.support.nodal_derivatives import gradients, reference_gradients
from calibrate.effects.unmeasured_strip import UnmeasuredStrip
from calibrate.equations import isochoric
from calibrate.equations.tensors import Tensors

Inputs = tuple[Any, ...]


@dataclass(frozen=True)
class OfEffect(Link):
    """A link of one effect."""

    effect: Effect


@dataclass(frozen=True)
class CorrectedPlaces(OfEffect):
    """Places of the nodes in the reference as an effect corrects them."""

    reads: ClassVar[tuple[str, ...]] = (PLACES,)
    writes: ClassVar[str] = PLACES

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return self.effect.places(constants, inputs[0], *parameters[0])


@dataclass(frozen=True)
class CorrectedDisplacements(OfEffect):
    """Displacements as an effect corrects them; it may look at the measured ones, too."""

    reads: ClassVar[tuple[str, ...]] = (DISPLACEMENTS, MEASURED)
    writes: ClassVar[str] = DISPLACEMENTS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        u, measured = inputs
        return self.effect.displacements(replace(constants, u=measured), u, *parameters[0])


@dataclass(frozen=True)
class MeanDisplacements(OfEffect):
    """Displacements of the mean over the thickness, of those of the surface."""

    effect: Thickness
    reads: ClassVar[tuple[str, ...]] = (DISPLACEMENTS, PLACES)
    writes: ClassVar[str] = DISPLACEMENTS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return self.effect.of_the_mean(constants, inputs[0], inputs[1], parameters[0][0])


@dataclass(frozen=True)
class DeformationGradients(Link):
    """F of displacements."""

    remembered: ClassVar[bool] = True
    reads: ClassVar[tuple[str, ...]] = (DISPLACEMENTS,)
    writes: ClassVar[str] = GRADIENTS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return gradients(constants, *inputs)


@dataclass(frozen=True)
class ElasticGradients(Link):
    """F by the true places of the reference: F A^-1 with A the gradient of the true by the measured places."""

    reads: ClassVar[tuple[str, ...]] = (GRADIENTS, PLACES)
    writes: ClassVar[str] = ELASTIC

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        F, places = inputs
        return (Tensors.of(F) @ Tensors.of(reference_gradients(constants, places)).inverse).array


@dataclass(frozen=True)
class Thinning(OfEffect):
    """Gradient of the stretch of the thickness; of no amplitude."""

    effect: Thickness
    reads: ClassVar[tuple[str, ...]] = (ELASTIC, PLACES)
    writes: ClassVar[str] = THINNING

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return self.effect.thinning(constants, inputs[0], inputs[1])


@dataclass(frozen=True)
class MeanDeformation(OfEffect):
    """The deformation of which the stress is the mean over the thickness."""

    effect: Thickness
    reads: ClassVar[tuple[str, ...]] = (ELASTIC, THINNING)
    writes: ClassVar[str] = CURVED

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return self.effect.mean_deformation(constants, inputs[0], inputs[1], parameters[0][0])


@dataclass(frozen=True)
class StripDeformation(OfEffect):
    """The deformation in the strip beside the measured region."""

    effect: UnmeasuredStrip
    reads: ClassVar[tuple[str, ...]] = (CURVED, ELASTIC, DISPLACEMENTS, PLACES)
    writes: ClassVar[str] = CURVED_BESIDE

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        mean, F, u, places = inputs
        return self.effect.beyond(constants, mean, F, u, places, parameters[0][0])


@dataclass(frozen=True)
class Incompressible(Link):
    """J = 1, and nothing before it."""

    reads: ClassVar[tuple[str, ...]] = (CURVED,)
    writes: ClassVar[str] = VOLUME

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        J = jnp.ones(inputs[0].shape[:2])
        return jnp.stack([J, J, jnp.zeros_like(J)], axis=-1)


@dataclass(frozen=True)
class FreeOfVolume(Link):
    """J^(-1/3) F of the volume ratio."""

    reads: ClassVar[tuple[str, ...]] = (CURVED, VOLUME)
    writes: ClassVar[str] = DEFORMATION

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        F, volume = inputs
        return F / jnp.cbrt(volume[..., 0])[..., None, None]


@dataclass(frozen=True)
class IsochoricPart(Link):
    """The deformation gradient of an incompressible sheet, in plane strain."""

    reads: ClassVar[tuple[str, ...]] = (CURVED,)
    writes: ClassVar[str] = DEFORMATION

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return isochoric.isochoric(*inputs)


@dataclass(frozen=True)
class CorrectedLoads(OfEffect):
    """Forces as an effect corrects them."""

    reads: ClassVar[tuple[str, ...]] = (LOADS,)
    writes: ClassVar[str] = LOADS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return self.effect.loads(constants, inputs[0], *parameters[0])
