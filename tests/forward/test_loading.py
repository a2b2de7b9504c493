"""Loadings that make no sense, or do not fit the mesh, are refused before anything is solved."""

import numpy as np
import pytest
from solid_helpers import grid

from forward import Loading
from forward.errors import LoadingError
from meshes import Cross, PlateWithHole, SquareSheet, Strip, extrude, quads


@pytest.mark.parametrize(
    "displacements", [{}, {"right": (np.nan, 0.0)}, {"right": (1.0,)}], ids=["none", "not a number", "one component"]
)
def test_displacements_that_make_no_sense(displacements):
    with pytest.raises(LoadingError):
        Loading(displacements)


def test_an_unknown_side():
    with pytest.raises(LoadingError):
        Loading.clamped(["arm"], 1.0)


@pytest.fixture(scope="module")
def meshes():
    return {
        "cross": quads(Cross(), quarter=True, size_factor=4.0),
        "solid": extrude(quads(PlateWithHole(), quarter=True, size_factor=4.0), 10.0, 1),
        "square": quads(SquareSheet(far_size=50.0)),
        "strip": quads(Strip(far_size=20.0)),
        "whole solid": extrude(grid((2, 1), (2.0, 1.0)), 1.0, 1, whole=True),
    }


@pytest.mark.parametrize(
    ("mesh", "displacements"),
    [
        ("cross", {"arm": (1.0, 0.0)}),
        ("cross", {"left": (-1.0, 0.0)}),
        ("solid", {"arm": (1.0, 0.0, None)}),
        ("solid", {"right": (1.0, 0.0)}),
        ("solid", {"left": (0.0, 0.0, None), "right": (20.0, 0.0, None)}),
        ("solid", {"right": (20.0, 0.0, None), "symmetry_x": (1.0, None, None)}),
    ],
    ids=["unknown", "not of a quarter", "unknown 3D", "two components", "no mirror image", "symmetry plane"],
)
def test_loadings_that_do_not_fit_the_mesh(meshes, mesh, displacements):
    with pytest.raises(LoadingError):
        Loading(displacements).on(meshes[mesh])


@pytest.mark.parametrize(
    ("mesh", "displacements"),
    [
        ("square", {"right": (1.0, 0.0), "top": (0.0, 1.0)}),
        ("solid", {"right": (1.0, 1.0, None)}),
        ("strip", {"left": (-1.0, None), "right": (1.0, None)}),
        ("whole solid", {"right": (1.0, 0.0, None)}),
    ],
    ids=["clash", "clash with symmetry", "rigid", "rigid 3D"],
)
def test_displacements_that_clash_or_hold_nothing(meshes, mesh, displacements):
    with pytest.raises(LoadingError):
        Loading(displacements).on(meshes[mesh]).prescribed(meshes[mesh])


def test_a_quarter_takes_a_symmetric_pull(meshes):
    Loading.clamped(["left", "right"], 20.0, dimension=3).on(meshes["solid"])
