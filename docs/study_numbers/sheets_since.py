"""Measured sheets since the tables of the page: the plausible effects, updated, with the inclusion in the fit of all effects and without it: folders of `equigap discover`, one a sheet,
in two folders."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from replay_sheet import _replays
from sheets import SHORT

from studies.output.words import percent

COLUMNS = ["sheet", "fit of all effects", "model", "force error before 15 s", "after 15 s", "half of its 95 % band", "displacements after 15 s, mm"]  # fmt: skip
MODELS = {"neo_hooke": "neo-Hooke", "updated": "plausible effects, updated"}


def take(with_inclusion: Path, without: Path) -> dict[str, Any]:
    """Errors of what a user is told to predict with, and of neo-Hooke fitted to the forces."""
    rows: list[list[str]] = [COLUMNS]
    numbers: dict[str, Any] = {}
    for words, key, folder in (("with inclusion", "with", with_inclusion), ("without", "without", without)):
        for name, short in SHORT.items():
            path = folder / name / "discovery.json"
            if not path.exists():
                continue
            made = _replays(json.loads(path.read_text()))
            for model in MODELS if key == "with" else ("updated",):
                one, band = made[model]
                values = percent(one["fitted"]["force"]), percent(one["judged"]["force"]), "" if band is None else percent(band), f"{one['judged']['field']:.3f}"  # fmt: skip
                rows.append([name, words if model == "updated" else "", MODELS[model], *values])
                numbers |= {f"{key}_{short}_{model}": values[1], f"{key}_{short}_{model}_mm": values[3]}
    return {
        "command": "equigap discover SHEET.npz --hold-out after:15",
        "how": "24 pictures a sheet; revision d1353bf with the inclusion, looked at once; the same without it at the revision that took it out of the fit of all effects, errors after 15 s of the first known",
        "numbers": numbers,
        "tables": {"errors": rows},
    }
