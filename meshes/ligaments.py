"""How wide is the material that holds a specimen together? Specimen in, its narrowest ligament in mm out."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from meshes.shapes import signed_distance
from meshes.specimens import Specimen

Array = NDArray[np.float64]
POINTS = 180  # on the rim of each hole


def narrowest_ligament(specimen: Specimen) -> float:
    """Least distance between two holes, or a hole and the outline, mm; the least width of the specimen where it has no hole.

    From points on the rims, 2 degrees apart, so that it is too large by less than 0.1 % of the size of a hole.
    """
    rims = [hole.rim(POINTS) for hole in specimen.holes()]
    outline = specimen.outline()
    found = [float(signed_distance(rim, outline).min()) for rim in rims]
    found += [_distance(one, other) for one, other in combinations(rims, 2)]
    return min(found, default=2 * min(specimen.half_extent))


def _distance(one: Array, other: Array) -> float:
    """Least distance between two sets of points (n, 2), mm."""
    return float(np.linalg.norm(one[:, None] - other[None], axis=-1).min())
