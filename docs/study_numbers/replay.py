"""The page on replays: errors of a replay, and of the calibration whose model it takes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from wording import share


def take(folder: Path, calibration: Path) -> dict[str, Any]:
    """Content of the file. folder: of `equigap replay`; calibration: of the `equigap calibrate` before."""
    told = {f["code"]: f["data"] for f in json.loads((folder / "maps.json").read_text())["results"]["alerts"]}
    force, field, mesh = told["R601"], told["R602"], told["R603"]
    fitted = json.loads((calibration / "report.json").read_text())["results"]["relative_force_error"]
    return {
        "command": "equigap import Soft_Homo --frames 12; equigap calibrate --quick; equigap replay",
        "how": "measured sheet, twelve pictures",
        "numbers": {
            "force_error": share(force["error"]),
            "field_error": f"{field['last']:.2f}",
            "in_noise": f"{field['last'] / field['noise']:.0f}",
            "mesh_field": f"{mesh['field']:.1g}",
            "calibration_error": share(fitted),
        },
        "tables": {},
    }
