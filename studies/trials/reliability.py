"""How often what has a probability is there: judged trials in, the points of a reliability diagram out.

A probability is calibrated where, of the effects that have a probability p, a share p is there (DeGroot and Fienberg 1983).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from calibrate.effects import CATALOGUE
from studies.trials.judgement import JudgedTrial

EDGES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)


@dataclass(frozen=True)
class Reliability:
    """Effects, over all trials, whose probability is from `low` up to `high`: how many, their mean probability, and how many were there."""

    low: float
    high: float
    effects: int
    mean: float
    there: int


@dataclass(frozen=True)
class Replaced:
    """Trials whose rounds had found other effects before a more probable explanation took their place. better, worse: of all hidden effects, more
    or fewer are among those of the model than were before."""

    trials: int
    better: int
    worse: int


def reliability(trials: Sequence[JudgedTrial]) -> tuple[Reliability, ...]:
    """Of every effect of the catalogue in every trial whose explanations were fitted; intervals without an effect are left out."""
    told = [one for one in trials if one.probabilities is not None]
    names = [effect.name for effect in CATALOGUE]
    p = np.array(
        [[one.probabilities.get(name, 0.0) for name in names] for one in told if one.probabilities is not None]
    )
    there = np.array([[name in one.hidden for name in names] for one in told])
    found = []
    for low, high in pairwise(EDGES):
        here = (p >= low) & ((p < high) | (high == EDGES[-1]))
        if here.any():
            found.append(Reliability(low, high, int(here.sum()), float(p[here].mean()), int(there[here].sum())))
    return tuple(found)


def replaced(trials: Sequence[JudgedTrial]) -> Replaced:
    """Of trials with something hidden."""
    changed = [one for one in trials if one.replaced is not None and one.hidden]
    gains = [
        len(set(one.hidden) & {*one.named, *one.closest}) - len(set(one.hidden) & set(one.replaced or ()))
        for one in changed
    ]
    return Replaced(len(changed), sum(gain > 0 for gain in gains), sum(gain < 0 for gain in gains))
