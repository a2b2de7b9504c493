"""Replays of a measured sheet in its diagnosis: ``discovery.json`` of `equigap discover` on `Soft_Homo`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from studies.output.words import percent


def take(folder: Path) -> dict[str, Any]:
    """Errors of base, final model and plausible effects, each at the level of its replay."""
    found = json.loads((folder / "discovery.json").read_text())
    check, together = found["replay"], found["all_effects"]
    plausible = (together["plausible"] or together)["replay"]
    numbers: dict[str, Any] = {"band": percent(check["band"]["force"])}
    for name, one in (("base", check["base"]), ("final", check["final"]), ("plausible", plausible)):
        numbers |= {
            f"{name}_fitted": percent(one["fitted"]["force"]),
            f"{name}_held": percent(one["judged"]["force"]),
            f"{name}_mm": f"{one['judged']['field']:.3f}",
            f"{name}_level": f"{one['level']:.3f}",
        }
    return {
        "command": "equigap import Soft_Homo --frames 24 -o results/sheet; equigap discover results/sheet/experiment.npz --hold-out after:15",
        "how": "measured sheet; nine pictures fitted, 15 held out, six of each compared; prior of the base, level and the rule of R614 committed before",
        "numbers": numbers,
    }  # fmt: skip
