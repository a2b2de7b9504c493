"""Mesh, material and loading in, equilibrium states and reaction forces out. N, mm, MPa.

`forward.plane_stress` and `forward.solid_model` hold the solvers; importing them needs DOLFINx, what is named here does not.
"""

from forward.errors import ForwardError
from forward.loading import Loading
from forward.materials import ArrudaBoyce, Material, MooneyRivlin, NeoHooke, Yeoh, material_from_dict
from forward.network_energy import Pann
from forward.solid_solution import SolidSolution
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
