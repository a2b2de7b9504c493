"""The replay of base and final model in a report: a `ReplayCheck` in; findings, tables and rows of files out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from calibrate.diagnosis.evidence.own_effects import apart
from calibrate.diagnosis.replayed.checked_replay import NoReplayCheck, ReplayCheck, Replayed
from calibrate.diagnosis.replayed.few_effects import FewEffects
from calibrate.diagnosis.replayed.observations import ReplayErrors
from calibrate.diagnosis.replayed.replay_rule import LEVEL, misses_more
from calibrate.diagnosis.replayed.updating import Updated
from calibrate.diagnosis.selection import Discovery, Verdict
from calibrate.models.parameter_covariance import Z95
from studies.output.findings import Finding, Macro
from studies.output.words import percent, plus_minus
from studies.reports.discovery.candidate_outcome import WORDS
from studies.reports.discovery.few_effects_table import few_data
from studies.reports.headline import LIMITS

Table = tuple[list[str], list[list[Any]]]
BASE, FINAL, NEO_HOOKE, FEW = "base model", "final model", "neo-Hooke", "few effects"
FEW_FILE, NEO_HOOKE_FILE = "model_few_effects.json", "model_neo_hooke.json"


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


def replay_findings(found: Discovery) -> Iterator[Finding]:
    """What the replay came to, and what speaks against the final model; none where it was not asked for."""
    check = found.replay_check
    if isinstance(check, NoReplayCheck):
        yield _finding(ReplayCode.NOT_MADE, reason=check.reason)
    if not isinstance(check, ReplayCheck):
        return
    names = list(found.final.names)
    yield _finding(ReplayCode.REPLAYED, **errors_data(check), alone=not names, without=_left_out(found, check))
    if check.judgement.worse:
        yield _finding(ReplayCode.WORSE, names=names)
    if check.judgement.outside:
        data = {"p": check.judgement.p_value, "held": check.held_out, "tests": _outside(check)}
        yield _finding(ReplayCode.OUTSIDE, bool(names), names=names, **data)
    if check.stand_ins[1]:
        yield _finding(ReplayCode.STAND_IN)
    elif check.final.levels_disagree:
        factor, deviation = check.final.level.factor, Z95 * check.final.deviation
        yield _finding(ReplayCode.LEVELS, percent=abs(factor - 1), deviation=deviation, stiffer=factor > 1)
    if check.is_beyond:
        yield _finding(ReplayCode.BEYOND, held=check.held_out)


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
        "levels": level_words(check),
    }


def level_words(check: ReplayCheck) -> list[str]:
    """Of base and final model, with half the 95 % interval; none where no force is known."""
    pairs = [(one.level.factor, Z95 * one.level.deviation) for one in (check.base, check.final)]
    return [plus_minus(*pair) for pair in pairs] if any(deviation for _, deviation in pairs) else []


def neo_hooke_replay(found: Discovery) -> Replayed | None:
    """Where nothing explains the test; None where it was not replayed."""
    one = found.few.neo_hooke if isinstance(found.few, FewEffects) else None
    return one if isinstance(one, Replayed) else None


def to_predict_with(found: Discovery) -> str | None:
    """File of the first of these, where nothing explains the test: few effects, neo-Hooke; of which neither force nor field of what was held out is
    missed by more (`misses_more`) than another replayed model misses them. None where each is beaten in one of both, or misses forces by more than a model that is not to be used, or none was replayed."""
    offered, check = [(file, one) for file, one in _offered(found) if not _is_poor(one)], found.replay_check
    others = [one for _, one in _offered(found)] + ([check.final] if isinstance(check, ReplayCheck) else [])
    noise = max(
        (p.experiment.noise.total_std for p in found.problem.trained if p.experiment.noise is not None), default=0.0
    )
    good = (file for file, one in offered if not any(misses_more(one.judged, other.judged, noise) for other in others))
    return next(good, None)


def _offered(found: Discovery) -> list[tuple[str, Replayed]]:
    """Models without a named effect that were replayed, by their files."""
    pairs = [(FEW_FILE, _few_replay(found)), (NEO_HOOKE_FILE, neo_hooke_replay(found))]
    return [(file, one) for file, one in pairs if one is not None]


def _is_poor(one: Replayed) -> bool:
    """Whether it misses forces by more than the headline allows of any model."""
    return one.judged.force > LIMITS.force_error[1]


def _all_are_poor(found: Discovery) -> bool:
    """Whether no model that is offered meets the forces."""
    return all(_is_poor(one) for _, one in _offered(found))


def recommendation(found: Discovery) -> str:
    """Which model file to predict with, and what it and others miss by finite elements."""
    check, explained = found.replay_check, found.verdict is not Verdict.NOT_EXPLAINED
    final = [("model.json", check.final)] if isinstance(check, ReplayCheck) else []
    models = dict(final if explained else [*_offered(found), *final])
    return WORDS.to_predict_with(
        file="model.json" if explained else to_predict_with(found),
        missed={file: one.judged.to_dict() for file, one in models.items()},
        held=any(bool(one.rows.held.any()) for one in models.values()),
        explained=explained,
        offered=bool(_offered(found)),
        poor=_all_are_poor(found),
        neo_hooke=NEO_HOOKE_FILE,
    )


def use_finding(found: Discovery) -> Iterator[Finding]:
    """Which model is to be used, by its replay, where nothing explains the test."""
    if _offered(found):
        file = to_predict_with(found)
        yield _finding(ReplayCode.USE, file is None, file=file, poor=_all_are_poor(found))


def few_findings(found: Discovery) -> Iterator[Finding]:
    """Which few effects leave least of the fields, and what their model misses."""
    few = found.few
    if isinstance(few, NoReplayCheck):
        yield _finding(ReplayCode.NO_FEW, reason=few.reason)
    if not isinstance(few, FewEffects):
        return
    if isinstance(few.updated, NoReplayCheck):
        yield _finding(ReplayCode.NO_FEW, reason=few.updated.reason)
    one, new = _few_replay(found), few.updated
    missed = None if one is None else one.judged.to_dict()
    held = one is not None and bool(one.rows.held.any())
    remembered = remembered_values(new) if isinstance(new, Updated) else []
    converged = not isinstance(new, Updated) or new.converged
    yield _finding(
        ReplayCode.FEW,
        **few_data(few),
        alike=len({part.experiment.name for part in found.problem.trained} - apart(found.own)) > 1,
        missed=missed,
        held=held,
        band=_band(new),
        remembered=remembered,
        converged=converged,
    )


def _few_replay(found: Discovery) -> Replayed | None:
    """Of the model of few effects; None where it was not replayed."""
    one = found.few.replayed if isinstance(found.few, FewEffects) else None
    return one if isinstance(one, Replayed) else None


def _band(new: Updated | NoReplayCheck | None) -> dict[str, Any] | None:
    """Of an updated model; others have none."""
    check = new.check if isinstance(new, Updated) else None
    if check is None:
        return None
    within = {f"{name}_within": None if test is None else test.p_value >= LEVEL
              for name, test in (("force", check.judgement.force), ("field", check.judgement.field))}  # fmt: skip
    return {**check.expected.to_dict(), **within}


def remembered_values(new: Updated) -> list[dict[str, Any]]:
    """Amplitudes and shapes of effects with a memory, with half their 95 % interval."""
    return [
        {"effect": a.effect.name, "values": [[p.name, plus_minus(v, Z95 * d), p.unit] for p, v, d in
         zip((*a.effect.amplitudes, *a.effect.shapes), (*a.amplitudes, *a.shape), (*deviations, *shapes), strict=True)]}
        for a, deviations, shapes in zip(new.additions, new.deviations, new.shape_deviations, strict=True)
        if a.effect.remembers and not a.is_null
    ]  # fmt: skip


def updated_bands(found: Discovery) -> list[tuple[str, ReplayErrors]]:
    """Half of the bands of models that were updated by forces."""
    pairs = [(FEW, found.few.updated if isinstance(found.few, FewEffects) else None)]
    return [(name, new.check.expected) for name, new in pairs if isinstance(new, Updated) and new.check is not None]


def replayed_models(found: Discovery) -> list[tuple[str, Replayed]]:
    """Of neo-Hooke and of few effects, where nothing explains the test; those that were replayed."""
    pairs = [(NEO_HOOKE, neo_hooke_replay(found)), (FEW, _few_replay(found))]
    return [(name, one) for name, one in pairs if one is not None]


def models_of(check: ReplayCheck, others: Sequence[tuple[str, Replayed]] = ()) -> list[tuple[str, Replayed]]:
    """Base, final model where it is another one, and further ones."""
    final = [] if check.final is check.base else [(FINAL, check.final)]
    return [(BASE, check.base), *final, *others]


def replay_table(
    check: ReplayCheck, others: Sequence[tuple[str, Replayed]] = (), bands: Sequence[tuple[str, ReplayErrors]] = ()
) -> Table:
    """One line a model, and the bands. others: see `replayed_models`; bands: see `updated_bands`."""
    where = "held out" if check.held_out else "fitted"
    columns = ["model", "level", "force error, fitted", f"force error, {where}", f"displacement error, {where}, mm", f"smooth part, {where}, mm"]  # fmt: skip
    smooth = dict(zip((BASE, FINAL), check.smooth, strict=True))
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
                _mm(smooth[name]) if name in smooth else None,
            ]
        )
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


def _finding(code: ReplayCode, raised: bool = False, /, **data: Any) -> Finding:
    return Finding("discovery", code, data, raised)
