"""Virtual fields: piecewise-bilinear test functions on a coarse grid, whatever the measured mesh.

In: an Experiment and a grid spacing in mm. Out: `VirtualFields`, nodal values of scalar fields that

- are constant on every loaded boundary, so that only the measured resultant force does work there,
- vanish on the rim of the measured region that is neither loaded nor free (unknown traction),
- are arbitrary on free edges, where the traction is zero, and run across holes unhindered.

Each field is used for both components. Near a loaded or rim edge the bilinear hats are multiplied by
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

MOST = 2  # points of the grid of virtual fields, over the number of nodes


@dataclass(frozen=True)
class VirtualFields:
    """values (n_nodes, n_fields), sparse; boundary (n_fields,): index of the loaded boundary where it is 1, or -1;
    spacing of the grid, mm, 0 without one."""

    values: sp.csr_array
    boundary: NDArray[np.int64]
    spacing: float

    @property
    def n_fields(self) -> int:
        """Number of scalar fields."""
        return self.values.shape[1]


def default_spacing(experiment: Experiment) -> float:
    """Five correlation lengths of the noise, but 1/12 to 1/5 of the specimen (1/10 where the noise is unknown), mm."""
    extent = float(np.ptp(experiment.points, axis=0).max())
    if experiment.noise is None or experiment.noise.correlation_length == 0:
        return extent / 10
    return float(np.clip(5 * experiment.noise.correlation_length, extent / 12, extent / 5))


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
    constrained = np.setdiff1d(boundary_nodes(experiment.triangles), experiment.free_nodes)
    cutoff = np.ones(len(points))
    if constrained.size:
        cutoff = np.minimum(1.0, cKDTree(points[constrained]).query(points)[0] / spacing)
    hats = sp.diags_array(cutoff) @ bilinear_hats(points, spacing)
    # a hat that lives on a few nodes only is noise; its neighbours cover the place
    mass = np.asarray(hats.sum(axis=0)).ravel()
    # without a free or inner node (a homogeneous test) no hat is left: the loaded boundaries say it all
    smallest = 0.05 * np.median(mass[mass > 0]) if (mass > 0).any() else 0.0
    hats = hats[:, mass > smallest]
    edges = [np.maximum(0.0, 1.0 - cKDTree(points[b.nodes]).query(points)[0] / spacing) for b in experiment.loaded]
    others = [np.setdiff1d(constrained, b.nodes) for b in experiment.loaded]
    for field, other in zip(edges, others, strict=True):
        if other.size:
            field *= np.minimum(1.0, cKDTree(points[other]).query(points)[0] / spacing)
    edges = [
        np.where(np.isin(np.arange(len(points)), b.nodes), 1.0, f)
        for b, f in zip(experiment.loaded, edges, strict=True)
    ]
    values = sp.csr_array(sp.hstack([hats, sp.csr_array(np.array(edges).T)]))
    boundary = np.concatenate([np.full(hats.shape[1], -1), np.arange(len(edges))])
    return VirtualFields(values, boundary, spacing)


def nodal_fields(experiment: Experiment) -> VirtualFields:
    """Every single node that is neither loaded nor on an unknown rim, and one field per loaded boundary.

    These are the test functions of the plain equilibrium gap: one nodal force a free node, the sum of the
    nodal forces a loaded boundary.
    """
    n = len(experiment.points)
    constrained = np.setdiff1d(boundary_nodes(experiment.triangles), experiment.free_nodes)
    constrained = np.union1d(constrained, np.concatenate([b.nodes for b in experiment.loaded]))
    free = np.setdiff1d(np.arange(n), constrained)
    single = sp.csr_array((np.ones(free.size), (free, np.arange(free.size))), shape=(n, free.size))
    edges = np.zeros((n, len(experiment.loaded)))
    for i, b in enumerate(experiment.loaded):
        edges[b.nodes, i] = 1.0
    boundary = np.concatenate([np.full(free.size, -1), np.arange(len(experiment.loaded))])
    return VirtualFields(sp.csr_array(sp.hstack([single, sp.csr_array(edges)])), boundary, 0.0)


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
