"""An Experiment as arrays: what effects and the chain read, in a form that compiled code serves for every test of a size."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.data.outline import Outline
from calibrate.effects.support.borders import nearest_lines
from calibrate.effects.support.branches import motion, sign_of_motion
from calibrate.effects.support.digest import digest
from calibrate.effects.support.membrane import Membrane
from calibrate.effects.support.nodal_derivatives import gradient
from calibrate.effects.support.twin_kinematics import TwinKinematics
from calibrate.equations import kinematics, recovery

Array = NDArray[np.float64]


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Data:
    """An Experiment prepared for the chain: arrays only, so that compiled code serves every experiment of its size.

    points (n, 2), triangles (m, 3), stencil (m, k) and slopes (m, k, 2): gradient at the centroids = sum over the
    stencil of nodal values times slopes, 1/mm; areas (m,) mm^2, centroids (m, 2), u (t, n, 2) mm, time (t,) s or None,
    thickness mm (1 where unknown), size: extent mm, edges (m,): length of free edges, but those of given rims, over area, 1/mm, edge_nodes (m, 2): of
    a free edge, beside (m,): number of a triangle among those beside a free edge, 0 of others, motion: see `calibrate.effects.support.branches`, None without a time, motion_sign (t,): see there, lines (n, 2, 4): see `calibrate.effects.support.borders`, rings (n, q) and ring_slopes (n, q, 2): gradient at the nodes, as
    the stencil and slopes above, membrane: see `calibrate.effects.support.membrane`; plane: 'stress' or 'strain'.
    twin: see `calibrate.effects.support.twin_kinematics`; None: the test has none. doubt: 1 where effects are to be wrong by a standard deviation of
    what their formulas leave out, else 0.
    reference_height (n,), mm: of stereo data, see `Experiment.heights`; None: one camera. zeroed, synchronised, biaxial: see `Experiment`.
    """

    points: Any
    triangles: Any
    stencil: Any
    slopes: Any
    areas: Any
    centroids: Any
    u: Any
    time: Any
    thickness: Any
    size: Any
    edges: Any
    edge_nodes: Any
    beside: Any
    motion: Any
    motion_sign: Any
    membrane: Membrane
    lines: Any
    rings: Any
    ring_slopes: Any
    plane: str = field(default="stress", metadata={"static": True})
    thickness_is_known: bool = field(default=True, metadata={"static": True})
    reference_height: Any = None
    zeroed: bool = field(default=False, metadata={"static": True})
    synchronised: bool = field(default=False, metadata={"static": True})
    biaxial: bool = field(default=False, metadata={"static": True})
    twin: TwinKinematics | None = None
    doubt: Any = 0.0

    @classmethod
    def of(cls, experiment: Experiment) -> Data:
        """Prepare an Experiment."""
        points, triangles = experiment.points, experiment.triangles
        areas = recovery.areas(points, triangles, experiment.free_nodes)
        length, edge_nodes = free_edges(experiment)
        (stencil, slopes), (rings, ring_slopes), lines = _of_mesh(_Mesh(points, triangles))
        return cls(
            jnp.asarray(points),
            jnp.asarray(triangles),
            jnp.asarray(stencil),
            jnp.asarray(slopes),
            jnp.asarray(areas),
            jnp.asarray(points[triangles].mean(axis=1)),
            jnp.asarray(experiment.displacements),
            None if experiment.time is None else jnp.asarray(experiment.time),
            jnp.asarray(experiment.thickness or 1.0),
            jnp.asarray(np.ptp(experiment.points, axis=0).max()),
            jnp.asarray(length / areas),
            jnp.asarray(edge_nodes),
            jnp.asarray(np.where(length > 0, np.cumsum(length > 0) - 1, 0)),
            None if experiment.time is None else jnp.asarray(motion(experiment.time, experiment.displacements)),
            jnp.asarray(sign_of_motion(experiment.displacements)),
            Membrane.of(experiment),
            jnp.asarray(lines),
            jnp.asarray(rings),
            jnp.asarray(ring_slopes),
            experiment.plane,
            experiment.thickness is not None,
            None if experiment.heights is None else jnp.asarray(experiment.heights[0]),
            experiment.is_zeroed,
            experiment.is_synchronised,
            experiment.is_biaxial,
        )

    def with_mean_gradients(self) -> Data:
        """The same with gradients at the nodes that are means of those in the triangles around, by area, and with what the twin knows wrong by a standard deviation, but for the bend."""
        points, triangles = np.asarray(self.points), np.asarray(self.triangles)
        areas = kinematics.shape_gradients(points, triangles)[1]
        around = sp.csr_array((np.repeat(areas, 3), (triangles.ravel(), np.repeat(np.arange(len(areas)), 3))))
        mean = sp.kron(sp.csr_array(sp.diags_array(1 / around.sum(axis=1)) @ around), sp.eye_array(2))
        rings, ring_slopes = padded(
            sp.csr_array(mean @ kinematics.gradient_operator(points, triangles)), self.rings.shape[1]
        )
        other = replace(self, rings=jnp.asarray(rings), ring_slopes=jnp.asarray(ring_slopes))
        if self.twin is None:
            return other
        twin, exact = self.twin.of_mean_gradients().doubted(), edge_means(self, self.u) - edge_means(other, self.u)
        return replace(other, twin=replace(twin, missed=twin.missed.at[1].add(exact[:, self.beside_edges])))

    @property
    def beside_edges(self) -> NDArray[np.int64]:
        """Triangles (e,) beside a free edge; the first one where there is none."""
        found = np.flatnonzero(np.asarray(self.edges))
        return found if found.size else np.zeros(1, np.int64)

    @property
    def centre(self) -> Any:
        """Middle (2,) of the specimen's extent, mm."""
        return 0.5 * (self.points.min(axis=0) + self.points.max(axis=0))


class NodalData(NamedTuple):
    """What `bend` and gradients at the nodes read of an Experiment, see `Data`."""

    points: Any
    u: Any
    thickness: Any
    membrane: Membrane
    rings: Any
    ring_slopes: Any

    @classmethod
    def of(cls, experiment: Experiment) -> NodalData:
        """Prepare an Experiment whose thickness is known."""
        rings = map(jnp.asarray, _rings(experiment.points, experiment.triangles))
        u, h = jnp.asarray(experiment.displacements), jnp.asarray(experiment.thickness)
        return cls(jnp.asarray(experiment.points), u, h, Membrane.of(experiment), *rings)


@dataclass(frozen=True)
class _Mesh:
    """Equal to another one of the same points (n, 2), mm, and triangles (m, 3)."""

    points: Array = field(compare=False)
    triangles: NDArray[np.int64] = field(compare=False)
    digest: bytes = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "digest", digest(self.points, self.triangles))


@lru_cache(maxsize=4)
def _of_mesh(mesh: _Mesh) -> tuple[tuple[NDArray[np.int64], Array], tuple[NDArray[np.int64], Array], Array]:
    """Stencil with slopes, rings with theirs, and lines, see `Data`: kept, as a diagnosis sees the same mesh again and again."""
    points, triangles = mesh.points, mesh.triangles
    stencil = padded(recovery.centroid_gradients(points, triangles))
    return stencil, _rings(points, triangles), nearest_lines(points, triangles)


def _rings(points: Array, triangles: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array]:
    """Rings with their slopes, see `Data`."""
    order = np.arange(2 * len(points)).reshape(2, -1).T.ravel()
    return padded(sp.csr_array(sp.csr_array(sp.vstack(recovery.nodal_gradients(points, triangles)))[order]))


def edge_means(data: Data, u: Any) -> Any:
    """Mean over the ends of the free edge of each triangle of the displacement gradient there (t, m, 2, 2), of displacements (t, n, 2)."""
    at_ends = gradient(data, u, data.edge_nodes.ravel())
    return at_ends.reshape(len(u), -1, 2, 2, 2).mean(axis=2)


STENCIL = 8  # stencils are padded to a multiple of it, so that meshes of one size share compiled code


def padded(operator: sp.csr_array, least: int = 0) -> tuple[NDArray[np.int64], Array]:
    """Nodes (m, k) and weights (m, k, 2) of a gradient operator (2 m, n); k at least `least`."""
    x, y = sp.csr_array(operator[0::2]), sp.csr_array(operator[1::2])
    for part in (x, y):
        part.eliminate_zeros()  # the sum of two stored zeros is not stored
    pattern = sp.csr_array(abs(x) + abs(y))
    pattern.sort_indices()
    counts = np.diff(pattern.indptr)
    width = max(STENCIL * int(np.ceil(counts.max() / STENCIL)), least)
    row = np.repeat(np.arange(len(counts)), counts)
    place = np.arange(pattern.nnz) - np.repeat(pattern.indptr[:-1], counts)
    nodes, weights = np.zeros((len(counts), width), np.int64), np.zeros((len(counts), width, 2))
    nodes[row, place] = pattern.indices
    for k, part in enumerate((x, y)):
        entries = sp.coo_array(part)
        key = row * operator.shape[1] + pattern.indices
        found = np.searchsorted(key, entries.row.astype(np.int64) * operator.shape[1] + entries.col)
        weights[entries.row, place[found], k] = entries.data
    return nodes, weights


def free_edges(experiment: Experiment) -> tuple[Array, NDArray[np.int64]]:
    """Length (m,), mm, of the free edges of each triangle that may be inside the specimen, and the nodes (m, 2) of one of them (0 where there is none)."""
    points, n_triangles, outline = experiment.points, len(experiment.triangles), Outline.of(experiment)
    inside = outline.free & ~outline.given
    ends, owners = outline.edges[inside], outline.owners[inside]
    length = np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1)
    nodes = np.zeros((n_triangles, 2), np.int64)
    nodes[owners] = ends
    return np.bincount(owners, length, n_triangles), nodes
