"""The page on ugly data: the healthy skin, through the commands that the page names."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from studies.output.words import digits, percent, plus_minus

COMMAND = "equigap unpack sutula_skin_dic/monolithic.npz --name skin -o skin; equigap import skin/columns.toml (with count = 12 in [frames]) -o imported; equigap calibrate imported/experiment.npz --hold-out every:3 -o calibrated; equigap discover imported/experiment.npz --quick -o discovered"  # fmt: skip

FORCES_MISSED = "F301"


def reason(results: dict[str, Any], code: str, key: str) -> float:
    """A number behind a reason of the headline. Raises `SystemExit` where the headline does not give it."""
    for finding in (*results["headline"]["against"], *results["headline"]["reservations"]):
        if finding["code"] == code:
            return float(finding["data"][key])
    raise SystemExit(f"the headline no longer says {code}: rewrite the page")


def numbers(imported: dict[str, Any], results: dict[str, Any], discovered: dict[str, Any]) -> dict[str, Any]:
    """What the page states, of the manifests of an import, a calibration and a diagnosis."""
    provenance = imported["provenance"]
    masked, signal = provenance["masked"]["spurious"], provenance["strain_signal"]
    found = results["initial_shear_modulus"], results["initial_shear_modulus_deviation"]
    ends = [one["stretch"] for one in results["curve_points"] if one["mode"] == "uniaxial" and one["calibrated"]]
    return {
        "points": imported["points"] + len(masked),
        "spurious": len(masked),
        "strain": percent(signal["strain"]),
        "scatter": percent(signal["scatter"]),
        "ratio": f"{signal['ratio']:.1f}",
        "force_error": percent(results["relative_force_error"]),
        "held_error": percent(results["held_out"]["relative_force_error"]),
        "expected_error": percent(reason(results, FORCES_MISSED, "expected")),
        "neo_hooke_error": percent(results["neo_hooke_force_error"]),
        "chi_square": digits(results["reduced_chi_square"], 2),
        "attenuation": digits(results["attenuation"], 2),
        "modulus": plus_minus(*found),
        "stretch": f"{max(ends):.2f}",
        "verdict": results["headline"]["verdict"],
        "diagnosis": discovered["headline"]["verdict"],
        "diagnosis_error": percent(reason(discovered, FORCES_MISSED, "error")),
    }


def take(folder: Path) -> dict[str, Any]:
    """Content of the file. folder: in which the commands were run."""
    inputs = [
        folder / name for name in ("imported/experiment.json", "calibrated/report.json", "discovered/report.json")
    ]
    imported, calibrated, discovered = (json.loads(path.read_text()) for path in inputs)
    return {
        "command": COMMAND,
        "how": "sutula_skin_dic/monolithic.npz (healthy skin), 12 of 50 frames, nothing else chosen",
        "revision": calibrated["revision"],
        "numbers": numbers(imported["results"], calibrated["results"], discovered["results"]),
    }
