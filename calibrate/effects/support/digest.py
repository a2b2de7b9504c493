"""Hash of arrays, by which what was worked out for them is found again."""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray


def digest(*arrays: NDArray[np.float64] | NDArray[np.int64]) -> bytes:
    """The same of the same values in the same shapes."""
    found = hashlib.sha256()
    for array in arrays:
        found.update(str(array.shape).encode() + np.ascontiguousarray(array).tobytes())
    return found.digest()
