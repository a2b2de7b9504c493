r"""Equilibrium where the camera does not see the free edges: a strip of the sheet beside the measured region carries load, too.

In: an Experiment whose rim (neither loaded nor free) runs at a known distance, the margin, from a free edge. Out: `Equilibrium` with
equations that hold in spite of that:

- virtual fields inside vanish on the rim, as its traction is unknown;
- the force of a grip passes through every section, seen or not. Fields that depend on the distance to the grip alone are
  continued through the strip, constant along its normal, up to the true edge, which is free. There

      work = t w sum_k L_k P(F_k) : (dv/ds t_k),      F_k: gradient in the middle of the strip beside edge k,

  where a quadratic displacement, fitted to the nodes within two margins of the edge, is continued to.

How wrong that may be is a part of the noise: in places of one spacing, and in all together, by `DOUBT` times the difference that
continuing the gradient from the edge to the middle of the strip makes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibrate.data.experiment import Experiment
from calibrate.data.outline import Outline
from calibrate.equations import kinematics
from calibrate.equations.basis import Basis, nominal_stress
from calibrate.equations.equilibrium import Equilibrium, check_force_sign
from calibrate.equations.virtual_fields import VirtualFields, virtual_fields
from calibrate.errors import ConfigError

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
REACH = 2.0  # margins, within which nodes tell of the strip
LEAST_NODES = 12  # of a quadratic
DOUBT = 2.0  # error of a continued gradient, over what continuing it changed


@dataclass(frozen=True)
class WindowEquilibrium(Equilibrium):
    """Virtual-work equations of an Experiment that ends `margin` mm before the free edges. Triangles first, then one cell of the strip
    for each edge of the rim."""

    margin: float = 0.0

    @cached_property
    def rim(self) -> Indices:
        """Edges (k, 2) of the rim: neither of a grip nor free."""
        return Outline.of(self.experiment).rim

    @cached_property
    def _along(self) -> tuple[Array, Array]:
        """Length (k,) mm and direction (k, 2) of each edge; the specimen is on its left."""
        along = np.diff(self.experiment.points[self.rim], axis=1)[:, 0]
        length = np.linalg.norm(along, axis=1)
        return length, along / length[:, None]

    @cached_property
    def _continued(self) -> tuple[sp.csr_array, sp.csr_array]:
        """Nodal values to gradients (2 k, n), 1/mm: in the middle of the strip, and at the edge."""
        points = self.experiment.points
        middle = points[self.rim].mean(axis=1)
        outward = self._along[1] @ np.array([[0.0, -1.0], [1.0, 0.0]])
        return quadratic_gradients(points, middle, middle + 0.5 * self.margin * outward, REACH * self.margin)

    @cached_property
    def gradient(self) -> sp.csr_array:
        """Nodal displacements to gradients (2 (m + k), n_nodes), 1/mm."""
        return sp.csr_array(sp.vstack([super().gradient, self._continued[0]]))

    @cached_property
    def areas(self) -> Array:
        """(m + k,) mm^2."""
        return np.concatenate([super().areas, self.margin * self._along[0]])

    @cached_property
    def virtual_gradients(self) -> sp.csr_array:
        """(n_fields, 2 (m + k)): thickness x area x gradient of each virtual field, mm^2."""
        length, direction = self._along
        k, n = len(self.rim), len(self.experiment.points)
        rows = np.repeat(np.arange(2 * k), 2)
        slopes = (direction / length[:, None]).ravel()
        values = np.column_stack([-slopes, slopes]).ravel()
        strip = sp.csr_array((values, (rows, np.repeat(self.rim, 2, axis=0).ravel())), shape=(2 * k, n))
        linear = kinematics.gradient_operator(self.experiment.points, self.experiment.triangles)
        weights = np.repeat(self.areas * (self.experiment.thickness or 1.0), 2)
        return sp.csr_array((sp.diags_array(weights) @ sp.vstack([linear, strip]) @ self.fields.values).T)

    def strip_error(self, basis: Basis, c: Array, increment: int) -> Array:
        """(2 n_fields, s), N: what independent normal numbers for the continued gradient do to the residuals at coefficients c (n_functions,)."""
        k = len(self.rim)
        there = self.deformation_gradients[increment, -k:]
        edge = kinematics.deformation_gradients(self._continued[1], self.experiment.displacements[increment])
        wrong = DOUBT * (nominal_stress(basis, there, c) - nominal_stress(basis, edge, c))
        cell = np.floor(self.experiment.points[self.rim].mean(axis=1) / self.fields.spacing).astype(np.int64)
        places = np.unique(cell, axis=0, return_inverse=True)[1].ravel()
        groups = sp.csr_array(np.column_stack([np.eye(places.max() + 1)[places], np.ones(k)]))
        at_strip = sp.csr_array(self.virtual_gradients[:, -2 * k :])
        blocks = []
        for i in (0, 1):
            work = at_strip @ sp.diags_array(wrong[:, i].ravel())
            blocks.append((work @ sp.kron(groups, np.ones((2, 1)))).toarray())
        return np.concatenate(blocks)


def window_equilibrium(experiment: Experiment, margin: float, spacing: float | None = None) -> Equilibrium:
    """Virtual-work equations of a measured region that ends `margin` mm before the free edges beside its rim; 0: the rim is the edge of
    what is known, as in `equilibrium`.

    Raises `ConfigError` for a margin that is negative, and the errors of `calibrate.equations.equilibrium.equilibrium`.
    """
    if not margin >= 0:
        raise ConfigError(
            f"{experiment.name}: a margin of {margin} mm; give 0 or the width of the strip that is not seen"
        )
    if margin == 0 or not len(Outline.of(experiment).rim):
        system: Equilibrium = Equilibrium(experiment, virtual_fields(experiment, spacing))
    else:
        system = WindowEquilibrium(experiment, section_fields(experiment, spacing), margin=margin)
    check_force_sign(system)
    return system


def section_fields(experiment: Experiment, spacing: float | None = None) -> VirtualFields:
    """Fields inside, zero on the rim; and fields of the distance to each grip alone, up to half the way to the next one."""
    plain = virtual_fields(experiment, spacing)
    inside = plain.values[:, np.flatnonzero(plain.boundary < 0)]
    distance = [cKDTree(experiment.points[b.nodes]).query(experiment.points)[0] for b in experiment.loaded]
    columns, boundary = [], []
    for i, own in enumerate(distance):
        others = [float(own[b.nodes].min()) for j, b in enumerate(experiment.loaded) if j != i]
        half = 0.5 * min(others, default=2 * float(own.max()))
        count = max(1, round(half / plain.spacing - 0.5))
        step = half / (count + 0.5)  # hats of two grips meet half-way: none is there twice
        for k in range(count + 1):
            columns.append(np.maximum(0.0, 1.0 - np.abs(own / step - k)))
            boundary.append(i if k == 0 else -1)
    values = sp.csr_array(sp.hstack([inside, sp.csr_array(np.array(columns).T)]))
    return VirtualFields(values, np.concatenate([np.full(inside.shape[1], -1), boundary]), plain.spacing)


def quadratic_gradients(
    points: Array, centres: Array, places: Array, reach: float
) -> tuple[sp.csr_array, sp.csr_array]:
    """Operators (2 k, n), 1/mm, from nodal values to gradients at places (k, 2) and at centres (k, 2), mm.

    Of quadratics fitted to the nodes within `reach` mm of each centre, or to the nearest `LEAST_NODES` where these are fewer.
    """
    tree = cKDTree(points)
    nearest = tree.query(centres, LEAST_NODES)[0][:, -1]
    rows, columns, values = [], [], []
    for k, near in enumerate(tree.query_ball_point(centres, np.maximum(reach, 1.001 * nearest))):
        size = max(reach, nearest[k])
        x, y = ((points[near] - centres[k]) / size).T
        weight = 1 / (0.25 + x**2 + y**2)
        monomials = np.stack([np.ones_like(x), x, y, x**2, x * y, y**2], axis=1)
        fit = np.linalg.pinv(monomials * weight[:, None]) * weight / size
        a, b = (places[k] - centres[k]) / size
        there = np.stack([fit[1] + 2 * a * fit[3] + b * fit[4], fit[2] + a * fit[4] + 2 * b * fit[5]])
        values.append(np.concatenate([there, fit[1:3]]))
        rows.append(np.repeat(2 * k + np.arange(2), len(near)))
        columns.append(np.tile(near, 2))
    shape, where = (2 * len(centres), len(points)), (np.concatenate(rows), np.concatenate(columns))
    at_place, at_centre = (np.concatenate([v[i : i + 2].ravel() for v in values]) for i in (0, 2))
    return sp.csr_array((at_place, where), shape=shape), sp.csr_array((at_centre, where), shape=shape)
