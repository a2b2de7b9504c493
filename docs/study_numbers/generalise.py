"""The page on generalisation, and the table of the eight sheets on that of specimens."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np

from calibrate.data.experiment import Experiment
from calibrate.equations.inputs import hencky_to_lode
from calibrate.equations.unseen_strip import window_equilibrium
from calibrate.fitting.calibrated_range import calibrated_range
from meshes import Specimen
from studies.grid.generalise import windows
from studies.grid.generalise.generalise_results import GeneraliseResults
from studies.grid.generalise.generalise_settings import SHEETS, GeneraliseSettings
from studies.grid.generalise.report import set_numbers

TRUTH = "arruda_boyce"
WIDTH_SETS = ("UT", "UT+PS", "TTd")
LEAST_STRAIN, HALF_WAY = 0.5, -np.pi / 12  # Hencky norm that counts; Lode angle between uniaxial tension and pure shear


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


def errors(folder: Path) -> dict[str, str]:
    """Worst-mode errors and r2_F that the page states, %, medians over seeds unless they say otherwise."""
    results = GeneraliseResults(folder, GeneraliseSettings.read(folder))
    settings, law = results.settings, "carroll"
    found: dict[str, Any] = {(tests, inputs): [set_numbers(results, law, seed, tests, inputs) for seed in settings.seeds]
                             for tests in settings.sets for inputs in ("I1", "I1I2")}  # fmt: skip
    medians = {key: float(np.median([row[1] for row in rows])) for key, rows in found.items()}
    numbers = {"cross": f"{medians['cross', 'I1I2']:.0f} %", "UT_cross": f"{medians['UT+cross', 'I1I2']:.0f} %"}
    for name, inputs in (("both", "I1I2"), ("first", "I1")):
        own = [value for (_, i), value in medians.items() if i == inputs]
        numbers[f"errors_{name}"] = f"{min(own):.0f} to {max(own):.0f} %"
    astray = [row for (_, i), rows in found.items() if i == "I1I2" for row in rows if row[2] > 100]
    every = [row for (_, i), rows in found.items() if i == "I1I2" for row in rows]
    numbers |= {"astray": str(len(astray)), "of_sets": str(len(every)),
                "ambiguity": f"{np.median([row[2] for row in every]):.1f} %"}  # fmt: skip
    on_ut = {(tests, inputs): float(np.median([one.scores["UT"] for seed in settings.seeds
                                               for one in results.chosen(TRUTH, seed, tests=tests, inputs=inputs, layers=(4, 4))]))
             for tests in settings.sets for inputs in ("I1", "I1I2")}  # fmt: skip
    below = {key: value for key, value in on_ut.items() if value < 0.99}
    numbers["below_on_UT"] = (
        ", ".join(f"{tests} ({inputs}) {value:.3f}" for (tests, inputs), value in below.items()) or "none"
    )
    return numbers


def holes(specimen: Specimen) -> str:
    """'2 of 4 x 2.5, 2 of 6 x 2.5'; those that lie across the pull say so."""
    kinds: dict[str, int] = {}
    for hole in specimen.holes():
        across = " across" if hole.a != hole.b and abs(np.sin(hole.angle)) > 0.5 else ""
        kind = f"{hole.a:g} x {hole.b:g}{across}"
        kinds[kind] = kinds.get(kind, 0) + 1
    return ", ".join(f"{count} of {kind}" for kind, count in kinds.items()) or "none"


def sheets(folder: Path) -> list[list[str]]:
    """Dimensions of the eight sheets and the states that a camera sees without noise, in the first rubber."""
    settings = GeneraliseSettings.read(folder)
    rows = [["name", "between the grips (mm)", "across (mm)", "holes (semi-axes, mm)", "each grip moves (mm)", "largest I1 seen",
             "share not uniaxial"]]  # fmt: skip
    for name in SHEETS:
        specimen = windows.specimen(name)
        clean = Experiment.load(settings.clean_path(folder, TRUTH, name))
        system = window_equilibrium(clean, 0.0, settings.spacing)
        F = system.deformation_gradients
        weights = np.broadcast_to(system.areas, F.shape[:2]).ravel()
        norm, angle = hencky_to_lode(F.reshape(-1, 2, 2))
        counts = norm >= LEAST_STRAIN
        share = weights[counts & (angle > HALF_WAY)].sum() / weights[counts].sum()
        along, across = ("half_length", "half_width") if "left" in specimen.loaded else ("half_width", "half_length")
        size = specimen.dimensions()
        rows.append([name, f"{2 * size[along]:g}", f"{2 * size[across]:g}", holes(specimen), f"{windows.pull(name):g}",
                     f"{calibrated_range(system)['I1'][1]:.1f}", f"{100 * share:.0f} %"])  # fmt: skip
    return rows


def take(folder: Path) -> dict[str, Any]:
    """Content of the file, of the folder of `equigap generalise`."""
    settings = json.loads((folder / "run.json").read_text())["settings"]
    return {
        "command": "equigap generalise (default)",
        "how": "medians over sizes and noise seeds",
        "numbers": {"seeds": len(settings["seeds"]), "starts": settings["starts"], **width(folder), **errors(folder)},
        "tables": {
            "sheets": sheets(folder),
            "statements": statements(folder),
            "sets_both": sets(folder, "carroll", "I1I2"),
            "sets_first": sets(folder, "carroll", "I1"),
        },
    }
