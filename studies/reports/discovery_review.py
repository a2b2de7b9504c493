"""What a discovery looks like in numbers: forces read and predicted, residuals over the specimen, records of the table.

In: a `Discovery`. Out: arrays for figures and files; residuals decorrelated, in units of their standard deviation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.diagnosis.effect_fit import Fit, bulk_modulus
from calibrate.diagnosis.effect_score import COLLINEAR
from calibrate.diagnosis.selection import ALPHA, Discovery, Misfit, Round, Row
from calibrate.diagnosis.whitened import Part
from calibrate.effects import Effect, Parameter
from calibrate.effects.chain import Additions
from calibrate.models.extended_model import amplitude_unit

Array = NDArray[np.float64]
BAND = 1.96
SMALLEST = 1e-16  # p-values below are all the same


@dataclass(frozen=True, eq=False)
class View:
    """A discovery, what was held out in words, and remarks on the input. quick: fewer pictures."""

    discovery: Discovery
    hold_out: str
    remarks: tuple[str, ...] = ()
    quick: bool = False

    @property
    def unit(self) -> str:
        """MPa, or N/mm where the thickness is unknown."""
        return self.discovery.problem.parts[0].experiment.stress_unit

    @property
    def models(self) -> dict[str, Fit]:
        """The base and, where something was added, the final model."""
        first, last = self.discovery.base, self.discovery.final
        return {"base model": first} if last is first else {"base model": first, "final model": last}


def carried(part: Part, additions: Additions) -> Additions:
    """Additions that hold for an experiment: all where it took part in the fit, else those of the material."""
    return additions if part.train.size else tuple(a for a in additions if a.effect.of_material)


def residual(part: Part, fit: Fit) -> Array:
    """Residual (t, 2 v), N, of a fit."""
    return part.residual(fit.c, carried(part, fit.additions))


def held_increments(part: Part) -> NDArray[np.bool_]:
    """(t,): increments no equation of which was used for fitting."""
    return ~part.train.rows.any(axis=1)


def forces(part: Part, fit: Fit) -> dict[str, tuple[Array, Array, Array]]:
    """Each loaded boundary's force (t, 2), N: measured, as the fit predicts the reading, standard deviation expected."""
    system, n = part.system, part.system.fields.n_fields
    r, spread = residual(part, fit), deviations(part)
    result = {}
    for v in np.flatnonzero(system.fields.boundary >= 0):
        loads = system.loads[:, [v, n + v]]
        name = part.experiment.loaded[system.fields.boundary[v]].name
        result[name] = (loads, np.nan_to_num(loads) + r[:, [v, n + v]], spread[:, [v, n + v]])
    return result


def _covariances(part: Part) -> Iterator[tuple[int, NDArray[np.bool_], Array]]:
    """Increment, equations (2 v,) and their covariance by noise and discretisation, N^2."""
    for weights in (part.train, part.held):
        growth, start = 1 / (1 + weights.shrink) ** 2 - 1, 0
        for i, lower in enumerate(weights.lowers):
            if not len(lower):
                continue
            common = lower @ (weights.U[start : start + len(lower)] * np.sqrt(growth))
            start += len(lower)
            yield i, weights.rows[i], lower @ lower.T + common @ common.T


def deviations(part: Part) -> Array:
    """Standard deviation (t, 2 v), N, of every residual; NaN where there is no equation."""
    result = np.full(part.train.rows.shape, np.nan)
    for i, rows, covariance in _covariances(part):
        result[i, rows] = np.sqrt(np.diag(covariance))
    return result


def decorrelated(part: Part, fit: Fit) -> Array:
    """Residuals (t, 2 v) of unit covariance that stay as close as can be to the virtual field they are named after.

    With s the standard deviations and R the correlations of an increment, R^-1/2 r / s (Kessy, Lewin and Strimmer 2018).
    """
    r = residual(part, fit)
    result = np.full(r.shape, np.nan)
    for i, rows, covariance in _covariances(part):
        spread = np.sqrt(np.diag(covariance))
        values, vectors = np.linalg.eigh(covariance / np.outer(spread, spread))
        root = np.sqrt(np.maximum(values, 1e-12 * values.max()))
        result[i, rows] = vectors @ ((vectors.T @ (r[i, rows] / spread)) / root)
    return result


def nodal(part: Part, values: Array) -> Array:
    """Root mean square of two components (t, n) at the nodes, of one (t, 2 v) for each virtual field."""
    size = np.sqrt((np.nan_to_num(values).reshape(len(values), 2, -1) ** 2).mean(axis=1))
    hats = part.system.fields.values
    return (hats @ size.T).T / np.maximum(np.asarray(hats.sum(axis=1)).ravel(), 1e-12)


# --- the table ------------------------------------------------------------------------------------------------


def outcome(row: Row, now: Round) -> str:
    """What became of a candidate, in words."""
    if row.score.status == "not testable":
        return f"not testable, {row.score.why}"
    if row.score.status != "tested":
        return {"gauge": f"gauge: {row.score.why}", "absorbed": f"singular: {row.score.why}"}[row.score.status]
    if row.name == now.added:
        return "added"
    if row.score.adjusted >= ALPHA:
        return "not significant"
    if not row.score.admissible:
        return "significant, not admissible"
    refused = [text.split(": ", 1)[1] for text in now.remarks if text.startswith(f"{row.name}: ")]
    if refused:
        return f"significant, refused: {refused[0]}"
    if not now.added:
        return "significant, not tried"
    return (
        "significant, not refitted: another has a higher score"
        if row.fit is None
        else "significant, another was better"
    )


def indistinguishable(row: Row, now: Round) -> tuple[str, ...]:
    """Effects that these data cannot tell from one: of what was added its group, else those of the same signature."""
    if row.name == now.added:
        return now.group[1:]
    return tuple(name for name, cosine in row.like if cosine > COLLINEAR)


def amplitudes(row: Row, unit: str) -> list[dict[str, Any]]:
    """Every amplitude: as the score test estimates it, and refitted with the base (None: no refit was made)."""
    addition = row.addition
    if row.score.status != "tested":
        return []
    return [
        {
            **_limits(p, unit),
            "tested": row.score.amplitudes[i],
            "tested_deviation": row.score.errors[i],
            **_fitted(None if addition is None else (addition.amplitudes[i], row.deviations[i])),
        }
        for i, p in enumerate(row.score.effect.amplitudes)
    ]


def _limits(p: Parameter, unit: str) -> dict[str, Any]:
    low, high = (float(v) if np.isfinite(v) else None for v in (p.lower, p.upper))
    return {"name": p.name, "unit": amplitude_unit(p, unit), "null": p.null, "lowest": low, "highest": high}


def _fitted(found: tuple[float, float] | None) -> dict[str, float | None]:
    value, deviation = (None, None) if found is None else found
    low, high = (None, None) if found is None else (found[0] - BAND * found[1], found[0] + BAND * found[1])
    return {"fitted": value, "fitted_deviation": deviation, "low_95": low, "high_95": high}


def shape(effect: Effect, values: tuple[float, ...], unit: str) -> list[dict[str, Any]]:
    """Every shape with its unit."""
    return [
        {"name": p.name, "unit": amplitude_unit(p, unit), "value": v}
        for p, v in zip(effect.shapes, values, strict=True)
    ]


def record(row: Row, now: Round, unit: str) -> dict[str, Any]:
    """A candidate with every number; improvement: share of the training misfit, predicted by the score and achieved."""
    score, effect = row.score, row.score.effect
    tested = score.status == "tested"
    fit = addition_shape = None
    if row.fit is not None and row.addition is not None:
        fit, addition_shape = row.fit, row.addition.shape
    return {
        "effect": effect.name,
        "stage": effect.stage,
        "formula": effect.formula,
        "status": score.status,
        "outcome": outcome(row, now),
        "indistinguishable": list(indistinguishable(row, now)),
        "score": score.score if tested else None,
        "degrees": score.degrees if tested else None,
        "p_value": score.p_value if tested else None,
        "adjusted_p_value": score.adjusted if tested else None,
        "predicted_improvement": score.share if tested else None,
        "achieved_improvement": None if fit is None else 1 - fit.loss / now.fit.loss,
        "absorbed_by_base": score.absorbed if score.status in ("tested", "absorbed") else None,
        "amplitudes": amplitudes(row, unit),
        "shape": shape(effect, addition_shape or score.shape, unit) if tested else [],
        "admissible": score.admissible if tested else None,
        "train_before": misfit_record(now.train),
        "train_after": misfit_record(row.train),
        "held_out_before": misfit_record(now.held),
        "held_out_after": misfit_record(row.held),
        "collinear_with": [{"effect": name, "cosine": cosine} for name, cosine in row.like],
        "decided_by": effect.decided_by,
        "of_material": effect.of_material,
    }


def misfit_record(misfit: Misfit | None) -> dict[str, Any] | None:
    """A misfit as plain data."""
    if misfit is None:
        return None
    return {"force_error": misfit.force, "field_error": misfit.field, "chi_square_per_equation": misfit.chi_square,
            "equations": misfit.rows}  # fmt: skip


def model_name(fit: Fit) -> str:
    """'base', or 'base + second invariant + image rotation'."""
    return " + ".join(["base", *(a.effect.name for a in fit.additions)])


def p_text(p: float) -> str:
    """'= 0.29', or '< 1e-16'."""
    return f"< {SMALLEST:.0e}" if p < SMALLEST else f"= {p:.2g}"


def experiment_record(part: Part) -> dict[str, Any]:
    """An experiment and how it was used."""
    e: Experiment = part.experiment
    return {
        "name": e.name, "increments": e.n_increments, "nodes": len(e.points), "triangles": len(e.triangles),
        "spacing_mm": part.system.fields.spacing, "equations_fitted": part.train.size,
        "equations_held_out": part.held.size,
        "held_out_increments": (np.flatnonzero(held_increments(part)) + 1).tolist(),
        "noise_is_known": part.assembled.noise_is_known,
    }  # fmt: skip


def round_record(now: Round, view: View) -> dict[str, Any]:
    """A round with every number."""
    problem, unit = view.discovery.problem, view.unit
    found = bulk_modulus(problem, now.fit)
    return {
        "bulk_modulus": None if found is None else {"value": found[0], "standard_deviation": found[1]},
        "model": model_name(now.fit),
        "loss": now.fit.loss,
        "equations": now.fit.n_rows,
        "degrees_of_freedom": now.fit.degrees,
        "reduced_chi_square": now.fit.reduced_chi_square,
        "p_value": now.fit.p_value if problem.noise_is_known else None,
        "misfits": {
            name: {"chi_square": loss, "degrees_of_freedom": n}
            for name, (loss, n) in zip(("all", "no discretisation error", "slow"), now.fit.misfits, strict=True)
        },
        "predicted": None
        if now.predicted is None
        else {
            "chi_square": now.predicted[0],
            "degrees_of_freedom": now.predicted[1],
            "p_value": now.predicted_p if problem.noise_is_known else None,
        },
        "train": misfit_record(now.train),
        "held_out": misfit_record(now.held),
        "candidates": [record(row, now, unit) for row in now.rows],
        "added": now.added,
        "group": list(now.group),
        "remarks": list(now.remarks),
    }


def content(view: View) -> dict[str, Any]:
    """Everything that the report says, as plain data."""
    found = view.discovery
    return {
        "format": "equigap-discovery",
        "version": 1,
        "verdict": found.verdict,
        "named": list(found.named),
        "closest": list(found.closest),
        "groups": {name: list(group) for name, group in found.groups.items()},
        "hold_out": view.hold_out,
        "noise_is_known": found.problem.noise_is_known,
        "stress_unit": view.unit,
        "plane": found.problem.parts[0].experiment.plane,
        "remarks": list(view.remarks),
        "experiments": [experiment_record(part) for part in found.problem.parts],
        "rounds": [round_record(now, view) for now in found.rounds],
    }
