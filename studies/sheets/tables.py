"""Tables of the report on measured data: results of the steps in, columns and rows out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from studies.output.words import Words, percent
from studies.sheets.leave_one_out import NESTED
from studies.sheets.measured_record import SHEETS
from studies.sheets.measured_results import ControlResult, HomogeneousResult, MapResult, MeasuredResults, RecordResult
from studies.sheets.sheet_results import ModelName, PartErrors, ScoredModel, SheetResult, TransferredModel

WORDS = Words("measured")
Table = tuple[list[str], list[list[Any]]]


def error_table(models: Sequence[ScoredModel]) -> Table:
    """One row a model: errors on what was fitted and on what was scored."""
    columns = ["model", "factors", "force, fitted", "force, scored", "mean force, fitted", "mean force, scored",
               "field, fitted", "field, scored", "section scatter, scored", "lower / upper third, scored"]  # fmt: skip
    rows = []
    for m in models:
        fitted, scored = m.errors.fitted, m.errors.scored
        found = m.factors if isinstance(m, TransferredModel) else {}
        factors = ", ".join(f"{name} {value:.3g}" for name, value in found.items())
        rows.append([m.name, factors, percent(fitted.force), percent(scored.force),
                     percent(fitted.mean_force), percent(scored.mean_force),
                     percent(fitted.field), percent(scored.field), percent(scored.section_scatter),
                     round(scored.lower_over_upper, 3)])  # fmt: skip
    return columns, rows


def record_table(records: dict[str, RecordResult]) -> Table:
    """What each record says before any model."""
    columns = ["sheet", "missing frames", "exponent of the force", "contraction in the middle",
               "largest axial strain left at no load", "lateral"]  # fmt: skip
    rows = []
    for name in SHEETS:
        r = records[name]
        inner = [max(map(abs, part[1:-1])) for part in r.at_rest]
        rows.append(
            [
                name,
                WORDS.gaps(missing_frames=r.missing_frames),
                round(r.force_exponent, 3),
                round(r.contraction, 3),
                percent(inner[0]),
                percent(inner[1]),
            ]
        )
    return columns, rows


def amplitude_table(learnt: SheetResult) -> Table:
    """Amplitudes of the retained effects, and their range over the leave-one-out fits."""
    columns = [
        "effect",
        "amplitude",
        "value",
        "standard deviation",
        "unit",
        "told from zero",
        "over the leave-one-out fits",
    ]
    left_out = [one.additions for one in learnt.model(ModelName.MEAN).models]
    rows = []
    for a in learnt.model(ModelName.RETAINED).amplitudes:
        values = [
            value
            for additions in left_out
            for one in additions
            if one.effect.name == a.effect
            for p, value in zip(one.effect.amplitudes, one.amplitudes, strict=True)
            if p.name == a.name
        ]
        told, over = WORDS.told_from_zero(told=a.is_told_from_zero), WORDS.over_fits(values=values)
        rows.append([a.effect, a.name, a.value, a.deviation, a.unit, told, over])
    return columns, rows


def leave_one_out_table(learnt: SheetResult) -> Table:
    """What is retained without each increment, and how that predicts."""
    columns = ["without the increment at (s)", "effects", "force, fitted", "force, scored", "field, scored"]
    return columns, [
        [
            round(one.left_out, 2),
            ", ".join(one.effects),
            *map(percent, (one.force_fitted, one.force_scored, one.field_scored)),
        ]
        for one in learnt.leave_one_out
    ]


def kept(learnt: SheetResult, effect: str) -> str:
    """In how many leave-one-out fits an effect, or one more general or special than it, is kept."""
    alike = {effect, NESTED.get(effect, effect), *(s for s, general in NESTED.items() if general == effect)}
    found = sum(bool(alike & set(one.effects)) for one in learnt.leave_one_out)
    return f"{found} of {len(learnt.leave_one_out)}"


def effect_table(learnt: SheetResult) -> Table:
    """What each effect is worth: errors of the model that is fitted without it."""
    columns = ["effect", "outcome", "kept in leave-one-out fits", "rise of the misfit without it", "penalty of its parameters",
               "imitated by the others", "force, scored, without it", "field, scored, without it", "decided by"]  # fmt: skip
    rows: list[list[Any]] = []
    for line in sorted(learnt.without, key=lambda line: -line.rise):
        outcome = WORDS.in_the_model(doubtful=line.doubtful)
        rows.append([line.effect, outcome, kept(learnt, line.effect), line.rise, line.penalty,
                     f"{100 * line.imitated:.1f} %", percent(line.force_scored), percent(line.field_scored), line.decided_by])  # fmt: skip
    gone = [(pair.general, WORDS.exchanged(special=pair.special)) for pair in learnt.exchanged]
    gone += [(name, WORDS.removed()) for name in learnt.taken_out]
    rows += [[name, why, kept(learnt, name), *[None] * 6] for name, why in gone]
    rows += [[name, why, *[None] * 7] for name, why in learnt.not_testable.items()]
    return columns, rows


def variant_table(learnt: SheetResult) -> Table:
    """Every effect from other starts, and the retained effects beside other bases."""
    columns = ["variant", "misfit, of bases with penalty, over the first", "force, fitted", "force, validation", "field, validation",
               "force, scored", "field, scored"]  # fmt: skip
    first = learnt.starts[0].objective
    rows: list[list[Any]] = []
    for i, s in enumerate(learnt.starts, start=1):
        rows.append([WORDS.start(number=i), s.objective - first, percent(s.force_fitted), None, None,
                     percent(s.force_scored), percent(s.field_scored)])  # fmt: skip
    for b in learnt.bases:
        seen = map(percent, (b.validation_error.force, b.validation_error.field))
        rows.append([WORDS.base(name=b.name, chosen=b.chosen), b.penalised_misfit, percent(b.force_fitted), *seen,
                     percent(b.force_scored), percent(b.field_scored)])  # fmt: skip
    return columns, rows


def spread(learnt: SheetResult) -> dict[str, tuple[float, float]]:
    """Smallest and largest error after the limit over the leave-one-out fits: models that the data fitted do not choose between."""
    lines = learnt.leave_one_out
    kinds = {"force": [line.force_scored for line in lines], "field": [line.field_scored for line in lines]}
    return {kind: (min(values), max(values)) for kind, values in kinds.items()}


def rival_table(results: MeasuredResults) -> Table:
    """Softening with strain against relaxation in time."""
    columns = ["base", "force, fitted", "field, fitted", "force, scored", "field, scored"]
    lines: list[tuple[str, PartErrors]] = [(WORDS.relaxing(name=b.name), b) for b in results.first.bases]
    lines += [(m.name, m) for m in results.rivals.models]
    return columns, [
        [name, *map(percent, (m.force_fitted, m.field_fitted, m.force_scored, m.field_scored))] for name, m in lines
    ]


def map_table(located: MapResult) -> Table:
    """Errors of the heterogeneous sheet before and after."""
    rows = []
    for part, change in (("fitted", located.errors.fitted), ("scored", located.errors.scored)):
        errors = (change.before.force, change.after.force, change.before.field, change.after.field)
        rows.append([part, *map(percent, errors)])
    return ["increments", "force before", "force after", "field before", "field after"], rows


def control_table(controls: dict[str, ControlResult]) -> Table:
    """The negative control."""
    columns = ["sheet", "pictures compared", "reduced chi-square", "effects tested", "smallest adjusted p", "highest score"]  # fmt: skip
    rows = []
    for name in SHEETS:
        r = controls[name]
        first = max(r.effects, key=lambda e: e.score, default=None)
        rows.append(
            [name, r.pictures, r.reduced_chi_square, len(r.effects), r.smallest_adjusted_p, first and first.effect]
        )
    return columns, rows


def loop_table(loops: Sequence[HomogeneousResult]) -> Table:
    """Homogeneous tests, before and after."""
    rows = []
    for r in loops:
        effects = WORDS.effects(named=r.named, closest=r.closest)
        for t in r.tests:
            rows.append(
                [
                    r.name,
                    t.name,
                    WORDS.role(fitted=t.fitted),
                    percent(t.before),
                    percent(t.after),
                    str(r.verdict),
                    effects,
                ]
            )
    return ["loop", "test", "role", "before", "after", "verdict", "effects"], rows
