r"""Evidence of sets of effects for the fields of a replay, beside a model discrepancy of unknown size.

In: smooth measured minus replayed displacements r (m,) of a base, signatures of effects. Out: `FieldEvidence`, which ranks sets as `linear_evidence` does.

With amplitudes a ~ N(0, 1) over their prior standard deviations, signatures S, and a discrepancy of standard deviation tau in each of n smooth modes (Kennedy and O'Hagan 2001),

.. math:: \ln Z(\tau) = -\tfrac{n}{2} \ln \tau^2 - \tfrac{1}{2} r^T (\tau^2 I + S S^T)^{-1} r - \tfrac{1}{2} (\ln |\tau^2 I + S S^T| - m \ln \tau^2)

(MacKay 1992), averaged over ln tau (Jeffreys 1946): what `linear_evidence` has for noise of size tau. A discrepancy persists while the load rises, so that all pictures of a mode are one observation: rows are over the root
of their number, and n counts modes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import special

from calibrate.diagnosis.evidence.linear_evidence import Evidence, Signature
from calibrate.diagnosis.evidence.signatures import EXPECTED

Array = NDArray[np.float64]
SMALLEST, GRID = 0.03, 25  # discrepancy, of the root mean square of the residual; how many are tried
UNSEEN = 1e-6  # of the residual, from which a signature is one


@dataclass(frozen=True, eq=False)
class FieldEvidence(Evidence):
    """Signatures and residual, mm, of n = modes observations; taus (g,): sizes of the discrepancy, mm. Log evidence of a subset is over that of none, both averaged over them; its amplitudes are those at the most
    probable one. There are no disturbances D beside it."""

    modes: float
    taus: Array = field(repr=False)

    @classmethod
    def of(
        cls, r: Array, modes: float, signatures: Sequence[Signature], effects: int, taus: Array | None = None
    ) -> FieldEvidence:
        """Of signatures that are seen; effects: how many there are to choose from. taus: None for those that the residual may be."""
        if taus is None:
            taus = np.geomspace(SMALLEST, 1.0, GRID) * np.sqrt(float(r @ r) / modes)
        size = UNSEEN * np.linalg.norm(r)
        seen = tuple(s for s in signatures if np.isfinite(s.columns).all() and np.linalg.norm(s.columns) > size)
        return cls(seen, r, np.zeros((len(r), 0)), float(np.log(EXPECTED / max(effects, 1))), modes, taus)

    @cached_property
    def _none(self) -> Array:
        """ln Z (g,) without an effect."""
        return np.asarray(-0.5 * self.modes * np.log(self.taus**2) - 0.5 * float(self.r @ self.r) / self.taus**2)

    @property
    def of_none(self) -> float:
        """Log evidence without an effect, to compare residuals with the same taus."""
        return float(special.logsumexp(self._none))

    @cached_property
    def _at(self) -> list[Evidence]:
        """Of every tau."""
        return [
            Evidence(tuple(replace(s, columns=s.columns / tau) for s in self.signatures), self.r / tau, self.D, self.log_odds)
            for tau in self.taus.tolist()
        ]  # fmt: skip

    def weighed(self, index: NDArray[np.int64]) -> tuple[Array, Array, Array]:
        """As `Evidence.weighed`, averaged."""
        values, a, volumes = self._of_taus(index)
        best, each = values.argmax(axis=0), np.arange(len(index))
        return special.logsumexp(values, axis=0) - self.of_none, a[best, each], volumes[best, each]

    def tau(self, members: tuple[int, ...]) -> float:
        """The most probable one, mm, beside these effects."""
        index = np.concatenate([self._slices[i] for i in members])[None]
        return float(self.taus[np.argmax(self._of_taus(index)[0])])

    def _of_taus(self, index: NDArray[np.int64]) -> tuple[Array, Array, Array]:
        """Log evidence (g, n), amplitudes (g, n, k) and volumes (g, n) of columns (n, k)."""
        values, a, volumes = (np.array(some) for some in zip(*(one.weighed(index) for one in self._at), strict=True))
        return self._none[:, None] + values, a, volumes
