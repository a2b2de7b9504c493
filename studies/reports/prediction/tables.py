"""Tables of predicted curves: columns and rows for ``curves.csv`` and for the report."""

from __future__ import annotations

from typing import Any

from studies.reports.prediction.predicted_curves import LARGEST, Curve

Table = tuple[list[str], list[list[Any]]]


def curve_rows(curves: list[Curve], unit: str) -> Table:
    """Every stretch of every mode: stress, invariants, 1 within the calibrated range, and what else is known."""
    columns = ["mode", "stretch", f"nominal_stress_{unit}", "I1", "I2", "calibrated"]
    bands = ("standard_deviation", "low_95", "high_95")
    columns += [f"{name}_{unit}" for name in bands] if curves[0].band is not None else []
    columns += ["compared"] if curves[0].truth is not None else []
    rows: list[list[Any]] = []
    for c in curves:
        parts = [c.stretch, c.stress, *c.invariants.T, c.calibrated.astype(int)]
        parts += [] if c.band is None or c.deviation is None else [c.deviation, *c.band]
        parts += [] if c.truth is None else [c.truth]
        rows += [[c.name, *(value.item() for value in row)] for row in zip(*parts, strict=True)]
    return columns, rows


def curve_ends(curves: list[Curve], unit: str) -> Table:
    """Stress where each mode leaves the calibrated range and at the end of its curve."""
    columns = ["mode", "calibrated to stretch", f"stress there, {unit}", "its standard deviation",
               "curve leaves the range", f"stress at its end, {unit}", "its standard deviation"]  # fmt: skip
    rows = []
    for c in curves:
        end = float(c.stretch[-1])
        rows.append([
            c.name.replace("_", " "), c.limit if c.limit < LARGEST else None, c.stress_at(c.limit),
            c.deviation_at(c.limit), c.extrapolates, c.stress_at(end), c.deviation_at(end),
        ])  # fmt: skip
    return columns, rows
