"""Errors of amplitudes over their stated deviations: ``pulls.json`` of `python -m benchmarks.noise.pulls`."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

from studies.output.words import percent

COLUMNS = [
    "effect",
    "trials",
    "strong",
    "amplitudes",
    "rms pull",
    "mean pull",
    "median size",
    "within 95 %",
    "beyond 4",
]
FAR, GOAL = 4.0, 1.3  # of a pull; of an rms


def take(folder: Path) -> dict[str, Any]:
    """Numbers and table."""
    found = json.loads((folder / "pulls.json").read_text())
    manifest = json.loads((folder / "pulls.manifest.json").read_text())
    settings = manifest["settings"]
    lines = [dict(zip(found["columns"], row, strict=True)) for row in found["rows"]]
    with (folder / "trials.csv").open() as file:
        far = [(r["effect"], r["seed"]) for r in csv.DictReader(file) if abs(float(r["pull"])) > FAR]
    table = [
        [line["effect"], *(str(line[key]) for key in ("trials", "strong", "amplitudes")),
         *(f"{line[key]:.2f}" for key in ("rms pull", "mean pull", "median size")), percent(line["within 95 %"]),
         ", ".join(dict.fromkeys(seed for effect, seed in far if effect == line["effect"]))]
        for line in lines
    ]  # fmt: skip
    numbers = {
        "first": settings["first"],
        "each": max(line["trials"] for line in lines),
        "effects": len(lines),
        "wide": sum(line["rms pull"] > GOAL for line in lines),
        "made": sum(line["trials"] for line in lines),
    }
    return {
        "command": "python -m benchmarks.noise.pulls --first {first} --trials {each}".format(**numbers),
        "how": f"run once, revision {manifest['revision']}; beyond 4: seeds of trials with a pull of more than 4",
        "numbers": numbers,
        "tables": {"pulls": [COLUMNS, *table]},
    }
