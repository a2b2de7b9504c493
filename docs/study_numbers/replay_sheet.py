"""Replays of a measured sheet in its diagnosis: ``discovery.json`` of `equigap discover` on `Soft_Homo`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from studies.output.words import percent


def take(folder: Path) -> dict[str, Any]:
    """Errors of base, final model and plausible effects, as the equations have them and updated, each at the level of its replay."""
    found = json.loads((folder / "discovery.json").read_text())
    check, together = found["replay"], found["all_effects"]
    plausible = (together["plausible"] or together)["replay"]
    numbers: dict[str, Any] = {"band": percent(check["band"]["force"])}
    updated = (together["plausible"] or together)["updated"]
    numbers["updated_band"] = percent(updated["check"]["band"]["force"])
    numbers["updated_mm_band"] = f"{updated['check']['band']['field']:.3f}"
    numbers["updated_smooth_mm"] = f"{updated['check']['smooth_field'][1]:.3f}"
    for one in updated["effects"]:
        if one["effect"] == "viscoelasticity":
            numbers["g"], numbers["tau"] = f"{one['amplitudes'][0]:.2f}", f"{one['shape'][0]:.1f}"
    models = {"base": check["base"], "final": check["final"], "plausible": plausible, "updated": updated["replay"]}
    for name, one in models.items():
        numbers |= {
            f"{name}_fitted": percent(one["fitted"]["force"]),
            f"{name}_held": percent(one["judged"]["force"]),
            f"{name}_mm": f"{one['judged']['field']:.3f}",
            f"{name}_level": f"{one['level']:.3f}",
        }
    return {
        "command": "equigap import Soft_Homo --frames 24 -o results/sheet; equigap discover results/sheet/experiment.npz --hold-out after:15",
        "how": "measured sheet; nine pictures fitted, 15 held out, six of each compared; prior of the base, level, the rule of R614 and the update by replays committed before",
        "numbers": numbers,
    }  # fmt: skip
