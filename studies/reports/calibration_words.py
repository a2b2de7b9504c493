"""A calibration in words and tables: what its report and the terminal say.

In: a `Review`. Out: rows of tables, sentences, and numbers for the manifest.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from calibrate.equations.deformation_modes import TITLES
from calibrate.equations.kinematics import INVARIANTS
from calibrate.models import pann
from studies.reports.calibration_review import (
    Review,
    curve_points,
    initial_shear_modulus,
    modulus_deviation,
)
from studies.reports.experiment_words import experiment_remarks
from studies.reports.force_record import COMPONENTS

CAUTION = " Trust the model only where predicted and measured forces agree."


def summary(view: Review) -> dict[str, Any]:
    """Numbers for a manifest."""
    return {
        **view.calibration.summary(),
        "initial_shear_modulus": initial_shear_modulus(view.model),
        "initial_shear_modulus_deviation": modulus_deviation(view.model),
        "curve_points": curve_points(view.model),
        "unit": view.model.unit,
        "neo_hooke_force_error": view.neo_hooke_error,
        "starts_alike": view.starts_alike,
        "held_out": view.held_out,
        "remarks": remarks(view),
    }


def remarks(view: Review) -> list[str]:
    """What the numbers mean, in sentences."""
    result = [_fit_remark(view), _starts_remark(view), _force_remark(view), _held_out_remark(view)]
    if view.model.uncertainty is not None:
        result.append(view.model.uncertainty.meaning())
    if view.experiment.thickness is None:
        result.append(
            "The thickness is unknown: stresses are stress times thickness, in N/mm. Divide by the thickness in mm "
            "to get MPa."
        )
    result += experiment_remarks(view.experiment, view.chi_square is not None)
    if view.experiment.plane == "strain":
        result.append(
            "Plane strain: invariants are those of the isochoric part of the deformation; the curves hold for constant volume."
        )
    return result


def summary_table(view: Review) -> tuple[list[str], list[list[Any]]]:
    """Columns and rows: quantity, value, unit."""
    model, chi_square = view.model, view.calibration.reduced_chi_square
    rows: list[list[Any]] = [
        ["initial shear modulus", initial_shear_modulus(model), model.unit],
        ["relative force error, fitted increments", 100 * view.force_error(view.fitted), "%"],
        ["best neo-Hooke, the same error", 100 * view.neo_hooke_error, "%"],
        ["loss", view.calibration.loss, ""],
    ]
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
        rows.append(["relative force error, held-out increments", 100 * held["relative_force_error"], "%"])
        if held["chi_square_per_equation"] is not None:
            rows.append(["chi-square per equation, held-out increments", held["chi_square_per_equation"], ""])
    for i in pann.INPUT_SETS[model.architecture.inputs]:
        name = INVARIANTS[i]
        rows.append([f"calibrated to {name}", model.calibrated_range[name][1], ""])
    rows += [[f"calibrated to stretch, {title}", model.largest_stretch(mode), ""] for mode, title in TITLES.items()]
    return ["quantity", "value", "unit"], rows


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
    """Columns and rows: stress with its 95 % band at some stretches of each mode, the last beyond the calibrated range."""
    unit = view.model.unit
    columns = ["mode", "stretch", f"stress, {unit}", f"standard deviation, {unit}", "lower end, 95 %",
               "upper end, 95 %", "calibrated"]  # fmt: skip
    rows: list[list[float | str | None]] = [
        [TITLES[p["mode"]], p["stretch"], p["stress"], p["standard_deviation"], p["low_95"], p["high_95"],
         "yes" if p["calibrated"] else "no"]
        for p in curve_points(view.model)
    ]  # fmt: skip
    return columns, rows


def _fit_remark(view: Review) -> str:
    value = view.calibration.reduced_chi_square
    if view.chi_square is None:
        return (
            "The noise of this experiment is unknown: the loss is no chi-square, and how much of the residual is noise "
            "cannot be said. Give the noise to the Experiment to know."
        )
    note = "" if np.isfinite(value) else " (judged with the noise weights, although this loss does not use them)"
    value = value if np.isfinite(value) else float(view.chi_square[view.fitted].mean())
    text = f"Reduced chi-square {value:.2f}{note}: "
    if value > 1.5:
        return text + (
            "above 1, the residuals are larger than the stated noise explains. Either the model leaves something out "
            "(another invariant, time dependence, thickness, a boundary that slips, a hole edge the camera does not "
            "see) or the noise is underestimated. The map of residuals shows where: scattered over the specimen "
            "points to noise, at holes or grips or growing with load to the model." + (CAUTION if value > 10 else "")
        )
    if value < 0.6:
        return text + "below 1, the residuals are smaller than the stated noise: the noise is overestimated."
    return text + "close to 1, what is left is as large as the stated noise and no larger."


def _starts_remark(view: Review) -> str:
    n, alike = len(view.calibration.losses), view.starts_alike
    text = f"{alike} of {n} starts ended as low as the best ({view.calibration.reason})."
    if n > 1 and alike < max(2, n // 5):
        return text + " Few agree: take more starts or a smaller network before trusting the shape of the curve."
    return text


def _force_remark(view: Review) -> str:
    error, simple = view.force_error(view.fitted), view.neo_hooke_error
    text = (
        f"Forces are met to {100 * error:.2g} % (root mean square); the best neo-Hookean modulus alone would give "
        f"{100 * simple:.2g} %."
    )
    if error > max(1.3 * simple, 0.02):
        text += " One modulus does better: equilibrium inside the specimen and the measured forces disagree."
    return text


def _held_out_remark(view: Review) -> str:
    held = view.held_out
    if held is None:
        return (
            "A low loss is no proof of a good model: no data were held out, so nothing here shows how it predicts. "
            "Fit again with --hold-out, or compare the model with another test of the same material."
        )
    numbers = np.flatnonzero(~view.fitted) + 1
    last = numbers.size == numbers[-1] - numbers[0] + 1 and numbers[-1] == view.experiment.n_increments
    text = (
        f"Held out: {'the last ' if last else ''}{held['increments']} of {view.experiment.n_increments} increments; "
        f"force error there {100 * held['relative_force_error']:.2g} %, "
        f"on the fitted ones {100 * view.force_error(view.fitted):.2g} %."
    )
    if held["chi_square_per_equation"] is not None:
        text += f" Chi-square per equation there: {held['chi_square_per_equation']:.2f}."
    worse = held["relative_force_error"] > max(0.05, 3 * view.force_error(view.fitted))
    if view.chi_square is not None:
        worse |= bool(held["chi_square_per_equation"] > 2 * view.chi_square[view.fitted].mean())
    if worse:
        text += " The model does not carry over to them: do not use it beyond its calibrated range."
    if last:
        return text + " They reach larger strains than the fit has seen, so this is a test of extrapolation."
    return text + " They lie between fitted ones, and camera noise may be correlated in time: a mild test."
