"""A homogeneous test as an Experiment: a few triangles that all have the same deformation gradient.

In: principal stretches along x and y, nominal stresses (NaN where not measured), time where known. Out: an Experiment
whose only virtual-work equations are force = nominal stress x 10 mm x 1 mm, one for each stress that was measured.

Two sheets. The strip is 10 x 10 mm, gripped at two opposite edges; its free edges have no node of their own. The square
is 12 x 12 mm and gripped at all four edges but for the last 2 mm at each corner, as corners cannot belong to two edges;
half of that strip hangs on either side, so that each edge carries the stress of 10 mm. Neither has an inner or a free
node: equilibrium inside a homogeneous sheet says nothing. The force of the opposite edge (left, bottom) is not
measured (NaN), for one load cell is one equation; nor are forces across an edge.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.data.experiment import Experiment, LoadedBoundary, Noise

Array = NDArray[np.float64]
WIDTH, THICKNESS, CORNER = 10.0, 1.0, 2.0
CROSS_SECTION = WIDTH * THICKNESS
SIDES = (("left", "right"), ("bottom", "top"))
STRIP = {"left": [0, 3], "right": [1, 2], "bottom": [0, 1], "top": [2, 3]}
SQUARE = {"bottom": [0, 1], "right": [2, 3], "top": [4, 5], "left": [6, 7]}


def strip() -> tuple[Array, NDArray[np.int64]]:
    """Points (4, 2) mm and triangles (2, 3)."""
    points = WIDTH * np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    return points, np.array([[0, 1, 2], [0, 2, 3]])


def square() -> tuple[Array, NDArray[np.int64]]:
    """Points (12, 2) mm, two on each edge and the corners, and triangles (10, 3)."""
    a, b, c = CORNER, WIDTH, WIDTH + CORNER
    edges = [[a, 0], [b, 0], [c, a], [c, b], [b, c], [a, c], [0, b], [0, a]]
    corners = [[0, 0], [c, 0], [c, c], [0, c]]
    inside = [[0, i, i + 1] for i in range(1, 7)]
    return np.array([*edges, *corners], float), np.array([*inside, [8, 0, 7], [9, 2, 1], [10, 4, 3], [11, 6, 5]])


def experiment(
    name: str,
    stretch: Array,
    stress: Array,
    axes: str = "xy",
    time: Array | None = None,
    noise: Noise | None = None,
    provenance: dict[str, Any] | None = None,
) -> Experiment:
    """The Experiment of principal stretches (n, 2) and nominal stresses (n, 2), MPa, along x and y.

    axes: 'x' or 'y' for a strip gripped across that axis, 'xy' for the square. time (n,), s. The points at rest (stretch
    1, stress 0) at the start are left out: they are no equation.

    Raises `ConfigError` for other axes, `MeshMismatchError` where stretch and stress are not both (n, 2),
    `InvalidDeformationError` for a stretch that is not positive, and the named errors of an Experiment.
    """
    if axes not in ("x", "y", "xy"):
        raise errors.ConfigError(f"axes '{axes}' unknown; choose 'x', 'y' (strips) or 'xy' (square)")
    stretch, stress = np.asarray(stretch, float), np.asarray(stress, float)
    if stretch.shape != stress.shape or stretch.ndim != 2 or stretch.shape[1] != 2:
        raise errors.MeshMismatchError(f"stretch {stretch.shape} and stress {stress.shape} must both be (n, 2)")
    if not (stretch > 0).all():
        raise errors.InvalidDeformationError(f"stretch {stretch.min()} is not positive; give lengths over first length")
    rest = np.cumsum((stretch != 1).any(axis=1) | (np.nan_to_num(stress) != 0).any(axis=1)) == 0
    stretch, stress = stretch[~rest], stress[~rest]
    points, triangles = square() if axes == "xy" else strip()
    nodes = SQUARE if axes == "xy" else STRIP
    loaded = []
    for axis in ("xy".index(letter) for letter in axes):
        for side in SIDES[axis]:
            force = np.full(stress.shape, np.nan)
            if side in ("right", "top"):
                force[:, axis] = CROSS_SECTION * stress[:, axis]
            loaded.append(LoadedBoundary(side, np.array(nodes[side]), force))
    return Experiment(
        name=name,
        points=points,
        triangles=triangles,
        displacements=(stretch - 1)[:, None, :] * points,
        loaded=tuple(loaded),
        free_nodes=np.array([], np.int64),
        thickness=THICKNESS,
        time=None if time is None else _from_rest(np.asarray(time, float), rest),
        noise=noise,
        provenance={"homogeneous": True, **(provenance or {})},
    )


def _from_rest(time: Array, rest: NDArray[np.bool_]) -> Array:
    """Times of the increments (t,), s, counted from the last row at rest; as they are where there is none."""
    return time[~rest] - (float(time[rest][-1]) if rest.any() else 0.0)


def stretches(test: Experiment) -> Array:
    """Stretches along x and y (n_increments, 2) of a homogeneous Experiment."""
    far = np.argmax(test.points.sum(axis=1))
    return 1 + test.displacements[:, far] / test.points[far]


def stresses(test: Experiment) -> Array:
    """Nominal stresses along x and y (n_increments, 2), MPa; NaN where not measured."""
    result = np.full((test.n_increments, 2), np.nan)
    for b in test.loaded:
        if b.name in ("right", "top"):
            axis = int(b.name == "top")
            result[:, axis] = b.force[:, axis] / CROSS_SECTION
    return result


def local_residuals(x: Array, y: Array, window: int = 7, degree: int = 2) -> Array:
    """What a polynomial in x (n,), a parabola by default, through the `window` nearest points in order leaves of each y
    (n,), over sqrt(1 - leverage).

    For independent errors of standard deviation s on a smooth curve each has that standard deviation. Raises
    `ConfigError` for too few points.
    """
    n = len(x)
    window = min(window, n)
    if window <= degree + 1:
        raise errors.ConfigError(f"{n} points do not show their scatter; {degree + 2} are needed")
    residuals = np.empty(n)
    for i in range(n):
        first = min(max(i - window // 2, 0), n - window)
        j = np.arange(first, first + window)
        span = max(float(np.ptp(x[j])), 1e-300)
        orthogonal = np.linalg.qr(np.vander((x[j] - x[i]) / span, degree + 1))[0]
        own = orthogonal[i - first]
        residuals[i] = (y[i] - own @ (orthogonal.T @ y[j])) / np.sqrt(max(1 - own @ own, 1e-6))
    return residuals


def evenly(time: Array, stretch: Array, stress: Array, count: int) -> NDArray[np.int64]:
    """Indices of at most `count` points of a record (n,), even in the path of (stretch, stress) plus elapsed time.

    The fast beginning of a relaxation gets its points, a long hold few. The last sixth of them goes where straight lines
    in time between the others are most wrong: reversals, mostly.
    """
    if len(time) <= count:
        return np.arange(len(time))
    scaled = np.stack([v / max(float(np.ptp(v)), 1e-300) for v in (stretch, stress)])
    steps = np.abs(np.diff(scaled)) / np.maximum(np.abs(np.diff(scaled)).sum(axis=1, keepdims=True), 1e-300)
    steps = steps.sum(axis=0) + 0.3 * np.diff(time) / (time[-1] - time[0])
    path = np.concatenate([[0.0], np.cumsum(steps)])
    even = np.searchsorted(path, np.linspace(0, path[-1], max(count - count // 6, 2))).clip(0, len(time) - 1)
    chosen = np.unique(even)
    while len(chosen) < count:
        lines = np.stack([np.interp(time, time[chosen], v[chosen]) for v in scaled])
        wrong = np.abs(scaled - lines).sum(axis=0)
        if wrong.max() == 0 or wrong.argmax() in chosen:
            break  # the record is these lines
        chosen = np.union1d(chosen, wrong.argmax())
    return chosen
