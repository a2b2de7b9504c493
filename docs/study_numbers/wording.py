"""Numbers as the pages write them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np


def percentage(value: float, digits: int = 1, sign: bool = False) -> str:
    """'0.1 %' of 0.1, which is in percent already, where `studies.output.words.percent` takes a share; no negative zero."""
    value = round(value, digits) + 0.0
    return f"{value:{'+' if sign else ''}.{digits}f} %"


def span(values: Iterable[float], digits: int = 0, sign: bool = False) -> str:
    """'1 to 2 %', the smaller one in magnitude first; '1 %' where both are equal."""
    found = list(values)
    low, high = min(found, key=abs), max(found, key=abs)
    first = f"{low:.{digits}f}"
    last = percentage(high, digits, sign)
    return last if first == f"{high:.{digits}f}" else f"{first} to {last}"


def share(value: float) -> str:
    """'0.42 %' of 0.0042: two digits."""
    return f"{100 * value:.2g} %" if value < 0.995 else f"{100 * value:.0f} %"


def spread(values: list[float]) -> str:
    """Median and range of shares."""
    return f"{share(float(np.median(values)))} ({share(min(values))} to {share(max(values))})"
