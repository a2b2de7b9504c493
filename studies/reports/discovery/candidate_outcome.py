"""What became of a candidate in a round, as an enum, and its words from the template."""

from __future__ import annotations

from enum import StrEnum

from calibrate.diagnosis.score_tests import Score
from calibrate.diagnosis.selection.rounds import Candidate, Refusal, RefusalReason, Round
from calibrate.diagnosis.selection.thresholds import DEFAULT, Thresholds
from studies.output.words import Words

WORDS = Words("discovery")


class Outcome(StrEnum):
    """What became of a candidate."""

    NOT_TESTED = "not tested"
    ADDED = "added"
    NOT_SIGNIFICANT = "not significant"
    NOT_ADMISSIBLE = "not admissible"
    REFUSED = "refused"
    NOT_TRIED = "not tried"
    NOT_REFITTED = "not refitted"
    NOT_THE_BEST = "not the best"


def outcome(candidate: Candidate, now: Round, thresholds: Thresholds = DEFAULT) -> Outcome:
    """What became of a candidate of a round."""
    if not candidate.score.is_tested:
        return Outcome.NOT_TESTED
    if candidate.name == now.added:
        return Outcome.ADDED
    if not candidate.is_significant(thresholds):
        return Outcome.NOT_SIGNIFICANT
    if not candidate.score.admissible:
        return Outcome.NOT_ADMISSIBLE
    if _reason(candidate, now) is not None:
        return Outcome.REFUSED
    if not now.added:
        return Outcome.NOT_TRIED
    return Outcome.NOT_REFITTED if candidate.fit is None else Outcome.NOT_THE_BEST


def _reason(candidate: Candidate, now: Round) -> RefusalReason | None:
    return next((r.reason for r in now.refusals if r.effect == candidate.name), None)


def outcome_words(candidate: Candidate, now: Round, thresholds: Thresholds = DEFAULT) -> str:
    """The outcome in words, with the reason."""
    score = candidate.score
    return WORDS.outcome(
        kind=outcome(candidate, now, thresholds), status=score.status, missing=score.missing, confounded_with=score.effect.confounded_with,
        measured_by=score.effect.measured_by, reason=_reason(candidate, now),
    )  # fmt: skip


def untested_words(score: Score) -> str:
    """Why an effect could not be tested."""
    return WORDS.untested(
        status=score.status,
        missing=score.missing,
        confounded_with=score.effect.confounded_with,
        measured_by=score.effect.measured_by,
    )


def round_remarks(now: Round) -> list[str]:
    """Refusals and the exchange of a round in words."""
    remarks = [refusal_words(refusal) for refusal in now.refusals]
    if now.exchange is not None:
        remarks.append(WORDS.exchanged(added=now.exchange.added, removed=now.exchange.removed))
    return remarks


def refusal_words(refusal: Refusal) -> str:
    """'effect: why it was not added'."""
    return WORDS.refused(effect=refusal.effect, reason=refusal.reason)


def indistinguishable(candidate: Candidate, now: Round, thresholds: Thresholds = DEFAULT) -> tuple[str, ...]:
    """Effects that these data cannot tell from one: of what was added its group, else those of the same signature."""
    if candidate.name == now.added:
        return now.group[1:]
    return tuple(name for name, cosine in candidate.like if cosine > thresholds.collinear)
