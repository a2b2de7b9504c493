"""A discovery in words and tables: what its report and the terminal say.

In: a `View`. Out: sentences, rows of tables.
"""

from __future__ import annotations

from typing import Any

from scipy import stats

from calibrate.diagnosis.effect_fit import Fit, bulk_modulus
from calibrate.diagnosis.selection import ALPHA, GLOBAL, Round, Row
from calibrate.effects import Effect
from studies.reports.discovery_review import (
    BAND,
    SMALLEST,
    View,
    amplitude_unit,
    amplitudes,
    indistinguishable,
    model_name,
    outcome,
    p_text,
    shape,
)
from studies.reports.experiments.experiment_findings import experiment_findings

OVERSTATED = 0.5  # reduced chi-square: the allowance for discretisation alone does not bring it so low
LISTED = 3  # amplitudes that a cell of the table can hold
MODEL_COLUMNS = [
    "model", "reduced chi-square", "degrees of freedom", "p", "chi-square each, fitted", "force error, fitted, %",
    "field error, fitted, %", "p, held out", "chi-square each, held out", "force error, held out, %", "field error, held out, %",
]  # fmt: skip
MODEL_CAPTION = (
    "Reduced chi-square and p: of what no energy of I1 can absorb, against the noise; chi-square each: per equation, "
    "with the model as it is. p, held out: of how any such energy predicts it. Force error: norm of the force errors over the norm of the measured forces. Field error: "
    "norm of the virtual work that fields without a load leave, over the same norm."
)
CANDIDATE_CAPTION = (
    "Score: by how much the whitened squared misfit would fall, over the dispersion; p adjusted for the whole search "
    "(1e-16 stands for anything smaller). Improvement: predicted by the score, as a share of what no energy of I1 "
    "absorbs; achieved when base and effect are fitted together, as a share of the whole misfit; empty where no fit with the "
    "effect was better than without it, and for all but those that were tried with --quick. Intervals are those of each candidate by itself, not adjusted for the search, so that "
    "those of insignificant ones may leave out zero. The head of an error column holds the error before. The numbers of the "
    "effect that was added differ a little from those of the next model, whose weights follow it. Symbols: see the catalogue "
    "at the end."
)
MISFIT_CAPTION = (
    "Whitened squared misfit, and its degrees of freedom: of all equations; of the part that a discretisation error could not "
    "change; of the part that varies slowly over specimen and increments. The p of a model is three times the smallest of its "
    "three. With no effect missing, chi-square is about as large as its degrees of freedom."
)
MISFITS = ("all equations", "beyond discretisation", "slow in place and load")
CATALOGUE_CAPTION = (
    "F: deformation gradient, F33: stretch of the thickness, J: change of volume, P, S: first and second Piola-Kirchhoff stress, "
    "psi: energy, u: displacement, x: place in the picture, f: force of a grip, h: thickness, q: curvature of an edge, positive at "
    "holes. x, y of a field run from 0 to 1 over the specimen, those of a gradient from its middle, over its larger extent. "
    "Lens, scale, motion and smoothing give what is seen of the true; all others the true of what was measured. Stage: where between "
    "specimen and numbers the effect sits."
)


def verdict(view: View) -> str:
    """The verdict in plain words, one paragraph; also that the last fit has not converged, if so."""
    final = view.discovery.final
    late = f"; its last fit had not converged (the last step still changed {final.last_step:.1f} standard deviations)"
    return _verdict(view) + ("" if final.converged else late)


def _verdict(view: View) -> str:
    found = view.discovery
    if found.verdict == "nothing significant":
        return f"nothing significant: {_best_candidate(found.rounds[-1])}; {_left(view)}"
    final = found.final
    if found.verdict == "explained":
        named = _additions(final, found.named, view.unit)
        parts = [f"explained: {named}, +- half the 95 % interval", _errors(view)]
        parts += [f"cannot be told from: {_likes(view, name)}" for name in found.named]
        parts += [f"would be decided by: {_deciding(view, found.named)}"] if _deciding(view, found.named) else []
        if found.closest:
            parts.append(f"beside it, too small to be named: {_additions(final, found.closest, view.unit)}")
        return "; ".join(parts)
    if found.closest:
        return "; ".join([
            f"significant, not explained: the closest is {_additions(final, found.closest, view.unit)}", _errors(view),
            _left(view), _best_candidate(found.rounds[-1]),
        ])  # fmt: skip
    last = found.rounds[-1]
    quiet = _calibrated(view) and last.fit.p_value > GLOBAL and last.predicted_p > GLOBAL
    alone = (
        "; no other test sees anything, so that it may well be a false alarm: repeat the test, or hold out others"
        if quiet
        else ""
    )
    return f"significant, not explained by any candidate: {_left(view)}; {_best_candidate(last)}{alone}"


def _additions(fit: Fit, names: tuple[str, ...], unit: str) -> str:
    texts = []
    for addition, deviations in zip(fit.additions, fit.errors, strict=True):
        if addition.effect.name not in names:
            continue
        values = [
            with_unit(f"{p.name} = {plus_minus(v, BAND * d)}", amplitude_unit(p, unit))
            for p, v, d in zip(addition.effect.amplitudes, addition.amplitudes, deviations, strict=True)
        ]
        if len(values) > LISTED:
            values = [f"{len(values)} amplitudes"]
        values += _shape_texts(addition.effect, addition.shape, unit)
        texts.append(f"{addition.effect.name} ({', '.join(values)})")
    return " and ".join(texts)


def plus_minus(value: float, half: float) -> str:
    """'0.01630 +- 0.00060': half the 95 % interval to two digits, the value to the same place."""
    if not 0 < half < float("inf"):
        return f"{value:.4g} +- {half:.2g}"
    digits = max(0, 1 - int(f"{half:e}".split("e")[1]))
    if digits > 7:
        return f"{value:.3e} +- {half:.1e}"
    return f"{value:.{digits}f} +- {half:.{digits}f}"


def _errors(view: View) -> str:
    first, last = view.discovery.rounds[0], view.discovery.rounds[-1]
    before, after, where = first.held, last.held, f"held out ({view.hold_out})"
    if before is None or after is None:
        before, after, where = first.train, last.train, "fitted, as nothing was held out"
    return (
        f"force error {percent(before.force)} -> {percent(after.force)}, field error {percent(before.field)} -> "
        f"{percent(after.field)} on data {where}"
    )


def percent(share: float) -> str:
    """'0.42 %', or 'unknown' where no force is among the equations."""
    return f"{100 * share:.2g} %" if share == share else "unknown"


def _hundred(share: float) -> float | None:
    """In per cent; None where there is none."""
    return 100 * share if share == share else None


def _likes(view: View, name: str) -> str:
    group = view.discovery.groups.get(name, (name,))[1:]
    return (", ".join(group) or "nothing else in the catalogue") + (f" (as to {name})" if _several(view) else "")


def _several(view: View) -> bool:
    return len(view.discovery.named) > 1


def _deciding(view: View, names: tuple[str, ...]) -> str:
    """The experiments that would break the ties; nothing where there is no tie."""
    tests = []
    known = {row.name: row.score.effect for now in view.discovery.rounds for row in now.rows}
    for name in names:
        group = view.discovery.groups.get(name, (name,))
        if len(group) > 1:
            tests += [known[n].decided_by for n in group if n in known and known[n].decided_by]
    return "; or ".join(dict.fromkeys(tests))


def _left(view: View) -> str:
    """How large what is left is, against the noise."""
    if not view.discovery.problem.noise_is_known:
        return "the noise is unknown, so that what is left cannot be compared with it"
    now = view.discovery.rounds[-1]
    smallest = min(range(3), key=lambda k: stats.chi2.sf(now.fit.misfits[k][0], max(now.fit.misfits[k][1], 1)))
    telling = smallest > 0 and now.fit.p_value < GLOBAL
    where = f" of what is {MISFITS[smallest]}" if telling else ""
    size = f"reduced chi-square {now.fit.reduced_chi_square:.3g}, p {p_text(now.fit.p_value)}{where}"
    if now.predicted is not None:
        size += f"; p of what was held out {p_text(now.predicted_p)}"
    if min(now.fit.p_value, now.predicted_p) < GLOBAL:
        return f"what the model leaves is more than noise ({size})"
    return f"what the model leaves is no more than noise ({size})"


def _best_candidate(now: Round) -> str:
    tested = [row for row in now.rows if row.score.status == "tested"]
    if not tested:
        return "no candidate could be tested"
    best = min(tested, key=lambda row: row.score.adjusted)
    p = p_text(best.score.adjusted)
    if best.score.adjusted >= ALPHA:
        return f"no candidate is significant (the best is {best.name}, adjusted p {p})"
    return f"{best.name} is significant (adjusted p {p}), but {outcome(best, now).removeprefix('significant, ')}"


def remarks(view: View) -> list[str]:
    """What a reader has to know, in sentences."""
    found, result = view.discovery, list(view.remarks)
    few = min(part.experiment.n_increments for part in found.problem.parts) < 3
    if not found.problem.noise_is_known:
        result.append(
            "The noise of an experiment is unknown: scores are judged by what the candidates leave, and whether that is "
            "more than noise cannot be said. Adjusted p are then no probabilities: noise alone may give tiny ones. Give the noise to the "
            "Experiment to know; `equigap import` estimates it."
        )
    elif found.rounds[0].fit.reduced_chi_square < OVERSTATED:
        result.append(
            f"What the base leaves is far less than the noise that is stated (reduced chi-square {found.rounds[0].fit.reduced_chi_square:.2g}): "
            "the noise is overstated, or the allowance for discretisation is. Small effects may go unnoticed, and adjusted p are inexact."
        )
    if found.rounds[0].held is None:
        result.append(
            "Nothing was held out: no data that the fit has not seen confirm what was added. "
            + (
                "Give another test of the same material."
                if few
                else "Give --hold-out every:3, or better another test of the same material."
            )
        )
    else:
        result.append(f"Held out: {view.hold_out}. {_how_hard(view)}")
    for i, now in enumerate(found.rounds, start=1):
        result += [f"Round {i}: {text}." for text in now.remarks]
    if view.unit != "MPa":
        result.append("The thickness is unknown: stresses are stress times thickness, in N/mm.")
    for part in found.problem.parts:
        result += [f.text for f in experiment_findings(part.experiment, part.assembled.noise_is_known)]
    bulk = bulk_modulus(found.problem, found.final)
    if bulk is not None:
        result.append(
            f"Plane strain: I1 is that of the isochoric part; bulk modulus {plus_minus(bulk[0], BAND * bulk[1])} {view.unit} "
            "(half the 95 % interval), of the last model."
        )
    return result


def _how_hard(view: View) -> str:
    """What holding this out can show."""
    if any(not part.train.size for part in view.discovery.problem.parts):
        return (
            "Another test is the strongest confirmation. Effects that belong to one test (load cell, camera, position) are "
            "not carried over to it, so that it confirms effects of the material only."
        )
    return (
        "The data held out come from the same test: errors that repeat in it, such as a wrong edge or camera noise that "
        "is correlated in time, are not uncovered."
    )


# --- tables ---------------------------------------------------------------------------------------------------


def model_table(view: View) -> tuple[list[str], list[list[Any]]]:
    """Columns and rows: the model of each round and its errors."""
    rows: list[list[Any]] = []
    for now in view.discovery.rounds:
        fit, held = now.fit, now.held
        outside = (held.chi_square, _hundred(held.force), 100 * held.field) if held else (None, None, None)
        predicted = _p(now.predicted_p) if _calibrated(view) and now.predicted is not None else None
        rows.append([
            model_name(fit), fit.reduced_chi_square, fit.degrees, _p(fit.p_value) if _calibrated(view) else None,
            now.train.chi_square, _hundred(now.train.force), 100 * now.train.field, predicted, *outside,
        ])  # fmt: skip
    return MODEL_COLUMNS, rows


def misfit_table(view: View) -> tuple[list[str], list[list[Any]]]:
    """Columns and rows: the three tests of what each model leaves."""
    rows: list[list[Any]] = []
    for now in view.discovery.rounds:
        for name, (chi, degrees) in zip(MISFITS, now.fit.misfits, strict=True):
            rows.append([model_name(now.fit), name, chi, degrees, _p(float(stats.chi2.sf(chi, max(degrees, 1))))])
    return ["model", "part", "chi-square", "degrees of freedom", "p"], rows


def catalogue_table(view: View) -> tuple[list[str], list[list[Any]]]:
    """Columns and rows: every effect with its formula, symbols, units and what decides it."""
    rows: list[list[Any]] = []
    for row in view.discovery.rounds[0].rows:
        effect = row.score.effect
        symbols = [
            (f"{p.name} ({unit})" if (unit := amplitude_unit(p, view.unit)) != "1" else p.name)
            for p in (*effect.amplitudes, *effect.shapes)
        ]
        shown = symbols if len(symbols) <= LISTED else [symbols[0], "...", symbols[-1]]
        source = "" if effect.source == Effect.source else f" ({effect.source})"
        rows.append([effect.name, effect.stage, effect.formula + source, ", ".join(shown), effect.decided_by or None])
    return ["effect", "stage", "formula (source)", "amplitudes and shapes (unit)", "decided by"], sorted(rows)


def _calibrated(view: View) -> bool:
    return view.discovery.problem.noise_is_known


def _p(value: float) -> float:
    return max(value, SMALLEST)


def candidate_table(now: Round, unit: str) -> tuple[list[str], list[list[Any]]]:
    """Columns and rows: every candidate of a round, those that could not be tested last."""
    columns = [
        "effect", "outcome", "cannot be told from", "score", "degrees", "adjusted p", "improvement predicted, %",
        "achieved, %", "amplitude, 95 % interval", "admissible",
        *_head("force error, fitted", now.train.force), *_head("field error, fitted", now.train.field),
        *_head("force error, held out", None if now.held is None else now.held.force),
        *_head("field error, held out", None if now.held is None else now.held.field),
        "chi-square each, held out" + ("" if now.held is None else f" (before: {now.held.chi_square:.3g})"),
        "similar to (cosine)", "decided by",
    ]  # fmt: skip
    rows: list[list[Any]] = [_in_the_model(now.fit, i, unit, len(columns)) for i in range(len(now.fit.additions))]
    return columns, rows + [_candidate(row, now, unit) for row in now.rows]


def _head(name: str, before: float | None) -> list[str]:
    return [f"{name}, %" + ("" if before is None or before != before else f" (before: {100 * before:.3g})")]


def _in_the_model(fit: Fit, i: int, unit: str, width: int) -> list[Any]:
    addition = fit.additions[i]
    row: list[Any] = [addition.effect.name, "in the model", *[None] * (width - 2)]
    row[8] = _additions(fit, (addition.effect.name,), unit).removeprefix(addition.effect.name).strip(" ()")
    row[-1] = addition.effect.decided_by or None
    return row


def _candidate(row: Row, now: Round, unit: str) -> list[Any]:
    s, effect = row.score, row.score.effect
    if s.status != "tested":
        return [row.name, outcome(row, now), *[None] * 14, effect.decided_by or None]
    after = (
        [v for m in (row.train, row.held) for v in (_hundred(m.force), 100 * m.field)]
        if row.train and row.held
        else ([_hundred(row.train.force), 100 * row.train.field, None, None] if row.train else [None] * 4)
    )
    like = ", ".join(f"{name} ({cosine:.2f})" for name, cosine in row.like)
    return [
        row.name, outcome(row, now), ", ".join(indistinguishable(row, now)) or None, s.score, s.degrees, _p(s.adjusted),
        100 * s.share, None if row.fit is None else round(100 * (1 - row.fit.loss / now.fit.loss), 6),
        amplitude_text(row, unit), s.admissible, *after,
        None if row.held is None else row.held.chi_square, like or None, effect.decided_by,
    ]  # fmt: skip


def amplitude_text(row: Row, unit: str) -> str:
    """'c01 = 0.0163 [0.0157, 0.0169] MPa; angle = 1.74 rad': refitted, or as tested where that is what there is.

    An inadmissible amplitude is the tested one: the refit stops at the bound.
    """
    texts = []
    all_of_them = amplitudes(row, unit)
    largest = sorted(all_of_them, key=lambda a: -abs(a["tested"]) / max(a["tested_deviation"], 1e-300))[:LISTED]
    for a in all_of_them if len(all_of_them) <= LISTED else largest:
        fitted = a["fitted"] is not None and row.score.admissible
        value, deviation = (a["fitted"], a["fitted_deviation"]) if fitted else (a["tested"], a["tested_deviation"])
        low, high = value - BAND * deviation, value + BAND * deviation
        texts.append(with_unit(f"{a['name']} = {value:.3g} [{low:.3g}, {high:.3g}]", a["unit"]))
    if len(all_of_them) > LISTED:
        texts.append(f"and {len(all_of_them) - LISTED} more in amplitudes.csv")
    if row.score.degrees < len(all_of_them):
        texts.append(f"only {row.score.degrees} of {len(all_of_them)} are independent in these data")
    values = row.score.shape if row.addition is None else row.addition.shape
    return "; ".join(texts + _shape_texts(row.score.effect, values, unit))


def _shape_texts(effect: Effect, values: tuple[float, ...], unit: str) -> list[str]:
    return [with_unit(f"{s['name']} = {s['value']:.3g}", s["unit"]) for s in shape(effect, values, unit)]


def with_unit(text: str, unit: str) -> str:
    """A quantity with its unit, which is left out where it is '1'."""
    return text if unit == "1" else f"{text} {unit}"


def untestable(now: Round) -> list[str]:
    """What these data cannot support: 'force gain: gauge, cannot be told from ...'."""
    return [f"{row.name}: {outcome(row, now)}" for row in now.rows if row.score.status != "tested"]
