"""Weights of a diagnosis that belong to a model: the noise that a base and its effects make of measured displacements.

In: a `Problem`, a base and effects. Out: the same equations with other weights.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, reduce

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis import base_functions
from calibrate.diagnosis import problem as equations
from calibrate.diagnosis.problem import Part, Problem, Unweighted, mean_of_noise, residual
from calibrate.diagnosis.residual_tests import rough_dispersion
from calibrate.effects.chain import Additions, Chain
from calibrate.effects.chain.true_surface import is_expressed
from calibrate.equations import discretisation_error
from calibrate.equations.basis import PlaneStrainBasis, SingleBasis
from calibrate.equations.noise_covariance import EquationNoise
from calibrate.equations.reduction import coefficients_of_weights, stacked
from calibrate.equations.weights import Sources, Weights, weights_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def weighted_part(
    test: Unweighted,
    basis: SingleBasis | PlaneStrainBasis,
    c: Array,
    train: Mask,
    held: Mask,
    with_discrepancy: bool,
    additions: Additions = (),
    others: Sequence[Unweighted] = (),
) -> Part:
    """One Experiment with the weights that belong to the material with coefficients c (n,) and effects; c as stiff as both. others: see `noise_of`."""
    sources = [Sources.of(one.sources) for one in test.own]
    if with_discrepancy:
        given = test.system, basis, c
        found = (
            discretisation_error.sources(*given)
            if test.twin is None
            else discretisation_error.remainder(*given, test.twin)
        )
        sources.append(found)
    common = reduce(Sources.beside, sources) if sources else None
    noise = noise_of(test, c, additions if train.any() else (), others)
    chain = test.chain.remembering()
    fitted, kept = _weights(noise, train, held, common)
    return Part(
        chain, test.assembled, test.twin, test.own, test.denoised, train=fitted, held=kept,
        shift=mean_of_noise(chain, test.assembled, c), common=common,
        together=_together(noise, train, held, common),
    )  # fmt: skip


def amplified(problem: Problem, additions: Additions) -> Problem:
    """The same equations and base with the weights of a model with these effects.

    Effects that take second derivatives of the displacements amplify their noise. Those in the material change what stress
    a noise makes, above all where they remember or stiffen; the weights know them as they were when `reweighted`, as long
    as they are in the model. With weights that do not know it, the misfit of the true model may be larger than that of none.
    """
    names = {a.effect.name for a in additions}
    known = tuple(a for a in problem.amplifying if not a.effect.rough and a.effect.name in names)
    found = (*known, *(a for a in amplifying(problem, additions) if a.effect.rough))
    if found == problem.amplifying:
        return problem
    parts = []
    for part in problem.parts:
        known = found if part.train.size else ()
        parts.append(_weighted_by(part, noise_of(part, problem.weights_c, known, problem.trained)))
    return replace(problem, parts=tuple(parts), amplifying=found)


def _weighted_by(part: Part, noise: EquationNoise) -> Part:
    """The same equations with the weights of a noise."""
    given = noise, part.train.rows, part.held.rows, part.common
    train, held = _weights(*given)
    return replace(part, train=train, held=held, together=_together(*given))


def _weights(noise: EquationNoise, train: Mask, held: Mask, common: Sources | None) -> tuple[Weights, Weights]:
    """Of the equations used for fitting and of those held out, each for themselves."""
    return weights_of(noise, train, common), weights_of(noise, held, common)


@dataclass(frozen=True, eq=False)
class _Together:
    """Weights of what is fitted and what is held out together, made where they are asked for. rows (t, 2 v)."""

    noise: EquationNoise = field(repr=False)
    rows: Mask = field(repr=False)
    common: Sources | None = field(repr=False)

    @cached_property
    def _weights(self) -> Weights:
        return weights_of(self.noise, self.rows, self.common)

    def __call__(self) -> Weights:
        return self._weights


def _together(noise: EquationNoise, train: Mask, held: Mask, common: Sources | None) -> Callable[[], Weights] | None:
    """Of both together, where increments have noise in common."""
    if noise.is_new_in_each or not (train.any() and held.any()):
        return None
    return _Together(noise, train | held, common)


def noise_of(test: Unweighted, c: Array, additions: Additions, others: Sequence[Unweighted] = ()) -> EquationNoise:
    """What noise does to the equations of a material as stiff as with coefficients c (n,) and effects. others: tests of the same material, whose loads tell how stiff effects make it where this one has no load.

    An effect that remembers meets the measured displacements: from which picture a softened place has its largest strain is a matter of noise, which a tangent at the true ones does not know.
    """
    chain, assembled = _chain(test, additions), test.assembled
    if not additions:
        return assembled.noise_at(c, test.denoised)
    has_load = bool(chain.external().any())
    loaded = [chain] if has_load else [_chain(one, additions) for one in others if one.chain.external().any()]
    if loaded:
        c = c * _work(loaded, c, ()) / _work(loaded, c, tuple(a for a in additions if a.effect.in_material))
    increments, shares = assembled.samples
    each = chain.spread_of_noise(c, additions, assembled.fewest_sources, increments)
    return EquationNoise.of(chain.system, assembled.noise, stacked(each, len(increments)), shares)


def _chain(test: Unweighted, additions: Additions) -> Chain:
    """At displacements without the noise that shows in the residual, where these are known and nothing remembers."""
    if test.denoised is None or any(a.effect.remembers for a in additions):
        return test.chain
    return test.chain.disturbed(test.denoised - np.asarray(test.chain.data.u))


def _work(chains: Sequence[Chain], c: Array, additions: Additions) -> float:
    """Of the measured loads on what the material has inside, N^2, by which its stiffness is measured."""
    loads = [chain.external() for chain in chains]
    inside = (chain.residual(c, additions) + load for chain, load in zip(chains, loads, strict=True))
    return sum(float((load * one).sum()) for load, one in zip(loads, inside, strict=True))


def amplifying(problem: Problem, additions: Additions) -> Additions:
    """Effects that change what noise does, where it is known."""
    if not problem.noise_is_known:
        return ()
    return tuple(
        a
        for a in additions
        if (a.effect.rough or a.effect.in_material)
        and any(v != p.null for v, p in zip(a.amplitudes, a.effect.amplitudes, strict=True))
    )


def reweighted(problem: Problem, c: Array, additions: Additions, chains: Sequence[Chain] = ()) -> Problem:
    """The same equations with the weights of a fit (c (n,), effects): those of its base, as stiff as base and effects are; and with its dispersion.

    chains: of the trained parts at displacements without the noise that shows in the residual, as a fit has them. At the measured ones the noise of a residual is in its weight,
    too: of the same order as the mean that noise brings into the residual, it shifts amplitudes. None: as they were.
    """
    found = iter(chains)
    parts = tuple(
        replace(p, denoised=np.asarray(next(found).data.u)) if chains and p.train.size else p for p in problem.parts
    )
    return _weighted(replace(problem, parts=parts), c, additions, amplifying(problem, additions))


def as_stiff(problem: Problem, c: Array, additions: Additions) -> Problem:
    """The same, but what effects do to noise stays as it is."""
    return _weighted(problem, c, additions, problem.amplifying)


def with_own_noise(problem: Problem, c: Array, additions: Additions) -> Problem:
    """As stiff as a model, with what its effects do to noise; at the displacements without noise that are there."""
    return _weighted(problem, c, additions, amplifying(problem, additions))


def _weighted(problem: Problem, c: Array, additions: Additions, known: Additions) -> Problem:
    """With weights of a fit, as the effects amplify the noise that are known. Effects of the measurement make no material stiffer."""
    measured = tuple(a for a in additions if is_expressed(a.effect))
    chains = [part.chain for part in problem.trained]
    whole, fitted, r = _work(chains, c, additions), c, residual(problem, c, additions)
    c = c * whole / _work(chains, c, measured)
    neo_hooke = base_functions.first_guess([(part.assembled, part.train.rows) for part in problem.trained])
    neo_hooke *= whole / _work(chains, neo_hooke, measured)
    c = coefficients_of_weights(problem.basis, c, neo_hooke, equations.dispersion(problem, r))
    heavier = _of_coefficients(problem, c, known)
    return replace(heavier, dispersion=rough_dispersion(heavier, residual(heavier, fitted, additions)))


def without_own_effects(problem: Problem) -> Problem:
    """The same equations with weights that allow for no effects of single tests."""
    parts = tuple(replace(part, own=()) for part in problem.parts)
    return _of_coefficients(replace(problem, parts=parts), problem.weights_c, problem.amplifying)


def _of_coefficients(problem: Problem, c: Array, known: Additions) -> Problem:
    """With the weights that belong to coefficients c (n,) as stiff as the material is, and to effects."""
    parts = [
        weighted_part(p, problem.basis, c, p.train.rows, p.held.rows, problem.with_discrepancy, known, problem.trained)
        for p in problem.parts
    ]
    return replace(problem, parts=tuple(parts), weights_c=c, amplifying=known)
