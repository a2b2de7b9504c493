r"""Information of a test on the parameters of a law, and what it leaves uncertain. Linear algebra alone.

In: the Fisher information M (k, k) of whitened sensitivities S, M = S^T S, and a factor L of the prior's covariance L L^T. The posterior
covariance of the linear model is C = (M + (L L^T)^-1)^-1 = L (I + L^T M L)^-1 L^T (Bayesian linear design: Chaloner and Verdinelli 1995,
Stat. Sci. 10; the letters after Kiefer 1959, J. R. Stat. Soc. B 21, and Atkinson, Donev and Tobias 2007):

- D: expected gain of information, log2 det(I + L^T M L) / 2, bit (Lindley 1956, Ann. Math. Stat. 27);
- E: the worst direction: largest ratio of posterior to prior standard deviation of any combination of parameters; 1: nothing was
  learnt of it;
- c: standard deviation sqrt(c^T C c) of a linear prediction c^T theta, such as a stress;
- I: the root of its mean square over a range of predictions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from studies.design.law_family import LawFamily

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Information:
    """fisher (k, k): M, 1/MPa^2, of independent tests added up; prior (k, k): L, MPa."""

    fisher: Array
    prior: Array

    def __add__(self, other: Information) -> Information:
        return Information(self.fisher + other.fisher, self.prior)

    @cached_property
    def _spectrum(self) -> tuple[Array, Array]:
        values, vectors = np.linalg.eigh(self.prior.T @ self.fisher @ self.prior)
        return np.maximum(values, 0.0), vectors

    @cached_property
    def root(self) -> Array:
        """(k, k), MPa: R with C = R R^T."""
        values, vectors = self._spectrum
        return self.prior @ vectors / np.sqrt(1 + values)

    @property
    def gain(self) -> float:
        """D, bit."""
        return float(np.log2(1 + self._spectrum[0]).sum() / 2)

    @property
    def worst(self) -> float:
        """E."""
        return float(1 / np.sqrt(1 + self._spectrum[0][0]))

    def deviation(self, c: Array) -> Array:
        """Standard deviations (p,) of predictions c (p, k)."""
        return np.linalg.norm(c @ self.root, axis=1)


@dataclass(frozen=True)
class Criteria:
    """Of an experiment. gain: D, bit; worst: E; deviation: {mode: I of the stress, over the root mean square of the stress}."""

    gain: float
    worst: float
    deviation: dict[str, float]

    @property
    def overall(self) -> float:
        """Root mean square of the deviations of all modes: by which specimens are ranked, smallest first."""
        return float(np.sqrt(np.mean(np.square(list(self.deviation.values())))))

    @classmethod
    def of(cls, information: Information, family: LawFamily) -> Criteria:
        """All criteria."""
        deviations = {}
        for mode in family.stretches:
            found = information.deviation(family.stress_sensitivity(mode))
            deviations[mode] = float(np.sqrt(np.mean(found**2) / np.mean(family.stress(mode) ** 2)))
        return cls(information.gain, information.worst, deviations)

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return {"gain": self.gain, "worst": self.worst, "deviation": dict(self.deviation), "overall": self.overall}

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Criteria:
        """Of what `to_dict` gave."""
        return cls(content["gain"], content["worst"], content["deviation"])
