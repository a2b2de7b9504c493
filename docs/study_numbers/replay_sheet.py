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
MODELS = {"neo_hooke": "neo-Hooke", "base": "base", "final": "base and effects found", "few": "few effects"}
VARIANTS = {"neo-Hooke, fitted to the forces": "neo_hooke", "stiffness map": "map"}


def take(folder: Path) -> dict[str, Any]:
    """Errors of neo-Hooke, of the base, with the effects found and of few effects, each at the level of its replay; of the map of stiffness."""
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
    transfer = json.loads((folder / "steps" / "transfer_Stiff2_Hetero.json").read_text())
    for row in transfer["rows"]:
        if row["name"] in VARIANTS:
            key = f"transfer_{VARIANTS[row['name']]}"
            numbers |= {f"{key}_{kind}": share(row["held_out"][kind]) for kind in ("force", "field")}
    return {
        "command": "equigap measured",
        "how": "measured sheets, 24 pictures each; those before 15 s fitted, six held out of them compared; every rule committed before",
        "numbers": numbers,
        "tables": {"models": rows},
    }  # fmt: skip


def _replays(found: dict[str, Any]) -> dict[str, tuple[dict[str, Any], float | None]]:
    """Replays by the keys of `MODELS`, with half of the band of the force error; those that were made."""
    check, few = found["replay"], found["few_effects"]
    updated = (few.get("models") or [{}])[0].get("replay") or {}
    band, only_base = check.get("band", {}).get("force"), check.get("base") == check.get("final")
    made = {
        "neo_hooke": (few["neo_hooke"], None),
        "base": (check.get("base"), band if only_base else None),
        "final": (None if only_base else check.get("final"), band),
        "few": (updated.get("final"), updated.get("band", {}).get("force")),
    }
    return {key: (one, band) for key, (one, band) in made.items() if one is not None and "not_made" not in one}
