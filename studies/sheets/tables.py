"""Tables of the report on measured data: results of the steps in, columns and rows out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from studies.output.words import Words, digits, digits_if_any, percent
from studies.sheets.sheet_results import ControlResult, HomogeneousResult, SheetResult, TransferResult

WORDS = Words("measured")
SAID = 0.05  # probability of an effect, from which it is told
Table = tuple[list[str], list[list[Any]]]
ERRORS = ["force error, fitted", "field error, fitted", "force error, held out", "field error, held out"]


def verdict_table(sheets: Mapping[str, SheetResult]) -> Table:
    """One line a sheet: what `equigap discover` says."""
    columns = ["sheet", "verdict", "reduced chi-square of the base", "few effects, most probable set", "its probability",
               "in all sets together, from 5 %", "alerts"]  # fmt: skip
    rows: list[list[Any]] = []
    for one in sheets.values():
        alone = sorted(one.inclusion.items(), key=lambda pair: -pair[1])
        rows.append(
            [
                one.name,
                str(one.verdict),
                digits_if_any(one.chi_square),
                ", ".join(one.few or one.named) or "none",
                one.probability and percent(one.probability),
                ", ".join(f"{name} {percent(p)}" for name, p in alone if p >= SAID) or None,
                ", ".join(one.alerts),
            ]
        )
    return columns, rows


def error_table(sheets: Mapping[str, SheetResult]) -> Table:
    """One line a model."""
    return ["sheet", "model", *ERRORS], [
        [one.name, m.name, *map(percent, (m.fitted.force, m.fitted.field, m.held_out.force, m.held_out.field))]
        for one in sheets.values()
        for m in one.models
    ]


def replay_table(sheets: Mapping[str, SheetResult]) -> Table:
    """One line a model that was replayed."""
    columns = [
        "sheet",
        "model",
        "level",
        "force error, fitted",
        "force error, held out",
        "half of its 95 % band",
        "field error, held out, mm",
    ]
    return columns, [
        [one.name, r.name, digits_if_any(r.level), r.fitted and percent(r.fitted), r.held_out and percent(r.held_out), r.band and percent(r.band),
         digits_if_any(r.field)]
        for one in sheets.values()
        for r in one.replays
    ]  # fmt: skip


def transfer_table(transfers: Mapping[str, TransferResult]) -> Table:
    """One line a variant."""
    return ["sheet", "model", "stiffness", "relaxation", *ERRORS], [
        [one.name, r.name, digits_if_any(r.stiffness), digits_if_any(r.relaxation),
         *map(percent, (r.fitted.force, r.fitted.field, r.held_out.force, r.held_out.field))]
        for one in transfers.values()
        for r in one.rows
    ]  # fmt: skip


def control_table(controls: Mapping[str, ControlResult]) -> Table:
    """The negative control."""
    columns = ["sheet", "pictures compared", "reduced chi-square", "effects tested", "smallest adjusted p", "highest score"]  # fmt: skip
    rows = []
    for r in controls.values():
        first = max(r.effects, key=lambda e: e.score, default=None)
        highest = first.effect if first is not None else None
        rows.append(
            [
                r.name,
                r.pictures,
                digits_if_any(r.reduced_chi_square),
                len(r.effects),
                digits(r.smallest_adjusted_p, 2),
                highest,
            ]
        )
    return columns, rows


def loop_table(loops: Sequence[HomogeneousResult]) -> Table:
    """Homogeneous tests, before and after."""
    rows = []
    for r in loops:
        effects = WORDS.effects(named=r.named, closest=r.closest)
        for t in r.tests:
            role = WORDS.role(fitted=t.fitted)
            rows.append([r.name, t.name, role, percent(t.before), percent(t.after), str(r.verdict), effects])
    return ["loop", "test", "role", "before", "after", "verdict", "effects"], rows
