"""Effects that every one of several tests has for itself: marginalised in the joint fit, told test by test beside it.

In: a `Problem` of several tests, effects, priors. Out: the same problem with weights that allow for such effects in each test, and `OwnEffect`s.

A warp or a gradient of thickness belongs to one specimen. Fitted to all tests together it would be wrong in most, and left out it would be taken for
the material. So each test has its own, with a normal prior: with S the signatures of amplitudes of one prior standard deviation, the covariance of the equations
gains S S^T (the marginal likelihood of a mixed model; Pinheiro and Bates 2000, 2.1).

S is taken at displacements without the noise that shows in the residual. The effects of all places together are nearly a factor on the stiffness of the
test; what the noise in S and the noise in the residual have in common would otherwise pass for a stiffer material.

Which of them are there is a question of their variances: none, one for each test, or one that all tests share, as an effect of the rig or of how the
specimens are made has it. Every answer is a covariance V and has an evidence (restricted likelihood; Patterson and Thompson 1971)

    ln Z = -1/2 ln |A| + 1/2 b^T A^-1 C b,   A = 1 + C W^T W,   b = W^T r

up to what all answers share, in rows whitened by noise and discretisation alone, over the dispersion and outside what the joint model adjusts: r the
residual, W the signatures of all tests there, C the prior covariance of their amplitudes. Amplitudes are the best linear unbiased predictor of the most
probable answer (Robinson 1991), -A^-1 C b with the covariance A^-1 C.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

from calibrate.diagnosis import model_weights
from calibrate.diagnosis import problem as equations
from calibrate.diagnosis.effect_fit import Fit, refit
from calibrate.diagnosis.evidence.explanations import CERTAIN
from calibrate.diagnosis.evidence.linear_evidence import FORMULA_ERROR
from calibrate.diagnosis.evidence.priors import Priors
from calibrate.diagnosis.evidence.signatures import EXPECTED, prior_deviations
from calibrate.diagnosis.problem import OwnSignature, Problem
from calibrate.diagnosis.score_tests import belongs_to_one_test, untestable
from calibrate.diagnosis.signature_noise import denoised_everywhere
from calibrate.effects import Effect
from calibrate.effects.chain import Additions, Chain
from calibrate.fitting.least_squares import orthonormal

Array = NDArray[np.float64]
SEEN = 0.05  # of all amplitudes in all tests together: probability that any is called seen where none is (Bonferroni)
PASSES = 2  # of weights and estimate of the true displacements, which answer each other


class Presence(IntEnum):
    """Where an effect is. COMMON: alike in all tests."""

    ABSENT = 0
    OWN = 1
    COMMON = 2


Answer = Mapping[str, Presence]  # by the name of an effect


def with_own_effects(problem: Problem, base: Fit, effects: Sequence[Effect], priors: Priors) -> tuple[Problem, Fit]:
    """The problem of several tests with weights that allow for the effects of each, and the base fitted again.

    Not for rough ones: second derivatives of the displacements have the noise of the residual in them, whose product would pass for an effect. Nor for tests
    without an equation inside, as homogeneous ones: of what varies over the specimen they see one factor on the force, in which a material would hide.
    """
    own = [e for e in effects if belongs_to_one_test(e) and not e.rough and untestable(problem.of_one_test, e) is None]
    for _ in range(PASSES):
        parts = []
        for part in problem.parts:
            seen = own if part.train.size and part.inside.any() else []
            chain = denoised_everywhere(part, base.c) if seen else part.chain
            known = tuple(_signature(problem, chain, base.c, effect, priors) for effect in seen)
            parts.append(replace(part, own=tuple(one for one in known if np.isfinite(one.sources).all())))
        problem = model_weights.reweighted(replace(problem, parts=tuple(parts)), base.c, ())
        base = refit(problem, base.c, ())
    return problem, base


def _signature(
    problem: Problem, chain: Chain, c: Array, effect: Effect, priors: Priors, others: Additions = ()
) -> OwnSignature:
    shapes = effect.shape_values(chain.data)
    deviation = prior_deviations(problem, effect, priors)
    each = [chain.signature(c, effect, tuple(shape), others) * deviation[:, None, None] for shape in shapes]
    return OwnSignature(effect, deviation, np.moveaxis(np.concatenate(each), 0, -1) / np.sqrt(len(shapes)))


@dataclass(frozen=True)
class OwnEffect:
    """An effect of each test beside a joint model. tests (n): those that may have it. own, common: probability that each test has its own, and that all have
    the same; `common` is 0 where its shapes are other ones in other tests. prior (p,): standard deviations of its amplitudes, in their units.
    values, deviations (n, p): amplitudes in the most probable model that has it, the sum over shapes; of noise and of the formula, which may be wrong by 2 %. limit: deviations from none beyond which an amplitude is
    seen."""

    effect: Effect
    tests: tuple[str, ...]
    own: float
    common: float
    prior: tuple[float, ...]
    values: tuple[tuple[float, ...], ...]
    deviations: tuple[tuple[float, ...], ...]
    limit: float

    @property
    def is_common(self) -> bool:
        """Whether it is there, and alike in all tests."""
        return self.common > CERTAIN

    @property
    def is_there(self) -> bool:
        """Whether a test has it."""
        return self.own + self.common > CERTAIN

    @property
    def seen_in(self) -> tuple[str, ...]:
        """Tests that have it for themselves."""
        if self.own <= CERTAIN:
            return ()
        return tuple(
            name for k, name in enumerate(self.tests) if any(self.is_seen(k, i) for i in range(len(self.prior)))
        )

    def is_seen(self, test: int, amplitude: int) -> bool:
        """Whether an amplitude of a test is further from none than `limit`."""
        return abs(self.values[test][amplitude]) > self.limit * self.deviations[test][amplitude]


def own_effects(problem: Problem, fit: Fit, priors: Priors) -> tuple[OwnEffect, ...]:
    """What every test has for itself beside a joint fit; none for a single test."""
    if not any(part.own for part in problem.trained):
        return ()
    plain = model_weights.without_own_effects(problem)
    found = OwnSignatures.of(problem, plain, fit, priors)
    return found.told(equations.residual(plain, fit.c, fit.additions))


class OwnSignatures(NamedTuple):
    """Tests and what they may have, beside a joint fit, and the signatures W (N, k) of all of it, outside what the fit adjusts; spread: the dispersion."""

    cells: tuple[tuple[str, OwnSignature], ...]
    W: Array
    spread: float

    @classmethod
    def of(cls, problem: Problem, plain: Problem, fit: Fit, priors: Priors) -> OwnSignatures:
        """Of a fit to `problem`, in the weights of `plain`, which allow for none."""
        adjusted = [equations.base_columns(plain, fit.chains) @ plain.cone]
        if fit.additions:
            adjusted.append(equations.signatures(plain, fit.chains, fit.c, fit.additions))
        U = orthonormal(np.concatenate(adjusted, axis=1))
        start, cells, columns = 0, [], [np.zeros((len(U), 0))]
        for part, chain, known in zip(plain.trained, fit.chains, (p.own for p in problem.trained), strict=True):
            inside = slice(start, start := start + part.train.size)
            for one in known:
                found = _signature(problem, chain, fit.c, one.effect, priors, fit.additions)
                if not np.isfinite(found.sources).all():
                    continue
                S = np.zeros((len(U), found.sources.shape[-1]))
                S[inside] = part.train(np.moveaxis(found.sources, -1, 0)).T
                columns.append(S - U @ (U.T @ S))
                cells.append((part.experiment.name, found))
        spread = max(1.0, fit.free_loss / max(fit.degrees, 1))
        return cls(tuple(cells), np.concatenate(columns, axis=1), spread)

    def told(self, residual: Array) -> tuple[OwnEffect, ...]:
        """Of a whitened residual (N,) of the fit."""
        if not self.cells:
            return ()
        return _told(_Cells(self.cells, self.W.T @ self.W / self.spread, self.W.T @ residual / self.spread))


class _Cells(NamedTuple):
    """What tests may have, with W^T W (k, k) and W^T r (k,), over the dispersion."""

    cells: tuple[tuple[str, OwnSignature], ...]
    gram: Array
    product: Array

    def of(self, name: str) -> list[slice]:
        """Places of the signatures of an effect, test by test."""
        ends = np.cumsum([0, *(one.sources.shape[-1] for _, one in self.cells)])
        own = [one.effect.name == name for _, one in self.cells]
        return [slice(a, b) for (a, b), here in zip(pairwise(ends), own, strict=True) if here]

    def covariance(self, answer: Answer) -> Array:
        """C (k, k) of the amplitudes."""
        C = np.zeros(self.gram.shape)
        for name, presence in answer.items():
            places = self.of(name)
            for a, b in product(places, places):
                if presence is Presence.COMMON or (presence is Presence.OWN and a == b):
                    np.fill_diagonal(C[a, b], 1.0)
        return C

    def log_evidence(self, answer: Answer) -> float:
        """With prior odds, up to what all answers share."""
        C = self.covariance(answer)
        A = np.eye(len(C)) + C @ self.gram
        fall = self.product @ np.linalg.solve(A, C @ self.product)
        odds = EXPECTED / len(answer)
        prior = sum(np.log(1 - odds) if one is Presence.ABSENT else np.log(odds / 2) for one in answer.values())
        return float(prior - 0.5 * np.linalg.slogdet(A)[1] + 0.5 * fall)

    def amplitudes(self, answer: Answer) -> tuple[Array, Array]:
        """Mean (k,) and covariance (k, k), in prior standard deviations."""
        C = self.covariance(answer)
        covariance = np.linalg.solve(np.eye(len(C)) + C @ self.gram, C)
        return -covariance @ self.product, covariance


def _told(cells: _Cells) -> tuple[OwnEffect, ...]:
    names = list(dict.fromkeys(one.effect.name for _, one in cells.cells))
    choices = []
    for name in names:
        places = cells.of(name)
        alike = len(places) > 1 and len({place.stop - place.start for place in places}) == 1
        choices.append([Presence.ABSENT, Presence.OWN, *([Presence.COMMON] if alike else [])])
    answers: list[Answer] = [dict(zip(names, found, strict=True)) for found in product(*choices)]
    probabilities = special.softmax([cells.log_evidence(answer) for answer in answers])
    n = sum(len(one.deviation) for _, one in cells.cells)
    limit = float(stats.norm.isf(0.5 * SEEN / n))
    return tuple(_own_effect(cells, name, answers, probabilities, limit) for name in names)


def _own_effect(cells: _Cells, name: str, answers: Sequence[Answer], probabilities: Array, limit: float) -> OwnEffect:
    own, common = (
        float(sum(p for p, answer in zip(probabilities, answers, strict=True) if answer[name] is here))
        for here in (Presence.OWN, Presence.COMMON)
    )
    there = [p if answer[name] else -1.0 for p, answer in zip(probabilities, answers, strict=True)]
    mean, covariance = cells.amplitudes(answers[int(np.argmax(there))])
    tests = [(test, one) for test, one in cells.cells if one.effect.name == name]
    effect, deviation = tests[0][1].effect, tests[0][1].deviation
    values, deviations = [], []
    for place in cells.of(name):
        p, k = len(deviation), place.stop - place.start
        sums = np.tile(np.eye(p), k // p) * deviation[:, None] / np.sqrt(k / p)
        values.append(tuple(map(float, sums @ mean[place])))
        variances = np.diag(sums @ covariance[place, place] @ sums.T)
        of_formula = FORMULA_ERROR * np.array(values[-1])
        deviations.append(tuple(map(float, np.sqrt(np.maximum(variances, 0.0) + of_formula**2))))
    return OwnEffect(
        effect, tuple(test for test, _ in tests), own, common, tuple(map(float, deviation)), tuple(values), tuple(deviations), limit
    )  # fmt: skip
