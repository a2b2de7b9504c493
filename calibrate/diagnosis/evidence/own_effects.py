"""Effects that every one of several tests has for itself: marginalised in the joint fit, told test by test beside it.

In: a `Problem` of several tests, effects, priors. Out: the same problem with weights that allow for such effects in each test, and `OwnEffect`s.

A warp or a gradient of thickness belongs to one specimen. Fitted to all tests together it would be wrong in most, and left out it would be taken for
the material. So each test has its own, with a normal prior: with S the signatures of amplitudes of one prior standard deviation, the covariance of the equations
gains S S^T (the marginal likelihood of a mixed model; Pinheiro and Bates 2000, 2.1).

S is taken at displacements without the noise that shows in the residual. The effects of all places together are nearly a factor on the stiffness of the
test; what the noise in S and the noise in the residual have in common would otherwise pass for a stiffer material.

Which of them are there is a question of their variances: none, one for each test, or one that all tests share, as an effect of the rig or of how the
specimens are made has it. Each is another signature of the effect: those of all tests side by side, or their sum. So every answer is a subset of signatures with
its evidence (`linear_evidence`), in rows whitened by noise and discretisation alone, over the dispersion and outside what the joint model adjusts: the restricted
likelihood of its variances (Patterson and Thompson 1971), amplitudes the best linear unbiased predictor (Robinson 1991).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special, stats

from calibrate.diagnosis import model_weights
from calibrate.diagnosis import problem as equations
from calibrate.diagnosis.effect_fit import Fit, refit
from calibrate.diagnosis.evidence.explanations import CERTAIN
from calibrate.diagnosis.evidence.levels import Level, StiffnessLevel, have_unknown_levels
from calibrate.diagnosis.evidence.linear_evidence import Evidence, Signature, Subset
from calibrate.diagnosis.evidence.priors import FAR, Priors
from calibrate.diagnosis.evidence.signatures import EXPECTED, disturbances, prior_deviations
from calibrate.diagnosis.problem import OwnSignature, Problem
from calibrate.diagnosis.score_tests import belongs_to_one_test, untestable
from calibrate.diagnosis.signature_noise import denoised_everywhere
from calibrate.effects import Effect
from calibrate.effects.chain import Additions, Chain
from calibrate.fitting.least_squares import orthonormal

Array = NDArray[np.float64]
SEEN = 0.05  # of all amplitudes in all tests together: probability that any is called seen where none is (Bonferroni)
PASSES = 2  # of weights and estimate of the true displacements, which answer each other


def with_own_effects(problem: Problem, base: Fit, effects: Sequence[Effect], priors: Priors) -> tuple[Problem, Fit]:
    """The problem of several tests with weights that allow for the effects of each, and the base fitted again.

    Not for rough ones: second derivatives of the displacements have the noise of the residual in them, whose product would pass for an effect. Nor for tests
    without an equation inside, as homogeneous ones: of what varies over the specimen they see one factor on the force, in which a material would hide.
    """
    own = [e for e in effects if belongs_to_one_test(e) and not e.rough and untestable(problem.of_one_test, e) is None]
    levels: list[Effect] = (
        [StiffnessLevel()] if have_unknown_levels([part.experiment for part in problem.trained]) else []
    )
    for _ in range(PASSES):
        parts = []
        for part in problem.parts:
            seen = own if part.train.size and part.inside.any() else []
            seen = seen + levels if part in problem.trained[1:] else seen
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
    the same; `common` is 0 where its shapes are other ones in other tests. prior (p,): standard deviations of its amplitudes, in their units. values, deviations
    (n, p): amplitudes, the sum over shapes, alike where it is common, else each its own; deviations of noise and of the formula, see `Effect.formula_error`.
    limit: deviations from none beyond which an amplitude is seen."""

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
        """Tests that have it for themselves, or where it is seen and nothing says that others have the same."""
        if self.is_common or not self.is_there:
            return ()
        return tuple(
            name for k, name in enumerate(self.tests) if any(self.is_seen(k, i) for i in range(len(self.prior)))
        )

    @property
    def lacking(self) -> tuple[str, ...]:
        """Tests that have it for themselves, or with all others, so that a joint model lacks it; none where it stands in for something, which excuses no test."""
        if not (self.is_there and self.is_plausible):
            return ()
        return self.tests if self.is_common else self.seen_in

    @property
    def is_plausible(self) -> bool:
        """Whether no amplitude is beyond what a specimen could have; else it stands in for something that nothing in the joint model has."""
        return bool(np.all(np.abs(self.values) <= FAR * np.array(self.prior)))

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


def apart(own: Sequence[OwnEffect]) -> frozenset[str]:
    """Tests that have something beside a joint model that a replay lacks, but for a level."""
    return frozenset(name for one in own if not isinstance(one.effect, StiffnessLevel) for name in one.lacking)


def of_own_level(own: Sequence[OwnEffect]) -> frozenset[str]:
    """Tests with a level of their own beside a joint model."""
    return frozenset(name for one in own if isinstance(one.effect, StiffnessLevel) for name in one.lacking)


def refined_levels(levels: Sequence[Level], own: Sequence[OwnEffect]) -> tuple[Level, ...]:
    """Levels with what each test was found to have of a `StiffnessLevel`; where that is beyond what may be left of one, the joint fit misses the forces, and the level is as uncertain as
    before it."""
    found = {
        test: (1 + g, deviation) if abs(g) < FAR * prior else (1.0, prior)
        for one in own
        if isinstance(one.effect, StiffnessLevel)
        for prior in one.prior
        for test, (g,), (deviation,) in zip(one.tests, one.values, one.deviations, strict=True)
    }
    return tuple(
        replace(level, factor=level.factor * found[level.test][0], deviation=level.factor * found[level.test][1])
        if level.test in found
        else level
        for level in levels
    )


class OwnSignatures(NamedTuple):
    """What tests may have beside a joint fit. cells: name of a test, an effect, and its signatures (N, k), columns of the same shape side by side. D (N, d): smooth
    disturbances, orthonormal. Both are outside what the fit adjusts, and all rows are to be taken over `scale`, the root of the dispersion."""

    cells: tuple[tuple[str, OwnSignature, Array], ...]
    D: Array
    scale: float

    @classmethod
    def of(cls, problem: Problem, plain: Problem, fit: Fit, priors: Priors) -> OwnSignatures:
        """Of a fit to `problem`, in the weights of `plain`, which allow for none."""
        adjusted = [equations.base_columns(plain, fit.chains) @ plain.cone]
        if fit.additions:
            adjusted.append(equations.signatures(plain, fit.chains, fit.c, fit.additions))
        U = orthonormal(np.concatenate(adjusted, axis=1))
        start, cells = 0, []
        for part, chain, known in zip(plain.trained, fit.chains, (p.own for p in problem.trained), strict=True):
            inside = slice(start, start := start + part.train.size)
            for one in known:
                found = _signature(problem, chain, fit.c, one.effect, priors, fit.additions)
                if np.isfinite(found.sources).all():
                    S = np.zeros((len(U), found.sources.shape[-1]))
                    S[inside] = part.train(np.moveaxis(found.sources, -1, 0)).T
                    cells.append((part.experiment.name, found, S - U @ (U.T @ S)))
        scale = max(1.0, fit.free_loss / max(fit.degrees, 1)) ** 0.5
        return cls(tuple(cells), disturbances(plain, U), scale)

    def told(self, residual: Array) -> tuple[OwnEffect, ...]:
        """Of a whitened residual (N,) of the fit."""
        names = list(dict.fromkeys(one.effect.name for _, one, _ in self.cells))
        if not names:
            return ()
        found: list[Signature] = []
        choices: list[list[tuple[int, ...]]] = []
        for name in names:
            ways = self._ways(name)
            choices.append([(), *((len(found) + i,) for i in range(len(ways)))])
            found += ways
        evidence = Evidence(tuple(found), residual / self.scale, self.D, float(np.log(EXPECTED / len(names))))
        subsets = evidence.subsets([sum(choice, ()) for choice in product(*choices)])
        chances = special.softmax([one.log_evidence for one in subsets])
        limit = float(stats.norm.isf(0.5 * SEEN / sum(len(one.deviation) for _, one, _ in self.cells)))
        return tuple(self._told(name, evidence, subsets, chances, limit) for name in names)

    def _ways(self, name: str) -> list[Signature]:
        """An effect as each test has its own, and, where all have the same shapes, as all have the same."""
        own = [(one, S / self.scale) for _, one, S in self.cells if one.effect.name == name]
        ways = [np.concatenate([S for _, S in own], axis=1)]
        if len(own) > 1 and len({S.shape for _, S in own}) == 1:
            ways.append(np.sum([S for _, S in own], axis=0))
        bounded = [p.lower == p.null for p in own[0][0].effect.amplitudes]
        error = own[0][0].effect.formula_error
        sided = (np.tile(bounded, S.shape[1] // len(bounded)) for S in ways)
        return [Signature(name, (), S, 1 / len(ways), one, "", error) for S, one in zip(ways, sided, strict=True)]

    def _told(
        self, name: str, evidence: Evidence, subsets: Sequence[Subset], chances: Array, limit: float
    ) -> OwnEffect:
        """An effect by the evidence of all answers, with its amplitudes in the most probable one."""
        ways = [i for i, signature in enumerate(evidence.signatures) if signature.name == name]
        own, *common = (sum(p for p, one in zip(chances, subsets, strict=True) if i in one.members) for i in ways)
        alike = bool(common) and common[0] > CERTAIN
        way = ways[1] if alike else ways[0]
        members = next(one.members for one in sorted(subsets, key=lambda one: -one.log_evidence) if way in one.members)
        mean, covariance = evidence.posterior(members)
        start = sum(evidence.signatures[i].columns.shape[1] for i in members[: members.index(way)])
        first = next(one for _, one, _ in self.cells if one.effect.name == name)
        wrong = first.effect.formula_error
        tests, values, deviations = [], [], []
        for test, one, S in self.cells:
            if one.effect.name == name:
                place, p = slice(start, start + S.shape[1]), len(one.deviation)
                shapes = S.shape[1] // p
                sums = np.tile(np.eye(p), shapes) * one.deviation[:, None] / np.sqrt(shapes)
                a, variance = sums @ mean[place], np.diag(sums @ covariance[place, place] @ sums.T)
                tests.append(test)
                values.append(tuple(map(float, a)))
                deviations.append(tuple(map(float, np.sqrt(variance + (wrong * a) ** 2))))
                start += 0 if alike else S.shape[1]
        chance = float(own), float(common[0]) if common else 0.0
        prior = tuple(map(float, first.deviation))
        return OwnEffect(first.effect, tuple(tests), *chance, prior, tuple(values), tuple(deviations), limit)
