"""Equations of virtual fields about as fine as the points, which tell the noise of the displacements.

In: an Experiment, a material, the distance of the fields. Out: `FineFields`, with residuals and what noise does to them.

Such fields feel the noise of neighbouring points most and an error of the material least: stresses that a model misses are smooth, so that their work
on such fields falls with the square of the distance, and that of the noise rises. What a hyperelastic fit leaves there, y, divided by the standard
deviation that unit noise would make of it, has the standard deviation of the noise as its own; it is taken from the median of |y| (Rousseeuw and
Croux 1993), which places with a large error of the model do not change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment, Noise
from calibrate.equations import discretisation_error, noise_covariance
from calibrate.equations.basis import Basis, nominal_stress
from calibrate.equations.equilibrium import Equilibrium
from calibrate.equations.virtual_fields import VirtualFields, virtual_fields
from calibrate.errors import ConfigError
from calibrate.fitting.noise.common_noise import CommonRatios, common_ratios
from calibrate.robust_deviation import robust_std
from meshes.mesh import spacing_of

Array = NDArray[np.float64]
FINE = 1.4  # distance of virtual fields over that of the points
MOST_INCREMENTS = 4  # looked at
FEWEST = 200  # values of y
MOST_ROWS, AT_ONCE = 800, 50  # looked at for what increments have in common, and so many at a time
MOST_FIELDS = 1000  # of which the rows are


@dataclass(frozen=True, eq=False)
class FineFields:
    """Equations of fine virtual fields away from loaded edges, of some increments: residuals r (k, rows), N, at coefficients c. shares (k,): of the
    deformation, see `Experiment.deformation_shares`; increments (k,): which; rows (r,): half of the fields, those of the least discretisation error."""

    system: Equilibrium
    basis: Basis
    c: Array
    shares: Array
    clock: Array
    increments: NDArray[np.int64]
    rows: NDArray[np.int64]
    residuals: Array
    _tangents: dict[int, list[sp.csr_array]] = field(default_factory=dict, repr=False)

    @classmethod
    def of(
        cls,
        experiment: Experiment,
        distance: float,
        basis: Basis,
        c: Array,
        most: int = MOST_INCREMENTS,
        before: int = 0,
        most_rows: int | None = None,
    ) -> FineFields | None:
        """distance: of the fields over that of the points; before: neighbours of each increment; most_rows: evenly spread. None where too few fields are
        inside, or have points."""
        some = np.unique(np.maximum(np.subtract.outer(evenly(experiment, most), np.arange(before + 1)), 0))
        few = experiment.select(some)
        try:
            fields = virtual_fields(few, distance * pitch(experiment))
        except ConfigError:  # points so unevenly spread that most of such fields have none
            return None
        system = Equilibrium(few, _some(fields))
        rows = _quiet(system, basis, c, len(some) - 1)
        if len(rows) * len(some) < FEWEST:
            return None
        rows = rows if most_rows is None else _spread_out(rows, most_rows)
        stresses = (nominal_stress(basis, F, c) for F in system.deformation_gradients)
        residuals = np.array([system.internal_forces(P)[rows] for P in stresses])
        shares, clock = experiment.deformation_shares[some], experiment.clock[some]
        return cls(system, basis, c, shares, clock, some, rows, residuals)

    def variances(self, unit: Noise) -> Array:
        """Of the residuals (k, r), N^2, by noise of 1 mm that is new in each increment."""
        return self.variances_of(self._factor(unit), range(len(self.shares)))

    def variances_of(self, factor: sp.csr_array, some: Sequence[int]) -> Array:
        """The same of noise with a factor (n, s), of these increments alone."""
        return np.array([sum((K @ factor).power(2).sum(axis=1) for K in self.tangent(i)) for i in some])

    def std(self, unit: Noise, variances: Array | float = 1.0) -> float:
        """Standard deviation, mm, of noise correlated as `unit`; of increments with variances (k,) that of a variance of 1."""
        return robust_std(self.residuals / np.sqrt(self.variances(unit)) / np.sqrt(np.reshape(variances, (-1, 1))))

    def common_ratios(self, unit: Noise, clock: Array | None = None) -> CommonRatios:
        """What increments have in common of noise of 1 mm; and its drift, where they are given times (k,)."""
        rows = _spread_out(np.arange(self.residuals.shape[1]), MOST_ROWS)
        factor, between, sizes, last = self._factor(unit), [], [], []
        for some in np.array_split(rows, int(np.ceil(len(rows) / AT_ONCE))):
            each = (self.tangent(i) for i in range(len(self.shares)))
            spreads = np.array([np.hstack([(K[some] @ factor).toarray() for K in both]) for both in each])
            sizes.append(np.linalg.norm(spreads, axis=2))
            normed = np.moveaxis(spreads / sizes[-1][:, :, None], 0, 1)
            between.append(normed @ normed.transpose(0, 2, 1))
            last.append(normed[:, -1].copy())
        alike = np.concatenate(last)
        repeated = float(((alike @ alike.T) ** 2).sum() / len(rows))
        residuals = (self.residuals[:, rows] / np.concatenate(sizes, axis=1)).T
        return common_ratios(residuals, np.concatenate(between), self.shares, clock, repeated)

    def tangent(self, i: int) -> list[sp.csr_array]:
        """d residual / d displacement (rows, n), N / mm, of an increment, along x and along y."""
        if i not in self._tangents:
            both = self.system.tangent(self.basis, self.system.deformation_gradients[i], self.c)
            self._tangents[i] = [sp.csr_array(sp.vstack([row[k] for row in both]))[self.rows] for k in range(2)]
        return self._tangents[i]

    def _factor(self, unit: Noise) -> sp.csr_array:
        return noise_covariance.noise_factor(self.system.experiment, unit)


def _some(fields: VirtualFields) -> VirtualFields:
    """`MOST_FIELDS` of them, evenly spread, where there are more."""
    kept = _spread_out(np.arange(fields.n_fields), MOST_FIELDS)
    admissible = None if fields.admissible is None else fields.admissible[:, kept]
    return replace(fields, values=fields.values[:, kept], boundary=fields.boundary[kept], admissible=admissible)


def _spread_out(rows: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    return rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), most)).round().astype(int))]


def _quiet(system: Equilibrium, basis: Basis, c: Array, increment: int) -> NDArray[np.int64]:
    """Half of the rows away from loaded edges, (r,): those of the smallest error of the kinematics over noise of points each for itself."""
    inside = np.flatnonzero(np.tile(system.fields.boundary < 0, 2))
    wrong = discretisation_error.correction_variances(system, basis, c, increment)[inside]
    tangent = system.tangent(basis, system.deformation_gradients[increment], c)
    noise = np.concatenate([sum(sp.csr_array(block).power(2).sum(axis=1) for block in row) for row in tangent])[inside]
    return np.sort(inside[np.argsort(wrong / noise)[: len(inside) // 2]])


def evenly(experiment: Experiment, most: int) -> NDArray[np.int64]:
    """Increments at even distances, the first and the last among them."""
    n = experiment.n_increments
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(np.int64))


def pitch(experiment: Experiment) -> float:
    """Median distance of a point from the nearest, mm."""
    return spacing_of(experiment.points)
