"""Specimen geometry in, meshes with named boundaries out. Lengths in mm."""

from meshes.errors import MeshError
from meshes.extrusion import SolidMesh, extrude
from meshes.generate import area_excess, quads, triangles
from meshes.known_specimens import SPECIMENS, specimen_from_dict
from meshes.mesh import Mesh
from meshes.perforated_sheets import PerforatedSheet
from meshes.specimens import Cross, PlateWithHole, PureShearSheet, Specimen, SquareSheet, Strip

__all__ = [
    "SPECIMENS",
    "Cross",
    "Mesh",
    "MeshError",
    "PerforatedSheet",
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
