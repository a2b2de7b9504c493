"""The catalogue: one module an effect, or a family of them; `CATALOGUE` lists all that are tested, `KNOWN` also those that a model file may hold.

Adding an effect: write a subclass of `Effect` in a module of its own in this folder. It is the last of the catalogue from then on; named here,
it has a place.
"""

import pkgutil
from importlib import import_module

from calibrate.effects.camera_errors import LensDistortion, OutOfPlane, Scale, SubsetSmoothing, UnmeasuredStrip
from calibrate.effects.compressibility import Compressibility
from calibrate.effects.effect import Data, Effect, Parameter
from calibrate.effects.fibres import OneFibreFamily, TwoFibreFamilies
from calibrate.effects.field import StiffnessField, StiffnessGradient
from calibrate.effects.finite_thickness import Thickness
from calibrate.effects.history import Mullins, Payne, PermanentSet
from calibrate.effects.load import ForceGain, ForceOffset, Lag, Rotation
from calibrate.effects.second_invariant import SecondInvariant
from calibrate.effects.upturn import Upturn
from calibrate.effects.viscosity import SecondViscosity, Viscosity
from calibrate.effects.warp import InitialWarp, UnevenWarp

LISTED: tuple[Effect, ...] = (
    SecondInvariant(),
    Upturn(),
    Compressibility(),
    OneFibreFamily(),
    TwoFibreFamilies(),
    StiffnessGradient(),
    StiffnessField(),
    Viscosity(),
    Mullins(),
    Payne(),
    PermanentSet(),
    Thickness(),
    ForceOffset(),
    ForceGain(),
    Lag(),
    Rotation(),
    Scale(),
    LensDistortion(),
    OutOfPlane(),
    SubsetSmoothing(),
    UnmeasuredStrip(),
    InitialWarp(),
)

BESIDE = (SecondViscosity(), UnevenWarp())  # in models, but not candidates of their own


def _further() -> tuple[Effect, ...]:
    """Effects in the modules of this folder that are not named here."""
    named = {type(effect) for effect in (*LISTED, *BESIDE)}
    found = []
    for one in pkgutil.iter_modules(__path__):
        for value in vars(import_module(f"{__name__}.{one.name}")).values():
            if isinstance(value, type) and issubclass(value, Effect) and "name" in vars(value) and value not in named:
                named.add(value)
                found.append(value())
    return tuple(sorted(found, key=lambda effect: effect.name))


CATALOGUE: tuple[Effect, ...] = (*LISTED, *_further())
KNOWN = (*CATALOGUE, *BESIDE)

__all__ = ["CATALOGUE", "KNOWN", "Data", "Effect", "Parameter", "SecondViscosity", "Viscosity"]
