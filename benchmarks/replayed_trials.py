"""How often the band of a replay rejects a right explanation: `python benchmarks/replayed_trials.py FOLDER`.

In: a folder for the trials, which are gone on with. Out: `docs/results/replay_verdict.json`: verdicts, levels, errors and chi-squares of eight blind trials, one effect
each and one without. Their seeds are not those of any reported trial.
"""

from __future__ import annotations

import json
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from studies.trials.blind_case import Plan, run

RESULTS = Path(__file__).parents[1] / "docs" / "results" / "replay_verdict.json"
FIRST = 994000
HIDDEN = ("second invariant", "viscoelasticity", "lens distortion", "force offset", "stiffness gradient", "image rotation", "Mullins softening", None)  # fmt: skip
HEAD = [
    "hidden",
    "verdict",
    "level",
    "force error: base",
    "final",
    "band",
    "chi-square of forces, each",
    "of fields, each",
    "p",
]


def main(folder: Path) -> None:
    """Run what is not there yet, and write the numbers."""
    plans = [Plan(FIRST + i, () if name is None else (name,)) for i, name in enumerate(HIDDEN)]
    found = [(plan, json.loads((folder / run(plan, folder) / "diagnosis.json").read_text())) for plan in plans]
    replayed = [(plan, content["full"]) for plan, content in found if "not_made" not in content["full"]["replay"]]
    before = json.loads(RESULTS.read_text()) if RESULTS.exists() else {"numbers": {}}
    content = {
        "command": "python benchmarks/replayed_trials.py FOLDER",
        "made": datetime.now(UTC).date().isoformat(),
        "how": "blind trials of seeds 994000 to 994007, one effect each and one without; the rule was committed before they were run",
        "numbers": {**before["numbers"], **numbers(replayed, len(plans))},
        "tables": {"trials": [HEAD, *(row(plan, full) for plan, full in replayed)]},
    }
    RESULTS.write_text(json.dumps(content, indent=1) + "\n")


def numbers(replayed: list[tuple[Plan, dict[str, Any]]], trials: int) -> dict[str, Any]:
    """Of all trials."""
    checks = [full["replay"] for _, full in replayed]
    each = {
        name: [one[f"{name}_test"]["chi_square"] / one[f"{name}_test"]["rows"] for one in checks]
        for name in ("force", "field")
    }
    off = [abs(one["final"]["level"] - 1) for one in checks]
    return {
        "trials": trials,
        "replayed": len(checks),
        "outside": sum(one["outside"] for one in checks),
        "worse": sum(one["worse"] for one in checks),
        "force_each": f"{np.median(each['force']):.2f}",
        "field_each": f"{np.median(each['field']):.2f}",
        "largest_level": f"{100 * max(off):.2f} %",
    }


def row(plan: Plan, full: dict[str, Any]) -> list[str]:
    """Of the table."""
    check = full["replay"]
    tests = [f"{check[k]['chi_square'] / check[k]['rows']:.2f}" for k in ("force_test", "field_test")]
    forces = [check["base"]["judged"]["force"], check["final"]["judged"]["force"], check["band"]["force"]]
    return [", ".join(plan.effects) or "nothing", full["verdict"], f"{check['final']['level']:.4f}", *(f"{100 * v:.2f} %" for v in forces), *tests, f"{check['p']:.2g}"]  # fmt: skip


if __name__ == "__main__":
    main(Path(sys.argv[1]))
