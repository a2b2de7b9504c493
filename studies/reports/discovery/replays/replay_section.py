"""The replay of base and final model in a report: a `ReplayCheck` in; findings, tables and rows of files out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from calibrate.diagnosis.replayed.averaged import Averaged
from calibrate.diagnosis.replayed.checked_replay import NoReplayCheck, ReplayCheck, Replayed
from calibrate.diagnosis.replayed.observations import ReplayErrors
from calibrate.diagnosis.replayed.replay_rule import LEVEL, LOAD_CELL
from calibrate.diagnosis.selection import Discovery
from calibrate.models.parameter_covariance import Z95
from studies.output.findings import Finding, Macro
from studies.output.words import percent, plus_minus

Table = tuple[list[str], list[list[Any]]]
TOLD_FROM = 2 * LOAD_CELL  # half of a band of forces, relative, from which it is told what makes most of it
BASE, FINAL, NEO_HOOKE = "base model", "final model", "neo-Hooke"


class ReplayCode(Macro):
    """Macros of ``templates/discovery.txt``."""

    REPLAYED = "replayed"
    NOT_MADE = "replay_not_made"
    OUTSIDE = "replay_outside"
    WORSE = "replay_worse"
    LEVELS = "replay_levels"
    BEYOND = "replay_beyond"
    STAND_IN = "replay_stand_in"
    USE = "model_to_use"
    FEW = "few_effects"
    NO_FEW = "no_few_effects"
    COMPETING = "competing_few_effects"


def replay_findings(found: Discovery) -> Iterator[Finding]:
    """What the replay came to, and what speaks against the final model; none where it was not asked for."""
    check = found.replay_check
    if isinstance(check, NoReplayCheck):
        yield finding(ReplayCode.NOT_MADE, reason=check.reason)
    if not isinstance(check, ReplayCheck):
        return
    names = list(found.final.names)
    yield finding(ReplayCode.REPLAYED, **errors_data(check), alone=not names, without=_left_out(found, check))
    if check.judgement.worse:
        yield finding(ReplayCode.WORSE, names=names)
    if check.judgement.outside:
        data = {"p": check.judgement.p_value, "held": check.held_out, "tests": _outside(check)}
        yield finding(ReplayCode.OUTSIDE, bool(names), names=names, **data)
    if check.stand_ins[1]:
        yield finding(ReplayCode.STAND_IN)
    elif check.final.levels_disagree:
        factor, deviation = check.final.level.factor, Z95 * check.final.deviation
        yield finding(ReplayCode.LEVELS, percent=abs(factor - 1), deviation=deviation, stiffer=factor > 1)
    if check.is_beyond:
        yield finding(ReplayCode.BEYOND, held=check.held_out)


def _left_out(found: Discovery, check: ReplayCheck) -> list[str]:
    """Names of the tests that do not judge the replay, as it lacks what they have for themselves; none where no test judges."""
    rows = check.final.rows
    judging = set(rows.test[rows.judging].tolist())
    return [p.experiment.name for k, p in enumerate(found.problem.parts) if judging and k not in judging]


def _outside(check: ReplayCheck) -> list[dict[str, Any]]:
    """Of forces and fields, each where it leaves the band by itself: its chi-square, and its largest error in standard deviations of the band, and where that is."""
    rows, found = check.final.rows, []
    sizes = np.abs(rows.residual) / np.sqrt(np.diag(check.band.covariance))
    pairs = [("forces", check.judgement.force, rows.is_force), ("fields", check.judgement.field, ~rows.is_force)]
    tests = [(name, test, kind) for name, test, kind in pairs if test is not None]
    for name, test, kind in tests:
        if len(tests) * test.p_value < LEVEL:
            own = rows.judged & kind
            most = int(np.flatnonzero(own)[sizes[own].argmax()])
            where = {"size": float(sizes[most]), "increment": int(rows.increment[most]) + 1}
            found.append({"name": name, "chi_square": test.value, "rows": test.degrees, **where})
    return found


def errors_data(check: ReplayCheck) -> dict[str, Any]:
    """Errors before and after, with the band, and the levels, for a sentence."""
    before, after, band = check.base.judged, check.final.judged, check.expected
    return {
        "held": check.held_out,
        "force": None if np.isnan(after.force) else [before.force, after.force, band.force],
        "field": [before.field, after.field],
        "smooth": [*check.smooth, band.field],
        "largest_part": check.largest_part if band.force > TOLD_FROM else None,
        "levels": level_words(check),
    }


def level_words(check: ReplayCheck) -> list[str]:
    """Of base and final model, with half the 95 % interval; none where no force is known."""
    pairs = [(one.level.factor, Z95 * one.level.deviation) for one in (check.base, check.final)]
    return [plus_minus(*pair) for pair in pairs] if any(deviation for _, deviation in pairs) else []


def models_of(check: ReplayCheck, others: Sequence[tuple[str, Replayed]] = ()) -> list[tuple[str, Replayed]]:
    """Base, final model where it is another one, and further ones."""
    final = [] if check.final is check.base else [(FINAL, check.final)]
    return [(BASE, check.base), *final, *others]


def replay_table(
    check: ReplayCheck,
    others: Sequence[tuple[str, Replayed]] = (),
    bands: Sequence[tuple[str, ReplayErrors]] = (),
    average: Averaged | None = None,
) -> Table:
    """One line a model, and the bands. others, bands, average: see `replayed_models`."""
    where = "held out" if check.held_out else "fitted"
    columns = ["model", "level", "force error, fitted", f"force error, {where}", f"displacement error, {where}, mm", f"smooth part, {where}, mm"]  # fmt: skip
    rows: list[list[Any]] = []
    for name, one in models_of(check, others):
        level = plus_minus(one.level.factor, Z95 * one.level.deviation) if one.level.deviation else "as it was"
        fitted = None if one.fitted is None else _share(one.fitted.force)
        rows.append(
            [
                name,
                level,
                fitted,
                _share(one.judged.force),
                _mm(one.judged.field),
                _mm(one.smooth),
            ]
        )
    if average is not None:
        errors = [_share(average.fitted), _share(average.judged), None, _mm(average.smooth)]
        rows.append(["few effects, averaged by their probabilities", "", *errors])
    rows.append(
        [
            f"half of the 95 % band of the {FINAL if check.final is not check.base else BASE}",
            "",
            None,
            _share(check.expected.force),
            None,
            _mm(check.expected.field),
        ]
    )
    for name, band in bands:
        rows.append([f"half of the 95 % band of the {name}", "", None, _share(band.force), None, _mm(band.field)])
    return columns, rows


def _share(value: float) -> str | None:
    """None where no force is known."""
    return None if np.isnan(value) else percent(value)


def _mm(value: float) -> str:
    return f"{value:.2g}"


def finding(code: ReplayCode, raised: bool = False, /, **data: Any) -> Finding:
    """Of this part of the report."""
    return Finding("discovery", code, data, raised)
