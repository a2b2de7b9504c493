"""Take the numbers and pictures of the page on generalisation from a finished run: `python docs/collect_generalise.py FOLDER`.

In: the folder of `equigap generalise`. Out: `results/generalise.json` and the pictures of the page, with their manifests.
"""

from __future__ import annotations

import csv
import json
import shutil
import sys
from pathlib import Path
from typing import Any

from studies.grid.generalise.generalise_results import GeneraliseResults
from studies.grid.generalise.generalise_settings import GeneraliseSettings

DOCS = Path(__file__).resolve().parent
TRUTH = "arruda_boyce"
PICTURES = ("predictions_carroll", "matrices_carroll")

WIDTH_SETS = ("UT", "UT+PS", "TTd")


def width(folder: Path) -> dict[str, str]:
    """Stress error in uniaxial tension, Arruda-Boyce, I1, (4, 4), first seed: with the width that is seen, and with the strip."""
    results = GeneraliseResults(folder, GeneraliseSettings.read(folder))
    seed, found = results.settings.seeds[0], {}
    for one in results.widths(TRUTH):
        if one.tests in WIDTH_SETS and one.inputs == "I1":
            (strip,) = results.chosen(TRUTH, seed, tests=one.tests, inputs="I1", layers=one.layers)
            name = one.tests.replace("+", "_")
            for kind, fit in (("width", one), ("strip", strip)):
                error = 100 * results.error(TRUTH, fit, "uniaxial")
                found[f"{kind}_{name}"] = f"{error:.1f} %" if error < 50 else f"{error:.0f} %"
    return found


def rows(path: Path) -> list[dict[str, str]]:
    """Lines of a CSV by column."""
    with path.open() as file:
        return list(csv.DictReader(file))


def statements(folder: Path) -> list[list[str]]:
    """A line for each statement, the rubbers side by side."""
    found: dict[str, list[str]] = {}
    truths: list[str] = []
    for row in rows(folder / "statements.csv"):
        truths += [row["truth"]] if row["truth"] not in truths else []
        found.setdefault(row["the paper"], []).append(f"**{row['verdict']}** {row['here']}")
    return [["the paper", *truths], *([claim, *cells] for claim, cells in found.items())]


def sets(folder: Path, truth: str, inputs: str) -> list[list[str]]:
    """A line for each set of tests."""
    columns = ("calibrated on", "states covered (%)", "mean r2_F of the sheets", "error (%)", "ambiguity over sizes (%)", "beyond its data (%)",
               "over starts (%)")  # fmt: skip
    chosen = [row for row in rows(folder / "sets.csv") if (row["truth"], row["inputs"]) == (truth, inputs)]
    return [list(columns), *([row[column] for column in columns] for row in chosen)]


def main(folder: Path, made: str) -> dict[str, Any]:
    """Content of the file; copies the pictures."""
    for name in PICTURES:
        for suffix in (".png", ".json"):
            shutil.copy(folder / "figures" / f"{name}{suffix}", DOCS / "pictures" / f"generalise_{name}{suffix}")
    settings = json.loads((folder / "run.json").read_text())["settings"]
    return {
        "command": f"equigap generalise --seeds {len(settings['seeds'])}",
        "made": made,
        "how": "medians over sizes, and over noise seeds where there are several; computed by docs/collect_generalise.py from the study's folder",
        "numbers": {"seeds": len(settings["seeds"]), "starts": settings["starts"], **width(folder)},
        "tables": {
            "statements": statements(folder),
            "sets_both": sets(folder, "carroll", "I1I2"),
            "sets_first": sets(folder, "carroll", "I1"),
        },
    }


if __name__ == "__main__":
    content = main(Path(sys.argv[1]), sys.argv[2])
    (DOCS / "results" / "generalise.json").write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n")
