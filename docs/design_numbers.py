"""Numbers of the page on design, from the folders of finished runs.

    python docs/design_numbers.py results/design results/cross-pattern

In: output folders of `equigap design --validate`, and of `equigap design docs/design/cross_pattern.toml`. Out: ``design.json`` in
`docs/results`; `make numbers` puts it into the pages.
"""

from __future__ import annotations

import argparse
import json
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

RESULTS = Path(__file__).parent / "results"
MODES = ("uniaxial", "equibiaxial", "pure_shear")


def percent(share: float) -> str:
    """'0.42 %', two digits."""
    return f"{100 * share:.2g} %" if share < 1 else f"{100 * share:.0f} %"


def spread(values: list[float]) -> str:
    """Median and range, %."""
    return f"{percent(float(np.median(values)))} ({percent(min(values))} to {percent(max(values))})"


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
                     *(percent(test["deviation"][m]) for m in MODES), percent(test["overall"]),
                     spread(errors) if errors else "not tested"])  # fmt: skip
    return rows


def overall(error: dict[str, Any]) -> float:
    """Root mean square over the modes."""
    return float(np.sqrt(np.mean(np.square(list(error["modes"].values())))))


def correlation_numbers(validation: dict[str, Any]) -> dict[str, Any]:
    """Rank correlations: median and range over seeds."""
    numbers: dict[str, Any] = {}
    for kind, values in validation["correlation"].items():
        numbers |= {
            f"rank_{kind}": f"{np.median(values):.2f}",
            f"rank_{kind}_range": f"{min(values):.2f} to {max(values):.2f}",
        }
    errors = validation["errors"]
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
        "actual_best_error": percent(medians[best]),
        "actual_least": percent(min(medians.values())),
        "actual_most": percent(max(medians.values())),
    }


def numbers_of(found: dict[str, Any], cross: dict[str, Any] | None) -> dict[str, Any]:
    """What the page states."""
    best = found["candidates"][0]
    by_title = {c["title"]: c for c in found["candidates"]}
    optimised, search = found["optimised"], found["search"]
    numbers = {
        "before": percent(found["before"]["overall"]),
        "best": best["title"],
        "best_overall": percent(best["test"]["overall"]),
        "last_overall": percent(found["candidates"][-1]["test"]["overall"]),
        "last": found["candidates"][-1]["title"],
        "candidates": len(by_title),
        "optimised_overall": percent(optimised["test"]["overall"]),
        "optimised_biaxial": percent(optimised["test"]["deviation"]["equibiaxial"]),
        "evaluations": search["evaluations"],
        **{f"found_{name.replace('.', '_')}": f"{value:g}" for name, value in search["best"]["values"].items()},
    }
    for title in ("PS", "UT", "cross", "small cross", "TTf", "TTd"):
        numbers |= {f"{title.replace(' ', '_')}_{m}": percent(by_title[title]["test"]["deviation"][m]) for m in MODES}
        numbers[f"{title.replace(' ', '_')}_overall"] = percent(by_title[title]["test"]["overall"])
    if found["validation"]:
        numbers |= correlation_numbers(found["validation"])
    if cross:
        numbers |= {
            "cross_evaluations": cross["search"]["evaluations"],
            "cross_found": percent(cross["optimised"]["test"]["overall"]),
            "cross_found_biaxial": percent(cross["optimised"]["test"]["deviation"]["equibiaxial"]),
            **{f"cross_{name}": f"{value:g}" for name, value in cross["search"]["best"]["values"].items()},
        }
    return numbers


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("cross", type=Path, nargs="?")
    folders = parser.parse_args(words)
    content = json.loads((folders.folder / "design.json").read_text())
    cross = json.loads((folders.cross / "design.json").read_text())["results"] if folders.cross else None
    found = content["results"]
    head = {
        "command": "equigap design --validate; equigap design docs/design/cross_pattern.toml",
        "made": date.today().isoformat(),
        "revision": content["revision"],
        "how": "computed by docs/design_numbers.py from the folders of the runs",
    }
    body = {"numbers": numbers_of(found, cross), "tables": {"candidates": candidate_rows(found)}}
    (RESULTS / "design.json").write_text(json.dumps({**head, **body}, indent=1, ensure_ascii=False) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
