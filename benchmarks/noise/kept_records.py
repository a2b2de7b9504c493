"""Records of simulated tests, one file each, so that a run that was stopped goes on without loss.

In: tests by name, a function that makes the record of one in a folder. Out: all records that are there.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from studies.trials.blind_workers import Named, make_missing


def records[T: Named](
    make: Callable[[T, Path], object], folder: Path, tests: Sequence[T], jobs: int, title: str
) -> list[dict[str, Any]]:
    """Make those of `tests` that are not in the folder, `jobs` side by side, and read all that are. make: writes NAME.json, whole or not at all.

    Errors of the programs are printed; such tests are made again with the next run. Raises `StudyError` where workers are killed again and again.
    """

    def missing() -> list[T]:
        return [test for test in tests if not (folder / f"{test.name}.json").exists()]

    for name, error in make_missing(make, folder, jobs, len(tests), missing, title).items():
        print(f"{name}: {error}", file=sys.stderr)
    return [json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))]
