r"""Evidence of sets of effects for the fields of a replay, beside a model discrepancy of unknown size.

In: smooth measured minus replayed displacements r (m,) of a base, signatures of effects. Out: sets of up to three effects, ranked.

With amplitudes a ~ N(0, 1) over their prior standard deviations, signatures S, and a discrepancy of standard deviation tau in each of n smooth modes (Kennedy and O'Hagan 2001),

.. math:: \ln Z(\tau) = -\tfrac{n}{2} \ln \tau^2 - \tfrac{1}{2} r^T (\tau^2 I + S S^T)^{-1} r - \tfrac{1}{2} (\ln |\tau^2 I + S S^T| - m \ln \tau^2)

(MacKay 1992), averaged over ln tau (Jeffreys 1946). A discrepancy persists while the load rises, so that all pictures of a mode are one observation: rows are over the root of their number, and n counts modes.
An amplitude of one sign has a half-normal prior, whose factor is twice the posterior probability of that side.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import special

from calibrate.diagnosis.evidence.signatures import EXPECTED

Array = NDArray[np.float64]
Shape = tuple[float, ...]
MOST = 3  # effects in a set
BEAM = 40  # sets of one size that are extended
SMALLEST, GRID = 0.03, 25  # discrepancy, of the root mean square of the residual; how many are tried
UNSEEN = 1e-6  # of the residual, from which a signature is one


@dataclass(frozen=True, eq=False)
class FieldSignature:
    """What one prior standard deviation of each amplitude of an effect explains of a residual: columns (m, p), mm. shapes: how many of the effect are tried; one_sided (p,): amplitudes that cannot be below null."""

    effect: str
    shape: Shape
    columns: Array = field(repr=False)
    shapes: int
    one_sided: NDArray[np.bool_] = field(repr=False)


@dataclass(frozen=True)
class RankedSet:
    """Effects with their shapes, and the log of evidence times prior odds over that of none."""

    effects: tuple[str, ...]
    shapes: tuple[Shape, ...]
    log_odds: float


@dataclass(frozen=True, eq=False)
class FieldEvidence:
    """r (m,), mm, of n modes; effects: how many there are to choose from."""

    r: Array
    modes: float
    effects: int

    @cached_property
    def taus(self) -> Array:
        """(GRID,), mm."""
        return np.geomspace(SMALLEST, 1.0, GRID) * np.sqrt(float(self.r @ self.r) / self.modes)

    @cached_property
    def of_none(self) -> float:
        return self._average(-0.5 * self.modes * np.log(self.taus**2) - 0.5 * float(self.r @ self.r) / self.taus**2)

    def log_odds(self, signatures: Sequence[FieldSignature], r: Array | None = None) -> tuple[float, float]:
        """Of a set against none, with prior odds; and the most probable tau, mm. r (m,): another residual, of the same effects at null to first order."""
        values = self._values(signatures, self.r if r is None else r)
        prior = len(signatures) * np.log(EXPECTED / self.effects) - sum(np.log(one.shapes) for one in signatures)
        return self._average(values) - self.of_none + float(prior), float(self.taus[np.argmax(values)])

    def _values(self, signatures: Sequence[FieldSignature], r: Array) -> Array:
        """ln Z (GRID,)."""
        S = np.concatenate([np.zeros((len(r), 0)), *(one.columns for one in signatures)], axis=1)
        U, s, Vt = np.linalg.svd(S, full_matrices=False)
        variance = self.taus[:, None] ** 2
        along, shrunk = U.T @ r, s**2 + variance  # (GRID, k)
        quadratic = (float(r @ r) - (along**2 * s**2 / shrunk).sum(axis=1)) / self.taus**2
        values = -0.5 * (self.modes * np.log(self.taus**2) + quadratic + np.log(shrunk / variance).sum(axis=1))
        one_sided = np.concatenate([np.zeros(0, bool), *(one.one_sided for one in signatures)])
        if one_sided.any():
            mean = (along * s / shrunk) @ Vt
            deviation = np.sqrt((variance / shrunk) @ Vt**2)
            values += (np.log(2) + special.log_ndtr(mean / deviation))[:, one_sided].sum(axis=1)
        return np.asarray(values)

    def _average(self, values: Array) -> float:
        return float(special.logsumexp(values) - np.log(GRID))

    def ranked(self, signatures: Sequence[FieldSignature]) -> tuple[RankedSet, ...]:
        """All sets of up to three effects, each with its best shapes, best first, none among them; of sets of one size the best are extended."""
        size = UNSEEN * np.linalg.norm(self.r)
        seen = [one for one in signatures if np.isfinite(one.columns).all() and np.linalg.norm(one.columns) > size]
        best: dict[tuple[str, ...], RankedSet] = {(): RankedSet((), (), 0.0)}
        level: list[tuple[int, ...]] = [()]
        for _ in range(MOST):
            tried = {members: self.log_odds([seen[i] for i in members])[0] for members in set(_extended(level, seen))}
            for members, value in tried.items():
                names = tuple(sorted(seen[i].effect for i in members))
                if names not in best or value > best[names].log_odds:
                    one = sorted((seen[i].effect, seen[i].shape) for i in members)
                    best[names] = RankedSet(names, tuple(shape for _, shape in one), value)
            level = sorted(tried, key=lambda members: -tried[members])[:BEAM]
        return tuple(sorted(best.values(), key=lambda one: -one.log_odds))


def _extended(level: Sequence[tuple[int, ...]], seen: Sequence[FieldSignature]) -> Iterator[tuple[int, ...]]:
    """Sets with one effect more."""
    for members in level:
        there = {seen[i].effect for i in members}
        for j, one in enumerate(seen):
            if one.effect not in there:
                yield tuple(sorted((*members, j)))
