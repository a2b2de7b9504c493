"""Which links a chain has, in their order: displacements, deformation gradients, stress of the base and of effects, loads.

    measured displacements -> as effects correct them -> F -> [plane strain: isochoric part] -> stress of the base
    -> as every effect changes it -> [plane strain: whole stress];        measured loads -> as effects correct them

In plane strain base and effects act on the isochoric part, as in an incompressible sheet; the bulk modulus is the last
coefficient (`calibrate.equations.isochoric`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import jax

from calibrate.effects.chain.addition import Addition, Additions, ordered
from calibrate.effects.chain.base_law import base_law
from calibrate.effects.chain.linearisation import Constants, Stage
from calibrate.effects.chain.link import Link, Parameters
from calibrate.effects.effect import Effect
from calibrate.effects.support.effect_data import Data
from calibrate.effects.support.nodal_derivatives import gradients
from calibrate.equations import isochoric

Inputs = tuple[Any, ...]

MEASURED = "measured displacements"  # (t, n, 2), mm
DISPLACEMENTS = "displacements"  # (t, n, 2), mm, as effects correct them
GRADIENTS = "deformation gradients"  # F (t, m, 2, 2)
DEFORMATION = "deformation of laws"  # (t, m, 2, 2): F, in plane strain its isochoric part
STRESS = "stress"  # P (t, m, 2, 2), MPa
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


@dataclass(frozen=True)
class CorrectedDisplacements(Link):
    """Displacements as an effect corrects them; it may look at the measured ones, too."""

    effect: Effect
    reads: ClassVar[tuple[str, ...]] = (DISPLACEMENTS, MEASURED)
    writes: ClassVar[str] = DISPLACEMENTS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        u, measured = inputs
        return self.effect.displacements(replace(constants, u=measured), u, *parameters)


@dataclass(frozen=True)
class DeformationGradients(Link):
    """F of displacements."""

    reads: ClassVar[tuple[str, ...]] = (DISPLACEMENTS,)
    writes: ClassVar[str] = GRADIENTS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return gradients(constants, *inputs)


@dataclass(frozen=True)
class SheetGradients(DeformationGradients):
    """F of displacements in plane stress, where laws take it as it is."""

    writes: ClassVar[str] = DEFORMATION


@dataclass(frozen=True)
class IsochoricPart(Link):
    """The deformation gradient of an incompressible sheet, in plane strain."""

    reads: ClassVar[tuple[str, ...]] = (GRADIENTS,)
    writes: ClassVar[str] = DEFORMATION

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return isochoric.isochoric(*inputs)


@dataclass(frozen=True)
class BaseStress(Link):
    """P of the base model."""

    base: Base
    reads: ClassVar[tuple[str, ...]] = (DEFORMATION,)
    writes: ClassVar[str] = STRESS
    uses_coefficients: ClassVar[bool] = True

    def __call__(self, inputs: Inputs, constants: Constants, parameters: Parameters) -> Any:
        (F,) = inputs
        return jax.vmap(self.base.law(constants))(F.reshape(-1, 2, 2)).reshape(F.shape)


@dataclass(frozen=True)
class ChangedStress(Link):
    """P as an effect changes it."""

    effect: Effect
    base: Base
    reads: ClassVar[tuple[str, ...]] = (DEFORMATION, STRESS)
    writes: ClassVar[str] = STRESS
    uses_coefficients: ClassVar[bool] = True

    def __call__(self, inputs: Inputs, constants: Constants, parameters: Parameters) -> Any:
        F, P = inputs
        return self.effect.stress(constants.data, F, P, parameters[0], parameters[1], self.base.law(constants))


@dataclass(frozen=True)
class PlaneStrainStress(Link):
    """P of F and of the stress that an incompressible sheet has at its isochoric part."""

    reads: ClassVar[tuple[str, ...]] = (GRADIENTS, STRESS)
    writes: ClassVar[str] = STRESS
    uses_coefficients: ClassVar[bool] = True

    def __call__(self, inputs: Inputs, constants: Constants, parameters: Parameters) -> Any:
        F, P = inputs
        return isochoric.stress(F, P, constants.c[-1])


@dataclass(frozen=True)
class CorrectedLoads(Link):
    """Forces as an effect corrects them."""

    effect: Effect
    reads: ClassVar[tuple[str, ...]] = (LOADS,)
    writes: ClassVar[str] = LOADS

    def __call__(self, inputs: Inputs, constants: Data, parameters: Parameters) -> Any:
        return self.effect.loads(constants, inputs[0], *parameters)


def stages(base: Base, additions: Additions) -> tuple[Stage, ...]:
    """All stages of a chain, additions in whatever order these are given."""
    return (
        *displacement_stages(additions),
        Stage(gradients_link(base)),
        *stress_stages(base, additions),
        *load_stages(additions),
    )


def gradients_link(base: Base) -> Link:
    """From displacements to F."""
    return DeformationGradients() if base.plane_strain else SheetGradients()


def displacement_stages(additions: Additions) -> tuple[Stage, ...]:
    """Those that correct displacements, the camera's first."""
    acting = reversed(acting_on("displacements", additions))
    return tuple(Stage(CorrectedDisplacements(a.effect), a, place) for place, a in acting)


def stress_stages(base: Base, additions: Additions) -> tuple[Stage, ...]:
    """Those from F to P, the material's first."""
    changes = [Stage(ChangedStress(a.effect, base), a, place) for place, a in acting_on("stress", additions)]
    if not base.plane_strain:
        return Stage(BaseStress(base)), *changes
    return Stage(IsochoricPart()), Stage(BaseStress(base)), *changes, Stage(PlaneStrainStress())


def load_stages(additions: Additions) -> tuple[Stage, ...]:
    """Those that correct loads, the camera's first."""
    acting = reversed(acting_on("loads", additions))
    return tuple(Stage(CorrectedLoads(a.effect), a, place) for place, a in acting)


def acting_on(quantity: str, additions: Additions) -> list[tuple[int, Addition]]:
    """Additions that change 'displacements', 'stress' or 'loads', with their places in the order of all."""
    plain = getattr(Effect, quantity)
    return [(i, a) for i, a in enumerate(ordered(additions)) if getattr(type(a.effect), quantity) is not plain]
