"""One correlation length beside two: two runs of `python -m benchmarks.noise.false_alarms` on the same seeds, of noise that is not stated."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

QUIET = "nothing significant"
KERNELS = {"Gaussian": "one length", "two lengths": "two lengths", "exponential": "exponential"}
COLUMNS = ["covariance of the noise", "tests", "alarms, one length", "alarms, two lengths", "reduced chi-square, one length", "two lengths"]  # fmt: skip


def take(one: Path, two: Path) -> dict[str, Any]:
    """Numbers and table. one, two: folders of the version before and of that with two lengths."""
    before, after = ({(r["condition"], r["seed"]): r for r in _tests(folder)} for folder in (one, two))
    same = sorted(before.keys() & after.keys())
    table = []
    for kernel, words in KERNELS.items():
        tests = [key for key in same if before[key]["kernel"] == kernel]
        pairs = [[by_seed[key] for key in tests] for by_seed in (before, after)]
        table.append([words, str(len(tests)), *(str(_alarms(each)) for each in pairs), *(_chi(each) for each in pairs)])
    numbers = {
        "tests": len(same),
        "one": _alarms([before[key] for key in same]),
        "two": _alarms([after[key] for key in same]),
        "first": min(seed for _, seed in same),
    }
    return {
        "command": f'python -m benchmarks.noise.false_alarms --first {numbers["first"]} --seeds 12 --only "not stated" "correlation 0.5, not stated"',
        "how": "at revisions 9886d80 and 91832c5, the same seeds; none was looked at before the second was fixed",
        "numbers": numbers,
        "tables": {"alarms": [COLUMNS, *table]},
    }


def _tests(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(file.read_text()) for file in sorted((folder / "tests").glob("*.json"))]


def _alarms(tests: list[dict[str, Any]]) -> int:
    return sum(one["verdict"] != QUIET for one in tests)


def _chi(tests: list[dict[str, Any]]) -> str:
    """Of all equations: median and range."""
    values = [one["chi_square"]["all"][0] / one["chi_square"]["all"][1] for one in tests]
    return f"{np.median(values):.2f} ({min(values):.2f} to {max(values):.2f})"
