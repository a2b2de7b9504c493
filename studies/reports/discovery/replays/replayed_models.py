"""Models of a test that nothing explains, which have no named effect: a `Discovery` in; their replays by names and files, and which to predict with, out."""

from __future__ import annotations

from collections.abc import Iterator

from calibrate.diagnosis.evidence.explanations import RIVALS
from calibrate.diagnosis.replayed.averaged import Averaged
from calibrate.diagnosis.replayed.checked_replay import ReplayCheck, Replayed
from calibrate.diagnosis.replayed.few_effects import FewEffects, FewModel, Usable
from calibrate.diagnosis.replayed.observations import ReplayErrors
from calibrate.diagnosis.replayed.replay_rule import misses_more
from calibrate.diagnosis.selection import Discovery, Verdict
from studies.output.findings import Finding
from studies.reports.discovery.candidate_outcome import WORDS
from studies.reports.discovery.replays.replay_section import NEO_HOOKE, ReplayCode, finding
from studies.reports.headline import LIMITS

FEW = "few effects"
FEW_FILES = (
    "model_few_effects.json",
    *(f"model_few_effects_{k}.json" for k in range(2, RIVALS + 2)),
)  # the most probable first
FINAL_FILE, NEO_HOOKE_FILE = "model.json", "model_neo_hooke.json"


def few_models(found: Discovery) -> list[tuple[str, str, FewModel]]:
    """Name in tables, file and model of few effects, the most probable and those that compete with it, where nothing explains the test."""
    models = found.few.models if isinstance(found.few, FewEffects) else ()
    return [
        (f"{FEW}: {words(one)}" if i else FEW, file, one)
        for i, (file, one) in enumerate(zip(FEW_FILES, models, strict=False))
    ]


def words(one: FewModel) -> str:
    """Its effects."""
    return " and ".join(one.effects) or "none"


def usable_models(found: Discovery) -> dict[str, Usable]:
    """By their files, those that were updated by forces, and neo-Hooke."""
    if not isinstance(found.few, FewEffects):
        return {}
    few = {file: one.usable for _, file, one in few_models(found)}
    return {file: use for file, use in (few | {NEO_HOOKE_FILE: found.few.usable_neo_hooke}).items() if use is not None}


def replayed_models(found: Discovery) -> list[tuple[str, Replayed]]:
    """Names and replays of neo-Hooke and of few effects; those that were replayed."""
    pairs = [(NEO_HOOKE, neo_hooke_replay(found)), *((name, one.replayed) for name, _, one in few_models(found))]
    return [(name, one) for name, one in pairs if one is not None]


def updated_bands(found: Discovery) -> list[tuple[str, ReplayErrors]]:
    """Half of the bands of models that were updated by forces."""
    checks = [(name, one.check) for name, _, one in few_models(found)]
    return [(name, check.expected) for name, check in checks if check is not None]


def average_of_few(found: Discovery) -> Averaged | None:
    """Of few effects that compete; None where there is one model of few effects at most."""
    return found.few.average if isinstance(found.few, FewEffects) else None


def neo_hooke_replay(found: Discovery) -> Replayed | None:
    """None where it was not replayed."""
    one = found.few.neo_hooke if isinstance(found.few, FewEffects) else None
    return one if isinstance(one, Replayed) else None


def to_predict_with(found: Discovery) -> str | None:
    """File of the first of these, where nothing explains the test: the final model, if its replay stays within its band; the most probable few effects; neo-Hooke; of which neither force nor field of what was held out is
    missed by more (`misses_more`) than another replayed model misses them. None where each is beaten in one of both, or misses forces by more than a model that is not to be used, or none was replayed."""
    offered, check = [(file, one) for file, one in _offered(found) if not _is_poor(one)], found.replay_check
    others = [one for _, one in _offered(found)] + ([check.final] if isinstance(check, ReplayCheck) else [])
    noise = max(
        (p.experiment.noise.total_std for p in found.problem.trained if p.experiment.noise is not None), default=0.0
    )
    good = (file for file, one in offered if not any(misses_more(one.judged, other.judged, noise) for other in others))
    return next(good, None)


def _offered(found: Discovery) -> list[tuple[str, Replayed]]:
    """The final model where its replay stays within its band, the most probable few effects, where these are not none, and neo-Hooke by their files, those that were replayed. Sets that compete are not chosen by what was held out."""
    if not isinstance(found.few, FewEffects):
        return []
    check = found.replay_check
    within = isinstance(check, ReplayCheck) and not check.judgement.outside and not check.stand_ins[1]
    final = [(FINAL_FILE, check.final)] if isinstance(check, ReplayCheck) and within else []
    few = [(file, one.replayed) for _, file, one in few_models(found)[:1] if one.usable and one.usable.additions]
    return [(file, one) for file, one in (*final, *few, (NEO_HOOKE_FILE, neo_hooke_replay(found))) if one is not None]


def _is_poor(one: Replayed) -> bool:
    """Whether it misses forces by more than the headline allows of any model."""
    return one.judged.force > LIMITS.force_error[1]


def _all_are_poor(found: Discovery) -> bool:
    """Whether no model that is offered meets the forces."""
    return all(_is_poor(one) for _, one in _offered(found))


def recommendation(found: Discovery) -> str:
    """Which model file to predict with, and what it and others miss by finite elements."""
    check, explained = found.replay_check, found.verdict is not Verdict.NOT_EXPLAINED
    final = [(FINAL_FILE, check.final)] if isinstance(check, ReplayCheck) else []
    models = dict(final if explained else [*_offered(found), *final])
    return WORDS.to_predict_with(
        file=FINAL_FILE if explained else to_predict_with(found),
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
        yield finding(ReplayCode.USE, file is None, file=file, poor=_all_are_poor(found))
