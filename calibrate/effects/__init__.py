"""The catalogue: one effect a module; `CATALOGUE` lists all that are tested, and that a model file may hold.

Adding an effect: write a subclass of `Effect` in a module of its own in this folder. It is the last of the catalogue from
then on; named here, it has a place. `chain` applies the effects; `support` holds what several of them need.
"""

import pkgutil
from importlib import import_module

from calibrate.effects.axis_gain import AxisGain
from calibrate.effects.camera_tilt import CameraTilt
from calibrate.effects.compressibility import Compressibility
from calibrate.effects.dic_scale import Scale
from calibrate.effects.effect import Effect, Parameter, distinct
from calibrate.effects.fibres import OneFibreFamily, TwoFibreFamilies
from calibrate.effects.finite_thickness import Thickness
from calibrate.effects.finite_viscoelasticity import FiniteViscosity, SecondFiniteViscosity
from calibrate.effects.force_drift import ForceDrift
from calibrate.effects.force_gain import ForceGain
from calibrate.effects.force_offset import ForceOffset
from calibrate.effects.friction import Friction
from calibrate.effects.image_rotation import Rotation
from calibrate.effects.inclusion import Inclusion
from calibrate.effects.lag import Lag
from calibrate.effects.lens_distortion import LensDistortion
from calibrate.effects.load_cell_nonlinearity import LoadCellNonlinearity
from calibrate.effects.magnification_drift import MagnificationDrift
from calibrate.effects.mullins import Mullins
from calibrate.effects.out_of_plane import OutOfPlane
from calibrate.effects.payne import Payne
from calibrate.effects.permanent_set import PermanentSet
from calibrate.effects.second_invariant import SecondInvariant, SecondInvariantLogarithm
from calibrate.effects.stiffness_drift import StiffnessDrift
from calibrate.effects.stiffness_field import StiffnessField
from calibrate.effects.stiffness_gradient import StiffnessGradient
from calibrate.effects.subset_smoothing import SubsetSmoothing
from calibrate.effects.support.effect_data import Data
from calibrate.effects.unmeasured_strip import UnmeasuredStrip
from calibrate.effects.upturn import Upturn
from calibrate.effects.viscosity import SecondViscosity, Viscosity
from calibrate.effects.warp import InitialWarp

LISTED: tuple[Effect, ...] = (
    SecondInvariant(),
    Upturn(),
    Compressibility(),
    OneFibreFamily(),
    TwoFibreFamilies(),
    StiffnessGradient(),
    StiffnessField(),
    Inclusion(),
    Viscosity(),
    SecondViscosity(),
    FiniteViscosity(),
    SecondFiniteViscosity(),
    Mullins(),
    Payne(),
    PermanentSet(),
    Thickness(),
    ForceOffset(),
    ForceDrift(),
    Friction(),
    ForceGain(),
    AxisGain(),
    LoadCellNonlinearity(),
    StiffnessDrift(),
    Lag(),
    Rotation(),
    Scale(),
    CameraTilt(),
    LensDistortion(),
    OutOfPlane(),
    MagnificationDrift(),
    SubsetSmoothing(),
    UnmeasuredStrip(),
    InitialWarp(),
)

FORMS = (SecondInvariantLogarithm(),)  # other forms of effects, in the uncertainty of models alone


def _further() -> tuple[Effect, ...]:
    """Effects in the modules of this folder that are not named here."""
    named = {type(effect) for effect in (*LISTED, *FORMS)}
    found = []
    modules = (one for one in pkgutil.iter_modules(__path__) if not one.ispkg)
    for one in modules:
        for value in vars(import_module(f"{__name__}.{one.name}")).values():
            if isinstance(value, type) and issubclass(value, Effect) and "name" in vars(value) and value not in named:
                named.add(value)
                found.append(value())
    return tuple(sorted(found, key=lambda effect: effect.name))


CATALOGUE: tuple[Effect, ...] = distinct((*LISTED, *_further(), *FORMS))[: -len(FORMS)]

__all__ = ["CATALOGUE", "FORMS", "Data", "Effect", "Parameter", "SecondViscosity", "Viscosity"]
