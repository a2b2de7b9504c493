"""Why an iteration stopped."""

from __future__ import annotations

from enum import StrEnum


class Stop(StrEnum):
    """Reason why a fit ended; its value is the word that results and model files hold."""

    CONVERGED = "converged"
    ITERATION_LIMIT = "iteration limit"
    NO_DESCENT = "no descent"
    NOT_FINITE = "not finite"

    @property
    def message(self) -> str:
        """What the reason means."""
        return _MESSAGES[self]

    @property
    def is_success(self) -> bool:
        """Whether the result is a minimum as far as rounding allows it to be told."""
        return self in (Stop.CONVERGED, Stop.NO_DESCENT)


_MESSAGES = {
    Stop.CONVERGED: "the last steps lowered the objective by less than the tolerance",
    Stop.ITERATION_LIMIT: "the number of iterations was used up before the objective settled",
    Stop.NO_DESCENT: "no step, however short, lowered the objective",
    Stop.NOT_FINITE: "the objective or its derivatives are not finite",
}
