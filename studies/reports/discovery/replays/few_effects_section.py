"""Findings on few effects of a test that nothing explains: a `Discovery` in."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from calibrate.diagnosis.evidence.own_effects import apart
from calibrate.diagnosis.replayed.checked_replay import NoReplayCheck
from calibrate.diagnosis.replayed.few_effects import FewEffects, FewModel
from calibrate.diagnosis.replayed.replay_rule import LEVEL
from calibrate.diagnosis.replayed.updating import Updated
from calibrate.diagnosis.selection import Discovery
from calibrate.models.parameter_covariance import Z95
from studies.output.findings import Finding
from studies.output.words import plus_minus
from studies.reports.discovery.replays.few_effects_table import few_data
from studies.reports.discovery.replays.replay_section import ReplayCode, finding
from studies.reports.discovery.replays.replayed_models import few_models


def few_findings(found: Discovery) -> Iterator[Finding]:
    """Which few effects leave least of the fields, what their model misses, and what those that compete with them do."""
    few = found.few
    if isinstance(few, NoReplayCheck):
        yield finding(ReplayCode.NO_FEW, reason=few.reason)
    if not isinstance(few, FewEffects):
        return
    for one in few.models[:1]:
        if isinstance(one.updated, NoReplayCheck):
            yield finding(ReplayCode.NO_FEW, reason=one.updated.reason)
    yield finding(
        ReplayCode.FEW,
        **few_data(few),
        alike=len({part.experiment.name for part in found.problem.trained} - apart(found.own)) > 1,
        model=_predicted(few.models[0]) if few.models else None,
    )
    others, average = few_models(found)[1:], few.average
    if others:
        competing = [{"file": file, "names": list(one.effects), "probability": one.probability, "model": _predicted(one)} for _, file, one in others]  # fmt: skip
        yield finding(ReplayCode.COMPETING, competing=competing, average=None if average is None else average.to_dict())


def _predicted(one: FewModel) -> dict[str, Any] | None:
    """What the model of a set misses, with its band and its memory; None where it was not replayed."""
    new, check = one.updated, one.check
    if check is None or not isinstance(new, Updated):
        return None
    pairs = (("force", check.judgement.force), ("field", check.judgement.field))
    within = {f"{name}_within": None if test is None else test.p_value >= LEVEL for name, test in pairs}
    return {
        "missed": check.final.judged.to_dict(),
        "held": check.held_out,
        "band": {**check.expected.to_dict(), **within},
        "remembered": remembered_values(new),
        "converged": new.converged,
    }


def remembered_values(new: Updated) -> list[dict[str, Any]]:
    """Amplitudes and shapes of effects with a memory, with half their 95 % interval."""
    return [
        {"effect": a.effect.name, "values": [[p.name, plus_minus(v, Z95 * d), p.unit] for p, v, d in
         zip((*a.effect.amplitudes, *a.effect.shapes), (*a.amplitudes, *a.shape), (*deviations, *shapes), strict=True)]}
        for a, deviations, shapes in zip(new.additions, new.deviations, new.shape_deviations, strict=True)
        if a.effect.remembers and not a.is_null
    ]  # fmt: skip
