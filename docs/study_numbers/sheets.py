"""Numbers and tables of the measured sheets: the folder of `equigap measured` in, what the pages state out."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

from wording import share

SHORT = {"Soft_Homo": "soft", "Stiff2_Homo": "stiff", "Stiff2_Hetero": "hetero"}
MODELS = {"neo-Hooke": "neo_hooke", "base": "base", "base and effects found": "found", "all effects at once": "all"}


def take(folder: Path) -> dict[str, Any]:
    """Errors of every model of every sheet, tables as the report has them, and the errors of transferred models."""
    found = json.loads((folder / "measured.json").read_text())
    record = json.loads((folder / "report.json").read_text())
    numbers: dict[str, Any] = {}
    for name, short in SHORT.items():
        one = found[f"sheet_{name}"]
        for model in one["models"]:
            for part in ("fitted", "held_out"):
                for kind in ("force", "field"):
                    numbers[f"{short}_{MODELS[model['name']]}_{kind}_{part}"] = share(model[part][kind])
        numbers[f"{short}_chi_square"] = f"{one['chi_square']:.0f}"
        numbers[f"{short}_verdict"] = one["verdict"]
        numbers[f"{short}_implausible"] = ", ".join(one["implausible"]) or "none"
        numbers[f"{short}_minutes"] = f"{one['seconds'] / 60:.0f}"
        if one["discrepancy"] is not None:
            numbers[f"{short}_discrepancy"] = f"{one['discrepancy']:.0f}"
    controls = [one for name, one in found.items() if name.startswith("control_")]
    numbers["control_smallest_p"] = f"{min(one['smallest_adjusted_p'] for one in controls):.2f}"
    tables = {name: list(csv.reader((folder / f"{name}.csv").read_text().splitlines()))
              for name in ("verdicts", "errors", "transfers", "homogeneous", "control")}  # fmt: skip
    return {
        "command": "equigap measured",
        "how": f"revision {record.get('revision', 'unknown')}; first 15 s fitted, what comes after held out and looked at once",
        "numbers": numbers,
        "tables": tables,
    }
