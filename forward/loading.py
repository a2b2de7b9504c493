"""Loading: which nodes move, and how; mesh in, prescribed nodes and their displacements out.

A `Loading` moves whole boundaries in proportion to the load factor; a `MeasuredMotion` moves nodes as they were measured.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from forward.errors import LoadingError

Component = float | None
OUTWARD = {"left": (-1.0, 0.0), "right": (1.0, 0.0), "bottom": (0.0, -1.0), "top": (0.0, 1.0)}
SYMMETRY = {"symmetry_x": 0, "symmetry_y": 1, "symmetry_z": 2}


class BoundedMesh(Protocol):
    """A mesh of nodes (n, 2) or (n, 3), mm, with named boundaries.

    boundaries: name to the nodes of its edges or faces (e, k); boundary_nodes: the sorted nodes (k,) of one.
    """

    @property
    def points(self) -> NDArray[np.float64]: ...
    @property
    def boundaries(self) -> dict[str, NDArray[np.int64]]: ...

    def boundary_nodes(self, name: str) -> NDArray[np.int64]: ...


class Motion(Protocol):
    """How nodes move with the load factor. sides: boundaries whose forces are reported."""

    @property
    def sides(self) -> tuple[str, ...]: ...

    def on(self, mesh: Any) -> Self: ...

    def prescribed(self, mesh: Any) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
        """Which components of the nodes (n, d) are held, and their `values`, mm, see `moved`."""
        ...

    def to_dict(self) -> dict[str, Any]: ...


def moved(values: NDArray[np.float64], load_factor: float) -> NDArray[np.float64]:
    """Displacements at a load factor. values (n,): final ones, reached in proportion; (k, n): those at 1 / k, 2 / k, ... 1.

    Straight lines between, from rest at 0.
    """
    if values.ndim == 1:
        return load_factor * values
    place = min(max(load_factor * len(values), 0.0), float(len(values)))
    below = min(int(place), len(values) - 1)
    start = values[below - 1] if below else np.zeros_like(values[0])
    return start + (place - below) * (values[below] - start)


@dataclass(frozen=True)
class Loading:
    """Final displacements of boundaries, reached in proportion to the load.

    displacements: boundary name to (u_x, u_y) or, of a solid, (u_x, u_y, u_z), mm; None leaves a component free. The
    symmetry boundaries of a quarter or an eighth are held by themselves. Raises `LoadingError` for no
    boundary, another number of components, or values that are not finite.
    """

    displacements: Mapping[str, tuple[Component, ...]]

    def __post_init__(self) -> None:
        if not self.displacements:
            raise LoadingError("no boundary is loaded; name at least one and its displacement")
        for name, components in self.displacements.items():
            if len(components) not in (2, 3):
                raise LoadingError(f"{name}: give two components (u_x, u_y), three for a solid, None where free")
            if not all(c is None or math.isfinite(c) for c in components):
                raise LoadingError(f"{name}: displacement {components} must be finite, in mm")

    @property
    def sides(self) -> tuple[str, ...]:
        """Boundaries that are moved; symmetry planes are none."""
        return tuple(name for name in self.displacements if name not in SYMMETRY)

    @classmethod
    def clamped(
        cls, boundaries: Iterable[str], displacement: float, dimension: int = 2, hold_thickness: bool = False
    ) -> Loading:
        """Sides held in the plane by rigid grips that move outward by `displacement`, mm, each.

        dimension 3: of a solid; its thickness is free at the grips, as in plane stress, unless `hold_thickness`.
        Raises `LoadingError` for a side other than left, right, bottom, top.
        """
        rest: tuple[Component, ...] = (0.0 if hold_thickness else None,) * (dimension - 2)
        try:
            return cls({n: (displacement * OUTWARD[n][0], displacement * OUTWARD[n][1], *rest) for n in boundaries})
        except KeyError as error:
            raise LoadingError(f"side {error} is unknown; choose from {', '.join(OUTWARD)}") from error

    def on(self, mesh: BoundedMesh) -> Loading:
        """The loading of this mesh: a quarter keeps the sides it has and gains its symmetry conditions.

        Raises `LoadingError` for a boundary that is not on the mesh, another number of components than it has, or a
        motion that a quarter cannot show.
        """
        dimension = mesh.points.shape[1]
        for name, components in self.displacements.items():
            if len(components) != dimension:
                raise LoadingError(f"{name}: {len(components)} components of displacement, the mesh has {dimension}")
        quarter = "symmetry_x" in mesh.boundaries
        there = {n: c for n, c in self.displacements.items() if n in mesh.boundaries}
        missing = [n for n in self.displacements if n not in there and not (quarter and n in ("left", "bottom"))]
        if missing:
            raise LoadingError(f"boundary '{missing[0]}' is not on this mesh, which has {', '.join(mesh.boundaries)}")
        if not there:
            raise LoadingError("a quarter has the sides 'right' and 'top' only; load one of these")
        if quarter:
            self._check_mirror_images()
        cut = next((name for name in SYMMETRY if name in there), None)
        if cut is not None:
            raise LoadingError(
                f"'{cut}' is a symmetry plane and holds itself; leave it out, or mesh the whole specimen"
            )
        cuts = {
            name: tuple(0.0 if axis == normal else None for axis in range(dimension))
            for name, normal in SYMMETRY.items()
            if name in mesh.boundaries
        }
        return Loading({**there, **cuts})

    def _check_mirror_images(self) -> None:
        """Raise `LoadingError` if a side that a quarter does not have moves otherwise than by symmetry."""
        for side, opposite, normal in (("right", "left", 0), ("top", "bottom", 1)):
            if side in self.displacements and opposite in self.displacements:
                moved = self.displacements[side]
                image = tuple(-c if axis == normal and c is not None else c for axis, c in enumerate(moved))
                other = self.displacements[opposite]
                if any(
                    (a is None) != (b is None) or (a or 0.0) != (b or 0.0) for a, b in zip(image, other, strict=True)
                ):
                    raise LoadingError(
                        f"'{opposite}' moves by {other}, which is no mirror image of '{side}' {moved}: a quarter cannot "
                        "show that; mesh the whole specimen"
                    )

    def prescribed(self, mesh: BoundedMesh) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
        """Which components of which nodes (n, d) are prescribed, and their final values (n, d), mm.

        Raises `LoadingError` where two boundaries ask for different values, or nothing holds the specimen.
        """
        held = np.zeros(mesh.points.shape, bool)
        values = np.zeros(mesh.points.shape)
        for name, components in self.displacements.items():
            nodes = mesh.boundary_nodes(name)
            for axis, value in enumerate(components):
                if value is None:
                    continue
                clash = held[nodes, axis] & (np.abs(values[nodes, axis] - value) > 1e-12)
                if clash.any():
                    at = ", ".join(f"{x:g}" for x in mesh.points[nodes[clash][0]])
                    raise LoadingError(
                        f"'{name}' meets another boundary at ({at}) with a different displacement; "
                        "free a component of one of them"
                    )
                held[nodes, axis], values[nodes, axis] = True, value
        if _can_move_rigidly(mesh.points, held):
            raise LoadingError("the specimen can move as a rigid body; prescribe more components")
        return held, values

    def to_dict(self) -> dict[str, Any]:
        """Plain dictionary for a manifest."""
        return {name: list(components) for name, components in self.displacements.items()}


@dataclass(frozen=True, eq=False)
class MeasuredMotion:
    """Nodes that move as they were measured.

    held (n, 2): which components of the mesh's nodes; values (k, n, 2), mm: displacements at the load factors 1 / k, 2 / k, ...
    1, straight lines between. sides: boundaries of the mesh whose forces are reported. Raises `LoadingError`.
    """

    sides: tuple[str, ...]
    held: NDArray[np.bool_]
    values: NDArray[np.float64]

    def __post_init__(self) -> None:
        if self.values.shape[1:] != self.held.shape or not len(self.values):
            raise LoadingError(f"measured motion: values {self.values.shape} do not fit nodes {self.held.shape}")
        if not np.isfinite(self.values[:, self.held]).all():
            raise LoadingError("measured motion: the displacements of held nodes must be finite, in mm")

    def on(self, mesh: BoundedMesh) -> Self:
        """The same; raises `LoadingError` for another mesh."""
        if mesh.points.shape != self.held.shape:
            raise LoadingError(f"measured motion of {len(self.held)} nodes, the mesh has {len(mesh.points)}")
        return self

    def prescribed(self, mesh: BoundedMesh) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
        """See `Motion`. Raises `LoadingError` where nothing holds the specimen."""
        if _can_move_rigidly(mesh.points, self.held):
            raise LoadingError("the specimen can move as a rigid body; more of its boundary must be held")
        return self.held, np.where(self.held, self.values, 0.0)

    def to_dict(self) -> dict[str, Any]:
        """Plain dictionary for a manifest; the motion itself is in the digest of a run."""
        return {"measured": list(self.sides), "increments": len(self.values), "held": int(self.held.sum())}


def _can_move_rigidly(points: NDArray[np.float64], held: NDArray[np.bool_]) -> bool:
    """Whether a translation or rotation respects all held components: rank of these modes there."""
    d = points.shape[1]
    centred = (points - points.mean(axis=0)) / np.ptp(points)
    modes = [np.broadcast_to(np.eye(d)[axis], points.shape) for axis in range(d)]
    for i in range(d):
        for j in range(i):
            mode = np.zeros(points.shape)
            mode[:, i], mode[:, j] = centred[:, j], -centred[:, i]
            modes.append(mode)
    restrained = np.stack(modes)[:, held]
    return bool(np.linalg.matrix_rank(restrained @ restrained.T / max(held.sum(), 1), tol=1e-12) < len(modes))
