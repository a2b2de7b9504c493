"""Mesh, material and loading in, equilibrium states and reaction forces out. N, mm, MPa.

`forward.plane_stress` holds the solver; importing it needs DOLFINx, what is named here does not.
"""

from forward.errors import ForwardError
from forward.loading import Loading
from forward.materials import ArrudaBoyce, Material, MooneyRivlin, NeoHooke, Yeoh, material_from_dict
from forward.pann import Pann
from forward.solution import SurfaceSolution

__all__ = [
    "ArrudaBoyce",
    "ForwardError",
    "Loading",
    "Material",
    "MooneyRivlin",
    "NeoHooke",
    "Pann",
    "SurfaceSolution",
    "Yeoh",
    "material_from_dict",
]
