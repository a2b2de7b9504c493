"""A long computation that tells what it does, and goes on where an earlier run of it was killed.

In: names of stages, unique within the computation. Out: what was reached there. `Resumable` itself says nothing and keeps nothing;
`studies.output.run_progress` does both.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class Resumable:
    """Says nothing and keeps nothing."""

    def __call__(self, text: str) -> None:
        """Say what is done next."""

    def load(self, stage: str) -> Any:
        """What an earlier run had reached; None where it had not come so far."""
        return None

    def save(self, stage: str, value: object) -> None:
        """Keep it, in the place of what was reached in this stage before; not None."""

    def discard(self, start: str) -> None:
        """Forget stages whose names start so: what comes after them is kept."""

    def checkpointed[T](self, stage: str, make: Callable[[], T]) -> T:
        """As an earlier run made it, else as it is made now."""
        found: T | None = self.load(stage)
        if found is None:
            found = make()
            self.save(stage, found)
        return found


SILENT = Resumable()
