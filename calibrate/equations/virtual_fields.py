"""Virtual fields: piecewise-bilinear test functions on a coarse grid, whatever the measured mesh.

In: an Experiment and a grid spacing in mm. Out: `VirtualFields`, nodal values of scalar fields that

- are constant on every loaded boundary, so that only the measured resultant force does work there,
- vanish on the rim of the measured region that is neither loaded nor free (unknown traction),
- are arbitrary on free edges, where the traction is zero, and run across holes unhindered.

Each field is used for both components, unless an edge slides: then a component that no edge holds is arbitrary there, and each
field is for one component alone. Near a loaded or rim edge the bilinear hats are multiplied by
min(1, distance / spacing); each loaded boundary adds max(0, 1 - distance / spacing), 1 on that edge.
The coarse grid keeps correlated displacement noise of short wavelength out of the equilibrium equations
(the role of the virtual mesh in Marek, Davis, Pierron 2017, Comput. Mech.).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibrate.data.experiment import Experiment
from calibrate.data.triangulation import boundary_nodes
from calibrate.errors import ConfigError

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MOST = 2  # points of the grid of virtual fields, over the number of nodes


@dataclass(frozen=True)
class VirtualFields:
    """values (n_nodes, n_fields), sparse; boundary (n_fields,): index of the loaded boundary where it is 1, or -1;
    spacing of the grid, mm, 0 without one; admissible (2, n_fields): components that a field is for, None: both. The work of
    another is unknown, and its equation has no load (NaN)."""

    values: sp.csr_array
    boundary: Indices
    spacing: float
    admissible: NDArray[np.bool_] | None = None

    @property
    def n_fields(self) -> int:
        """Number of scalar fields."""
        return self.values.shape[1]


def default_spacing(experiment: Experiment) -> float:
    """Five correlation lengths of the noise, but 1/12 to 1/5 of the specimen (1/10 where the noise is unknown), mm."""
    extent = float(np.ptp(experiment.points, axis=0).max())
    if experiment.noise is None or experiment.noise.mean_length == 0:
        return extent / 10
    return float(np.clip(5 * experiment.noise.mean_length, extent / 12, extent / 5))


def virtual_fields(experiment: Experiment, spacing: float | None = None) -> VirtualFields:
    """Build the virtual fields of an experiment on a grid of `spacing` mm.

    Raises `ConfigError` for a spacing that leaves no field inside the specimen, or makes more than `MOST` for each node.
    """
    given = spacing is not None
    spacing = default_spacing(experiment) if spacing is None else float(spacing)
    points = experiment.points
    extent = float(np.ptp(points, axis=0).max())
    inside = len(boundary_nodes(experiment.triangles)) < len(points)  # a homogeneous test is all boundary
    if inside and not 0 < spacing <= extent:
        raise ConfigError(
            f"{experiment.name}: virtual fields {spacing:g} mm apart do not fit a specimen of {extent:.3g} mm; give a "
            f"--spacing well below it ({default_spacing(experiment):.3g} by default)"
        )
    if inside and given and np.prod(np.ceil(np.ptp(points, axis=0) / spacing) + 1) > MOST * len(points):
        raise ConfigError(
            f"{experiment.name}: virtual fields {spacing:g} mm apart are more than {MOST} for each of its {len(points)} nodes; give a larger "
            f"--spacing ({default_spacing(experiment):.3g} by default)"
        )
    parts = [_fields_of_component(experiment, spacing, component) for component in (0, 1)]
    slides = not all(all(b.held) for b in experiment.loaded)
    return _joined(parts, spacing) if slides else VirtualFields(*parts[0], spacing)


def _fields_of_component(experiment: Experiment, spacing: float, component: int) -> tuple[sp.csr_array, Indices]:
    """Values (n_nodes, q) and boundary (q,) of the fields that one component of the virtual displacement may have."""
    points, rim = experiment.points, boundary_nodes(experiment.triangles)
    loaded = [(i, b.nodes) for i, b in enumerate(experiment.loaded) if b.held[component]]
    gripped = np.concatenate([b.nodes for b in experiment.loaded])
    unknown = np.setdiff1d(rim, np.union1d(experiment.free_nodes, gripped))
    constrained = np.unique(np.concatenate([unknown, *(nodes for _, nodes in loaded)]))
    cutoff = _ramp(points, constrained, spacing)
    hats = sp.diags_array(cutoff) @ bilinear_hats(points, spacing)
    # a hat that lives on a few nodes only is noise; its neighbours cover the place
    mass = np.asarray(hats.sum(axis=0)).ravel()
    # without a free or inner node (a homogeneous test) no hat is left: the loaded boundaries say it all
    smallest = 0.05 * np.median(mass[mass > 0]) if (mass > 0).any() else 0.0
    hats = hats[:, mass > smallest]
    edges = []
    for _, nodes in loaded:
        field = np.maximum(0.0, 1.0 - cKDTree(points[nodes]).query(points)[0] / spacing)
        field *= _ramp(points, np.setdiff1d(constrained, nodes), spacing)
        field[nodes] = 1.0
        edges.append(field)
    values = sp.csr_array(sp.hstack([hats, sp.csr_array(np.array(edges).reshape(-1, len(points)).T)]))
    boundary = np.concatenate([np.full(hats.shape[1], -1), np.array([i for i, _ in loaded], np.int64)])
    return values, boundary


def _ramp(points: Array, nodes: Indices, spacing: float) -> Array:
    """(n,): 0 at some nodes (k,), 1 from a spacing away; 1 everywhere without any."""
    if not nodes.size:
        return np.ones(len(points))
    return np.minimum(1.0, cKDTree(points[nodes]).query(points)[0] / spacing)


def _joined(parts: list[tuple[sp.csr_array, Indices]], spacing: float) -> VirtualFields:
    """Fields for x and behind them those for y."""
    sizes = [len(boundary) for _, boundary in parts]
    component = np.repeat([0, 1], sizes)
    admissible = np.stack([component == 0, component == 1])
    values = sp.csr_array(sp.hstack([part[0] for part in parts]))
    return VirtualFields(values, np.concatenate([part[1] for part in parts]), spacing, admissible)


def nodal_fields(experiment: Experiment) -> VirtualFields:
    """Every single node that is neither loaded nor on an unknown rim, and one field per loaded boundary.

    These are the test functions of the plain equilibrium gap: one nodal force a free node, the sum of the
    nodal forces a loaded boundary.
    """
    parts = [_nodes_of_component(experiment, component) for component in (0, 1)]
    slides = not all(all(b.held) for b in experiment.loaded)
    return _joined(parts, 0.0) if slides else VirtualFields(*parts[0], 0.0)


def _nodes_of_component(experiment: Experiment, component: int) -> tuple[sp.csr_array, Indices]:
    """The same for one component of the virtual displacement: values (n_nodes, q), boundary (q,)."""
    n = len(experiment.points)
    loaded = [(i, b.nodes) for i, b in enumerate(experiment.loaded) if b.held[component]]
    sliding = [b.nodes for b in experiment.loaded if not b.held[component]]
    rim = np.setdiff1d(boundary_nodes(experiment.triangles), np.concatenate([experiment.free_nodes, *sliding]))
    free = np.setdiff1d(np.arange(n), np.concatenate([rim, *(nodes for _, nodes in loaded)]))
    single = sp.csr_array((np.ones(free.size), (free, np.arange(free.size))), shape=(n, free.size))
    edges = np.zeros((n, len(loaded)))
    for k, (_, nodes) in enumerate(loaded):
        edges[nodes, k] = 1.0
    boundary = np.concatenate([np.full(free.size, -1), np.array([i for i, _ in loaded], np.int64)])
    return sp.csr_array(sp.hstack([single, sp.csr_array(edges)])), boundary


def bilinear_hats(points: Array, spacing: float) -> sp.csr_array:
    """Bilinear hats (n_nodes, n_grid) at points (n_nodes, 2) of a grid of `spacing`, mm, centred on the specimen;
    columns without a node are dropped."""
    low, high = points.min(axis=0), points.max(axis=0)
    cells = np.maximum(1, np.ceil((high - low) / spacing)).astype(int)
    start = 0.5 * (low + high) - 0.5 * cells * spacing
    position = (points - start) / spacing
    cell = np.clip(np.floor(position).astype(int), 0, cells - 1)
    local = position - cell
    rows, columns, values = [], [], []
    for i in (0, 1):
        for j in (0, 1):
            weight = np.abs(1 - i - local[:, 0]) * np.abs(1 - j - local[:, 1])
            rows.append(np.arange(len(points)))
            columns.append((cell[:, 0] + i) * (cells[1] + 1) + cell[:, 1] + j)
            values.append(weight)
    shape = (len(points), int(np.prod(cells + 1)))
    hats = sp.csr_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=shape)
    used = np.asarray(abs(hats).sum(axis=0)).ravel() > 0
    return sp.csr_array(hats[:, used])
