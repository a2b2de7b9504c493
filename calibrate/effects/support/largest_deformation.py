"""The largest deformation so far, which softening and permanent set depend on, and whether a test unloads."""

from __future__ import annotations

import jax
import numpy as np

from calibrate.effects.support.nodal_derivatives import law_gradients
from calibrate.equations.tensors import Tensors

UNLOADED = 0.02  # share of the mean I1 - 3 by which the sheet must have come back


def excess(F):
    """I1 - 3 (t, m) and its largest value so far (t, m)."""
    whole = Tensors.of(F)
    value = whole.dot(whole) + 1.0 / whole.det**2 - 3.0
    return value, jax.lax.cummax(value, axis=0)


def lacks_unloading(data) -> str | None:
    """What is missing for an effect that is seen where the sheet comes back from its largest deformation."""
    mean = np.asarray(excess(law_gradients(data, data.u))[0]).mean(axis=1)  # noise unloads single places in any test
    back = (np.maximum.accumulate(mean) - mean).max() > UNLOADED * mean.max()
    return None if back else "unloading"
