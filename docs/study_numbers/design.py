"""The page on design: predicted information and actual errors of candidate specimens."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from wording import share, spread

OPTIMISED = "optimised"
MODES = ("uniaxial", "equibiaxial", "pure_shear")


def candidate_rows(found: dict[str, Any]) -> list[list[str]]:
    """Of every candidate: what ends its pull, what is predicted, what was found."""
    rows = [
        [
            "rank",
            "specimen",
            "axes",
            "pulled until",
            "D, bit",
            "uniaxial",
            "equi-biaxial",
            "pure shear",
            "all: predicted",
            "all: actual error, median (range)",
        ]
    ]
    for number, c in enumerate(found["candidates"], start=1):
        errors = [overall(e) for e in (found["validation"] or {"errors": []})["errors"] if e["title"] == c["title"]]
        end, test = c["end"], c["test"]
        axes = "2" if "cross" in c["specimen"]["specimen"] else "1"
        rows.append([str(number), c["title"], axes, f"{end['displacement']:.0f} mm ({end['limit']})", f"{test['gain']:.0f}",
                     *(share(test["deviation"][m]) for m in MODES), share(test["overall"]),
                     spread(errors) if errors else "not tested"])  # fmt: skip
    return rows


def overall(error: dict[str, Any]) -> float:
    """Root mean square over the modes; infinite where the calibration failed."""
    return float(np.sqrt(np.mean(np.square(list(error["modes"].values()))))) if error["modes"] else float("inf")


def correlation_numbers(validation: dict[str, Any]) -> dict[str, Any]:
    """Rank correlations: median and range over seeds."""
    numbers: dict[str, Any] = {}
    for kind, values in validation["correlation"].items():
        numbers |= {
            f"rank_{kind}": f"{np.median(values):.2f}",
            f"rank_{kind}_range": f"{min(values):.2f} to {max(values):.2f}",
        }
    errors = [e for e in validation["errors"] if e["title"] != OPTIMISED]
    by_title: dict[str, list[float]] = {}
    for e in errors:
        by_title.setdefault(e["title"], []).append(overall(e))
    medians = {title: float(np.median(values)) for title, values in by_title.items()}
    best = min(medians, key=lambda title: medians[title])
    return {
        **numbers,
        **{f"{title.replace(' ', '_')}_actual": spread(values) for title, values in by_title.items()},
        "verdict": validation["verdict"].replace("_", " "),
        "seeds": len({e["seed"] for e in errors}),
        "calibrations": len(errors),
        "actual_best": best,
        "actual_best_error": share(medians[best]),
        "actual_least": share(min(medians.values())),
        "actual_most": share(max(medians.values())),
    }


def actual_of_optimised(found: dict[str, Any]) -> dict[str, str]:
    """Actual error of the specimen that a search found, of all modes and of equi-biaxial tension."""
    errors = [e for e in (found["validation"] or {"errors": []})["errors"] if e["title"] == OPTIMISED]
    if not errors:
        return {}
    return {
        "actual": spread([overall(e) for e in errors]),
        "actual_biaxial": spread([e["modes"].get("equibiaxial", float("inf")) for e in errors]),
    }


def numbers_of(found: dict[str, Any], cross: dict[str, Any] | None) -> dict[str, Any]:
    """What the page states."""
    best = found["candidates"][0]
    by_title = {c["title"]: c for c in found["candidates"]}
    optimised, search = found["optimised"], found["search"]
    numbers = {
        "before": share(found["before"]["overall"]),
        "best": best["title"],
        "best_overall": share(best["test"]["overall"]),
        "last_overall": share(found["candidates"][-1]["test"]["overall"]),
        "last": found["candidates"][-1]["title"],
        "candidates": len(by_title),
        "optimised_overall": share(optimised["test"]["overall"]),
        "optimised_biaxial": share(optimised["test"]["deviation"]["equibiaxial"]),
        "evaluations": search["evaluations"],
        **{f"found_{name.replace('.', '_')}": f"{value:g}" for name, value in search["best"]["values"].items()},
    }
    for title in ("PS", "UT", "cross", "small cross", "TTf", "TTd"):
        numbers |= {f"{title.replace(' ', '_')}_{m}": share(by_title[title]["test"]["deviation"][m]) for m in MODES}
        numbers[f"{title.replace(' ', '_')}_overall"] = share(by_title[title]["test"]["overall"])
    if found["validation"]:
        numbers |= correlation_numbers(found["validation"])
        numbers |= {f"optimised_{key}": value for key, value in actual_of_optimised(found).items()}
    if cross:
        numbers |= {
            "cross_evaluations": cross["search"]["evaluations"],
            "cross_found": share(cross["optimised"]["test"]["overall"]),
            "cross_found_biaxial": share(cross["optimised"]["test"]["deviation"]["equibiaxial"]),
            **{f"cross_found_{key}": value for key, value in actual_of_optimised(cross).items()},
            **{f"cross_{name}": f"{value:g}" for name, value in cross["search"]["best"]["values"].items()},
        }
    return numbers


def take(folder: Path, cross: Path | None = None) -> dict[str, Any]:
    """Content of the file. folder: of `equigap design --validate`; cross: of the cross's optimised hole pattern."""
    content = json.loads((folder / "design.json").read_text())
    pattern = json.loads((cross / "design.json").read_text())["results"] if cross else None
    found = content["results"]
    return {
        "command": "equigap design --validate; equigap design docs/design/cross_pattern.toml --validate",
        "how": "medians and ranges over noise seeds",
        "revision": content["revision"],
        "numbers": numbers_of(found, pattern),
        "tables": {"candidates": candidate_rows(found)},
    }
