"""Replays of measured sheets in their diagnoses, and the transfer to the sheet with an inclusion: the folder of `equigap measured`, in which the loops on
homogeneous tests need not be there."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from sheets import SHORT
from wording import share

from studies.output.words import percent

COLUMNS = ["sheet", "model", "level", "force error before 15 s", "after 15 s", "half of its 95 % band", "displacements after 15 s, mm"]  # fmt: skip
MODELS = {"neo_hooke": "neo-Hooke", "base": "base", "final": "base and effects found", "plausible": "plausible effects", "updated": "plausible effects, updated", "few": "few effects"}  # fmt: skip
VARIANTS = {"neo-Hooke, fitted to the forces": "neo_hooke", "stiffness map": "map"}


def take(folder: Path) -> dict[str, Any]:
    """Errors of neo-Hooke, base and plausible effects, as the equations have them and updated, each at the level of its replay; of the map of stiffness."""
    numbers: dict[str, Any] = {}
    rows: list[list[str]] = [COLUMNS]
    for name, short in SHORT.items():
        found = json.loads((folder / name / "discovery.json").read_text())
        for model, (one, band) in _replays(found).items():
            values = {
                "level": f"{one['level']:.3f}",
                "fitted": percent(one["fitted"]["force"]),
                "held": percent(one["judged"]["force"]),
                "band": "" if band is None else percent(band),
                "mm": f"{one['judged']['field']:.3f}",
            }
            numbers |= {f"{short}_{model}_{what}": value for what, value in values.items() if value}
            rows.append([name, MODELS[model], *values.values()])
        numbers |= {f"{short}_{key}": value for key, value in _relaxation(found).items()}
    transfer = json.loads((folder / "steps" / "transfer_Stiff2_Hetero.json").read_text())
    for row in transfer["rows"]:
        if row["name"] in VARIANTS:
            key = f"transfer_{VARIANTS[row['name']]}"
            numbers |= {f"{key}_{kind}": share(row["held_out"][kind]) for kind in ("force", "field")}
    return {
        "command": "equigap measured",
        "how": "measured sheets, 24 pictures each; those before 15 s fitted, six held out of them compared; prior of the base, level, the rule of R614 and the update by replays committed before",
        "numbers": numbers,
        "tables": {"models": rows},
    }  # fmt: skip


def _used(found: dict[str, Any]) -> dict[str, Any]:
    """Of discovery.json what is to be used where nothing explains the test."""
    together = found["all_effects"]
    used: dict[str, Any] = together["plausible"] or together
    return used


def _replays(found: dict[str, Any]) -> dict[str, tuple[dict[str, Any], float | None]]:
    """Replays by the keys of `MODELS`, with half of the band of the force error; those that were made."""
    used, check = _used(found), found["replay"]
    updated, few = (one.get("replay") or {} for one in (used["updated"], found["few_effects"].get("updated") or {}))
    band, only_base = check.get("band", {}).get("force"), check.get("base") == check.get("final")
    made = {
        "neo_hooke": (used["neo_hooke"], None),
        "base": (check.get("base"), band if only_base else None),
        "final": (None if only_base else check.get("final"), band),
        "plausible": (used["replay"], None),
        "updated": (updated.get("final"), updated.get("band", {}).get("force")),
        "few": (few.get("final"), few.get("band", {}).get("force")),
    }
    return {key: (one, band) for key, (one, band) in made.items() if one is not None and "not_made" not in one}


def _relaxation(found: dict[str, Any]) -> dict[str, str]:
    """g and tau, s, by the equations and updated, where there is any."""
    numbers = {}
    for prefix, effects in (("equations_", _used(found)["effects"]), ("", _used(found)["updated"].get("effects", ()))):
        for one in effects:
            if one["effect"] == "viscoelasticity":
                numbers |= {f"{prefix}g": f"{one['amplitudes'][0]:.2f}", f"{prefix}tau": f"{one['shape'][0]:.1f}"}
    return numbers
