"""Simulated tests that hide nothing, in noise that is not what the diagnosis assumes.

In: a `Condition` and a seed. Out: an Experiment. The fields of noise share no code with `calibrate.equations.noise_covariance`: they are drawn with
a dense covariance. By the seed, the covariance is in turn Gaussian, as the diagnosis assumes, exponential (rough, as that of small subsets), and the
sum of a short and a long Gaussian. Noise that is correlated between increments is in turn one that all have in common (half with the pattern, growing
with the displacements, half with the reference) and one that drifts from each to the next (autoregressive).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from calibrate.data.experiment import Experiment, Noise
from forward.loading import Loading
from forward.materials import ArrudaBoyce
from forward.sheet.plane_stress import solve
from meshes import Cross, quads, triangles
from studies.synthetic.camera import Camera, observe, stream
from studies.trials.blind_data import draw
from studies.trials.blind_data import record as with_forces
from studies.trials.blind_solution import clean_experiment

Array = NDArray[np.float64]
FIELDS = 7  # random stream, beside those of the trials
SHORT, LONG, SHARE = 0.7, 1.6, 0.6  # correlation lengths over the stated one; share of the variance of the short
NUGGET = 1e-8  # of the variance, for the Cholesky factor
CROSS_NODES, CROSS_INCREMENTS, CROSS_LENGTH = 900, 4, 4.0
CROSS_ELEMENTS = 0.5  # elements of 2.5 times the usual size are wrong by 4 to 9 um (rms), more than the noise of 4 um; usual ones by 2
PULL = 60.0  # of each grip of the cross, mm: a stretch of 2 in the arms


class Kernel(StrEnum):
    """Covariance of noise between points."""

    GAUSSIAN = "Gaussian"
    EXPONENTIAL = "exponential"
    TWO_LENGTHS = "two lengths"

    def covariance(self, points: Array, length: float) -> Array:
        """(n, n) of points (n, 2), mm, of unit variance."""
        r = cdist(points, points) / length
        if self is Kernel.EXPONENTIAL:
            return np.asarray(np.exp(-r))
        if self is Kernel.GAUSSIAN:
            return np.asarray(np.exp(-(r**2) / 2))
        return np.asarray(SHARE * np.exp(-((r / SHORT) ** 2) / 2) + (1 - SHARE) * np.exp(-((r / LONG) ** 2) / 2))


class Course(StrEnum):
    """What noise does from increment to increment where it is correlated."""

    COMMON = "in common"
    DRIFT = "drift"


class Told(StrEnum):
    """What the Experiment says of its noise: standard deviation alone, as of increments that are independent, or what they have in common, too."""

    NOTHING = "nothing"
    STD = "standard deviation"
    ALL = "with what is in common"


@dataclass(frozen=True)
class Condition:
    """factor: stated standard deviation over the true one. correlation: between increments, see `Course`. std: of the displacements on the coarse
    cross, mm; None: a specimen, loading and noise of the blind trials (1350 to 1460 nodes)."""

    name: str
    told: Told = Told.STD
    factor: float = 1.0
    correlation: float = 0.0
    std: float | None = None

    def kernel(self, seed: int) -> Kernel:
        """Of this test."""
        return list(Kernel)[seed % len(Kernel)]

    def course(self, seed: int) -> Course:
        """Of this test; what is told can only be noise in common."""
        drifts = self.told is not Told.ALL and seed // len(Kernel) % 2 == 1
        return Course.DRIFT if drifts else Course.COMMON


CONDITIONS = (
    Condition("stated x 0.5", factor=0.5),
    Condition("stated x 1"),
    Condition("stated x 2", factor=2.0),
    Condition("not stated", Told.NOTHING),
    Condition("correlation 0.5", correlation=0.5),
    Condition("correlation 0.95", correlation=0.95),
    Condition("correlation 0.5, stated", Told.ALL, correlation=0.5),
    Condition("correlation 0.95, stated", Told.ALL, correlation=0.95),
    Condition("correlation 0.5, not stated", Told.NOTHING, correlation=0.5),
    Condition("correlation 0.95, not stated", Told.NOTHING, correlation=0.95),
    Condition("942 nodes, stretch 2", std=0.1),
    Condition("942 nodes, 4 um", std=0.004),
)


def experiment(condition: Condition, seed: int) -> Experiment:
    """The test. Raises the errors of the forward models."""
    clean, exact, noise = _cross(condition, seed) if condition.std else _trial(seed)
    rng = stream(seed, FIELDS)
    root = np.linalg.cholesky(_with_nugget(condition.kernel(seed).covariance(clean.points, noise.correlation_length)))
    new = np.moveaxis(np.tensordot(root, rng.standard_normal((len(root), clean.n_increments + 2, 2)), 1), 0, 1)
    unit = _over_increments(new, clean, condition.correlation, condition.course(seed))
    displacements = clean.displacements + noise.displacement_std * unit
    return replace(exact, displacements=displacements, noise=_stated(condition, noise))


def _with_nugget(covariance: Array) -> Array:
    return covariance + NUGGET * np.eye(len(covariance))


def _over_increments(new: Array, clean: Experiment, correlation: float, course: Course) -> Array:
    """Noise (t, n, 2) of independent fields (t + 2, n, 2), of unit variance at the last increment."""
    if course is Course.DRIFT:
        fields = [new[0]]
        for field in new[1:-2]:
            fields.append(correlation * fields[-1] + np.sqrt(1 - correlation**2) * field)
        return np.array(fields)
    growth = np.linalg.norm(clean.displacements, axis=(1, 2))
    pattern = (growth / growth.max())[:, None, None] * new[-1]
    return np.asarray(np.sqrt(1 - correlation) * new[:-2] + np.sqrt(correlation / 2) * (pattern + new[-2]))


def _stated(condition: Condition, noise: Noise) -> Noise | None:
    """What the Experiment says."""
    if condition.told is Told.NOTHING:
        return None
    if condition.told is Told.STD:
        return noise.scaled(condition.factor)
    own, common = np.sqrt(1 - condition.correlation), np.sqrt(condition.correlation / 2)
    parts = {name: float(noise.displacement_std * common) for name in ("pattern_std", "reference_std")}
    return replace(noise, displacement_std=float(noise.displacement_std * own), **parts)


def _trial(seed: int) -> tuple[Experiment, Experiment, Noise]:
    """A blind trial without an effect: without noise, with that of its forces, and the noise."""
    trial = draw(seed, None)
    clean = clean_experiment(trial)
    exact = with_forces(trial, clean)
    assert exact.noise is not None
    return clean, exact, exact.noise


def _cross(condition: Condition, seed: int) -> tuple[Experiment, Experiment, Noise]:
    """The same of the coarse cross of `equigap simulate --quick`."""
    assert condition.std is not None
    clean, camera = _clean_cross(), Camera()
    factors = camera.force_factors([b.name for b in clean.loaded], clean.n_increments, seed)
    loaded = tuple(replace(b, force=b.force * factors[b.name][:, None]) for b in clean.loaded)
    noise = replace(camera.noise(condition.std), correlation_length=CROSS_LENGTH)
    return clean, replace(clean, loaded=loaded), noise


@cache
def _clean_cross() -> Experiment:
    law = ArrudaBoyce()
    mesh = quads(Cross(), quarter=True, size_factor=CROSS_ELEMENTS)
    solution = solve(mesh, law, Loading.clamped(Cross().loaded, PULL), CROSS_INCREMENTS, 1.0).mirrored()
    return observe(solution, triangles(Cross(), n_nodes=CROSS_NODES), name="coarse cross")
