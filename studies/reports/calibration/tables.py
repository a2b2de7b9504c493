"""Tables of a calibration: a `Review` in, columns and rows out, for the report and the terminal."""

from __future__ import annotations

from typing import Any

import numpy as np

from calibrate.equations.deformation_modes import TITLES
from calibrate.equations.inputs import INPUT_SETS
from calibrate.equations.kinematics import INVARIANTS
from studies.reports.calibration.fit_review import (
    Review,
    curve_points,
    initial_shear_modulus,
    modulus_deviation,
    section_shares,
)
from studies.reports.force_record import COMPONENTS
from studies.reports.prediction.predicted_curves import calibrated_stretch


def summary_table(view: Review) -> tuple[list[str], list[list[Any]]]:
    """Columns and rows: quantity, value, unit."""
    model, chi_square = view.model, view.calibration.reduced_chi_square
    nominal = model.level_is_nominal
    rows: list[list[Any]] = [
        [f"initial shear modulus{', nominal' if nominal else ''}", initial_shear_modulus(model), model.unit],
        *(_shares(view) if nominal else _force_errors(view)),
        ["loss", view.calibration.loss, ""],
    ]
    rows.append(["signal to noise of the strain", view.experiment.strain_signal.ratio, ""])
    deviation = modulus_deviation(model)
    if deviation is not None:
        rows.insert(1, ["its standard deviation", deviation, model.unit])
    if model.bulk_modulus is not None:
        rows.append(["bulk modulus", model.bulk_modulus, model.unit])
        rows.append(["its standard deviation", model.bulk_modulus_deviation, model.unit])
    if np.isfinite(chi_square):
        rows.append(["reduced chi-square", chi_square, ""])
    held = view.held_out
    if held is not None:
        if not nominal:
            rows.append(["relative force error, held-out increments", 100 * held.relative_force_error, "%"])
        if held.chi_square_per_equation is not None:
            rows.append(["chi-square per equation, fitted increments", view.fitted_chi_square, ""])
            rows.append(["chi-square per equation, held-out increments", held.chi_square_per_equation, ""])
    for i in INPUT_SETS[model.architecture.inputs]:
        name = INVARIANTS[i]
        rows.append([f"calibrated to {name}", model.calibrated_range[name][1], ""])
    rows += [[f"calibrated to stretch, {title}", calibrated_stretch(model, mode), ""] for mode, title in TITLES.items()]
    return ["quantity", "value", "unit"], rows


def _force_errors(view: Review) -> list[list[Any]]:
    return [
        ["relative force error, fitted increments", 100 * view.force_error(view.fitted), "%"],
        ["best neo-Hooke, the same error", 100 * view.neo_hooke_error, "%"],
    ]


def _shares(view: Review) -> list[list[Any]]:
    """Force of each section at the nominal level over the recorded one."""
    return [
        [f"force of the section over the recorded one, {name}, {which}", value, ""]
        for name, pair in section_shares(view).items()
        for which, value in zip(("smallest", "largest"), pair, strict=True)
    ]


def force_table(view: Review) -> tuple[list[str], list[list[float | str]]]:
    """Columns and rows: each measured force component, its largest value and how far the prediction is off."""
    columns = [
        "boundary",
        "component",
        "largest force, N",
        "rms error, N",
        "rms error, % of boundary's largest",
        "largest error, N",
    ]
    if view.deviations is not None:
        columns.append("expected from noise, N")
    rows: list[list[float | str]] = []
    for name, force in view.measured.items():
        for k, component in enumerate(COMPONENTS):
            known = np.isfinite(force[:, k])
            if not known.any():
                continue
            error = (view.forces[name] - force)[known, k]
            largest, rms = float(np.abs(force[known, k]).max()), float(np.sqrt(np.mean(error**2)))
            share = 100 * rms / float(np.nanmax(np.abs(force)) or np.nan)
            row: list[float | str] = [name, component, largest, rms, share, float(np.abs(error).max())]
            deviation = view.force_deviation(name, k)
            if deviation is not None:
                row.append(float(np.sqrt(np.mean(deviation[known] ** 2))))
            rows.append(row)
    return columns, rows


def curve_table(view: Review) -> tuple[list[str], list[list[float | str | None]]]:
    """Columns and rows: stress with its 95 % band at some stretches of each mode, and whether these are calibrated."""
    unit = view.model.unit
    columns = ["mode", "stretch", f"stress, {unit}", f"standard deviation, {unit}", "lower end, 95 %",
               "upper end, 95 %", "calibrated"]  # fmt: skip
    rows: list[list[float | str | None]] = [
        [TITLES[p["mode"]], p["stretch"], p["stress"], p["standard_deviation"], p["low_95"], p["high_95"],
         "yes" if p["calibrated"] else "no"]
        for p in curve_points(view.model)
    ]  # fmt: skip
    return columns, rows
