"""Tests without an effect over conditions of their noise: ``alarms.json`` of `python -m benchmarks.noise.false_alarms`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

COLUMNS = ["condition", "tests", "alarms", "with a name", "95 % interval of the rate", "best candidates of the alarms"]
COARSE = "942 nodes"


def take(folder: Path) -> dict[str, Any]:
    """Numbers and table."""
    found = json.loads((folder / "alarms.json").read_text())
    settings = json.loads((folder / "alarms.manifest.json").read_text())["settings"]
    lines = [dict(zip(found["columns"], row, strict=True)) for row in found["rows"]]
    of_trials = [line for line in lines if not line["condition"].startswith(COARSE)]
    table = [
        [line["condition"], str(line["tests"]), str(line["alarms"]), str(line["named"]),
         f"{100 * line['low']:.0f} to {100 * line['high']:.0f} %", line["best where alarmed"]]
        for line in lines
    ]  # fmt: skip
    numbers = {
        "tests": sum(line["tests"] for line in of_trials),
        "alarms": sum(line["alarms"] for line in of_trials),
        "named": sum(line["named"] for line in lines),
        "every": sum(line["tests"] for line in lines),
        "first": settings["first"],
        "seeds": max(line["tests"] + line["errors"] for line in lines),
        "seconds": max(line["CPU seconds"] for line in lines),
    }
    return {
        "command": "python -m benchmarks.noise.false_alarms --first {first} --seeds {seeds}".format(**numbers),
        "how": "every seed that was finished; looked at once, the diagnosis was fixed before",
        "numbers": numbers,
        "tables": {"alarms": [COLUMNS, *table]},
    }
