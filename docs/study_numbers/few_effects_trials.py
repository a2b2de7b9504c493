"""How often few effects by the fields of replays are right: the folder of `python -m benchmarks.few_effects` in."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def take(folder: Path) -> dict[str, Any]:
    """The table of all kinds."""
    found = json.loads((folder / "few_effects.json").read_text())
    numbers = {**found["numbers"], "hidden": sum(bool(one["effect"]) for one in found["tests"])}
    numbers["part"] = sum(bool(one["named_part"]) for one in found["tests"])
    return {
        "command": "python -m benchmarks.few_effects --first 999000",
        "how": "stopped for time, the first of the plan; the rule fixed before, looked at when three were there and at the end",
        "numbers": numbers,
        "tables": found["tables"],
    }
