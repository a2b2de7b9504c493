"""Which pictures of an Experiment a command uses: the one rule of the project.

In: an Experiment with every picture of the test, and how many are wanted. Out: an Experiment with those, which says in its provenance which they are.

The cost of a fit grows with points times pictures. Where nobody says how many, they are all used as long as that product is affordable, and
otherwise spread evenly over the pictures that were taken.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.data.experiment import WHOLE, Experiment

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Wanted = Literal["all"] | int | tuple[int, ...] | None
AFFORDABLE = 40_000  # points times pictures
FEWEST = 12  # pictures, however many points there are
TURN = 0.1  # of the largest deformation, by which the load goes back after a turn
UNSEEN = (
    0.02  # of the largest deformation, by which a specimen may have been deformed more than the chosen pictures show
)


def chosen(experiment: Experiment, wanted: Wanted = None) -> Experiment:
    """The Experiment with the pictures wanted: all, at most so many, or those of numbers, from 1; None: as many as are affordable.

    Raises `ConfigError` for numbers that do not rise, or of no picture.
    """
    n = experiment.n_increments
    if isinstance(wanted, int) and wanted < 1:
        raise errors.ConfigError(f"pictures = {wanted}: give how many are used, at least 1, 'all', or their numbers")
    index = _listed(wanted, experiment) if isinstance(wanted, tuple) else spread(experiment, _most(experiment, wanted))
    if len(index) == n:
        return experiment
    found = experiment.select(index)
    told = {"used": (index + 1).tolist(), "of": n, "asked_for": wanted is not None}
    return replace(found, provenance={**found.provenance, "pictures": told, WHOLE: experiment.whole})


def spread(experiment: Experiment, most: int) -> Indices:
    """At most `most` increments, evenly spread, the last among them; one is exchanged for its neighbour where the load turns, and where the specimen would
    otherwise have been deformed more than they show: relaxation, softening and permanent set depend on the course."""
    n = experiment.n_increments
    size = min(n, most)
    index = np.unique(np.round(np.linspace(n / size - 1, n - 1, size)).astype(np.int64))
    if len(index) == n:
        return index
    shares = experiment.deformation_shares
    return _with_peaks(shares, *_with_turns(shares, index))


def turns(shares: Array) -> list[int]:
    """Increments at which the deformation, shares (n,) of the largest, turns by more than `TURN`."""
    found, last, direction = list[int](), 0, 0
    for i, share in enumerate(shares.tolist()):
        further = (share - shares[last]) * direction
        if direction == 0 and abs(share - shares[last]) > TURN:
            last, direction = i, 1 if share > shares[last] else -1
        elif further > 0:
            last = i
        elif further < -TURN:
            found.append(last)
            last, direction = i, -direction
    return found


def _with_turns(shares: Array, index: Indices) -> tuple[Indices, set[int]]:
    """index (k,), rising, with the turns, and these; as it is where they would take more than half of the places."""
    needed = turns(shares)
    if 2 * len(needed) > len(index):
        return index, set()
    kept, held = index.tolist(), set(needed)
    for turn in needed:
        if turn not in kept:
            kept.remove(min((i for i in kept[:-1] if i not in held), key=lambda i: abs(i - turn)))
            kept = sorted([*kept, turn])
    return np.array(kept, dtype=np.int64), held


def _with_peaks(shares: Array, index: Indices, held: set[int]) -> Indices:
    """shares (n,) of the deformation; index (k,), rising; held: those that stay."""
    kept, peaks = index.copy(), set(held)
    for _ in range(len(index)):
        missed = np.maximum.accumulate(shares)[kept] - np.maximum.accumulate(shares[kept])
        worst = kept[np.argmax(missed)]
        peak = int(np.argmax(shares[: worst + 1]))
        others = [i for i in kept[:-1].tolist() if i not in peaks]
        if missed.max() <= UNSEEN or not others:
            break
        gone = min(others, key=lambda i: abs(i - peak))
        kept = np.unique([peak if i == gone else i for i in kept.tolist()]).astype(np.int64)
        peaks.add(peak)
    return kept


def _most(experiment: Experiment, wanted: Literal["all"] | int | None) -> int:
    if wanted == "all":
        return experiment.n_increments
    return wanted or max(FEWEST, AFFORDABLE // len(experiment.points))


def _listed(numbers: tuple[int, ...], experiment: Experiment) -> Indices:
    index = np.array(numbers, dtype=np.int64) - 1
    if index.size == 0 or (np.diff(index) <= 0).any() or index[0] < 0 or index[-1] >= experiment.n_increments:
        raise errors.ConfigError(
            f"{experiment.name}: pictures {', '.join(map(str, numbers))}; give rising numbers from 1 to {experiment.n_increments}"
        )
    return index
