"""What every command returns: typed results, with the lines that a terminal shows of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from studies.errors import StudyError


class Outcome(ABC):
    """Result of a command. The command line prints `lines` and ends with exit code 2 where there is a `failure`."""

    @abstractmethod
    def lines(self) -> Iterable[str]:
        """What a terminal shows."""

    def failure(self) -> StudyError | None:
        """Why a command that came to its end did not succeed."""
        return None


@dataclass(frozen=True)
class Complete(Outcome):
    """Of a command that has come to its end before, with the same settings and the same folder. answer: see `studies.output.folder.earlier_answer`."""

    folder: Path
    answer: tuple[str, ...]

    def lines(self) -> Iterable[str]:
        """That nothing was computed, then the same as then."""
        yield from self.answer
