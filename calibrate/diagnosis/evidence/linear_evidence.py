"""Evidence of every subset of effects from one Gram matrix, linear in the amplitudes.

In: whitened residual r (N,), columns U that the base adjusts freely, signatures S of every effect and shape over prior standard deviations.
Out: log evidence of subsets. With amplitudes a ~ N(0, 1) and everything projected on the complement of U,

    ln Z = -1/2 (|r|^2 - b^T M^-1 b) - 1/2 ln |M|,   M = 1 + S^T S,   b = S^T r

up to what all subsets share (MacKay 1992; Bishop 2006, 3.5). An amplitude with a bound at its null value has a half-normal prior: its
factor is twice the posterior probability of the admissible side. Smooth disturbances D of no particular kind are two things:

- the formula of an effect is itself wrong by some share eps of what it explains: D with variance sum eps_i^2 |S_i a_i|^2 over its number of columns;
- 'none of these': D with a variance of its own, averaged over a logarithmic grid (a Gaussian process over place and load).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import batched, islice, pairwise, product

import numpy as np
from numpy.typing import NDArray
from scipy import special

from calibrate.effects.effect import FORMULA_ERROR

Array = NDArray[np.float64]
MOST = 3  # effects in a subset
BEAM = 40  # subsets of one size that are extended
GRID = 12  # variances of a discrepancy that are tried
TOGETHER = 4_000_000  # numbers in the matrices of subsets that are solved at once


def over_variances(log_evidence: Callable[[float], float], largest: float) -> float:
    """Log evidence averaged over a logarithmic grid of variances of smooth disturbances."""
    values = [log_evidence(float(v)) for v in np.geomspace(0.1, max(largest, 10.0), GRID)]
    return float(special.logsumexp(values) - np.log(GRID))


def _blocks(matrix: Array, index: NDArray[np.int64]) -> Array:
    """Rows and columns (n, k) of a matrix: (n, k, k)."""
    return np.asarray(matrix[index[:, :, None], index[:, None, :]])


@dataclass(frozen=True, eq=False)
class Signature:
    """Signature (N, p) of an effect with one shape, outside what the base adjusts, for amplitudes of one prior standard deviation.

    An amplitude that is not there, as the effect may have fewer (`Effect.alone`), has a column of zeros. prior: share of the prior probability of the effect that this shape with these amplitudes has. one_sided (p,): amplitudes that cannot be below null. beside: the effect without
    which it is none. error: of its formula, relative.
    """

    name: str
    shape: tuple[float, ...]
    columns: Array = field(repr=False)
    prior: float
    one_sided: NDArray[np.bool_] = field(repr=False)
    beside: str = ""
    error: float = FORMULA_ERROR


@dataclass(frozen=True)
class Subset:
    """Effects with their shapes (indices of signatures), log evidence with prior odds, amplitudes in prior standard deviations.

    charge: of the log evidence, what the effects cost: prior odds and -1/2 ln |M|.
    """

    members: tuple[int, ...]
    log_evidence: float
    amplitudes: tuple[Array, ...]
    charge: float = 0.0


@dataclass(frozen=True, eq=False)
class Evidence:
    """Signatures, the residual r (N,) and smooth disturbances D (N, k), orthonormal, all outside what the base adjusts and over the noise.

    log_odds: of the prior, of an effect against none.
    """

    signatures: tuple[Signature, ...]
    r: Array
    D: Array
    log_odds: float

    @cached_property
    def _S(self) -> Array:
        return np.concatenate([np.zeros((len(self.r), 0)), *(s.columns for s in self.signatures)], axis=1)

    @cached_property
    def _gram(self) -> tuple[Array, Array]:
        """S^T S, and S^T D D^T S."""
        cross = self._S.T @ self.D
        return self._S.T @ self._S, cross @ cross.T

    @cached_property
    def _doubted(self) -> Array:
        """S^T S of each effect by itself, times the square of the error of its formula."""
        sizes = [len(own) for own in self._slices]
        owner = np.repeat(np.arange(len(sizes)), sizes)
        error = np.repeat([s.error for s in self.signatures], sizes)
        return np.where(owner[:, None] == owner, self._gram[0] * error**2, 0.0)

    @cached_property
    def _b(self) -> tuple[Array, Array, float]:
        """S^T r, S^T D D^T r and |D^T r|^2."""
        smooth = self.D.T @ self.r
        return self._S.T @ self.r, self._S.T @ (self.D @ smooth), float(smooth @ smooth)

    @cached_property
    def _slices(self) -> list[NDArray[np.int64]]:
        ends = np.cumsum([0, *(s.columns.shape[1] for s in self.signatures)])
        return [np.arange(a, b) for a, b in pairwise(ends)]

    def subset(self, members: tuple[int, ...]) -> Subset:
        """Evidence of effects together, with the error of their formulas."""
        return self.subsets([members])[0]

    def subsets(self, many: Sequence[tuple[int, ...]]) -> list[Subset]:
        """The same of many subsets, those of as many amplitudes together."""
        sizes: dict[int, list[int]] = {}
        for place, members in enumerate(many):
            sizes.setdefault(sum(len(self._slices[i]) for i in members), []).append(place)
        found: dict[int, Subset] = {}
        for size, places in sizes.items():
            for some in batched(places, max(1, TOGETHER // max(size, 1) ** 2)):
                found |= zip(some, self._of_size([many[k] for k in some]), strict=True)
        return [found[place] for place in range(len(many))]

    def _of_size(self, many: Sequence[tuple[int, ...]]) -> Iterator[Subset]:
        """Of subsets that have equally many amplitudes."""
        if not many[0]:
            yield from (Subset((), 0.0, ()) for _ in many)
            return
        own = [[self._slices[i] for i in members] for members in many]
        index = np.array([np.concatenate(one) for one in own])
        values, a, volumes = self.weighed(index)
        for members, places, value, amplitudes, volume in zip(many, own, values, a, volumes, strict=True):
            prior = sum(self.log_odds + np.log(self.signatures[i].prior) for i in members)
            parts = np.split(amplitudes, np.cumsum([len(one) for one in places])[:-1])
            yield Subset(members, float(value + prior), tuple(parts), float(volume + prior))

    def weighed(self, index: NDArray[np.int64]) -> tuple[Array, Array, Array]:
        """Log evidence (n,) without prior odds, amplitudes (n, k), and -1/2 ln |M| (n,) of columns (n, k) each; an amplitude of one sign has a half-normal prior."""
        values, a, covariance, volumes = self._with_formula_error(index)
        spread = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
        sided = np.concatenate([s.one_sided for s in self.signatures])[index]
        return values + np.where(sided, np.log(2) + special.log_ndtr(a / spread), 0.0).sum(axis=1), a, volumes

    def posterior(self, members: tuple[int, ...]) -> tuple[Array, Array]:
        """Mean (k,) and covariance (k, k) of the amplitudes of effects together, in prior standard deviations, without their bounds."""
        _, mean, covariance, _ = self._with_formula_error(np.concatenate([self._slices[i] for i in members])[None])
        return mean[0], covariance[0]

    def _with_formula_error(self, index: NDArray[np.int64]) -> tuple[Array, Array, Array, Array]:
        """Log evidence (n,), amplitudes (n, k) and their covariance (n, k, k) of columns (n, k) each; and -1/2 ln |M| (n,) without the error of the formulas."""
        _, a, _, volumes = self._solve(index, np.zeros(len(index)))
        squares = np.einsum("nk,nkl,nl->n", a, _blocks(self._doubted, index), a)
        values, a, covariance, _ = self._solve(index, squares / max(self.D.shape[1], 1))
        return values, a, covariance, volumes

    def discrepancy(self) -> float:
        """Log evidence of smooth disturbances without any effect."""
        nothing = np.zeros((1, 0), np.int64)
        value = over_variances(lambda v: float(self._solve(nothing, np.array([v]))[0][0]), float(self.r @ self.r))
        return value + self.log_odds

    def _solve(self, index: NDArray[np.int64], variance: Array) -> tuple[Array, Array, Array, Array]:
        """Log evidence (n,), amplitudes (n, k), their posterior covariance M^-1 (n, k, k), and -1/2 ln |M| (n,) of columns (n, k) each; D, which is orthonormal,
        with variances (n,), integrated out."""
        (gram, of_smooth), (b, b_smooth, smooth) = self._gram, self._b
        share = variance / (1 + variance)
        M = np.eye(index.shape[1]) + _blocks(gram, index) - share[:, None, None] * _blocks(of_smooth, index)
        right = b[index] - share[:, None] * b_smooth[index]
        inverse = np.linalg.inv(M)
        removed = np.einsum("nkl,nl->nk", inverse, right)
        volume = -np.log(np.diagonal(np.linalg.cholesky(M), axis1=1, axis2=2)).sum(axis=1)
        value = 0.5 * (np.einsum("nk,nk->n", right, removed) + share * smooth) + volume
        value -= 0.5 * self.D.shape[1] * np.log1p(variance)
        return value, -removed, inverse, volume  # r = residual + S a: the amplitude that removes it

    def best(self, most: int = MOST) -> list[Subset]:
        """Subsets of up to `most` different effects, the best first: all single ones, and beams of the larger, of the best subsets and of the best of every set of names."""
        found: dict[tuple[int, ...], Subset] = {(): self.subset(())}
        beam = [self.subset(())]
        for _ in range(most):
            new = [m for m in dict.fromkeys(self._extensions(beam)) if m not in found]
            larger = dict(zip(new, self.subsets(new), strict=True))
            found |= larger
            ranked = sorted(larger.values(), key=lambda s: -s.log_evidence)
            beam = list({one.members: one for one in (*ranked[:BEAM], *self.by_names(ranked, BEAM))}.values())
        return sorted(found.values(), key=lambda s: -s.log_evidence)

    def _extensions(self, beam: Sequence[Subset]) -> Iterator[tuple[int, ...]]:
        for one in beam:
            names = {self.signatures[i].name for i in one.members}
            for k, s in enumerate(self.signatures):
                if s.name not in names and s.beside in ("", *names):
                    yield tuple(sorted((*one.members, k)))

    def names(self, one: Subset) -> frozenset[str]:
        """Of the effects of a subset."""
        return frozenset(self.signatures[i].name for i in one.members)

    def of_names(self, names: Collection[str]) -> Subset | None:
        """The best subset of these effects; None where one of them has no signature."""
        shapes = [[i for i, s in enumerate(self.signatures) if s.name == name] for name in names]
        if not all(shapes):
            return None
        return max(self.subsets([tuple(sorted(some)) for some in product(*shapes)]), key=lambda one: one.log_evidence)

    def by_names(self, subsets: Sequence[Subset], count: int) -> list[Subset]:
        """The best of every set of names, the first `count`."""
        best: dict[frozenset[str], Subset] = {}
        for one in subsets:
            best.setdefault(self.names(one), one)
        return list(islice(best.values(), count))
