"""All three measured sheets fitted together: the folder of `equigap discover A.npz B.npz C.npz --hold-out after:15` in."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from studies.output.words import percent


def take(folder: Path) -> dict[str, Any]:
    """Levels of the sheets, and errors of replays in the pictures held out."""
    found = json.loads((folder / "discovery.json").read_text())
    record = json.loads((folder / "report.json").read_text())
    replays = {
        "neo_hooke": found["few_effects"]["neo_hooke"],
        "final": found["replay"]["final"],
    }
    numbers: dict[str, Any] = {"verdict": found["verdict"], "added": ", ".join(now["added"] for now in found["rounds"] if now["added"]) or "none"}  # fmt: skip
    for level in found["levels"]:
        numbers[f"level_{level['test']}"] = f"{level['divided_by']:.2f}"
    for name, one in replays.items():
        numbers |= {f"{name}_force": percent(one["judged"]["force"]), f"{name}_mm": f"{one['judged']['field']:.2f}"}
    return {
        "command": "equigap discover Soft_Homo.npz Stiff2_Homo.npz Stiff2_Hetero.npz --hold-out after:15",
        "how": f"revision {record.get('revision', 'unknown')}; 24 pictures a sheet, run once",
        "numbers": numbers,
        "tables": {},
    }
