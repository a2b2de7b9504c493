"""The catalogue: one module an effect, or a family of them; `CATALOGUE` lists all that are tested, `KNOWN` also those that a model file may hold.

Adding an effect: write a subclass of `Effect` in a module of its own and name it here.
"""

from calibrate.effects.camera import LensDistortion, OutOfPlane, Scale, SubsetSmoothing, UnmeasuredStrip
from calibrate.effects.compressibility import Compressibility
from calibrate.effects.effect import Data, Effect, Parameter
from calibrate.effects.fibres import OneFibreFamily, TwoFibreFamilies
from calibrate.effects.field import StiffnessField, StiffnessGradient
from calibrate.effects.history import Mullins, Payne, PermanentSet
from calibrate.effects.load import ForceGain, ForceOffset, Lag, Rotation
from calibrate.effects.second_invariant import SecondInvariant
from calibrate.effects.thickness import Thickness
from calibrate.effects.upturn import Upturn
from calibrate.effects.viscosity import SecondViscosity, Viscosity
from calibrate.effects.warp import InitialWarp, UnevenWarp

CATALOGUE: tuple[Effect, ...] = (
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

KNOWN = (*CATALOGUE, SecondViscosity(), UnevenWarp())

__all__ = ["CATALOGUE", "KNOWN", "Data", "Effect", "Parameter", "SecondViscosity", "Viscosity"]
