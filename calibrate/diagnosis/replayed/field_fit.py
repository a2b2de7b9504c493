"""Effects fitted to the smooth fields of replays by Gauss and Newton's method.

In: replays, computed elsewhere, and effects with their priors. Out: `FieldFit`, of one replay or at the minimum.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.evidence.priors import FAR
from calibrate.diagnosis.parameters import Variables
from calibrate.diagnosis.replayed.observations import ReplayErrors
from calibrate.diagnosis.replayed.parameter_spread import Directions
from calibrate.diagnosis.replayed.replayed_rows import ReplayedRows, Replays
from calibrate.effects.chain import Additions
from calibrate.fitting.least_squares import bounded

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Widths = Mapping[str, Array]  # {effect: prior standard deviations of its amplitudes (p,)}
REPLAYS, HALVINGS, ENOUGH = 8, 4, 1e-3  # at most; of a step; relative fall of the objective that ends a fit


@dataclass(frozen=True, eq=False)
class FieldFit:
    """Effects beside a base c (n,), MPa, and their replay. start: where their priors are centred: amplitudes at null, shapes as they were tried."""

    c: Array
    start: Additions
    additions: Additions
    replayed: ReplayedRows = field(repr=False)
    priors: Widths = field(repr=False)

    @cached_property
    def _used(self) -> Mask:
        """Displacements (N,) of pictures that were fitted."""
        rows = self.replayed.rows
        return ~rows.is_force & ~rows.held

    @cached_property
    def _weights(self) -> Array:
        """(m,): one over the root of the number of pictures of each test."""
        test, increment = (own[self._used] for own in (self.replayed.rows.test, self.replayed.rows.increment))
        pictures = {i: len(np.unique(increment[test == i])) for i in np.unique(test).tolist()}
        return 1 / np.sqrt([pictures[i] for i in test.tolist()])

    @property
    def modes(self) -> float:
        """Smooth modes of all tests."""
        return float((self._weights**2).sum())

    @cached_property
    def residual(self) -> Array:
        """(m,), mm: measured minus replayed over the root of the number of pictures."""
        return self._weights * self.replayed.rows.residual[self._used]

    @property
    def errors(self) -> ReplayErrors:
        """Of all pictures that were fitted."""
        return ReplayErrors.of(self.replayed.rows, ~self.replayed.rows.held)

    def slopes(self, additions: Additions) -> Array:
        """Derivatives (m, k) of the residual by amplitudes and shapes of additions, each times its prior standard deviation."""
        directions = Directions.of(self.c, additions, self.c[:, None], 1.0)
        asked = np.arange(len(directions.sizes)) > 0
        columns = self.replayed.slopes(directions, asked)[self._used][:, asked]
        return self._weights[:, None] * columns * self.widths(additions)

    def widths(self, additions: Additions) -> Array:
        """Prior standard deviations (k,) of amplitudes, and of shapes about where they are."""
        variables = Variables(additions)
        found = variables.shape_deviations
        found[~variables.is_shape] = np.concatenate([np.zeros(0), *(self.priors[a.effect.name] for a in additions)])
        return found

    @cached_property
    def S(self) -> Array:
        """(m, k)."""
        return self.slopes(self.additions) / self.widths(self.additions) * self.widths(self.start)

    @cached_property
    def shifts(self) -> Array:
        """Amplitudes and shapes (k,) from the start, over their prior standard deviations."""
        moved = Variables(self.additions).values - Variables(self.start).values
        return np.asarray(moved / self.widths(self.start))

    @property
    def at_start(self) -> Array:
        """Residual (m,) at the start, to first order."""
        return np.asarray(self.residual - self.S @ self.shifts)

    def objective(self, tau: float) -> float:
        """Squares over tau^2, mm^2, with the prior."""
        return float(self.residual @ self.residual) / tau**2 + float(self.shifts @ self.shifts)

    def posterior(self, tau: float) -> dict[str, tuple[Array, Array]]:
        """Mean and standard deviation of every amplitude, then of every shape, to first order."""
        widths, sizes = self.widths(self.start), Variables(self.start).sizes
        information = np.eye(len(widths)) + self.S.T @ self.S / tau**2
        deviations = np.split(np.sqrt(np.diag(np.linalg.inv(information))) * widths, np.cumsum(sizes)[:-1])
        return {
            a.effect.name: (np.array([*a.amplitudes, *a.shape]), own)
            for a, own in zip(self.additions, deviations, strict=True)
        }

    @property
    def at_limit(self) -> dict[str, NDArray[np.bool_]]:
        """Which amplitudes (p,) are at three standard deviations of their priors, and would go further."""
        far = np.split(np.abs(self.shifts) > FAR * (1 - 1e-6), np.cumsum(Variables(self.start).sizes)[:-1])
        return {a.effect.name: own[: len(a.amplitudes)] for a, own in zip(self.additions, far, strict=True)}

    def at_minimum(self, replays: Replays, tau: float) -> FieldFit:
        """Of the objective, from here on; no amplitude beyond three prior standard deviations."""
        now = self
        for _ in range(REPLAYS):
            better = now._better(replays, tau)
            if better is None:
                break
            fall = 1 - better.objective(tau) / now.objective(tau)
            now = better
            if fall < ENOUGH:
                break
        return now

    def _better(self, replays: Replays, tau: float) -> FieldFit | None:
        """A step away, halved until the objective falls; None where it does not."""
        variables = Variables(self.additions)
        widths, values, start = self.widths(self.start), variables.values, Variables(self.start).values
        low, high = (
            np.clip(end, start - FAR * widths, start + FAR * widths) for end in variables.bounds(self.replayed.tests)
        )
        A = np.concatenate([self.S / tau, np.eye(len(values))])
        target = np.concatenate([-self.residual / tau, -self.shifts])
        step = widths * bounded(A, target, (low - values) / widths, (high - values) / widths)
        for k in range(HALVINGS):
            additions = variables.at(values + 0.5**k * step)
            replayed = replays(self.c, additions)
            if replayed is None:
                continue
            new = replace(self, additions=additions, replayed=replayed)
            if new.objective(tau) < self.objective(tau):
                return new
        return None
