"""Specimen geometry in, meshes with named boundaries out. Lengths in mm."""

from meshes.errors import MeshError
from meshes.extrusion import SolidMesh, extrude
from meshes.generate import area_excess, quads, triangles
from meshes.mesh import Mesh
from meshes.specimens import Cross, PlateWithHole, PureShearSheet, Specimen, SquareSheet, Strip, specimen_from_dict

__all__ = [
    "Cross",
    "Mesh",
    "MeshError",
    "PlateWithHole",
    "PureShearSheet",
    "SolidMesh",
    "Specimen",
    "SquareSheet",
    "Strip",
    "area_excess",
    "extrude",
    "quads",
    "specimen_from_dict",
    "triangles",
]
