"""Replays of measured sheets in their diagnoses: ``SHEET/discovery.json`` of `equigap measured`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from studies.output.words import percent

SHEETS = {"Soft_Homo": "soft", "Stiff2_Homo": "stiff", "Stiff2_Hetero": "hetero"}
KEYS = {
    "neo-Hooke": "neo_hooke",
    "base": "base",
    "plausible effects": "plausible",
    "plausible effects, updated": "updated",
}
COLUMNS = ["sheet", "model", "level", "force error before 15 s", "after 15 s", "half of its 95 % band", "displacements after 15 s, mm"]  # fmt: skip


def take(folder: Path) -> dict[str, Any]:
    """Errors of base and plausible effects, as the equations have them and updated, each at the level of its replay; of the sheets that were diagnosed."""
    numbers: dict[str, Any] = {}
    rows: list[list[str]] = [COLUMNS]
    for name, short in SHEETS.items():
        path = folder / name / "discovery.json"
        if not path.exists():
            continue
        found = json.loads(path.read_text())
        numbers |= {f"{short}_{key}": value for key, value in _relaxation(found).items()}
        for model, one, band in _models(found):
            key = f"{short}_{KEYS[model]}"
            values = {
                "level": f"{one['level']:.3f}",
                "fitted": percent(one["fitted"]["force"]),
                "held": percent(one["judged"]["force"]),
                "band": "" if band is None else percent(band),
                "mm": f"{one['judged']['field']:.3f}",
            }
            numbers |= {f"{key}_{what}": value for what, value in values.items() if value}
            rows.append([name, model, *values.values()])
    return {
        "command": "equigap measured",
        "how": "measured sheets, 24 pictures each; those before 15 s fitted, six held out of them compared; prior of the base, level, the rule of R614 and the update by replays committed before",
        "numbers": numbers,
        "tables": {"models": rows},
    }  # fmt: skip


def _models(found: dict[str, Any]) -> list[tuple[str, dict[str, Any], float | None]]:
    """Name, replay, and half of the band of the force error; of those that were made."""
    check, together = found["replay"], found["all_effects"]
    used = {} if together is None else together["plausible"] or together
    updated = used.get("updated") or {}
    band = ((updated.get("check") or {}).get("band") or {}).get("force")
    own = check["band"]["force"] if check.get("base") == check.get("final") else None
    replays = [used.get("neo_hooke"), check.get("base"), used.get("replay"), updated.get("replay")]
    models = list(zip(KEYS, replays, (None, own, None, band), strict=True))
    return [one for one in models if one[1] is not None and "not_made" not in one[1]]


def _relaxation(found: dict[str, Any]) -> dict[str, str]:
    """g and tau, s, of the updated model, where it has any."""
    together = found["all_effects"] or {}
    updated = (together.get("plausible") or together).get("updated") or {}
    branches = [one for one in updated.get("effects", ()) if one["effect"] == "viscoelasticity"]
    return {key: value for one in branches for key, value in
            (("g", f"{one['amplitudes'][0]:.2f}"), ("tau", f"{one['shape'][0]:.1f}"))}  # fmt: skip
