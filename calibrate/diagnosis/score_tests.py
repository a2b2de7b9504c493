"""Score tests: which effect the residual of a fit looks like.

In: a `Problem` and its `Fit`. Out: `Score` of every effect.

With whitened residuals r, base columns B (splines of the energy and effects in the model) and the signature S of an
effect, all of unit covariance, the score test (Rao 1948) projects both on the complement of B,

    T = g^T M^-1 g,   g = S'^T r,   M = S'^T S',   amplitude = -M^-1 g,

T is chi-square distributed with as many degrees of freedom as the effect has amplitudes if the effect is absent, and
tells by how much the loss would fall. Shapes are tried on a grid (Davies 1977); the p-value of the whole search comes
from the simulated distribution of its smallest p-value (Westfall and Young 1993).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from calibrate.diagnosis import problem as equations
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.signature_noise import excess, hidden_noise
from calibrate.effects import CATALOGUE, Effect
from calibrate.effects.chain import Addition
from calibrate.fitting.least_squares import CONDITION, bounded, orthonormal, subtract
from calibrate.fitting.side_by_side import side_by_side

Array = NDArray[np.float64]
ABSORBED = 1e-3  # share of a signature that must be left by the base
APART = 0.95  # cosine of changes, below which two shapes are starts of their own
STARTS, HIGH = 3, 0.5  # starts beside the best shape at most, and the share of its score that they have at least
DRAWS = 2000  # of the simulated search


class Status(StrEnum):
    """Whether an effect can be tested: one that is confounded cannot be told from what it names; data may be missing, or it belongs to one
    test where several are fitted; the data may exclude it, as stereo
    data do out-of-plane motion; the base may absorb its signature; or that is not finite at these deformations."""

    TESTED = "tested"
    CONFOUNDED = "confounded"
    NOT_TESTABLE = "not testable"
    EXCLUDED = "excluded"
    ABSORBED = "absorbed"
    NOT_FINITE = "not finite"


@dataclass(frozen=True, eq=False)
class Score:
    """One effect's test. missing: the data that it needs, where it is not testable; none where it belongs to one test alone.

    score: T over the dispersion, with `degrees`; p_value: of the effect; adjusted: of the whole search. share: of the
    misfit that it would explain. absorbed: share of the signature that the base takes. amplitudes, errors: with null
    value 0 of the difference. admissible: within bounds. direction (N,): unit vector of the fitted change. others: shapes that
    make another change, from which a fit may end elsewhere; the best first.
    """

    effect: Effect
    status: Status
    missing: tuple[str, ...] = ()
    score: float = 0.0
    degrees: int = 0
    p_value: float = 1.0
    adjusted: float = 1.0
    share: float = 0.0
    absorbed: float = 1.0
    amplitudes: tuple[float, ...] = ()
    errors: tuple[float, ...] = ()
    shape: tuple[float, ...] = ()
    admissible: bool = True
    direction: Array | None = field(default=None, repr=False)
    others: tuple[Score, ...] = field(default=(), repr=False)

    @property
    def evidence(self) -> float:
        """Improvement minus the penalty on its amplitudes and shapes (BIC; Schwarz 1978), for ranking."""
        n = 1000 if self.direction is None else len(self.direction)
        penalty = (self.degrees + len(self.shape)) * float(np.log(n))
        return self.score - penalty if self.is_tested else -np.inf

    @property
    def is_tested(self) -> bool:
        """Whether there is a score."""
        return self.status is Status.TESTED


def score(problem: Problem, state: Fit, effects: Sequence[Effect] = CATALOGUE, seed: int = 0) -> list[Score]:
    """Test every effect that is not in the model yet, one that is more of another only beside that; best first, those that could not be tested last."""
    present = {a.effect.name for a in state.additions}
    state = state.remembering()
    U, r = state.columns, state.residual
    r = r - U @ (U.T @ r)
    hidden = hidden_noise(problem, state.chains, state.c, state.additions) if problem.noise_is_known else []

    def examined(effect: Effect) -> tuple[Score, Array | None]:
        refused = untestable(problem, effect)
        return (refused, None) if refused is not None else examine(problem, state, effect, U, r, hidden)

    candidates = (e for e in effects if e.name not in present and (e.beside is None or e.beside.name in present))
    every = side_by_side(examined, candidates)
    found = [(one, Q) for one, Q in every if Q is not None and one.is_tested]
    skipped = [one for one, _ in every if not one.is_tested]
    if not found:
        return skipped
    everything = np.concatenate([Q.reshape(len(Q), -1) for _, Q in found], axis=1)
    both = orthonormal(everything)
    rest = r - both @ (both.T @ r)
    left = len(r) - U.shape[1] - both.shape[1]  # none where all together can make any residual
    dispersion = max(1.0, float(rest @ rest) / left if left > 0 else state.reduced_chi_square)
    tested = adjust([one for one, _ in found], [Q for _, Q in found], dispersion, seed)
    tested.sort(key=lambda s: -s.evidence)
    return tested + skipped


def untestable(problem: Problem, effect: Effect, alike: bool = False) -> Score | None:
    """Score of an effect that cannot be tested with these data, or None. alike: several tests may have one of a specimen alike."""
    if effect.confounded_with:
        return Score(effect, Status.CONFOUNDED)
    if all(effect.excluded(part.chain.data) for part in problem.trained):
        return Score(effect, Status.EXCLUDED)
    missing = {effect.missing(part.chain.data) for part in problem.trained} - {None}
    if problem.level_is_nominal and effect.of_forces:
        missing |= {"forces of the section"}
    if missing or (len(problem.trained) > 1 and belongs_to_one_test(effect) and not alike):
        return Score(effect, Status.NOT_TESTABLE, tuple(sorted(map(str, missing))))
    return None


def belongs_to_one_test(effect: Effect) -> bool:
    """Whether it is neither of the material nor of the rig: of several tests each has its own."""
    return not (effect.of_material or effect.of_rig)


def examine(
    problem: Problem, state: Fit, effect: Effect, U: Array, r: Array, hidden: list[list[Array]] | None = None
) -> tuple[Score, Array]:
    """Score of one effect over its shapes, and the orthonormal signature of each (N, shapes, p) for the simulation, with zeros where one has fewer directions than another.

    U (N, k): orthonormal columns that the model can adjust; r (N,): what they leave. hidden: see `hidden_noise`; found
    here where it is not given.
    """
    null = tuple(p.null for p in effect.amplitudes)
    tested: list[Score] = []
    blocks, absorbed_most = [], 1.0
    shapes = problem.shapes(effect)
    single = len(shapes) == 1
    for shape in shapes:
        one, Q = examine_shape(problem, state, Addition(effect, null, shape), U, r, hidden, correct=single)
        absorbed_most = min(absorbed_most, one.absorbed)
        if not one.is_tested:
            continue
        blocks.append(Q)
        tested.append(one)
    if not tested:
        status = one.status if one.status is Status.NOT_FINITE else Status.ABSORBED
        return Score(effect, status, absorbed=absorbed_most), np.zeros((len(r), 0, 0))
    best = max(tested, key=lambda one: (one.admissible, one.score))
    others = _others(best, tested)
    if not single and effect.rough and problem.noise_is_known:
        best = examine_shape(problem, state, Addition(effect, null, best.shape), U, r, hidden)[0]
    p = min(1.0, len(blocks) * float(stats.chi2.sf(best.score, best.degrees)))
    widest = max(Q.shape[1] for Q in blocks)
    return replace(best, p_value=p, others=others), np.stack(
        [np.pad(Q, ((0, 0), (0, widest - Q.shape[1]))) for Q in blocks], axis=1
    )


def _others(best: Score, tested: Sequence[Score]) -> tuple[Score, ...]:
    """The best of the admissible shapes that make other changes than the best one and than each other, and score at least half as high: of an inclusion
    that is softer a stiffer one on the other side of the sheet may score higher than the right one before its shape is refined."""
    starts = [best]
    for one in sorted(tested, key=lambda score: -score.score):
        high = one.admissible and one.score > HIGH * best.score
        if high and len(starts) <= STARTS and likeness([one, *starts])[0, 1:].max() < APART:
            starts.append(one)
    return tuple(starts[1:])


def examine_shape(
    problem: Problem,
    state: Fit,
    addition: Addition,
    U: Array,
    r: Array,
    hidden: list[list[Array]] | None = None,
    correct: bool = True,
) -> tuple[Score, Array]:
    """Score of one effect with one shape, and its orthonormal signature (N, p).

    U, r: see `examine`. correct: the amplitude of a rough effect for the noise in its signature, which its score does
    not depend on.
    """
    effect = addition.effect
    typical = np.array([p.typical for p in effect.amplitudes])
    S = equations.signature(problem, state.chains, state.c, (*state.additions, addition)) * typical
    if not np.isfinite(S).all():
        return Score(effect, Status.NOT_FINITE), S
    outside = S - U @ (U.T @ S)
    absorbed = 1.0 - np.linalg.norm(outside) / max(np.linalg.norm(S), 1e-300)
    if absorbed > 1 - ABSORBED:
        return Score(effect, Status.ABSORBED, absorbed=absorbed), outside
    g, M = outside.T @ r, outside.T @ outside
    values, vectors = np.linalg.eigh(M)
    keep = values > CONDITION * values.max()
    Q = (outside @ vectors[:, keep]) / np.sqrt(values[keep])
    T = float(((vectors[:, keep].T @ g) ** 2 / values[keep]).sum())
    inverse = (vectors[:, keep] / values[keep]) @ vectors[:, keep].T
    if correct and effect.rough and problem.noise_is_known:
        inverse = np.linalg.inv(subtract(M, _hidden_excess(problem, state, addition, U, typical, S, hidden)))
    a = -inverse @ g
    spread = np.sqrt(np.diag(inverse @ M @ inverse))
    amplitudes, admissible = _amplitudes(effect, a)
    if not admissible and len(a) > 1:  # the best within the bounds; its score is lower, its penalty is not
        a = bounded(outside, -r, *_bounds(effect))
        amplitudes, admissible = _amplitudes(effect, a)[0], True
        T = max(float(-2 * (g @ a) - a @ M @ a), 0.0)
    change = outside @ a
    one = Score(
        effect,
        Status.TESTED,
        score=T,
        degrees=int(keep.sum()),
        share=T / max(float(r @ r), 1e-300),
        absorbed=absorbed,
        amplitudes=tuple(map(float, amplitudes)),
        errors=tuple(map(float, spread * typical)),
        shape=addition.shape,
        admissible=admissible,
        direction=change / max(np.linalg.norm(change), 1e-300),
    )
    return one, Q


def _hidden_excess(
    problem: Problem,
    state: Fit,
    addition: Addition,
    U: Array,
    typical: Array,
    S: Array,
    hidden: list[list[Array]] | None,
) -> Array:
    """(p, p): what noise that does not show in the residual adds to the squares of the signature S (N, p)."""
    hidden = hidden_noise(problem, state.chains, state.c, state.additions) if hidden is None else hidden
    return excess(problem, state.chains, state.c, (*state.additions, addition), U, typical, S, hidden)


def _amplitudes(effect: Effect, a: Array) -> tuple[Array, bool]:
    """Amplitudes (p,) of changes a (p,) in typical ones, and whether all are admissible."""
    values = np.array([p.null for p in effect.amplitudes]) + a * np.array([p.typical for p in effect.amplitudes])
    return values, all(p.lower <= v <= p.upper for p, v in zip(effect.amplitudes, values, strict=True))


def _bounds(effect: Effect) -> tuple[Array, Array]:
    """Lower and upper bounds (p,) of changes in typical amplitudes."""
    lower, upper, null, typical = np.array([(p.lower, p.upper, p.null, p.typical) for p in effect.amplitudes]).T
    return (lower - null) / typical, (upper - null) / typical


def adjust(scores: list[Score], blocks: list[Array], dispersion: float, seed: int) -> list[Score]:
    """Scores over the dispersion, with p-values of the whole search from simulated noise."""
    smallest = _smallest_p(blocks, seed)
    result = []
    for one, block in zip(scores, blocks, strict=True):
        n_shapes = block.shape[1]
        score = one.score / dispersion
        p = min(1.0, n_shapes * float(stats.chi2.sf(score, one.degrees)))
        exceeded = int((smallest <= p).sum())
        adjusted = exceeded / DRAWS if exceeded >= 10 else min(len(scores) * p, 10 / DRAWS)
        deviations = tuple(float(e * np.sqrt(dispersion)) for e in one.errors)
        result.append(replace(one, score=score, p_value=p, adjusted=adjusted, errors=deviations))
    return result


def _smallest_p(blocks: list[Array], seed: int) -> Array:
    """(DRAWS,): the smallest p-value of the search in noise alone; blocks (N, shapes, p): signatures of all shapes."""
    Q = np.concatenate([block.reshape(len(block), -1) for block in blocks], axis=1)
    values, vectors = np.linalg.eigh(Q.T @ Q)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    draws = np.random.default_rng(seed).standard_normal((DRAWS, root.shape[1])) @ root.T
    smallest = np.ones(DRAWS)
    start = 0
    for block in blocks:
        _, n_shapes, size = block.shape
        T = (draws[:, start : start + n_shapes * size].reshape(DRAWS, n_shapes, size) ** 2).sum(axis=2).max(axis=1)
        smallest = np.minimum(smallest, np.minimum(1.0, n_shapes * stats.chi2.sf(T, size)))
        start += n_shapes * size
    return smallest


def likeness(scores: Sequence[Score]) -> Array:
    """|cos| (k, k) of the fitted changes of tested effects."""
    directions = np.array([s.direction for s in scores])
    return np.abs(directions @ directions.T)
