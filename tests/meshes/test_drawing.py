"""Drawings are read back with their exact area and size; ligaments against distances by hand."""

import math

import ezdxf
import numpy as np
import pytest

from meshes.drawing import CUT, GRIP, NOTE, read_curves, write_drawing
from meshes.known_specimens import SPECIMENS
from meshes.ligaments import narrowest_ligament
from meshes.perforated_sheets import PerforatedSheet, UniaxialTension
from meshes.shapes import Ellipse
from meshes.specimens import Cross, PlateWithHole

CLAMPED = 12.0


def area(points):
    x, y = points.T
    return abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))) / 2


@pytest.mark.parametrize("specimen", [kind() for kind in SPECIMENS.values()], ids=SPECIMENS)
def test_cut_is_the_specimen_with_what_the_grips_hold(specimen, tmp_path):
    path = tmp_path / "drawing.dxf"
    write_drawing(specimen, path, CLAMPED, "a note")
    curves = read_curves(path)
    outline, *holes = sorted(curves[CUT], key=area, reverse=True)
    size = 2 * np.array(specimen.half_extent) + 2 * CLAMPED * np.array(
        ["left" in specimen.loaded, "bottom" in specimen.loaded]
    )
    assert np.ptp(outline, axis=0) == pytest.approx(size, abs=1e-9)
    assert len(holes) == len(specimen.holes())
    lines = curves[GRIP]
    assert len(lines) == len(specimen.loaded)
    added = sum(CLAMPED * np.linalg.norm(line[-1] - line[0]) for line in lines)
    corners = 4 * CLAMPED**2 if specimen.name == "square" else 0.0
    drawn = area(outline) - sum(map(area, holes))
    assert drawn == pytest.approx(specimen.exact_area() + added + corners, rel=2e-4)
    assert ezdxf.readfile(path).units == ezdxf.units.MM
    assert not ezdxf.readfile(path).audit().has_errors
    assert [text.dxf.text for text in ezdxf.readfile(path).modelspace().query(f'TEXT[layer=="{NOTE}"]')] == ["a note"]


def test_fillets_are_arcs_not_chords(tmp_path):
    path = tmp_path / "cross.dxf"
    write_drawing(Cross(), path)
    outline = max(read_curves(path)[CUT], key=area)
    exact = Cross().exact_area() + sum(hole.area for hole in Cross().holes())
    chords = 4 * Cross().fillet_radius ** 2 * (math.pi / 2 - 1) / 2  # what chords would miss
    assert area(outline) == pytest.approx(exact, abs=1e-3 * chords)


def test_ligaments():
    assert narrowest_ligament(PlateWithHole()) == pytest.approx(20.0, abs=1e-6)
    assert narrowest_ligament(UniaxialTension()) == 30.0
    sheet = PerforatedSheet(perforation=(Ellipse(0.0, 6.0, 4.0, 2.0, math.pi / 2),))
    assert narrowest_ligament(sheet) == pytest.approx(4.0, abs=1e-6)  # between the holes; 5 mm to the sides
