"""Every refusal of an Experiment names a place or a size and a remedy; the remedy is followed, and the data pass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial import Delaunay
from small_sheet import stretched

from calibrate import errors
from calibrate.data.experiment import Experiment
from calibrate.data.points import drop_points
from calibrate.data.triangulation import signed_areas

Arrays = dict[str, Any]
PLACE = r"at \(-?[\d.]+, -?[\d.]+\) mm"


def good() -> Arrays:
    return {item.name: getattr(stretched(), item.name) for item in fields(Experiment)}


def changed(a: Arrays, key: str, edit: Callable[[Any], Any]) -> Arrays:
    value = a[key].copy() if isinstance(a[key], np.ndarray) else a[key]
    edited = edit(value)
    return {**a, key: value if edited is None else edited}


def put(place: Any, value: Any) -> Callable[[Any], None]:
    return lambda array: array.__setitem__(place, value)


def scaled(factor: float) -> Callable[[Any], Any]:
    return lambda value: factor * value


def forces(edit: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda loaded: tuple(replace(b, force=edit(b.force)) for b in loaded)


def turned(triangles: Any) -> Any:
    """Row 3 the other way round."""
    return np.where(np.arange(len(triangles))[:, None] == 3, triangles[:, ::-1], triangles)


def counter_clockwise(a: Arrays) -> Arrays:
    wrong = signed_areas(a["points"], a["triangles"]) < 0
    return {**a, "triangles": np.where(wrong[:, None], a["triangles"][:, ::-1], a["triangles"])}


def with_node(a: Arrays, place: Any) -> Arrays:
    """One more node without a triangle."""
    u = np.concatenate([a["displacements"], a["displacements"][:, :1]], axis=1)
    return {**a, "points": np.concatenate([a["points"], [place]]), "displacements": u}


def without_last(a: Arrays) -> Arrays:
    last = len(a["points"]) - 1
    return {**a, "points": a["points"][:-1], "displacements": a["displacements"][:, :-1], "triangles": np.where(a["triangles"] == last, 0, a["triangles"])}  # fmt: skip


def doubled(a: Arrays) -> Arrays:
    """Node 0 twice, each in a triangle of its own."""
    more = with_node(a, a["points"][0])
    triangles = np.where(a["triangles"] == 0, len(more["points"]) - 1, a["triangles"])
    triangles[0] = a["triangles"][0]
    return {**more, "triangles": triangles}


def masked(a: Arrays) -> Arrays:
    kept = drop_points(a["points"], a["triangles"], a["displacements"], a["loaded"], a["free_nodes"])
    return {**a, "points": kept.points, "triangles": kept.triangles, "displacements": kept.displacements, "loaded": kept.loaded, "free_nodes": kept.free_nodes}  # fmt: skip


def masked_at_node_14(a: Arrays) -> Arrays:
    return masked(changed(a, "displacements", put((slice(None), 14), np.nan)))


def triangulated(a: Arrays) -> Arrays:
    """Node 14, inside, is dropped, and the rest triangulated again."""
    keep = np.arange(len(a["points"])) != 14
    number = np.cumsum(keep) - 1
    points = a["points"][keep]
    found = {**a, "points": points, "displacements": a["displacements"][:, keep], "triangles": Delaunay(points).simplices.astype(np.int64)}  # fmt: skip
    found["loaded"] = tuple(replace(b, nodes=number[b.nodes]) for b in a["loaded"])
    found["free_nodes"] = number[a["free_nodes"]]
    return counter_clockwise(found)


CASES: dict[str, tuple[type[Exception], str, Callable[[Arrays], Arrays], Callable[[Arrays], Arrays]]] = {
    "node is not finite": (errors.DegenerateMeshError, "drop those points and re-triangulate", lambda a: changed(a, "points", put(14, np.nan)), triangulated),
    "triangle the other way round": (errors.DegenerateMeshError, f"{PLACE}; order nodes counter-clockwise", lambda a: changed(a, "triangles", turned), counter_clockwise),
    "image coordinates": (errors.DegenerateMeshError, "flip y", lambda a: changed(a, "points", lambda p: p * [1, -1]), lambda a: changed(a, "points", lambda p: p * [1, -1])),
    "flat triangle": (errors.DegenerateMeshError, f"{PLACE}; re-triangulate", lambda a: changed(a, "triangles", lambda t: np.concatenate([t, [[0, 1, 2]]])), lambda a: changed(a, "triangles", lambda t: t[:-1])),
    "node twice": (errors.DegenerateMeshError, f"{PLACE}; merge", doubled, without_last),
    "node alone": (errors.DegenerateMeshError, f"{PLACE}; drop", lambda a: with_node(a, [4.3, 3.1]), without_last),
    "failed point": (errors.InvalidDeformationError, f"{PLACE}; leave them out", lambda a: changed(a, "displacements", put((2, 14, 0), np.nan)), masked),
    "folded triangle": (errors.InvalidDeformationError, f"{PLACE}; points there are wrong: leave them out", lambda a: changed(a, "displacements", put((1, 14, 0), 9.0)), masked_at_node_14),
    "points in m": (errors.UnitsError, "must be in mm", lambda a: changed(a, "points", scaled(1e-3)), lambda a: changed(a, "points", scaled(1e3))),
    "displacements in pixels": (errors.UnitsError, "give mm, not pixels", lambda a: changed(a, "displacements", scaled(1e3)), lambda a: changed(a, "displacements", scaled(1e-3))),
    "thickness in m": (errors.UnitsError, "thickness.*give mm", lambda a: changed(a, "thickness", scaled(1e-6)), lambda a: changed(a, "thickness", scaled(1e6))),
    "forces in nN": (errors.UnitsError, "give N", lambda a: changed(a, "loaded", forces(scaled(1e9))), lambda a: changed(a, "loaded", forces(scaled(1e-9)))),
    "time backwards": (errors.TimeError, "sort or drop", lambda a: changed(a, "time", lambda t: t[[0, 2, 1]]), lambda a: changed(a, "time", np.sort)),
    "time before the start": (errors.TimeError, "count it from the start", lambda a: changed(a, "time", lambda t: t - 5.0), lambda a: changed(a, "time", lambda t: t - t.min())),
    "infinite force": (errors.MissingForceError, "use NaN", lambda a: changed(a, "loaded", forces(lambda f: np.where(np.arange(len(f))[:, None] == 1, np.inf, f))), lambda a: changed(a, "loaded", forces(lambda f: np.where(np.isinf(f), np.nan, f)))),
    "no force": (errors.MissingForceError, "give the load-cell record", lambda a: changed(a, "loaded", forces(lambda f: np.full_like(f, np.nan))), lambda a: {**a, "loaded": good()["loaded"]}),
    "free and loaded": (errors.ExperimentError, "a gripped node is not free", lambda a: {**a, "free_nodes": a["loaded"][0].nodes[:1]}, lambda a: {**a, "free_nodes": np.setdiff1d(a["free_nodes"], a["loaded"][0].nodes)}),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_the_remedy_of_a_refusal_works(case):
    error, said, spoil, remedy = CASES[case]
    spoilt = spoil(good())
    with pytest.raises(error, match=said):
        Experiment(**spoilt)
    assert Experiment(**remedy(spoilt)).n_increments == 3
