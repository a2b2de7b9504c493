r"""Rows of a replayed test that a diagnosis is judged by: forces, smooth parts of the fields, and what noise makes of both.

In: a test as it was (`calibrate.effects.chain.true_surface`), and the law of a model. Out: `SheetRows`.

The field is seen through orthonormal combinations of cosines over the specimen at the points that are not prescribed: they depend on no model, and noise hardly
shows in them. Their virtual fields and those of the forces (`forward.sheet.adjoint`) tell what noise of the motion that is prescribed does,

.. math:: \rho = y - y_h \approx W \cdot \eta - (K v)_h \cdot \eta_h + \epsilon_F,

as in a polish (`studies.polish.replay_equations`), and what a change of the law does (`law_changes`). K is the tangent of what is elastic in the law, times the force of the model over that of
its elastic part: v of a displacement is as much smaller, K v of a force as much larger.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment, Noise
from calibrate.data.measurement import one_cell
from calibrate.equations import noise_covariance
from calibrate.equations.virtual_fields import default_spacing
from forward.sheet.adjoint import AdjointLaw
from studies.replay.model_law import Law
from studies.replay.replayed_experiment import BoundaryValues, Replay

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
COSINES = 3  # over each side of the specimen
SOFTEST, STIFFEST = 0.2, 5.0  # force of a model over that of its elastic part, at one deformation
SAME = 1e-9  # part of a wave that the ones before it do not have, of the root of the number of points: none
NOTHING = 1e-3  # of the largest force: a component of this size in all increments is none


@dataclass(frozen=True)
class Layout:
    """Which rows a test has: the same of all its models. chosen (k,): increments that are compared; sides: numbers of boundaries and components of the
    forces that are known; weights (w, n): orthonormal, zero where displacements are prescribed."""

    chosen: NDArray[np.int64]
    sides: tuple[tuple[int, int], ...]
    weights: Array = field(repr=False)

    @classmethod
    def of(cls, experiment: Experiment, chosen: NDArray[np.int64], judged: Mask) -> Layout:
        """judged (n,): points that are not prescribed."""
        return cls(chosen, _sides(experiment, chosen), smooth_weights(experiment.points, judged))

    @property
    def rows(self) -> int:
        """Of one increment."""
        return len(self.sides) + 2 * len(self.weights)

    @property
    def is_force(self) -> Mask:
        """(rows,)."""
        return np.arange(self.rows) < len(self.sides)

    def labels(self, experiment: Experiment) -> tuple[str, ...]:
        """Of the rows of one increment."""
        forces = [f"{experiment.loaded[b].name} {'xy'[axis]}" for b, axis in self.sides]
        return (*forces, *(f"field {i} {axis}" for i in range(len(self.weights)) for axis in "xy"))

    def observe(self, forces: list[Array], displacements: Array) -> Array:
        """(t, rows): forces (t, 2) of every boundary, N, and displacements (t, n, 2), mm."""
        fields = np.einsum("wn,tni->twi", self.weights, displacements).reshape(len(displacements), -1)
        return (
            np.concatenate([np.stack([forces[b][:, axis] for b, axis in self.sides], axis=1), fields], axis=1)
            if self.sides
            else fields
        )


@dataclass(frozen=True, eq=False)
class SheetRows:
    """Of one test and model. experiment: as it was, the chosen increments alone; measured, replayed (k, rows); noise (k rows, k rows); fields (k, rows, n, 2): virtual fields at the points,
    mm/mm of a force row, mm/N of a displacement; prescribed (k, rows, n, 2): derivative of measured minus replayed by the displacements that were measured;
    squares (k,): mean square of the whole residual, mm^2."""

    experiment: Experiment
    layout: Layout
    measured: Array
    replayed: Array
    squares: Array
    noise: Array = field(repr=False)
    fields: Array = field(repr=False)
    prescribed: Array = field(repr=False)


def sheet_rows(
    experiment: Experiment, layout: Layout, found: Replay, solved: NDArray[np.int64], linear: bool
) -> SheetRows:
    """experiment: as it was; found: its replay in the increments that were solved, the chosen ones among them. linear: with noise and virtual fields."""
    seen = experiment.select(layout.chosen)
    own = np.searchsorted(solved, layout.chosen)
    forces = [found.forces[b.name][own] for b in seen.loaded]
    measured = layout.observe([b.force for b in seen.loaded], seen.displacements)
    replayed = layout.observe(forces, found.displacements[own])
    left = (seen.displacements - found.displacements[own])[:, found.judged]
    squares = (left**2).sum(axis=(1, 2)) / max(2 * left.shape[1], 1)
    k = len(layout.chosen)
    if not linear:
        none = np.zeros((k * layout.rows,) * 2)
        return SheetRows(
            seen, layout, measured, replayed, squares, none, np.zeros((k, 0, 0, 2)), np.zeros((k, 0, 0, 2))
        )
    made = _Linear(seen, layout, found.law, found.solution.displacements[own], forces)
    fields, prescribed = made.virtual_fields()
    noise = made.covariance(prescribed, measured)
    return SheetRows(seen, layout, measured, replayed, squares, noise, fields, prescribed)


@dataclass(eq=False)
class _Linear:
    """A replay linearised. displacements (k, nodes, 2), mm, of all nodes; forces: of every boundary (k, 2), N."""

    experiment: Experiment
    layout: Layout
    law: Law
    displacements: Array
    forces: list[Array]

    @cached_property
    def boundary(self) -> BoundaryValues:
        return BoundaryValues.of(self.experiment, strip=self.law.strip)

    def virtual_fields(self) -> tuple[Array, Array]:
        """At the camera's points (k, rows, n, 2): v, and W - (K v)_h."""
        mesh, n = self.boundary.mesh, len(self.experiment.points)
        held, values = self.boundary.motion(self.experiment.displacements).prescribed(mesh)
        sheet = AdjointLaw(mesh, self.law.sheet, held, values)
        weights, on_held = self._weights()
        carried = sp.csr_array(self.boundary.carried.T)
        fields, forces = [], []
        for k, u in enumerate(self.displacements):
            sheet.unknowns = (u,)
            found = sheet.virtual_fields(weights, on_held)
            ratio = self._stiffer(k, sheet.nodal_forces())
            scale = np.where(self.layout.is_force, 1.0, 1 / ratio)[:, None, None]
            fields.append(scale * found.values[:, :n])
            at_points = np.stack([(carried @ found.held[:, :, i].T).T for i in (0, 1)], axis=-1)
            prescribed = -np.where(self.layout.is_force, ratio, 1.0)[:, None, None] * at_points
            for axis in (0, 1):
                prescribed[len(self.layout.sides) + axis :: 2, :, axis] += self.layout.weights
            forces.append(prescribed)
        return np.array(fields), np.array(forces)

    def _weights(self) -> tuple[Array, Array]:
        """Of the displacements of all nodes in every row, and values of the virtual fields where held; each (rows, nodes, 2)."""
        mesh, layout = self.boundary.mesh, self.layout
        weights, on_held = (np.zeros((layout.rows, *mesh.points.shape)) for _ in range(2))
        for row, (b, axis) in enumerate(layout.sides):
            nodes = mesh.boundary_nodes(self.experiment.loaded[b].name)
            on_held[row, nodes, axis] = self.boundary.held[nodes, axis]
        n, first = len(self.experiment.points), len(layout.sides)
        for axis in (0, 1):
            weights[first + axis :: 2, :n, axis] = layout.weights
        return weights, on_held

    def _stiffer(self, k: int, nodal: Array) -> float:
        """Force of the model over that of its elastic part at the same displacements."""
        own = np.array(
            [nodal[self.boundary.mesh.boundary_nodes(b.name)].sum(axis=0) * b.held for b in self.experiment.loaded]
        )
        whole = np.array([force[k] for force in self.forces])
        return float(np.clip((whole * own).sum() / max((own * own).sum(), 1e-300), SOFTEST, STIFFEST))

    def covariance(self, spread: Array, measured: Array) -> Array:
        """(k rows, k rows) of what noise of displacements and load cells does; spread (k, rows, n, 2): W - (K v)_h."""
        e, first, noise = self.experiment, len(self.layout.sides), noise_of(self.experiment)
        B = noise_covariance.noise_factor(e, noise)
        k, rows = spread.shape[:2]
        sources = np.concatenate([(B.T @ spread[..., i].reshape(k * rows, -1).T).T for i in (0, 1)], axis=1)
        between = noise_covariance.between_increments(e, noise)
        found = (sources @ sources.T).reshape(k, rows, k, rows) * between[:, None, :, None]
        deviation = noise.force_deviation(measured[:, :first])
        for i in range(k):
            found[i, :first, i, :first] += np.diag(deviation[i] ** 2)
        return found.reshape(k * rows, -1)


def noise_of(experiment: Experiment) -> Noise:
    """As stated, or a stand-in."""
    noise = experiment.noise
    if noise is not None and noise.displacement_std > 0:
        return noise
    return noise_covariance.default_noise(experiment, default_spacing(experiment))


def forces_known(experiment: Experiment) -> Mask:
    """Increments (t,) in which each component of a force was read that is ever read."""
    forces = np.stack([b.force[:, axis] for b in experiment.loaded for axis in (0, 1)], axis=1)
    read = np.isfinite(forces)
    return np.asarray((read | ~read.any(axis=0)).all(axis=1))


def _sides(experiment: Experiment, chosen: NDArray[np.int64]) -> tuple[tuple[int, int], ...]:
    """Boundaries and components whose force is measured in the chosen increments, that of its section, and not nothing; of two read by one cell the first."""
    if experiment.level_is_nominal:
        return ()
    found: list[tuple[int, int]] = []
    cells = [one_cell(np.stack([b.force[:, axis] for b in experiment.loaded], axis=1)) for axis in (0, 1)]
    largest = max(float(np.nanmax(np.abs(b.force), initial=0.0)) for b in experiment.loaded)
    for i, b in enumerate(experiment.loaded):
        for axis in (0, 1):
            force = b.force[:, axis]
            if (
                not b.held[axis]
                or not np.isfinite(force[chosen]).all()
                or np.nanmax(np.abs(force)) <= NOTHING * largest
            ):
                continue
            if not any(a == axis and cells[axis][i, j] for j, a in found):
                found.append((i, axis))
    return tuple(found)


def smooth_weights(points: Array, judged: Mask) -> Array:
    """Orthonormal combinations (w, n) of cosines over the specimen, at the points (n, 2) that are judged (n,); none where all are prescribed."""
    low, high = points.min(axis=0), points.max(axis=0)
    x = np.pi * (points - low) / (high - low)
    waves = [np.cos(k * x[:, 0]) * np.cos(l * x[:, 1]) for k in range(COSINES) for l in range(COSINES)]
    Q, R = np.linalg.qr((np.array(waves) * judged).T)
    return Q.T[np.abs(np.diag(R)) > SAME * np.sqrt(judged.sum())]
