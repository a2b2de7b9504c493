"""In which order frames were taken, by their names.

In: names of files. Out: their order, the number or time that gives it, and in words what was found. A name is cut into text and
numbers; the number that differs from file to file gives the order. Where several differ, they have to agree.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibrate import errors

Array = NDArray[np.float64]
type Rule = Literal["auto", "natural"]
NUMBER = re.compile(r"\d+(?:[.,]\d+)?")
SECONDS = re.compile(r"(\d+(?:[.,]\d+)?) ?s(?![a-z])", re.IGNORECASE)


@dataclass(frozen=True)
class Order:
    """index (n,): positions in the order taken; values (n,): in that order, the number or time of each; None: names gave none.

    seconds: whether the values are times, s. found: what the order follows, in words.
    """

    index: tuple[int, ...]
    values: Array | None
    seconds: bool
    found: str


def frame_order(names: Sequence[str], rule: Rule = "auto") -> Order:
    """The order of files by their names, without folder and ending.

    rule: 'auto' refuses names whose numbers disagree; 'natural' compares them from left to right. One name without any number is
    the reference, and first. Raises `UndecidedError` for an ambiguous order.
    """
    skeletons = [NUMBER.sub("0", name) for name in names]
    plain = [i for i, name in enumerate(names) if not NUMBER.search(name)]
    numbered = [i for i in range(len(names)) if i not in plain]
    if len(plain) > 1:
        raise errors.UndecidedError(
            f"frame order: {names[plain[0]]} and {names[plain[1]]} have no number; list points.files in their order"
        )
    if len({skeletons[i] for i in numbered}) > 1:
        other = next(i for i in numbered if skeletons[i] != skeletons[numbered[0]])
        raise errors.UndecidedError(
            f"frame order: {names[numbered[0]]} and {names[other]} are named unlike; narrow points.files (--files), or list the files in their order"
        )
    chosen = [names[i] for i in numbered]
    order = _by_time(chosen) or _by_numbers(chosen, rule)
    index = (*plain, *(numbered[i] for i in order.index))
    return Order(index, order.values, order.seconds and not plain, order.found)


def _by_time(names: Sequence[str]) -> Order | None:
    """By a time in seconds, where every name ends with one and they differ."""
    found = [SECONDS.findall(name) for name in names]
    if not all(len(times) == 1 for times in found):
        return None
    times = np.array([float(one[0].replace(",", ".")) for one in found])
    if len(np.unique(times)) < len(times):
        return None
    index = np.argsort(times)
    return Order(tuple(index.tolist()), times[index], True, "time in the file names")


def _by_numbers(names: Sequence[str], rule: Rule) -> Order:
    """By the numbers that differ from name to name."""
    numbers = np.array([[float(n.replace(",", ".")) for n in NUMBER.findall(name)] for name in names])
    numbers = numbers.reshape(len(names), -1)
    differing = np.flatnonzero(np.ptp(numbers, axis=0) > 0) if numbers.size else np.zeros(0, int)
    index = np.lexsort([numbers[:, k] for k in differing[::-1]]) if differing.size else np.arange(len(names))
    rows = numbers[index][:, differing]
    if len(names) > 1 and (not differing.size or (np.diff(rows, axis=0) == 0).all(axis=1).any()):
        raise errors.UndecidedError("frame order: two files have the same numbers; list points.files in their order")
    falling = [k for k in range(differing.size) if (np.diff(rows[:, k]) < 0).any()]
    if falling and rule == "auto" and _several_areas(rows):
        raise errors.UndecidedError(
            f"frame order: every picture has the same {len(np.unique(rows[:, -1]))} last numbers in names such as {names[index[-1]]}; where these are areas "
            'of one picture, choose one of them (--files), else choose points.order = "natural" (--order natural)'
        )
    if falling and rule == "auto":
        raise errors.UndecidedError(
            f"frame order: numbers {differing[0] + 1} and {differing[falling[0]] + 1} of names such as {names[index[-1]]} give different orders; "
            'choose points.order = "natural" (--order natural: from left to right), or list points.files in their order'
        )
    values = rows[:, 0] if differing.size == 1 else None
    return Order(tuple(index.tolist()), values, False, "number in the file names")


def _several_areas(rows: Array) -> bool:
    """Whether each first number comes with each last one. rows (n, k): numbers of the names that differ."""
    first, last = (np.unique(rows[:, k]) for k in (0, -1))
    return rows.shape[1] == 2 and len(last) < len(first) and len(first) * len(last) == len(rows)
