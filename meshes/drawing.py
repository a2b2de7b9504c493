"""A specimen as a drawing for who cuts it: dimensions in mm in, a DXF file (AutoCAD R2010, mm) out.

Layers: CUT, closed curves that are cut: the outline, lengthened at its gripped sides by what the grips hold, and the holes as
circles or ellipses; GRIP, lines at which the grips begin, not to be cut; NOTE, a line of text below.
"""

from __future__ import annotations

import math
from pathlib import Path

import ezdxf
import numpy as np
from ezdxf import units
from ezdxf.layouts import Modelspace
from ezdxf.path import make_path
from numpy.typing import NDArray

from meshes.shapes import Corner, fillet_arc, triples, turn_angle
from meshes.specimens import Specimen

Array = NDArray[np.float64]
CUT, GRIP, NOTE = "CUT", "GRIP", "NOTE"
SIGNS = {"left": (0, -1), "right": (0, 1), "bottom": (1, -1), "top": (1, 1)}
TEXT_HEIGHT = 3.0  # mm
FLATNESS = 1e-3  # mm


def write_drawing(specimen: Specimen, path: str | Path, clamped: float = 0.0, note: str = "") -> None:
    """Write the drawing; clamped: length that each grip holds, mm, added to the specimen. Raises OSError."""
    document = ezdxf.new("R2010", units=units.MM)
    for name, colour in ((CUT, 7), (GRIP, 1), (NOTE, 3)):
        document.layers.add(name, color=colour)
    space = document.modelspace()
    _add_outline(space, gripped_corners(specimen, clamped))
    _add_holes(space, specimen)
    if clamped:
        _add_grip_lines(space, specimen)
    if note:
        low = -specimen.half_extent[1] - clamped - 2 * TEXT_HEIGHT
        text = space.add_text(note, height=TEXT_HEIGHT, dxfattribs={"layer": NOTE})
        text.set_placement((-specimen.half_extent[0] - clamped, low))
    document.saveas(path)


def read_curves(path: str | Path) -> dict[str, list[Array]]:
    """Curves of a drawing by layer, each as points (n, 2), mm, within 0.001 mm of it; a closed one ends where it began. Raises OSError."""
    found: dict[str, list[Array]] = {}
    for entity in ezdxf.readfile(path).modelspace():
        if entity.dxftype() in ("LWPOLYLINE", "CIRCLE", "ELLIPSE", "LINE"):
            points = np.array([(p.x, p.y) for p in make_path(entity).flattening(FLATNESS)])
            found.setdefault(entity.dxf.layer, []).append(points)
    return found


def gripped_corners(specimen: Specimen, clamped: float) -> list[Corner]:
    """Corners of the outline, those on gripped sides moved outwards by `clamped`, mm."""
    moved = []
    for corner in specimen.corners():
        at = [corner.x, corner.y]
        for side in specimen.loaded:
            axis, sign = SIGNS[side]
            if math.isclose(sign * (corner.x, corner.y)[axis], specimen.half_extent[axis]):
                at[axis] += sign * clamped
        moved.append(Corner(at[0], at[1], corner.radius))
    return moved


def _add_outline(space: Modelspace, corners: list[Corner]) -> None:
    """One closed polyline; an arc is a bulge, the tangent of a quarter of its angle."""
    points: list[tuple[float, float, float]] = []
    for before, corner, after in triples(corners):
        if corner.radius:
            start, _, end = fillet_arc(before, corner, after)
            points += [(*start, math.tan(turn_angle(before, corner, after) / 4)), (*end, 0.0)]
        else:
            points.append((corner.x, corner.y, 0.0))
    space.add_lwpolyline(points, format="xyb", close=True, dxfattribs={"layer": CUT})


def _add_holes(space: Modelspace, specimen: Specimen) -> None:
    for hole in specimen.holes():
        if math.isclose(hole.a, hole.b):
            space.add_circle((hole.x, hole.y), hole.a, dxfattribs={"layer": CUT})
        else:
            axis = hole.a * np.array([math.cos(hole.angle), math.sin(hole.angle)])
            space.add_ellipse((hole.x, hole.y), axis.tolist(), hole.b / hole.a, dxfattribs={"layer": CUT})


def _add_grip_lines(space: Modelspace, specimen: Specimen) -> None:
    """From corner to corner of every gripped side."""
    for side in specimen.loaded:
        axis, sign = SIGNS[side]
        on = [c for c in specimen.corners() if math.isclose(sign * (c.x, c.y)[axis], specimen.half_extent[axis])]
        along = sorted((c.x, c.y) for c in on)
        space.add_line(along[0], along[-1], dxfattribs={"layer": GRIP})
