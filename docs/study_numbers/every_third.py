"""A measured sheet with every third picture held out: the folder of `equigap discover sheet.npz --hold-out every:3` in."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from studies.output.words import percent


def take(folder: Path) -> dict[str, Any]:
    """Errors of replays in the pictures held out: neo-Hooke, the final model where it was replayed, few effects."""
    found = json.loads((folder / "discovery.json").read_text())
    record = json.loads((folder / "report.json").read_text())
    few, noise = found["few_effects"], found["noise"][0]["found_std_mm"]
    updated = few["models"][0]["replay"]
    replays = {
        "neo_hooke": few["neo_hooke"],
        "final": found["replay"].get("final"),
        "few": updated["final"],
    }
    numbers: dict[str, Any] = {"noise_mm": f"{noise:.3f}", "verdict": found["verdict"]}
    for name, one in replays.items():
        if one is None:  # no equilibrium
            continue
        judged = one["judged"]
        numbers |= {
            f"{name}_force": percent(judged["force"]),
            f"{name}_mm": f"{judged['field']:.3f}",
            f"{name}_noises": f"{judged['field'] / noise:.1f}",
        }
    numbers |= {
        "band_force": percent(updated["band"]["force"]),
        "band_mm": f"{updated['band']['field']:.3f}",
        "smooth_mm": f"{updated['smooth_field'][1]:.3f}",
    }
    for name in ("stiffness gradient", "compressibility"):
        numbers[f"p_{name.split()[-1]}"] = percent(few["inclusion"].get(name, 0.0))
    numbers["best"] = " and ".join(few["sets"][0]["effects"]) or "none"
    numbers["added"] = ", ".join(now["added"] for now in found["rounds"] if now["added"]) or "none"
    for one in few["models"][0]["effects"]:
        if one["effect"] == "viscoelasticity":
            numbers |= {"g": f"{one['amplitudes'][0]:.2f}", "tau": f"{one['shape'][0]:.1f}"}
    return {
        "command": "equigap discover Soft_Homo.npz --hold-out every:3",
        "how": f"revision {record.get('revision', 'unknown')}; 24 pictures, every third held out; run once, with the rule of the sheets",
        "numbers": numbers,
        "tables": {},
    }
