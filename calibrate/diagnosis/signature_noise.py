"""Noise in signatures: of the displacements it is both in the residual and in its derivatives, which biases their product.

In: a `Problem` and a model. Out: displacements without the noise that shows in the residual, and what the noise that does not
show adds to the squares of a signature.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis import model_weights
from calibrate.diagnosis import problem as equations
from calibrate.diagnosis.problem import Part, Problem
from calibrate.effects.chain import Additions, Chain
from calibrate.equations import noise_covariance

Array = NDArray[np.float64]
SAMPLES = 2  # of noise, for its part in a signature


def denoised(problem: Problem, c: Array, additions: Additions, r: Array, dispersion: float) -> list[Chain]:
    """The trained chains at displacements without the noise that shows in the whitened residual r (N,).

    Signatures and residuals of noisy displacements hold the same noise, which biases their product. The maximum of the
    likelihood, whose covariance C follows the parameters, has no such bias; its derivative by a parameter is S^T C^-1 r
    with the signature S taken at u - Sigma K^T C^-1 r, the best linear estimate of the true displacements (K: tangent,
    Sigma: covariance of the noise). dispersion: only this part of the squared residual is taken for noise.
    """
    pairs = zip(problem.trained, visible_noise(problem, c, additions, r), strict=True)
    return [part.chain.disturbed(-noise / dispersion) for part, noise in pairs]


def visible_noise(problem: Problem, c: Array, additions: Additions, r: Array) -> list[Array]:
    """Sigma K^T C^-1 r (t, n, 2), mm, of each trained part; K knows of effects those that the weights know."""
    known = model_weights.amplifying(problem, additions)
    found, start = [], 0
    for part in problem.trained:
        forces = part.train.adjoint(r[start : start + part.train.size])
        start += part.train.size
        found.append(_noise_that_makes(part, c, known, forces))
    return found


def denoised_everywhere(part: Part, c: Array) -> Chain:
    """The chain of a test at displacements without the noise that shows in the residual of a base c (n,), also of equations that are held out: for weights, not for fits."""
    r = part.residual(c)
    forces, rows, squares = np.zeros(r.shape), 0, 0.0
    for weights in [part.together()] if part.together else [part.train, part.held]:
        white = weights(r)
        forces += weights.adjoint(white)
        rows, squares = rows + len(white), squares + float(white @ white)
    return part.chain.disturbed(-_noise_that_makes(part, c, (), forces) / max(1.0, squares / max(rows, 1)))


def _noise_that_makes(part: Part, c: Array, additions: Additions, forces: Array) -> Array:
    """Sigma K^T f (t, n, 2), mm, of weighted residuals f (t, 2 v), 1 / N."""
    factor = part.assembled.noise_factor
    noise = np.moveaxis(part.chain.pulled_back(c, additions, forces), 1, 0)
    flat = factor @ (factor.T @ noise.reshape(len(noise), -1))
    return np.tensordot(part.assembled.between, flat.reshape(noise.shape), (1, 1))


def hidden_noise(problem: Problem, chains: Sequence[Chain], c: Array, additions: Additions) -> list[list[Array]]:
    """Samples of noise (t, n, 2), mm, of each trained part, without what would show in the residual."""
    rough, samples = model_weights.amplifying(problem, additions), []
    rng = np.random.default_rng(0)
    for _ in range(SAMPLES):
        noise = [
            noise_covariance.common_sample(part.assembled.noise_factor, rng, part.assembled.between)
            for part in problem.trained
        ]
        moved = [chain.disturbed(z) for chain, z in zip(chains, noise, strict=True)]
        change = [m.residual(c, rough) - k.residual(c, rough) for m, k in zip(moved, chains, strict=True)]
        seen = visible_noise(problem, c, rough, problem.whiten(change))
        samples.append([z - s for z, s in zip(noise, seen, strict=True)])
    return samples


def excess(
    problem: Problem,
    chains: Sequence[Chain],
    c: Array,
    additions: Additions,
    U: Array,
    scale: Array,
    S: Array,
    hidden: list[list[Array]],
) -> Array:
    """(p, p): what `hidden_noise` adds to M, by the signature S (N, p), times scale (p,), of the last addition beside U.

    The noise that shows in the residual has been taken out, that which does not is independent of it: the score has the
    variance M, but its slope is M less this, so that the amplitude is -(M - excess)^-1 g.
    """
    total = np.zeros((len(scale), len(scale)))
    for sample in hidden:
        moved = [chain.disturbed(z) for chain, z in zip(chains, sample, strict=True)]
        change = equations.signature(problem, moved, c, additions) * scale - S
        change = change - U @ (U.T @ change)
        total += change.T @ change / len(hidden)
    return total


def of_rough_effects(
    problem: Problem, chains: Sequence[Chain], c: Array, additions: Additions, U: Array, scale: Array, S: Array
) -> Array:
    """(k, k): what hidden noise adds to the squares of the signatures S (N, k), times scale (k,), of all amplitudes and shapes beside U: of rough effects alone, each by itself."""
    found, start = np.zeros((len(scale), len(scale))), 0
    rough = problem.noise_is_known and any(one.effect.rough for one in additions)
    hidden = hidden_noise(problem, chains, c, additions) if rough else []
    for one in additions:
        own = slice(start, start + len(one.amplitudes))
        if hidden and one.effect.rough:
            others = tuple(a for a in additions if a is not one)
            found[own, own] = excess(problem, chains, c, (*others, one), U, scale[own], S[:, own], hidden)
        start = own.stop + len(one.shape)
    return found
