"""Noise of the displacements as the equations of equilibrium see it, beside what is stated.

In: an Experiment. Out: `NoiseCheck`, with the noise that a diagnosis works with.

Virtual fields about as fine as the points (`FINE` of their distance) feel the noise of neighbouring points most and an error of the
material least: stresses that a model misses are smooth, so that their work on such fields falls with the square of the distance, and
that of the noise rises. What a hyperelastic fit leaves there, y, divided by the standard deviation that unit noise would make of it,
has the standard deviation of the noise as its own; it is taken from the median of |y| (Rousseeuw and Croux 1993), which places with a
large error of the model do not change. Of each y the fit takes hardly a degree of freedom, so that this is also the restricted maximum
likelihood.

Where no noise is stated, its correlation length is the one at which finer and coarser fields agree best on the standard deviation, and what
increments have in common of it, and how it drifts, is found from the same fields (`common_noise`). An error of the material grows with the deformation as
noise of the pattern does, so that the fit is then one of both invariants. A drift is seen between neighbours, so that each increment that is looked at
brings the ones before it along.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from calibrate.data.experiment import Experiment, Noise
from calibrate.equations import discretisation_error, noise_covariance
from calibrate.equations.basis import Basis, basis_for
from calibrate.equations.equilibrium import Equilibrium, equilibrium, tangent_modulus
from calibrate.equations.reduction import assemble
from calibrate.equations.virtual_fields import virtual_fields
from calibrate.fitting.common_noise import NORMAL, CommonRatios, common_ratios
from calibrate.fitting.network_fit import convex_spline

Array = NDArray[np.float64]
FINE, COARSER = 1.4, (2.0, 2.8, 4.0)  # distances of virtual fields over that of the points
LENGTHS = (0.0, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0)  # correlation lengths that are tried, over the distance of the points
AGREES = 1.1  # factor by which a stated standard deviation may differ from what the equations see
INPUTS = "I1I2"
PASSES = 2  # of the weights of the fit
MATERIAL_INCREMENTS = 12  # of the fit, at most
MOST_INCREMENTS, FEW_INCREMENTS = 4, 2  # looked at; for the correlation length
NEIGHBOURS = 2  # before each increment, looked at for what increments have in common
FEWEST = 200  # values of y
MOST_ROWS, AT_ONCE = 800, 50  # looked at for what increments have in common, and so many at a time
FORCE_STD = 1e-3, 5e-4  # of a load cell whose noise is not stated: of the force, of the largest one


@dataclass(frozen=True)
class NoiseCheck:
    """stated: what the Experiment says, None where it says nothing. found: standard deviation of all parts (`Noise.total_std`), mm, that the
    equations see; NaN where too few points are there to tell. used: what a diagnosis works with, None where nothing is known."""

    stated: Noise | None
    found: float
    used: Noise | None

    @property
    def factor(self) -> float:
        """Standard deviation found over the stated one; NaN without either."""
        return self.found / self.stated.total_std if self.stated else float("nan")

    @property
    def common_found(self) -> bool:
        """Whether increments have noise in common, or one that drifts, that is not stated."""
        return bool(self.used and self.used.is_correlated and not (self.stated and self.stated.is_correlated))

    @property
    def corrected(self) -> bool:
        """Whether what is stated is not what is used."""
        return self.used != self.stated


def with_checked_noise(experiment: Experiment) -> tuple[Experiment, NoiseCheck]:
    """The Experiment with the noise that its equations see, where that is not what is stated."""
    check = check_noise(experiment)
    return (replace(experiment, noise=check.used) if check.corrected else experiment), check


def check_noise(experiment: Experiment) -> NoiseCheck:
    """Raises the errors of `calibrate.equations.equilibrium.equilibrium`. In plane strain the stated noise is used unseen."""
    stated = experiment.noise if experiment.noise and experiment.noise.displacement_std > 0 else None
    unseen = NoiseCheck(stated, float("nan"), stated)
    if experiment.plane == "strain":
        return unseen
    basis, c = _material(experiment)
    fine = _Fine.of(experiment, FINE, basis, c)
    if fine is None:
        return unseen
    if stated is None:
        return _of_unstated(experiment, fine, basis, c)
    return _of_stated(
        stated,
        fine,
        CommonRatios() if stated.is_correlated else _ratios(experiment, fine, stated.correlation_length, basis, c),
    )


def _of_stated(stated: Noise, fine: _Fine, ratios: CommonRatios) -> NoiseCheck:
    """With what increments have in common, where none of it is stated but some is there."""
    length = stated.correlation_length
    if any(ratios):
        used = _with_common(replace(stated, displacement_std=fine.std(length, ratios.variances(fine.shares))), ratios)
        used = with_least_own(used, fine.system.experiment.temporal_std)
        return NoiseCheck(stated, used.total_std, used)
    factor = fine.std(length, stated.variances(fine.shares)) / stated.displacement_std
    used = stated if 1 / AGREES <= factor <= AGREES else stated.scaled(factor)
    return NoiseCheck(stated, factor * stated.total_std, used)


def with_least_own(noise: Noise, least: float) -> Noise:
    """The same variance in all, of which no less than least^2, mm^2, is not common to the increments: a few pictures of one ramp may show hardly any of it, and what
    changes from picture to picture is known from all of them."""
    total, common = noise.total_std, float(np.hypot(noise.pattern_std, noise.reference_std))
    if not noise.displacement_std < least < total:
        return noise
    share = float(np.sqrt(total**2 - least**2)) / common
    return replace(
        noise, displacement_std=least, pattern_std=share * noise.pattern_std, reference_std=share * noise.reference_std
    )


def _ratios(experiment: Experiment, fine: _Fine, length: float, basis: Basis, c: Array) -> CommonRatios:
    """What increments have in common of noise with a correlation length, mm, and its drift: of runs of neighbours where it drifts, else of increments far
    apart, between which an error of the material changes most."""
    runs = _Fine.of(experiment, FINE, basis, c, MOST_INCREMENTS, NEIGHBOURS)
    found = runs.common_ratios(length, runs.clock) if runs else CommonRatios()
    return found if found.time else fine.common_ratios(length)


def _with_common(noise: Noise, ratios: CommonRatios) -> Noise:
    """With variances over that of what increments have of their own."""
    pattern, reference = (float(noise.displacement_std * ratio**0.5) for ratio in (ratios.pattern, ratios.reference))
    return replace(noise, pattern_std=pattern, reference_std=reference, correlation_time=ratios.time)


def _of_unstated(experiment: Experiment, fine: _Fine, basis: Basis, c: Array) -> NoiseCheck:
    """With the correlation length, and a load cell of usual accuracy."""
    ratios = _ratios(experiment, fine, length := _length(experiment, basis, c), basis, c)
    std = fine.std(length, ratios.variances(fine.shares))
    if not std > 0:
        return NoiseCheck(None, std, None)
    largest = max(float(np.nanmax(np.abs(b.force), initial=0.0)) for b in experiment.loaded)
    used = _with_common(Noise(std, length, FORCE_STD[0], FORCE_STD[1] * largest), ratios)
    return NoiseCheck(None, used.total_std, used)


def _material(experiment: Experiment) -> tuple[Basis, Array]:
    """A convex spline of both invariants and its coefficients, as a calibration begins."""
    system = equilibrium(experiment.select(_evenly(experiment, MATERIAL_INCREMENTS)))
    basis = basis_for(INPUTS, system.deformation_gradients.reshape(-1, 2, 2), plane=experiment.plane)
    assembled = assemble(system, basis)
    c = assembled.first_guess()
    for _ in range(PASSES):
        c = convex_spline(assembled.quadratic(c), INPUTS)
    return basis, c


@dataclass(frozen=True, eq=False)
class _Fine:
    """Equations of fine virtual fields away from loaded edges, of some increments: residuals r (k, rows), N, at coefficients c. shares (k,): of the
    deformation, see `Experiment.deformation_shares`; rows (r,): those used, see the head of this module."""

    system: Equilibrium
    basis: Basis
    c: Array
    shares: Array
    clock: Array
    rows: NDArray[np.int64]
    residuals: Array

    @classmethod
    def of(
        cls,
        experiment: Experiment,
        distance: float,
        basis: Basis,
        c: Array,
        most: int = MOST_INCREMENTS,
        before: int = 0,
    ) -> _Fine | None:
        """distance: of the fields over that of the points; before: neighbours of each increment. None where too few fields are inside."""
        some = np.unique(np.maximum(np.subtract.outer(_evenly(experiment, most), np.arange(before + 1)), 0))
        few = experiment.select(some)
        system = Equilibrium(few, virtual_fields(few, distance * _pitch(experiment)))
        rows = _quiet(system, basis, c, len(some) - 1)
        if len(rows) * len(some) < FEWEST:
            return None
        residuals = np.array([system.matrix(basis, F)[rows] @ c for F in system.deformation_gradients])
        shares, clock = experiment.deformation_shares[some], experiment.clock[some]
        return cls(system, basis, c, shares, clock, rows, residuals)

    def std(self, length: float, variances: Array | float = 1.0) -> float:
        """Standard deviation, mm, of noise with a correlation length, mm; of increments with variances (k,) that of a variance of 1."""
        factor = self._factor(length)
        sizes = np.sqrt([sum((K @ factor).power(2).sum(axis=1) for K in both) for both in self.tangents])
        y = self.residuals / sizes / np.sqrt(np.reshape(variances, (-1, 1)))
        return float(np.median(np.abs(y))) / NORMAL

    def common_ratios(self, length: float, clock: Array | None = None) -> CommonRatios:
        """What increments have in common of noise with a correlation length, mm; and its drift, where they are given times (k,)."""
        n = self.residuals.shape[1]
        rows = np.unique(np.linspace(0, n - 1, min(n, MOST_ROWS)).round().astype(int))
        factor, between, sizes, last = self._factor(length), [], [], []
        for some in np.array_split(rows, int(np.ceil(len(rows) / AT_ONCE))):
            spreads = np.array([np.hstack([(K[some] @ factor).toarray() for K in both]) for both in self.tangents])
            sizes.append(np.linalg.norm(spreads, axis=2))
            unit = np.moveaxis(spreads / sizes[-1][:, :, None], 0, 1)
            between.append(unit @ unit.transpose(0, 2, 1))
            last.append(unit[:, -1].copy())
        alike = np.concatenate(last)
        repeated = float(((alike @ alike.T) ** 2).sum() / len(rows))
        residuals = (self.residuals[:, rows] / np.concatenate(sizes, axis=1)).T
        return common_ratios(residuals, np.concatenate(between), self.shares, clock, repeated)

    @cached_property
    def tangents(self) -> list[list[sp.csr_array]]:
        """d residual / d displacement (rows, n), N / mm, of each increment, along x and along y."""
        tensors = (tangent_modulus(self.basis, F, self.c) for F in self.system.deformation_gradients)
        blocks = map(self.system.stiffness, tensors)
        return [[sp.csr_array(sp.vstack([row[k] for row in both]))[self.rows] for k in range(2)] for both in blocks]

    def _factor(self, length: float) -> sp.csr_array:
        """Of noise of 1 mm with a correlation length, mm."""
        return noise_covariance.noise_factor(self.system.experiment.points, Noise(1.0, length))


def _quiet(system: Equilibrium, basis: Basis, c: Array, increment: int) -> NDArray[np.int64]:
    """Half of the rows away from loaded edges, (r,): those of the smallest error of the kinematics over noise of points each for itself."""
    inside = np.flatnonzero(np.tile(system.fields.boundary < 0, 2))
    wrong = discretisation_error.correction_variances(system, basis, c, increment)[inside]
    tangent = system.tangent(basis, system.deformation_gradients[increment], c)
    noise = np.concatenate([sum(sp.csr_array(block).power(2).sum(axis=1) for block in row) for row in tangent])[inside]
    return np.sort(inside[np.argsort(wrong / noise)[: len(inside) // 2]])


def _evenly(experiment: Experiment, most: int) -> NDArray[np.int64]:
    """Increments at even distances, the first and the last among them."""
    n = experiment.n_increments
    return np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(np.int64))


def _pitch(experiment: Experiment) -> float:
    """Median distance of a point from the nearest, mm."""
    return float(np.median(cKDTree(experiment.points).query(experiment.points, k=2)[0][:, 1]))


def _length(experiment: Experiment, basis: Basis, c: Array) -> float:
    """Correlation length, mm, at which fields of all distances agree best on the standard deviation."""
    every = [_Fine.of(experiment, distance, basis, c, FEW_INCREMENTS) for distance in (FINE, *COARSER)]
    used, lengths = [one for one in every if one is not None], _pitch(experiment) * np.array(LENGTHS)
    if len(used) < 2:
        return 0.0
    spread = [float(np.var(np.log([one.std(length) for one in used]))) for length in lengths]
    i = int(np.argmin(spread))
    if i in (0, len(lengths) - 1):
        return float(lengths[i])
    left, middle, right = spread[i - 1 : i + 2]  # vertex of the parabola through three, over their numbers
    place = i + 0.5 * (left - right) / (left - 2 * middle + right)
    return float(np.interp(place, np.arange(len(lengths)), lengths))
