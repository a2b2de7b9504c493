"""Numbers and tables of docs/peers.md from the records of the comparison.

In: the dicts of `side_by_side.compare`, `elastic_plate.study` and the growth of times. Out: {name: number}, {name: rows of text}.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from beside.nn_euclid_data import PATHS, TITLES

Row = dict[str, Any]
ORDER = ("UT", "BT", "PS", "SS", "UC", "BC")


def median_of(rows: list[Row]) -> list[Row]:
    """One row a model: the one of median loss over its seeds."""
    names = list(dict.fromkeys(row["name"] for row in rows))
    alike = [sorted((row for row in rows if row["name"] == name), key=lambda row: row["loss"]) for name in names]
    return [group[len(group) // 2] for group in alike]


def percent(value: float) -> str:
    """Two digits."""
    return f"{100 * value:.2g}"


def mean_error(row: Row, end: int, kind: str = "stress_error") -> float:
    """Over the six paths; end 0: to gamma 0.3, 1: to 1."""
    return float(np.mean([row[kind][path][end] for path in PATHS]))


def worst_error(row: Row, end: int) -> float:
    """Of the six paths."""
    return max(row["stress_error"][path][end] for path in PATHS)


def reached(peer: list[Row], loss: float) -> Row | None:
    """The first checkpoint with no more than a loss."""
    return next((row for row in peer if row["loss"] <= loss), None)


def models_table(case: Row) -> list[list[str]]:
    """Loss, time and errors of every model of a case."""
    head = [
        "model",
        "CPU s",
        "loss",
        "stress error to 0.3, mean (worst) %",
        "to 1, mean (worst) %",
        "energy to 1, mean %",
    ]
    rows = [head]
    peer = [{**case["peer"][-1], "name": f"NN-EUCLID, {case['peer'][-1]['epoch']} epochs"}] if case["peer"] else []
    for row in [*median_of(case["models"]), *peer]:
        errors = [f"{percent(mean_error(row, k))} ({percent(worst_error(row, k))})" for k in (0, 1)]
        seconds = f"{row['cpu_seconds']:.3g}" if "cpu_seconds" in row else ""
        energy = percent(mean_error(row, 1, "energy_error"))
        rows.append([row["name"].replace("truth", "exact law"), seconds, f"{row['loss']:.3g}", *errors, energy])
    return rows


def paths_table(case: Row) -> list[list[str]]:
    """Relative stress error of every model on every path to gamma 1, %."""
    rows = [["model", *(TITLES[path] for path in ORDER)]]
    for row in [*median_of(case["models"])[1:], *case["peer"][-1:]]:
        cells = [f"{percent(row['stress_error'][p][0])}, {percent(row['stress_error'][p][1])}" for p in ORDER]
        rows.append([row["name"], *cells])
    return rows


def time_to_equal_loss(case: Row) -> list[str]:
    """Material, noise, our loss and time, NN-EUCLID's time to it, its last loss and time."""
    mine = min((row for row in median_of(case["models"]) if row["name"].startswith("equigap")), key=lambda r: r["loss"])
    last, found = case["peer"][-1], reached(case["peer"], mine["loss"])
    there = f"{found['cpu_seconds']:.0f} s" if found else "not reached"
    return [
        f"{case['material']}, {case['noise']}", mine["name"], f"{mine['loss']:.3g}", f"{mine['cpu_seconds']:.0f} s",
        there, f"{last['loss']:.3g} after {last['epoch']} epochs, {last['cpu_seconds']:.0f} s",
    ]  # fmt: skip


def plate_table(plate: list[Row]) -> list[list[str]]:
    """Median and largest relative error of E and nu over the seeds."""
    rows = [
        [
            "points",
            "noise, mm",
            "method",
            "E: median (largest) error %",
            "nu: median (largest) error %",
            "CPU s",
            "refused",
        ]
    ]
    keys = list(dict.fromkeys((row["points"], row["noise"]) for row in plate))
    for points, noise in keys:
        group = [row for row in plate if (row["points"], row["noise"]) == (points, noise)]
        refused = sum("refused" in row for row in group)
        for method in ("network", "two constants"):
            good = [row for row in group if row["method"] == method and "refused" not in row]
            cells = ["", "", ""]
            if good:
                cells = [_spread([row[key] for row in good]) for key in ("E_error", "nu_error")]
                cells.append(f"{np.median([row['cpu_seconds'] for row in good]):.2g}")
            rows.append([str(points), f"{noise:g}", method, *cells, f"{refused} of {len(good) + refused}"])
    return rows


def _spread(values: list[float]) -> str:
    largest = max(values, key=abs)
    return f"{100 * float(np.median(values)):+.2g} ({100 * largest:+.2g})"


def growth_table(times: list[Row]) -> list[list[str]]:
    """Times over the number of load steps."""
    rows = [["load steps", "equigap, one calibration, s", "NN-EUCLID, one epoch, s", "500 epochs, s"]]
    for row in times:
        rows.append([str(row["steps"]), f"{row['equigap']:.1f}", f"{row['epoch']:.2f}", f"{500 * row['epoch']:.0f}"])
    return rows


def summary(cases: list[Row], plate: list[Row], times: list[Row], settings: Row) -> tuple[Row, dict[str, Any]]:
    """All numbers and tables of the page."""
    tables: dict[str, Any] = {"plate": plate_table(plate)} | ({"growth": growth_table(times)} if times else {})
    equal = [["data", "equigap", "its loss", "its CPU time", "NN-EUCLID's CPU time to it", "NN-EUCLID's last loss"]]
    numbers: Row = {}
    for case in cases:
        key = f"{case['material'].lower()}_{case['noise']}"
        tables[key], tables[f"{key}_paths"] = models_table(case), paths_table(case)
        if case["peer"]:
            equal.append(time_to_equal_loss(case))
            last = case["peer"][-1]
            numbers |= {
                f"{key}_epochs": str(last["epoch"]),
                f"{key}_epoch_s": f"{last['cpu_seconds'] / last['epoch']:.1f}",
                f"{key}_nn_error": f"{percent(mean_error(last, 0))} %",
                f"{key}_nn_far": f"{percent(mean_error(last, 1))} %",
            }
            if "angle" in last:
                numbers[f"{key}_angle"] = f"{last['angle']:.1f}"
        for row in median_of(case["models"]):
            numbers |= _model_numbers(key, row)
    tables["equal_loss"] = equal
    versions = settings["nn_euclid"]
    numbers["versions"] = ", ".join(f"{name} {value[:12]}" for name, value in versions.items())
    return numbers, tables


def _model_numbers(key: str, row: Row) -> Row:
    name = {
        "equigap, I1": "i1",
        "equigap, I1I2": "i1i2",
        "truth": "truth",
        "Yeoh": "yeoh",
        "Ogden, one term": "ogden",
        "two fibres (Holzapfel)": "fibres",
    }.get(row["name"])
    if name is None:
        return {}
    found = {
        f"{key}_{name}_loss": f"{row['loss']:.3g}",
        f"{key}_{name}_error": f"{percent(mean_error(row, 0))} %",
        f"{key}_{name}_far": f"{percent(mean_error(row, 1))} %",
    }
    if "bulk_modulus" in row:
        found[f"{key}_{name}_kappa"] = f"{row['bulk_modulus']:.3g}"
        found[f"{key}_{name}_mu"] = f"{row['shear_modulus']:.3g}"
    if "reduced_chi_square" in row:
        found[f"{key}_{name}_chi"] = f"{row['reduced_chi_square']:.2g}"
    if "angle" in row.get("parameters", {}):
        found[f"{key}_{name}_angle"] = f"{row['parameters']['angle']:.2f}"
    return found


def fibre_numbers(found: Row) -> Row:
    """Of the diagnosis of the fibrous data."""
    numbers = {"fibres_verdict": found.get("verdict", "refused"), "fibres_s": f"{found['cpu_seconds']:.0f}"}
    for addition in found.get("additions", []):
        if addition["effect"] == "two fibre families":
            axis, half = np.degrees(addition["shape"][:2])
            numbers |= {
                "fibres_axis": f"{axis:.2f}",
                "fibres_half": f"{half:.1f}",
                "fibres_k": f"{addition['amplitudes'][0]:.2f}",
                "fibres_k2": f"{addition['shape'][2]:.2f}",
            }
    return numbers
