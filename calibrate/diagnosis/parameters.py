"""Amplitudes and shapes of effects as one vector of numbers of order 1, with its bounds: the unknowns of a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from calibrate.effects import Effect, Parameter
from calibrate.effects.chain import Addition, Additions
from calibrate.effects.support.effect_data import Data
from calibrate.fitting.least_squares import CONDITION

Array = NDArray[np.float64]
LEVEL = 0.05  # of the test whether an effect differs from none
ROUNDING = 1e-9  # relative, of a value that a fit takes to its bound
ANGLE = 0.5  # rad, by which an angle is uncertain before a test


def is_null(addition: Addition, covariance: Array) -> bool:
    """Whether its amplitudes together differ from their null values by no more than 95 % of errors with this covariance (p, p) do (Wald 1943); one that lies at its null value says nothing."""
    change = np.array(addition.amplitudes) - [p.null for p in addition.effect.amplitudes]
    some = np.flatnonzero(change)
    if not len(some):
        return True
    variances, directions = np.linalg.eigh(covariance[np.ix_(some, some)])
    least = max(CONDITION * float(variances.max()), 1e-300)  # what is known exactly differs
    distance = ((directions.T @ change[some]) ** 2 / np.maximum(variances, least)).sum()
    return bool(distance < stats.chi2.isf(LEVEL, len(some)))


def limits(effect: Effect, tests: Sequence[Data]) -> tuple[Array, Array]:
    """Lower and upper amplitudes (p,) that are possible in every test; in any, if there are none."""
    of_all = [(p.lower, p.upper) for p in effect.amplitudes]
    lower, upper = zip(tuple(np.transpose(of_all)), *(effect.limits(data) for data in tests), strict=True)
    return np.max(lower, axis=0), np.min(upper, axis=0)


def at_bounds(addition: Addition, tests: Sequence[Data]) -> bool:
    """Whether an amplitude is at the end of what is possible, and not at its null value: it would go further, and is none that a specimen or a rig has."""
    ends = zip(addition.amplitudes, addition.effect.amplitudes, *limits(addition.effect, tests), strict=True)
    return any(
        a != p.null and not lower + ROUNDING * abs(a) < a < upper - ROUNDING * abs(a) for a, p, lower, upper in ends
    )


@dataclass(frozen=True)
class Variables:
    """Amplitudes and shapes of additions as one vector of numbers of order 1, and its bounds."""

    additions: Additions

    @property
    def parameters(self) -> list[tuple[Parameter, float]]:
        """Every amplitude and shape with its value: of each addition its amplitudes, then its shapes."""
        return [
            pair
            for a in self.additions
            for pair in (
                *zip(a.effect.amplitudes, a.amplitudes, strict=True),
                *zip(a.effect.shapes, a.shape, strict=True),
            )
        ]

    @property
    def sizes(self) -> list[int]:
        """How many amplitudes and shapes each addition has."""
        return [len(a.amplitudes) + len(a.shape) for a in self.additions]

    @property
    def slices(self) -> list[tuple[slice, slice]]:
        """Where in `parameters` the amplitudes of each addition are, and where its shapes."""
        found, start = [], 0
        for a in self.additions:
            middle, end = start + len(a.amplitudes), start + len(a.amplitudes) + len(a.shape)
            found.append((slice(start, middle), slice(middle, end)))
            start = end
        return found

    @property
    def is_shape(self) -> NDArray[np.bool_]:
        """Which of `parameters` are shapes (k,)."""
        return np.array([k for a in self.additions for k in [False] * len(a.amplitudes) + [True] * len(a.shape)], bool)

    @property
    def scale(self) -> Array:
        """(k,): of amplitudes a typical one, of shapes their size (times), a tenth of a radian (angles) or of the extent (places)."""
        sizes = []
        for (p, value), shape in zip(self.parameters, self.is_shape, strict=True):
            sizes.append((0.1 if p.unit == "rad" else p.shape_size(value)) if shape else p.typical)
        return np.array(sizes)

    @property
    def shape_deviations(self) -> Array:
        """Standard deviation (k,) of every shape before a test, in its unit: an angle is uncertain by half a radian, another shape by itself; infinite for amplitudes. Where
        a shape hardly shows, an amplitude would else be as uncertain as values of the shape that mean nothing make it."""
        sizes = [(ANGLE if p.unit == "rad" else 1.0) * p.shape_size(value) for p, value in self.parameters]
        return np.where(self.is_shape, sizes, np.inf)

    @property
    def values(self) -> Array:
        """Values (k,) of `parameters`, each in its unit."""
        return np.array([value for _, value in self.parameters])

    def bounds(self, tests: Sequence[Data]) -> tuple[Array, Array]:
        """Lower and upper (k,) in every test; shapes move by no more than half their size, or a fifth of a radian, at a time."""
        lower, upper = (np.array([getattr(p, end) for p, _ in self.parameters]) for end in ("lower", "upper"))
        if self.additions:
            ends = zip(*(limits(a.effect, tests) for a in self.additions), strict=True)
            lower[~self.is_shape], upper[~self.is_shape] = (np.concatenate(end) for end in ends)
        reach = np.where([p.unit == "rad" for p, _ in self.parameters], 2.0, 0.5) * self.scale
        lower = np.where(self.is_shape, np.maximum(lower, self.values - reach), lower)
        upper = np.where(self.is_shape, np.minimum(upper, self.values + reach), upper)
        return lower, np.maximum(upper, lower)

    def at(self, values: Array) -> Additions:
        """The additions with other values (k,)."""
        result = []
        ends = np.cumsum(self.sizes).astype(int)
        for a, part in zip(self.additions, np.split(values, ends)[:-1], strict=True):
            n = len(a.amplitudes)
            result.append(replace(a, amplitudes=tuple(map(float, part[:n])), shape=tuple(map(float, part[n:]))))
        return tuple(result)
