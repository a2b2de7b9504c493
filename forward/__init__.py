"""Mesh, material and loading in, equilibrium states and reaction forces out. N, mm, MPa.

`forward.sheet.plane_stress` and `forward.solid.solid_model` hold the solvers; importing them needs DOLFINx, what is
named here does not.
"""

from forward.errors import ForwardError
from forward.loading import Loading
from forward.materials import ArrudaBoyce, Material, MooneyRivlin, NeoHooke, Pann, Yeoh, material_from_dict
from forward.solid.solid_solution import SolidSolution
from forward.solution import SurfaceSolution

__all__ = [
    "ArrudaBoyce",
    "ForwardError",
    "Loading",
    "Material",
    "MooneyRivlin",
    "NeoHooke",
    "Pann",
    "SolidSolution",
    "SurfaceSolution",
    "Yeoh",
    "material_from_dict",
]
