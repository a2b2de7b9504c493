"""Tables of the report of a discovery: a `View` in, columns and rows out."""

from __future__ import annotations

from typing import Any

import numpy as np

from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.misfit import Misfit
from calibrate.diagnosis.selection.rounds import Candidate, Round
from calibrate.effects import Effect
from calibrate.models.addition_json import amplitude_unit
from calibrate.models.parameter_covariance import Z95
from studies.output.words import with_unit
from studies.reports.discovery.candidate_outcome import WORDS, indistinguishable, outcome_words
from studies.reports.discovery.records import amplitude_records, model_name, told_shapes
from studies.reports.discovery.statement import LISTED, effect_values
from studies.reports.discovery.view import View

SMALLEST = 1e-16  # p-values below are all the same
MODEL_COLUMNS = [
    "model", "reduced chi-square", "degrees of freedom", "p", "chi-square each, fitted", "force error, fitted, %",
    "field error, fitted, %", "p, held out", "chi-square each, held out", "force error, held out, %", "field error, held out, %",
]  # fmt: skip
AMPLITUDE = "amplitude, 95 % interval"
Table = tuple[list[str], list[list[Any]]]


def _percent(share: float) -> float | None:
    """In per cent; None where there is none."""
    return 100 * share if share == share else None


def model_table(view: View) -> Table:
    """The model of each round and its errors."""
    known = view.discovery.problem.noise_is_known
    rows: list[list[Any]] = []
    for now in view.discovery.rounds:
        fit, held = now.fit, now.held
        rows.append([
            model_name(fit), fit.reduced_chi_square, fit.degrees, _p(now.misfits.p_value) if known else None,
            now.train.chi_square, *_errors(now.train), _p(now.predicted_p) if known and now.predicted is not None else None,
            None if held is None else held.chi_square, *_errors(held),
        ])  # fmt: skip
    return MODEL_COLUMNS, rows


def _errors(misfit: Misfit | None) -> list[float | None]:
    """Force and field error, %."""
    return [None, None] if misfit is None else [_percent(misfit.force), 100 * misfit.field]


def misfit_table(view: View) -> Table:
    """The three tests of the residual of each model."""
    rows: list[list[Any]] = []
    for now in view.discovery.rounds:
        for name, test in now.misfits._asdict().items():
            rows.append([model_name(now.fit), WORDS.part(test=name), test.value, test.degrees, _p(test.p_value)])
    return ["model", "part", "chi-square", "degrees of freedom", "p"], rows


def catalogue_table(view: View) -> Table:
    """Every effect of any round with its formula, symbols, units and what decides it."""
    rows: list[list[Any]] = []
    for effect in view.effects:
        symbols = [
            (f"{p.name} ({unit})" if (unit := amplitude_unit(p, view.unit)) != "1" else p.name)
            for p in (*effect.amplitudes, *effect.shapes)
        ]
        shown = symbols if len(symbols) <= LISTED else [symbols[0], "...", symbols[-1]]
        source = "" if effect.source == Effect.source else f" ({effect.source})"
        rows.append([effect.name, effect.stage, effect.formula + source, ", ".join(shown), effect.decided_by or None])
    return ["effect", "stage", "formula (source)", "amplitudes and shapes (unit)", "decided by"], sorted(rows)


def _p(value: float) -> float | str:
    return value if value > SMALLEST else f"< {SMALLEST:g}"


def candidate_table(now: Round, view: View) -> Table:
    """Every candidate of a round by its score, those that could not be tested last; what else is known of them is in ``effects.csv``."""
    before, where = (now.train, "fitted") if now.held is None else (now.held, "held out")
    columns = [
        "effect", "outcome", "cannot be told from", "similar to (cosine)", "score", "adjusted p", AMPLITUDE,
        _head(f"force error, {where}", before.force), _head(f"field error, {where}", before.field),
    ]  # fmt: skip
    rows = [_in_the_model(now.fit, i, view, columns) for i in range(len(now.fit.additions))]
    ordered = sorted(now.candidates, key=lambda c: -c.score.score if c.score.is_tested else np.inf)
    return columns, rows + [_candidate(candidate, now, view, columns) for candidate in ordered]


def _head(name: str, before: float | None) -> str:
    return f"{name}, %" + ("" if before is None or before != before else f" (before: {100 * before:.3g})")


def _in_the_model(fit: Fit, i: int, view: View, columns: list[str]) -> list[Any]:
    row: list[Any] = [fit.additions[i].effect.name, "in the model", *[None] * (len(columns) - 2)]
    row[columns.index(AMPLITUDE)] = ", ".join(effect_values(fit, i, view.unit, view.level))
    return row


def _candidate(candidate: Candidate, now: Round, view: View, columns: list[str]) -> list[Any]:
    s, thresholds = candidate.score, view.discovery.thresholds
    words = outcome_words(candidate, now, thresholds)
    if not s.is_tested:
        return [candidate.name, words, *[None] * (len(columns) - 2)]
    like = ", ".join(f"{name} ({cosine:.2f})" for name, cosine in candidate.like)
    return [
        candidate.name, words, ", ".join(indistinguishable(candidate, now, thresholds)) or None, like or None,
        s.score, _p(s.adjusted), amplitude_text(candidate, view.unit, view.level),
        *_errors(candidate.train if now.held is None else candidate.held),
    ]  # fmt: skip


def amplitude_text(candidate: Candidate, unit: str, level: float = 1.0) -> str:
    """'c01 = 0.0163 [0.0157, 0.0169] MPa; angle = 1.74 rad': refitted, or as tested where that is what there is.

    An inadmissible amplitude is the tested one: the refit stops at the bound.
    """
    texts, score = [], candidate.score
    everything = amplitude_records(candidate, unit, level)
    largest = sorted(everything, key=lambda a: -abs(a.tested) / max(a.tested_deviation, 1e-300))[:LISTED]
    for a in everything if len(everything) <= LISTED else largest:
        value, deviation = a.tested, a.tested_deviation
        if a.fitted is not None and a.fitted_deviation is not None and score.admissible:
            value, deviation = a.fitted, a.fitted_deviation
        low, high = value - Z95 * deviation, value + Z95 * deviation
        texts.append(with_unit(f"{a.name} = {value:.3g} [{low:.3g}, {high:.3g}]", a.unit))
    if len(everything) > LISTED:
        texts.append(WORDS.more_amplitudes(n=len(everything) - LISTED))
    if score.degrees < len(everything):
        texts.append(WORDS.independent(degrees=score.degrees, n=len(everything)))
    values = score.shape if candidate.addition is None else candidate.addition.shape
    shapes = told_shapes(score.effect, values, unit)
    return "; ".join(texts + [with_unit(f"{s.name} = {s.value:.3g}", s.unit) for s in shapes])
