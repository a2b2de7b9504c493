"""How much of the largest deformation each increment has.

In: points, triangles, displacements. Out: the root mean square of the displacement gradient over the area, without the rigid motion of
the specimen, over that of the increment with the largest. An error that stays with the speckle pattern grows with it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibrate.data.strain_signal import displacement_gradients
from calibrate.data.triangulation import signed_areas

Array = NDArray[np.float64]


def deformation_shares(points: Array, triangles: NDArray[np.int64], displacements: Array) -> Array:
    """Shares (t,) in [0, 1] of points (n, 2) mm, triangles (m, 3) and displacements (t, n, 2) mm; 1 where nothing deforms.

    The rotation is that of the mean deformation gradient (polar decomposition in the plane).
    """
    F = np.eye(2) + displacement_gradients(points, triangles, displacements)
    areas = np.abs(signed_areas(points, triangles))
    mean = np.einsum("m,tmij->tij", areas / areas.sum(), F)
    angle = np.arctan2(mean[:, 1, 0] - mean[:, 0, 1], mean[:, 0, 0] + mean[:, 1, 1])
    R = np.moveaxis(np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]), -1, 0)
    H = np.einsum("tji,tmjk->tmik", R, F) - np.eye(2)
    size = np.sqrt(np.einsum("m,tmij->t", areas, H**2))
    return np.asarray(size / size.max()) if size.max() > 0 else np.ones(len(size))
