r"""The replay of a test linearised about a law and a motion of its grips: equations for both.

In: a point, that is a law, the motion d of what is prescribed, and the equilibrium u_h there. Out: for observations y of the measured test

.. math:: \rho = y - y_h(\theta, d) - (K v)_h \cdot (d_{measured} - d) \approx G\, \delta c + W \cdot \eta - (K v)_h \cdot \eta_h + \epsilon_F,

with the virtual fields v of `forward.sheet.adjoint`, a change of the law dP = sum_k delta c_k P_k, G = t int P_k : grad v dA, noise eta of the displacements,
eta_h that of what is prescribed. So d is eliminated exactly: its noise enters the covariance of rho, and its best estimate follows from rho.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment, Noise
from calibrate.data.measurement import first_of_cell
from calibrate.data.triangulation import signed_areas
from calibrate.equations import noise_covariance
from calibrate.equations.basis import SingleBasis
from calibrate.equations.noise_covariance import EquationNoise, common_between, own_between
from calibrate.equations.virtual_fields import default_spacing
from calibrate.equations.weights import Weights, weights_of
from forward.errors import ConvergenceError
from forward.sheet.adjoint import AdjointSheet, VirtualFields, force_operator, gradients
from forward.stepping import REST, State, proportional, steps
from studies.polish.varied_law import VariedLaw, stress_columns
from studies.replay.replayed_experiment import BoundaryValues

Array = NDArray[np.float64]
PARTS = 8  # of the range of each invariant, in which the law is imagined to change
BISECTIONS = 6  # of a step of the load


@dataclass(frozen=True, eq=False)
class Point:
    """A law, the motion (t, n, 2), mm, of the camera's points of which that of what is prescribed counts, and the equilibria (t, nodes, 2), mm, with the
    nodal forces (t, nodes, 2), N. objective: chi-square, by the weights of the linearisation that it was reached from."""

    law: VariedLaw
    motion: Array
    displacements: Array
    nodal_forces: Array
    objective: float = np.inf


@dataclass(frozen=True, eq=False)
class Equations:
    """Of a point: residual (t, r), G (t, r, k), and held (t, r, n, 2): (K v)_h at the camera's points; weights of the residual."""

    point: Point
    residual: Array
    G: Array
    held: Array
    weights: Weights = field(repr=False)

    def white(self, residual: Array) -> Array:
        """Rows (..., N) of unit variance of residuals (..., t, r)."""
        return self.weights(np.nan_to_num(residual))

    @cached_property
    def chi_square(self) -> float:
        """Squared residual of unit variance."""
        white = self.white(self.residual)
        return float(white @ white)

    @property
    def rows(self) -> tuple[Array, Array]:
        """(N, k) and (N,): the columns of G and the residual, of unit variance."""
        return self.white(np.moveaxis(self.G, -1, 0)).T, self.white(self.residual)


@dataclass(eq=False)
class ReplayedTest:
    """A test whose replays are linearised. observed: weights (t, w, n, 2) of the displacements of the camera's points that are not prescribed, in each observation;
    chosen at the first law that is linearised: what the fields answer to a change of the law in a part of its range, and to a motion of a grip."""

    experiment: Experiment
    observed: Array | None = None

    @cached_property
    def boundary(self) -> BoundaryValues:
        """Mesh and what is prescribed."""
        return BoundaryValues.of(self.experiment)

    @cached_property
    def noise(self) -> Noise:
        """As stated, or a stand-in."""
        stated = self.experiment.noise
        return stated if self.noise_is_known and stated else noise_covariance.default_noise(
            self.experiment, default_spacing(self.experiment)
        )  # fmt: skip

    @property
    def noise_is_known(self) -> bool:
        """Whether the noise of the displacements is stated."""
        noise = self.experiment.noise
        return noise is not None and noise.displacement_std > 0

    @cached_property
    def _noise_factor(self) -> sp.csr_array:
        return noise_covariance.noise_factor(self.experiment, self.noise)

    @cached_property
    def _between(self) -> Array:
        return noise_covariance.between_increments(self.experiment, self.noise)

    @cached_property
    def _forces_of_stress(self) -> sp.csr_array:
        return force_operator(self.boundary.mesh) * (self.experiment.thickness or 1.0)

    @cached_property
    def measured_forces(self) -> Array:
        """(t, sides * 2), N; NaN where not measured, along an edge that slides, where the section carries an unknown part, and where the cell of another
        side has read it already."""
        held = np.array([b.held for b in self.experiment.loaded])
        forces = np.stack([b.force for b in self.experiment.loaded], axis=1)
        known = held & (not self.experiment.level_is_nominal)
        forces = np.where(known, forces, np.nan)
        return np.stack([first_of_cell(forces[..., i]) for i in (0, 1)], axis=2).reshape(len(forces), -1)

    @cached_property
    def _sides(self) -> Array:
        """(sides * 2, nodes, 2): 1 at the held nodes of a side, in one component."""
        mesh, held = self.boundary.mesh, self.boundary.held
        found = np.zeros((len(self.experiment.loaded), 2, *mesh.points.shape))
        for i, boundary in enumerate(self.experiment.loaded):
            nodes = mesh.boundary_nodes(boundary.name)
            for axis in np.flatnonzero(boundary.held):
                found[i, axis, nodes, axis] = held[nodes, axis]
        return found.reshape(-1, *mesh.points.shape)

    def forces(self, point: Point) -> Array:
        """Of the grips on the specimen (t, sides * 2), N."""
        return np.einsum("sni,tni->ts", self._sides, point.nodal_forces)

    def start(self, law: VariedLaw) -> Point:
        """The replay from rest with the motion as measured. Raises `ConvergenceError`, `LoadingError`, `MaterialError`."""
        motion = self.experiment.displacements
        sheet, rest = self._sheet(law, motion), np.zeros_like(self.boundary.mesh.points)
        found = [
            (step.state.unknowns[0], step.forces)
            for step in steps(sheet, proportional(len(motion)), [State(REST, (rest,))], BISECTIONS)
        ]
        displacements, forces = zip(*found, strict=True)
        return Point(law, motion, np.array(displacements), np.array(forces))

    def moved(self, near: Equations, law: VariedLaw) -> Point:
        """The replay with another law and the motion of the grips that then is best. Its objective is infinite where there is no equilibrium."""
        change = near.G @ (law.coefficients - near.point.law.coefficients)
        motion = self.experiment.displacements - self._noise_of_displacements(near, near.residual - change)
        sheet, count = self._sheet(law, motion), len(motion)
        found = []
        try:
            for k, start in enumerate(near.point.displacements):
                found.append((sheet.equilibrium((k + 1) / count, start), sheet.nodal_forces()))
        except ConvergenceError:
            return Point(law, motion, near.point.displacements, near.point.nodal_forces)
        displacements, forces = zip(*found, strict=True)
        point = Point(law, motion, np.array(displacements), np.array(forces))
        return replace(point, objective=self.about(point, near).chi_square)

    def about(self, point: Point, near: Equations) -> Equations:
        """The equations about a point, with the sensitivities and weights of one nearby."""
        return replace(near, point=point, residual=self._residual(point, near.held))

    def linearised(self, point: Point) -> Equations:
        """The equations about a point."""
        sheet = self._sheet(point.law, point.motion)
        chosen, G, held = [], [], []
        for k, u in enumerate(point.displacements):
            sheet.unknowns = (u,)
            F = gradients(self.boundary.mesh, u)
            weights = self._observation(sheet, F, point.law) if self.observed is None else self.observed[k]
            fields = self._virtual_fields(sheet, weights)
            chosen.append(weights)
            columns = self._forces_of_stress @ point.law.columns(F)
            G.append(fields.values.reshape(len(fields.values), -1) @ columns)
            held.append(applied(sp.csr_array(self.boundary.carried.T), fields.held))
        self.observed = np.array(chosen)
        residual = self._residual(point, np.array(held))
        weights = self.weights(np.array(held), np.isfinite(residual))
        found = Equations(point, residual, np.array(G), np.array(held), weights)
        return replace(found, point=replace(point, objective=found.chi_square))

    def _sheet(self, law: VariedLaw, motion: Array) -> AdjointSheet:
        held, values = self.boundary.motion(motion).prescribed(self.boundary.mesh)
        return AdjointSheet(self.boundary.mesh, law.material, self.experiment.thickness or 1.0, held, values)

    def _observation(self, sheet: AdjointSheet, F: Array, law: VariedLaw) -> Array:
        """Weights (w, n, 2) of the displacements in each observation: responses at the free points, times their areas."""
        mesh, n = self.boundary.mesh, len(self.experiment.points)
        parts = [SingleBasis(k, law.input_tops[k], PARTS) for k in law.inputs]
        change = sp.hstack([stress_columns(basis, F) for basis in parts])
        loads = (self._forces_of_stress @ change).toarray().T.reshape(-1, *mesh.points.shape)
        loads[:, self.boundary.held] = 0.0
        none = np.zeros_like(loads)
        responses = sheet.virtual_fields(
            np.concatenate([loads, np.zeros_like(self._sides)]), np.concatenate([none, self._sides])
        ).values[:, :n]
        responses[:, self.boundary.held[:n]] = 0.0
        weights = responses * self._areas[:, None]
        size = np.linalg.norm(weights, axis=(1, 2), keepdims=True)
        return weights / np.where(size > 0, size, 1.0)

    @cached_property
    def _areas(self) -> Array:
        """(n,), mm^2: a third of the triangles at each point."""
        points, triangles = self.experiment.points, self.experiment.triangles
        return np.bincount(triangles.ravel(), np.repeat(signed_areas(points, triangles) / 3, 3), len(points))

    def _virtual_fields(self, sheet: AdjointSheet, weights: Array) -> VirtualFields:
        """Of the observations of displacements, then of the forces."""
        nodes = len(self.boundary.mesh.points)
        everywhere = np.zeros((len(weights) + len(self._sides), nodes, 2))
        everywhere[: len(weights), : weights.shape[1]] = weights
        on_held = np.concatenate([np.zeros((len(weights), nodes, 2)), self._sides])
        return sheet.virtual_fields(everywhere, on_held)

    def _residual(self, point: Point, held: Array) -> Array:
        """rho (t, r), NaN where nothing is measured."""
        assert self.observed is not None
        n, measured = len(self.experiment.points), self.experiment.displacements
        fields = np.einsum("twni,tni->tw", self.observed, measured - point.displacements[:, :n])
        found = np.concatenate([fields, self.measured_forces - self.forces(point)], axis=1)
        silent = np.concatenate([~self.observed.any(axis=(2, 3)), ~np.isfinite(self.measured_forces)], axis=1)
        found -= np.einsum("trni,tni->tr", held, measured - point.motion)
        return np.where(silent, np.nan, found)

    def _spread(self, weights: Array, held: Array) -> Array:
        """(r, s): what independent normal numbers do to rho of one increment."""
        noise = -held
        noise[: len(weights)] += weights
        return np.concatenate([(self._noise_factor.T @ noise[:, :, i].T).T for i in (0, 1)], axis=1)

    def weights(self, held: Array, known: NDArray[np.bool_]) -> Weights:
        """Of the residuals of which these are known (t, r), with (K v)_h at the camera's points (t, r, n, 2): zero as if what is prescribed were exact."""
        assert self.observed is not None
        spreads = np.array([self._spread(*each) for each in zip(self.observed, held, strict=True)])
        size = np.abs(np.nan_to_num(self.measured_forces))
        deviations = np.zeros(known.shape)
        deviations[:, -size.shape[1] :] = self.noise.force_deviation(size)
        own, common = (part(self.experiment, self.noise) for part in (own_between, common_between))
        every = np.ones(len(own), bool)
        noise = EquationNoise(spreads, np.eye(len(own)), own, common, np.eye(known.shape[1]), deviations, every)
        return weights_of(noise, known)

    def _noise_of_displacements(self, near: Equations, residual: Array) -> Array:
        """Best estimate (t, n, 2), mm, of the noise of the displacements, given rho (t, r)."""
        assert self.observed is not None
        pull = near.weights.adjoint(near.white(residual))  # V^-1 rho
        sources = -np.einsum("tr,trni->tni", pull, near.held)
        sources += np.einsum("tw,twni->tni", pull[:, : self.observed.shape[1]], self.observed)
        shared = np.einsum("ij,jnk->ink", self._between, sources)
        B = self._noise_factor
        return applied(B, applied(sp.csr_array(B.T), shared))


def applied(operator: sp.csr_array, fields: Array) -> Array:
    """Operator (k, n) on fields (..., n, 2): (..., k, 2)."""
    flat = np.moveaxis(fields, -2, 0)
    found = operator @ flat.reshape(len(flat), -1)
    return np.moveaxis(found.reshape(-1, *flat.shape[1:]), 0, -2)
