"""Progress: steps done in; a bar on a terminal, a line now and then elsewhere (log files, pipes)."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sized
from types import TracebackType
from typing import Self, TextIO

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

INTERVAL = 20.0


class Progress:
    """Progress of `total` steps on stderr: a bar on a terminal, else a line at most every 20 s and at the end.

    A task that ends within the first 20 s writes no line to a log.
    """

    def __init__(self, description: str, total: int | None = None, unit: str = "it", stream: TextIO | None = None):
        self.description, self.total, self.unit = description, total, unit
        self.stream = stream or sys.stderr
        self.done = 0
        self._start = self._last = time.monotonic()
        self._bar: Bar | None = None
        if self.stream.isatty():
            self._bar = Bar(
                TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn(unit),
                TimeElapsedColumn(), TimeRemainingColumn(), console=Console(file=self.stream),
            )  # fmt: skip
            self._task = self._bar.add_task(description, total=total)
            self._bar.start()

    def update(self, steps: int = 1) -> None:
        """Count `steps` more."""
        self.done += steps
        if self._bar is not None:
            self._bar.advance(self._task, steps)
        elif time.monotonic() - self._last >= INTERVAL:
            self._line()

    def to(self, done: int, total: int | None = None) -> None:
        """Set the steps done; fits callbacks of the form callback(done, total)."""
        if total is not None and total != self.total:
            self.total = total
            if self._bar is not None:
                self._bar.update(self._task, total=total)
        self.update(done - self.done)

    def close(self) -> None:
        """End the bar, or write the last line."""
        if self._bar is not None:
            self._bar.stop()
        elif self._last > self._start:
            self._line()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _line(self) -> None:
        self._last = time.monotonic()
        share = f"{self.done}/{self.total}" if self.total else str(self.done)
        seconds = self._last - self._start
        print(f"{self.description}: {share} {self.unit}, {seconds:.0f} s", file=self.stream, flush=True)


def track[T](items: Iterable[T], description: str, total: int | None = None, unit: str = "it") -> Iterator[T]:
    """Iterate over `items` with progress."""
    if total is None and isinstance(items, Sized):
        total = len(items)
    with Progress(description, total, unit) as progress:
        for item in items:
            yield item
            progress.update()


def callback(description: str) -> Callable[[int, int], None]:
    """A function (done, total) that shows the progress of increments and closes itself when done reaches total."""
    shown: list[Progress] = []

    def show(done: int, total: int) -> None:
        if not shown:
            shown.append(Progress(description, total, "increments"))
        shown[0].to(done, total)
        if done >= total:
            shown.pop().close()

    return show
