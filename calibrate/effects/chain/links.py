"""The links of the chain: each a function of the quantities that it names, of the base model, and of at most one effect."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import jax
import jax.numpy as jnp

from calibrate.effects.chain.base_law import base_law
from calibrate.effects.chain.linearisation import Constants
from calibrate.effects.chain.link import Link, Parameters
from calibrate.effects.effect import Effect
from calibrate.effects.support.effect_data import Data
from calibrate.effects.support.nodal_derivatives import gradients, reference_gradients
from calibrate.equations import isochoric
from calibrate.equations.tensors import det, inverse

Inputs = tuple[Any, ...]

MEASURED = "measured displacements"  # (t, n, 2), mm
DISPLACEMENTS = "displacements"  # (t, n, 2), mm, from the measured places of the nodes to where they truly are
PLACES = "reference places"  # (n, 2), mm, where the nodes truly were in the reference
TIME = "time"  # (t,), s, since the start of loading, of the forces
GRADIENTS = "deformation gradients"  # (t, m, 2, 2), by the measured places of the reference
ELASTIC = "elastic deformation gradients"  # (t, m, 2, 2), by the true places
THINNING = "gradient of F33"  # (t, n, 2), 1/mm, by the true places
CURVED = "mean deformation"  # (t, m, 2, 2), of which the stress is the mean over the thickness
VOLUME = "volume ratio"  # J (t, m)
DEFORMATION = "deformation of laws"  # (t, m, 2, 2), of an incompressible sheet
STRESS = "stress"  # P (t, m, 2, 2), MPa
CURVED_BESIDE = "mean deformation of the strip"  # (t, m, 2, 2), in the strip beside the measured region
STRESS_BESIDE = "stress of the strip"  # P (t, m, 2, 2), MPa
LOADS = "loads"  # (t, 2, b), N, as effects correct them


@dataclass(frozen=True)
class Base:
    """A base model of one invariant: its number, that of its functions, and whether in plane strain."""

    invariant: int
    n_functions: int
    plane_strain: bool

    def law(self, constants: Constants) -> Any:
        """Its stress (2, 2) at one deformation gradient (2, 2); in plane strain at its isochoric part."""
        return partial(base_law, self.invariant, self.n_functions, constants.top, constants.c)

    def stress(self, constants: Constants, F: Any) -> Any:
        """The same (..., 2, 2) at F (..., 2, 2)."""
        return jax.vmap(self.law(constants))(F.reshape(-1, 2, 2)).reshape(F.shape)

    def modulus(self, constants: Constants) -> Any:
        """About its shear modulus at rest, MPa."""
        return (2.0 if self.invariant == 0 else 3.0 * 3.0**0.5) * constants.c[0]


@dataclass(frozen=True)
class OfEffect(Link):
    """A link of one effect."""

    effect: Effect


@dataclass(frozen=True)
class CorrectedPlaces(OfEffect):
    """Places of the nodes in the reference as an effect corrects them."""

    reads: ClassVar[tuple[str, ...]] = (PLACES,)
    writes: ClassVar[str] = PLACES
    passes: ClassVar[str | None] = PLACES

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return self.effect.places(constants, inputs[0], *parameters[0])


@dataclass(frozen=True)
class CorrectedDisplacements(OfEffect):
    """Displacements as an effect corrects them; it may look at the measured ones, too."""

    reads: ClassVar[tuple[str, ...]] = (DISPLACEMENTS, MEASURED)
    writes: ClassVar[str] = DISPLACEMENTS
    passes: ClassVar[str | None] = DISPLACEMENTS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        u, measured = inputs
        return self.effect.displacements(replace(constants, u=measured), u, *parameters[0])


@dataclass(frozen=True)
class MeanDisplacements(OfEffect):
    """Displacements of the mean over the thickness, of those of the surface."""

    reads: ClassVar[tuple[str, ...]] = (DISPLACEMENTS, PLACES)
    writes: ClassVar[str] = DISPLACEMENTS
    passes: ClassVar[str | None] = DISPLACEMENTS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return self.effect.of_the_mean(constants, *inputs, parameters[0][0])


@dataclass(frozen=True)
class CorrectedTime(OfEffect):
    """Times as an effect corrects them."""

    reads: ClassVar[tuple[str, ...]] = (TIME,)
    writes: ClassVar[str] = TIME
    passes: ClassVar[str | None] = TIME

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return self.effect.time(inputs[0], parameters[0][0])


@dataclass(frozen=True)
class DeformationGradients(Link):
    """F of displacements."""

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
        return F @ inverse(reference_gradients(constants, places))


@dataclass(frozen=True)
class MeasuredReference(Link):
    """P by the measured places of the reference: det A P A^-T (Piola transformation)."""

    reads: ClassVar[tuple[str, ...]] = (STRESS, PLACES)
    writes: ClassVar[str] = STRESS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        P, places = inputs
        A = reference_gradients(constants, places)
        return det(A)[:, None, None] * P @ jnp.swapaxes(inverse(A), -1, -2)


@dataclass(frozen=True)
class Thinning(OfEffect):
    """Gradient of the stretch of the thickness; of no amplitude."""

    reads: ClassVar[tuple[str, ...]] = (ELASTIC, PLACES)
    writes: ClassVar[str] = THINNING

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return self.effect.thinning(constants, *inputs)


@dataclass(frozen=True)
class MeanDeformation(OfEffect):
    """The deformation of which the stress is the mean over the thickness."""

    reads: ClassVar[tuple[str, ...]] = (ELASTIC, THINNING)
    writes: ClassVar[str] = CURVED
    passes: ClassVar[str | None] = ELASTIC

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return self.effect.mean_deformation(constants, *inputs, parameters[0][0])


@dataclass(frozen=True)
class MeanStress(OfEffect):
    """P as the mean over the thickness, of that of the mean deformation."""

    reads: ClassVar[tuple[str, ...]] = (STRESS, ELASTIC, CURVED, THINNING, PLACES)
    writes: ClassVar[str] = STRESS
    passes: ClassVar[str | None] = STRESS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return self.effect.mean_stress(constants, *inputs, parameters[0][0])


@dataclass(frozen=True)
class StripDeformation(OfEffect):
    """The deformation in the strip beside the measured region."""

    reads: ClassVar[tuple[str, ...]] = (CURVED, ELASTIC, DISPLACEMENTS, PLACES)
    writes: ClassVar[str] = CURVED_BESIDE

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return self.effect.beyond(constants, *inputs, parameters[0][0])


@dataclass(frozen=True)
class WithStrip(OfEffect):
    """P with the load that the strip carries."""

    reads: ClassVar[tuple[str, ...]] = (STRESS, STRESS_BESIDE)
    writes: ClassVar[str] = STRESS
    passes: ClassVar[str | None] = STRESS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        P, beside = inputs
        return P + self.effect.share(constants, parameters[0][0])[:, None, None] * beside


@dataclass(frozen=True)
class Incompressible(Link):
    """J = 1."""

    reads: ClassVar[tuple[str, ...]] = (CURVED,)
    writes: ClassVar[str] = VOLUME

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return jnp.ones(inputs[0].shape[:2])


@dataclass(frozen=True)
class FreeOfVolume(Link):
    """J^(-1/3) F of the volume ratio."""

    reads: ClassVar[tuple[str, ...]] = (CURVED, VOLUME)
    writes: ClassVar[str] = DEFORMATION

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        F, J = inputs
        return F / jnp.cbrt(J)[..., None, None]


@dataclass(frozen=True)
class VolumeRatio(OfEffect):
    """J, nearer to that at which the faces are free of stress."""

    base: Base
    reads: ClassVar[tuple[str, ...]] = (DEFORMATION, STRESS, VOLUME)
    writes: ClassVar[str] = VOLUME
    passes: ClassVar[str | None] = VOLUME
    uses_coefficients: ClassVar[bool] = True

    def __call__(self, inputs: Inputs, constants: Constants, parameters: Parameters) -> Any:
        return self.effect.volume(*inputs, parameters[0][0], self.base.modulus(constants))


@dataclass(frozen=True)
class StressAtVolume(Link):
    """P of F, of that at J^(-1/3) F."""

    reads: ClassVar[tuple[str, ...]] = (STRESS, VOLUME)
    writes: ClassVar[str] = STRESS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        P, J = inputs
        return P / jnp.cbrt(J)[..., None, None]


@dataclass(frozen=True)
class IsochoricPart(Link):
    """The deformation gradient of an incompressible sheet, in plane strain."""

    reads: ClassVar[tuple[str, ...]] = (CURVED,)
    writes: ClassVar[str] = DEFORMATION

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return isochoric.isochoric(*inputs)


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
class BaseStress(Link):
    """P of the base model."""

    base: Base
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
    passes: ClassVar[str | None] = STRESS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        F, P = inputs
        return self.effect.stress(constants, F, P, *parameters[0])


@dataclass(frozen=True)
class RelaxedStress(Link):
    """P as effects change it in time, each from what is elastic."""

    effects: tuple[Effect, ...]
    reads: ClassVar[tuple[str, ...]] = (DEFORMATION, STRESS, TIME)
    writes: ClassVar[str] = STRESS
    passes: ClassVar[str | None] = STRESS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        F, P, time = inputs
        data = replace(constants, time=time)
        both = zip(self.effects, parameters, strict=True)
        return P + sum(effect.stress(data, F, P, *given) - P for effect, given in both)


@dataclass(frozen=True)
class FormedAnew(OfEffect):
    """P with chains that are formed anew in the deformed state; energies: what else the law of these chains is made of, whose
    parameters come behind those of the effect."""

    energies: tuple[Effect, ...]
    base: Base
    reads: ClassVar[tuple[str, ...]] = (DEFORMATION, STRESS)
    writes: ClassVar[str] = STRESS
    passes: ClassVar[str | None] = STRESS
    uses_coefficients: ClassVar[bool] = True

    def __call__(self, inputs: Inputs, constants: Constants, parameters: Parameters) -> Any:
        F, P = inputs

        def law(F: Any, formed: Any) -> Any:
            back = inverse(formed)
            found = self.base.stress(constants, F @ back) @ jnp.swapaxes(back, -1, -2)
            for effect, (a, shape) in zip(self.energies, parameters[1:], strict=True):
                found = found + effect.stress_formed(constants.data, F, formed, a, shape)
            return found

        return self.effect.reformed(F, P, parameters[0][0], law)


@dataclass(frozen=True)
class CorrectedLoads(OfEffect):
    """Forces as an effect corrects them."""

    reads: ClassVar[tuple[str, ...]] = (LOADS,)
    writes: ClassVar[str] = LOADS
    passes: ClassVar[str | None] = LOADS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return self.effect.loads(constants, inputs[0], *parameters[0])
