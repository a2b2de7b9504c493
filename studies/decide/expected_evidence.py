"""How much a test is expected to say for one explanation against another, before it is made.

In: an Experiment without noise, `Rivals`, priors. Out: the difference of their ln evidence on the data that the first is expected to give: the residual -S a,
with S its signature beside the base that the test would have and a its amplitudes as they were found. Both are weighed as a diagnosis weighs them
(`calibrate.diagnosis.evidence.linear_evidence`): amplitudes free within their priors, all shapes tried, each with an equal share of the prior, the error of the formulas allowed for. This is the
expected utility of Lindley (1956) for the choice between two models, linear in the amplitudes.

Noise of unit variance in the residual adds to the ln evidence of k amplitudes, in the mean, half the number of those that the test determines,
(k - tr M^-1) / 2, M^-1 their posterior covariance over that of the prior (MacKay 1992): more to many amplitudes than to one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from calibrate.data.experiment import Experiment
from calibrate.diagnosis.base_fit import prepare
from calibrate.diagnosis.evidence.linear_evidence import Evidence, Subset
from calibrate.diagnosis.evidence.priors import Priors
from calibrate.diagnosis.evidence.signatures import evidence, modulus, prior_deviations
from calibrate.diagnosis.problem import Problem, all_rows
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from studies.decide.rivals import Rivals

Array = NDArray[np.float64]


def expected(e: Experiment, pairs: Sequence[Rivals], stiffness: float, priors: Priors) -> list[float | None]:
    """ln evidence for each pair's truth against its others; None where the test cannot show the truth. stiffness: shear modulus of the base that the
    amplitudes were found beside, MPa or N/mm.

    Raises `FitError`, and the errors of `calibrate.equations.equilibrium.equilibrium`.
    """
    problem, base = prepare([e], [all_rows])
    chains = [part.chain for part in problem.trained]
    known = {effect.name: effect for effect in CATALOGUE}
    found: list[float | None] = []
    for pair in pairs:
        effects = [known[name] for name in dict.fromkeys((*pair.names, *pair.others))]
        shapes = {a.effect.name: a.shape for a in pair.truth if a.shape}
        weighed = evidence(problem, base, chains, effects, priors, shapes)
        change = _change(problem, weighed, pair, modulus(problem) / stiffness, priors)
        if change is None:
            found.append(None)
            continue
        found.append(difference(replace(weighed, r=-change), pair.names, pair.others))
    return found


def difference(weighed: Evidence, names: Sequence[str], others: Sequence[str]) -> float:
    """ln evidence of effects less that of others in the mean over the noise; the residual of `weighed` has none."""
    return _of_all_shapes(weighed, names) - _of_all_shapes(weighed, others)


def _change(problem: Problem, weighed: Evidence, pair: Rivals, stiffer: float, priors: Priors) -> Array | None:
    """What the truth adds to the whitened equations (N,); None where a signature is missing."""
    total = np.zeros(len(weighed.r))
    for a in pair.truth:
        own = [s for s in weighed.signatures if s.name == a.effect.name and (not a.shape or s.shape == a.shape)]
        if not own:
            return None
        total += own[-1].columns @ (_amplitudes(a, stiffer) / prior_deviations(problem, a.effect, priors))
    return total


def _amplitudes(a: Addition, stiffer: float) -> Array:
    """Distances (p,) from the null values beside a base that is as many times stiffer."""
    pairs = zip(a.effect.amplitudes, a.amplitudes, strict=True)
    return np.array([(value - p.null) * stiffer**p.stiffness_power for p, value in pairs])


def _of_all_shapes(weighed: Evidence, names: Sequence[str]) -> float:
    """ln evidence of effects, of all their shapes, with what noise adds and without prior odds; those that the test cannot show are left out."""
    places = [[i for i, s in enumerate(weighed.signatures) if s.name == name] for name in names]
    subsets = [weighed.subset(members) for members in product(*(own for own in places if own))]
    values = [one.log_evidence - len(one.members) * weighed.log_odds for one in subsets]
    return float(logsumexp([value + _of_noise(weighed, one) for value, one in zip(values, subsets, strict=True)]))


def _of_noise(weighed: Evidence, one: Subset) -> float:
    """What noise adds to the ln evidence of a subset in the mean."""
    if not one.members:
        return 0.0
    amplitudes, covariance = weighed.posterior(one.members)
    return 0.5 * float(len(amplitudes) - np.trace(covariance))
