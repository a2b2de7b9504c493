"""Effects that every one of several tests has for itself: marginalised in the joint fit, told test by test beside it.

In: a `Problem` of several tests, effects, priors. Out: the same problem with weights that allow for such effects in each test, and `OwnEffect`s.

A warp or a gradient of thickness belongs to one specimen. Fitted to all tests together it would be wrong in most, and left out it would be taken for
the material. So each test has its own, with a normal prior: with L its standard deviations and S its signatures the covariance of the equations gains
S L^2 S^T (the marginal likelihood of a mixed model; Pinheiro and Bates 2000, 2.1). What each test has of it is then the best linear unbiased predictor
(Robinson 1991), linear about the base,

    a = -L^2 S^T P r,   cov a = L^2 - L^2 S^T P S L^2,   P = V^-1 - V^-1 U (U^T V^-1 U)^-1 U^T V^-1,

with r the residual and U what the joint model adjusts. Freed of the prior, estimates of one amplitude in several tests are compared: where they are
alike, the effect is that of the rig or of how the specimens are made, and of no specimen alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from calibrate.diagnosis import model_weights
from calibrate.diagnosis.effect_fit import Fit, refit
from calibrate.diagnosis.evidence.priors import Priors
from calibrate.diagnosis.evidence.signatures import prior_deviations
from calibrate.diagnosis.problem import OwnSignature, Part, Problem
from calibrate.diagnosis.score_tests import belongs_to_one_test, untestable
from calibrate.effects import Effect
from calibrate.effects.effect import Parameter

Array = NDArray[np.float64]
SEEN = 0.05  # of all amplitudes in all tests together: probability that any is called seen where none is (Bonferroni)
ALIKE = 0.05  # p of a chi-square test, above which estimates are alike
TOLD = 0.1  # share of the prior variance that a test must take away to count


def with_own_effects(problem: Problem, base: Fit, effects: Sequence[Effect], priors: Priors) -> tuple[Problem, Fit]:
    """The problem of several tests with weights that allow for the effects of each, and the base fitted again.

    Not for rough ones: second derivatives of the displacements have the noise of the residual in them, whose product would pass for an effect. Nor for tests
    without an equation inside, as homogeneous ones: of what varies over the specimen they see one factor on the force, in which a material would hide.
    """
    own = [e for e in effects if belongs_to_one_test(e) and not e.rough and untestable(problem.of_one_test, e) is None]
    parts = []
    for part in problem.parts:
        seen = own if part.train.size and part.inside.any() else []
        known = tuple(_signature(problem, part, base.c, effect, priors) for effect in seen)
        parts.append(replace(part, own=tuple(one for one in known if np.isfinite(one.sources).all())))
    problem = model_weights.reweighted(replace(problem, parts=tuple(parts)), base.c, ())
    return problem, refit(problem, base.c, ())


def _signature(problem: Problem, part: Part, c: Array, effect: Effect, priors: Priors) -> OwnSignature:
    shapes = effect.shape_values(part.chain.data)
    deviation = prior_deviations(problem, effect, priors)
    each = [part.chain.signature(c, effect, tuple(shape)) * deviation[:, None, None] for shape in shapes]
    return OwnSignature(effect, deviation, np.moveaxis(np.concatenate(each), 0, -1) / np.sqrt(len(shapes)))


@dataclass(frozen=True)
class OwnEffect:
    """One amplitude in every test. values, deviations (n,): in each, in its unit; prior: its standard deviation. estimates, errors (n,): the same without
    the prior, NaN where the test tells nothing of it. limit: standard deviations from none beyond which it is seen."""

    effect: Effect
    parameter: Parameter
    tests: tuple[str, ...]
    prior: float
    values: tuple[float, ...]
    deviations: tuple[float, ...]
    estimates: tuple[float, ...]
    errors: tuple[float, ...]
    limit: float

    @property
    def mean(self) -> tuple[float, float]:
        """Of the estimates, weighted by their variances, and its standard deviation; NaN where no two tests tell of it."""
        a, weights = self._known
        if len(a) < 2:
            return float("nan"), float("nan")
        return float(weights @ a / weights.sum()), float(weights.sum() ** -0.5)

    @property
    def is_common(self) -> bool:
        """Whether it is there, and alike in all tests that tell of it."""
        mean, error = self.mean
        a, weights = self._known
        if not abs(mean) > self.limit * error:
            return False
        return bool(stats.chi2.sf(weights @ (a - mean) ** 2, len(a) - 1) > ALIKE)

    @property
    def seen_in(self) -> tuple[str, ...]:
        """Tests that have it for themselves."""
        if self.is_common:
            return ()
        rows = zip(self.tests, self.estimates, self.errors, strict=True)
        return tuple(name for name, a, d in rows if abs(a) > self.limit * d)

    @property
    def _known(self) -> tuple[Array, Array]:
        a, errors = np.array(self.estimates), np.array(self.errors)
        told = np.isfinite(a)
        return a[told], errors[told] ** -2


def own_effects(problem: Problem, fit: Fit) -> tuple[OwnEffect, ...]:
    """What every test has for itself beside a joint fit; none for a single test."""
    found: dict[tuple[str, int], list[tuple[str, float, float, OwnSignature]]] = {}
    start, rows = 0, len(fit.residual)
    spread = max(1.0, fit.free_loss / max(fit.degrees, 1))
    for part in problem.trained:
        inside = slice(start, start := start + part.train.size)
        for one in part.own:
            S = np.zeros((rows, one.sources.shape[-1]))
            S[inside] = part.train(np.moveaxis(one.sources, -1, 0)).T
            S -= fit.columns @ (fit.columns.T @ S)
            mean, told = _of_amplitudes(-(S.T @ fit.residual), S.T @ S, len(one.deviation))
            for i, (size, a, k) in enumerate(zip(one.deviation, mean, told, strict=True)):
                place = found.setdefault((one.effect.name, i), [])
                place.append((part.experiment.name, size * a, size * np.sqrt(max(1 - k / spread, 0.0)), one))
    limit = float(stats.norm.isf(0.5 * SEEN / max(sum(map(len, found.values())), 1)))
    return tuple(_own_effect(i, cells, limit) for (_, i), cells in found.items())


def _of_amplitudes(g: Array, M: Array, p: int) -> tuple[Array, Array]:
    """Mean (p,) of the sum over shapes of every amplitude, in prior standard deviations, and the share (p,) of its prior variance that is told."""
    sums = np.tile(np.eye(p), len(g) // p) / np.sqrt(len(g) / p)
    return sums @ g, np.clip(np.einsum("pk,kl,pl->p", sums, M, sums), 0.0, 1 - 1e-9)


def _own_effect(i: int, cells: Sequence[tuple[str, float, float, OwnSignature]], limit: float) -> OwnEffect:
    names, values, deviations, (one, *_) = zip(*cells, strict=True)
    size = float(one.deviation[i])
    told = 1 - (np.array(deviations) / size) ** 2
    known = np.where(told > TOLD, told, np.nan)
    return OwnEffect(
        one.effect, one.effect.amplitudes[i], names, size, values, deviations,
        tuple(np.array(values) / known), tuple(np.array(deviations) / np.sqrt(known)), limit,
    )  # fmt: skip
