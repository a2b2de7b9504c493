"""Whether few effects of the measured sheets stay the same under small changes: the folder of `python -m benchmarks.sheet_stability` in."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def take(folder: Path) -> dict[str, Any]:
    """The table of all cases that were made."""
    found = json.loads((folder / "sheet_stability.json").read_text())
    numbers = {**found["numbers"], "least_of_pair": f"{found['numbers']['least_of_pair']:.2g}"}
    gradients = [one["amplitudes"]["stiffness gradient"][0][1] for one in found["cases"] if "stiffness gradient" in one["amplitudes"]]  # fmt: skip
    numbers["gy"] = f"{min(gradients):.2f} to {max(gradients):.2f}"
    return {
        "command": "python -m benchmarks.sheet_stability",
        "how": "in the order of the plan, stopped for time where cases are missing; the rule fixed before; nothing that is held out is used",
        "numbers": numbers,
        "tables": found["tables"],
    }
