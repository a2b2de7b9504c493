"""What a diagnosis and a calibration cost: ``cost.csv`` of `python benchmarks/diagnosis.py`."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

COLUMNS = ["command", "points", "pictures", "CPU s", "wall s", "peak GB"]


def take(*folders: Path) -> dict[str, Any]:
    """Numbers and table: of every size its last run, which finds compiled code if there was one before."""
    last: dict[tuple[str, int, int], dict[str, str]] = {}
    for folder in folders:
        with (folder / "cost.csv").open() as file:
            for row in csv.DictReader(line for line in file if not line.startswith("#")):
                last[row["command"], int(row["points"]), int(row["pictures"])] = row
    table = [
        [command, str(points), str(pictures), *(f"{float(row[name]):.{digits}f}" for name, digits in
         (("CPU s", 0), ("wall s", 0), ("peak GB", 1)))]
        for (command, points, pictures), row in sorted(last.items())
    ]  # fmt: skip
    numbers = {
        f"{command}_{points}x{pictures}_{unit}": float(row[name])
        for (command, points, pictures), row in last.items()
        for unit, name in (("cpu", "CPU s"), ("wall", "wall s"), ("memory", "peak GB"))
    }
    return {
        "command": "python benchmarks/diagnosis.py --large",
        "how": "the whole command, from start to report, on two cores; the last of two runs where there were two",
        "numbers": numbers,
        "tables": {"cost": [COLUMNS, *table]},
    }
