"""Standard deviation that outliers do not move: from the median size of numbers (Hampel 1974)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
TO_DEVIATION = 1.4826  # standard deviation of normal numbers over the median of their sizes


def robust_std(values: Array, axis: int | tuple[int, ...] | None = None) -> Any:
    """Of numbers about 0, along axes; of all of them a float."""
    found = TO_DEVIATION * np.median(np.abs(values), axis=axis)
    return float(found) if axis is None else found
