"""Tests without an effect over conditions of their noise: ``alarms.json`` of `python -m benchmarks.noise.false_alarms`."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

from scipy.stats import binomtest

COLUMNS = ["condition", "tests", "alarms", "with a name", "95 % interval of the rate", "best candidates of the alarms"]
COARSE, QUIET = "942 nodes", "nothing significant"


def take(folder: Path) -> dict[str, Any]:
    """Numbers and table."""
    found = json.loads((folder / "alarms.json").read_text())
    settings = json.loads((folder / "alarms.manifest.json").read_text())["settings"]
    lines = [dict(zip(found["columns"], row, strict=True)) for row in found["rows"]]
    of_trials = [line for line in lines if not line["condition"].startswith(COARSE)]
    with (folder / "tests.csv").open() as file:
        drift = [r for r in csv.DictReader(file) if r["condition"].startswith("correlation") and r["course"] == "drift"]
    table = [
        [line["condition"], str(line["tests"]), str(line["alarms"]), str(line["named"]),
         f"{100 * line['low']:.0f} to {100 * line['high']:.0f} %", line["best where alarmed"]]
        for line in lines
    ]  # fmt: skip
    every, alarms = (sum(line[key] for line in lines) for key in ("tests", "alarms"))
    low, high = binomtest(alarms, every).proportion_ci()
    numbers = {
        "tests": sum(line["tests"] for line in of_trials),
        "alarms": sum(line["alarms"] for line in of_trials),
        "named": sum(line["named"] for line in lines),
        "drift": len(drift),
        "drift_alarms": sum(one["verdict"] != QUIET for one in drift),
        "others": sum(line["tests"] for line in lines) - len(drift),
        "others_alarms": sum(line["alarms"] for line in lines) - sum(one["verdict"] != QUIET for one in drift),
        "every": every,
        "every_alarms": alarms,
        "every_interval": f"{100 * low:.0f} to {100 * high:.0f} %",
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
