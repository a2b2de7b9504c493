"""A solid to be turned in a report: `SolidSolution` in, `Scene` out, coloured as in `solid_pictures.contraction`.

The skin of the eighth that was solved for is stored once; the page draws its mirror images, or cuts the specimen open.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from forward.solid.solid_solution import SolidSolution
from studies.output.scene import Scene, joined
from studies.reports.solid_pictures import WHOLE, Skin, colour_range, contraction_of, skin

Indices = NDArray[np.int64]
LABEL = "thickness / original thickness (-)"


def contraction_scenes(solids: Mapping[str, SolidSolution]) -> list[Scene]:
    """The deformed specimens at the last increment, one scale of colours for all."""
    ratios = {name: contraction_of(solid) for name, solid in solids.items()}
    limits = colour_range({name: ratios[name][skin(solid).faces] for name, solid in solids.items()})
    return [_scene(f"{name} mm thick", solid, ratios[name], limits) for name, solid in solids.items()]


def _scene(name: str, solid: SolidSolution, values: NDArray[np.float64], limits: tuple[float, float]) -> Scene:
    parts = skin(solid)
    y = solid.mesh.points[parts.faces][..., 1]
    outside, cut = _triangles(parts, ~parts.cut), _triangles(parts, parts.cut & (np.abs(y).max(axis=1) < 1e-9))
    used, triangles = joined(np.concatenate([outside, cut]))
    points = (solid.mesh.points + solid.displacements[-1])[used]
    n = len(outside)
    return Scene(name, points, triangles[:n], values[used], limits, tuple(WHOLE), triangles[n:])


def _triangles(parts: Skin, chosen: NDArray[np.bool_]) -> Indices:
    """(m, 3): two triangles for each quad of the chosen faces."""
    corners = np.take_along_axis(parts.faces[chosen][:, None], parts.quads[chosen], axis=2)
    return corners[..., [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
