"""What an effect is: one small thing a model may lack, as a differentiable change of the chain from images to forces.

The chain of an Experiment is displacements -> deformation gradients -> stresses -> virtual work - measured forces. An
effect may change any link; with its amplitudes at their null value nothing changes, exactly. Amplitudes are what is
tested and fitted; shapes (a relaxation time, an angle) mean nothing at the null value, so that a few of them are tried.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.effects.borders import nearest_lines
from calibrate.effects.branches import motion
from calibrate.effects.membrane import Membrane
from calibrate.equations import recovery

Array = NDArray[np.float64]
STAGES = ("energy", "kinematics", "stiffness", "softening", "relaxation", "set", "measurement", "load")
"""Where effects act, from the material to the camera: on the energy; on what a sheet is in three dimensions; as a factor that
depends on the place; as one that depends on the history; over time; by chains formed anew; on what is measured.

What varies, softens or relaxes is all that comes before, so that kinematics, which know the law of the base alone, come early."""
ELSEWHERE = ("kinematics", "measurement", "load")


@dataclass(frozen=True)
class Parameter:
    """An amplitude or shape. null: no effect. lower, upper: physically admissible. typical: of a strong effect."""

    name: str
    unit: str
    null: float = 0.0
    lower: float = -np.inf
    upper: float = np.inf
    typical: float = 0.1

    @property
    def stiffness_power(self) -> int:
        """Power of the stiffness of the material that it grows with, if everything is as many times stiffer."""
        return {"MPa": 1, "1/MPa": -1}.get(self.unit, 0)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Data:
    """An Experiment prepared for the chain: arrays only, so that compiled code serves every experiment of its size.

    points (n, 2), triangles (m, 3), stencil (m, k) and slopes (m, k, 2): gradient at the centroids = sum over the
    stencil of nodal values times slopes, 1/mm; areas (m,) mm^2, centroids (m, 2), u (t, n, 2) mm, time (t,) s or None,
    thickness mm (1 where unknown), size: extent mm, edges (m,): length of free edges over area, 1/mm, edge_nodes (m, 2): of
    a free edge, motion: see `calibrate.effects.branches`, None without a time, lines (n, 2, 4): see `calibrate.effects.borders`, rings (n, q) and ring_slopes (n, q, 2): gradient at the nodes, as
    the stencil and slopes above, membrane: see `calibrate.effects.membrane`; plane: 'stress' or 'strain'.
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
    motion: Any
    membrane: Membrane
    lines: Any
    rings: Any
    ring_slopes: Any
    plane: str = field(default="stress", metadata={"static": True})

    @classmethod
    def of(cls, experiment: Experiment) -> Data:
        """Prepare an Experiment."""
        points, triangles = experiment.points, experiment.triangles
        areas = recovery.areas(points, triangles, experiment.free_nodes)
        stencil, slopes = padded(recovery.centroid_gradients(points, triangles))
        x, y = recovery.nodal_gradients(points, triangles)
        length, edge_nodes = free_edges(experiment)
        order = np.arange(2 * len(points)).reshape(2, -1).T.ravel()
        rings, ring_slopes = padded(sp.csr_array(sp.csr_array(sp.vstack([x, y]))[order]))
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
            None if experiment.time is None else jnp.asarray(motion(experiment.time, experiment.displacements)),
            Membrane.of(experiment),
            jnp.asarray(nearest_lines(points, triangles)),
            jnp.asarray(rings),
            jnp.asarray(ring_slopes),
            experiment.plane,
        )


STENCIL = 8  # stencils are padded to a multiple of it, so that meshes of one size share compiled code


def padded(operator: sp.csr_array) -> tuple[NDArray[np.int64], Array]:
    """Nodes (m, k) and weights (m, k, 2) of a gradient operator (2 m, n)."""
    x, y = sp.csr_array(operator[0::2]), sp.csr_array(operator[1::2])
    pattern = sp.csr_array(abs(x) + abs(y))
    pattern.sort_indices()
    counts = np.diff(pattern.indptr)
    width = STENCIL * int(np.ceil(counts.max() / STENCIL))
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
    """Length (m,), mm, of the free edges of each triangle, and the nodes (m, 2) of one of them (0 where there is none)."""
    triangles, points = experiment.triangles, experiment.points
    pairs = np.concatenate([triangles[:, [a, (a + 1) % 3]] for a in range(3)])
    _, first, count = np.unique(np.sort(pairs, axis=1), axis=0, return_index=True, return_counts=True)
    single = first[count == 1]
    free, gripped = np.zeros(len(points), bool), np.zeros(len(points), bool)
    free[experiment.free_nodes] = True
    for boundary in experiment.loaded:
        gripped[boundary.nodes] = True
    ends = pairs[single]
    edge = (free | gripped)[ends].all(axis=1) & free[ends].any(axis=1)
    length = np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=1)
    owner = single[edge] % len(triangles)
    nodes = np.zeros((len(triangles), 2), np.int64)
    nodes[owner] = ends[edge]
    return np.bincount(owner, length[edge], len(triangles)), nodes


LATE = 10.0  # durations of the record: what begins so late has the time of a clock


def lacks_plane_stress(data: Data) -> str | None:
    """What is missing for an effect that is derived for a sheet with free faces."""
    return None if data.plane == "stress" else "plane stress"


def lacks_rate(data: Data) -> str | None:
    """What is missing for an effect that is seen in how fast the sheet is loaded."""
    if data.time is None:
        return "time"
    if len(data.time) < 3:
        return "more increments"
    late = float(data.time[0]) > LATE * float(data.time[-1] - data.time[0])
    return "time counted from the start of loading" if late else None


@dataclass(frozen=True)
class Effect:
    """Base of the effects; a subclass states its class variables and overrides the links it changes.

    name; stage: one of STAGES, in whose order effects act on the stress, whichever was found first; formula: for the report; source: of the formula;
    amplitudes; shapes; shapes_vary: False where they only choose a
    derivative at the null value and mean nothing once the amplitude is known; gauge: why it can never be told apart
    from another quantity, or nothing; decided_by: the experiment that tells it from its likes; of_material: holds for
    every specimen of a material, not of one test alone; rough: adds second derivatives of the displacements to them, whose
    noise the weights of a model with it must know; truncated: its formula is the beginning of a series, so that a small part
    of what it explains is left for others.

    In the links below a (p,) are the values of the amplitudes, shape those of the shapes, in the units of `Parameter`.
    """

    name: ClassVar[str]
    stage: ClassVar[str]
    formula: ClassVar[str]
    source: ClassVar[str] = "its own definition"
    amplitudes: ClassVar[tuple[Parameter, ...]]
    shapes: ClassVar[tuple[Parameter, ...]] = ()
    shapes_vary: ClassVar[bool] = True
    gauge: ClassVar[str] = ""
    decided_by: ClassVar[str] = ""
    of_material: ClassVar[bool] = False
    rough: ClassVar[bool] = False
    truncated: ClassVar[bool] = False

    @property
    def in_material(self) -> bool:
        """Whether it makes stress from F at a place and its past."""
        return self.stage not in ELSEWHERE

    @property
    def remembers(self) -> bool:
        """Whether its stress depends on earlier increments."""
        return self.stage in ("softening", "relaxation", "set")

    def missing(self, data: Data) -> str | None:
        """What the data lack for this effect to be tested ('time', 'unloading', ...), or None."""
        return None

    def shape_values(self, data: Data) -> list[tuple[float, ...]]:
        """Shapes to be tried; one empty one for an effect without shapes."""
        return [()]

    def displacements(self, data: Data, u: Any, a: Any, shape: Any) -> Any:
        """True displacements (t, n, 2), mm, of the measured ones u (t, n, 2)."""
        return u

    def stress(self, data: Data, F: Any, P: Any, a: Any, shape: Any, law: Any) -> Any:
        """In-plane first Piola-Kirchhoff stress (t, m, 2, 2), MPa, from the one so far, P; F (t, m, 2, 2), of an
        incompressible sheet.

        In plane strain F is the isochoric part, and P what it would be in such a sheet; see `calibrate.equations.isochoric`.
        law: the base model's stress (2, 2), MPa, at one deformation gradient (2, 2).
        """
        return P

    def loads(self, data: Data, loads: Any, a: Any, shape: Any) -> Any:
        """True forces (t, 2, b), N, of the measured ones (t, 2, b) on the b loaded boundaries."""
        return loads
