"""Alternatives and power of a diagnosis: a `Weighing` in; tables, data of two sentences and of discovery.json out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from calibrate.diagnosis.evidence.explanations import CERTAIN, UNKNOWN, Explanation, Finding, Power, Weighing
from calibrate.models.addition_json import addition_to_dict, amplitude_unit
from calibrate.models.parameter_covariance import Z95
from studies.output.words import plus_minus, probability_text
from studies.reports.discovery.candidate_outcome import WORDS

SHOWN, LEAST = 8, 1e-3  # explanations in a table; probability of one that a sentence names
NOTHING_NEEDED = (Finding.FOUND, Finding.EXCLUDED, Finding.MEASURED, Finding.OWN)
Table = tuple[list[str], list[list[Any]]]


def explanation(one: Explanation) -> str:
    """Its effects in words."""
    return WORDS.explanation(names=list(one.names), discrepancy=one.discrepancy)


def alternatives_table(found: Weighing) -> Table:
    """The most probable explanations."""
    best = found.alternatives.explanations[0].log_evidence
    rows: list[list[Any]] = [
        [
            explanation(one),
            probability(one.probability),
            f"{one.log_evidence - best:+.1f}",
            "yes" if one.additions else "no",
        ]
        for one in found.alternatives.explanations[:SHOWN]
    ]
    return ["explanation", "probability", "ln evidence, against the best", "fitted"], rows


def power_table(found: Weighing, unit: str) -> Table:
    """What the test shows of every effect."""
    rows: list[list[Any]] = []
    for one in found.powers:
        own = amplitude_unit(one.parameter, unit)
        symbol = one.parameter.name if own == "1" else f"{one.parameter.name} ({own})"
        included = "" if found.is_provisional else probability(found.alternatives.inclusion.get(one.effect.name, 0.0))
        limit, prior = ("" if v is None else f"{v:.2g}" for v in (one.limit, one.prior))
        value = "" if one.value is None else plus_minus(one.value[0], Z95 * one.value[1])
        needed = "" if one.finding in NOTHING_NEEDED else one.needed
        rows.append([one.effect.name, str(one.finding), symbol, value, limit, prior, included, needed])
    return ["effect", "this test", "amplitude", "value", "limit (95 %)", "prior", "probability", "would show it"], rows


def probability(value: float) -> str:
    """To two digits; what is nearly certain is not told more exactly than priors are known."""
    return "< 0.001" if value < LEAST else "> 0.999" if value > 1 - LEAST else f"{value:.2g}"


def alternatives_data(found: Weighing, groups: Iterable[Sequence[str]]) -> dict[str, Any]:
    """Alternatives, for one sentence. groups: of effects that the data cannot tell apart."""
    said = [f"{explanation(one)} ({probability_text(one.probability)})" for one in found.alternatives.explanations[:SHOWN]
            if one.probability > LEAST]  # fmt: skip
    inclusion = found.alternatives.inclusion
    present = [name for name, value in inclusion.items() if value > CERTAIN]
    for group in groups:
        if not set(group) & set(present) and found.alternatives.together(group) > CERTAIN:
            present.append(" or ".join(sorted(group, key=lambda name: -inclusion.get(name, 0.0))))
    certain = None if found.is_provisional else present
    spans = {name: list(group) for name, group in found.groups.items() if group}
    unexplained = found.alternatives.unexplained
    unknown = float(unexplained) if unexplained > UNKNOWN else None
    return {"said": said[:3], "certain": certain, "spans": spans, "fitted": found.fitted, "unknown": unknown}


def power_data(found: Weighing) -> dict[str, Any]:
    """Which effects this test does not show, and how many it excludes."""
    hidden = [
        one.effect.name for one in found.powers if one.finding is Finding.INVISIBLE and not one.effect.confounded_with
    ]
    excluded, undecided = (
        sum(one.finding is kind for one in found.powers) for kind in (Finding.EXCLUDED, Finding.UNDECIDED)
    )
    return {"hidden": hidden, "excluded": excluded, "undecided": undecided}


def weighing_record(found: Weighing | None, unit: str) -> dict[str, Any] | None:
    """As discovery.json holds it."""
    if found is None:
        return None
    return {
        "fitted": found.fitted,
        "explanations": [
            {"effects": list(one.names), "not_in_catalogue": one.discrepancy, "probability": one.probability,
             "log_evidence": one.log_evidence, "fitted": bool(one.additions),
             "additions": [addition_to_dict(a, d, unit) for a, d in zip(one.additions, one.errors, strict=True)]}
            for one in found.alternatives.explanations[:SHOWN]
        ],
        "inclusion": found.alternatives.inclusion,
        "not_in_catalogue": found.alternatives.unexplained,
        "spanned_by": {name: list(group) for name, group in found.groups.items()},
        "power": [_power(one, unit) for one in found.powers],
    }  # fmt: skip


def _power(one: Power, unit: str) -> dict[str, Any]:
    return {
        "effect": one.effect.name, "finding": str(one.finding), "amplitude": one.parameter.name,
        "unit": amplitude_unit(one.parameter, unit), "value": one.value and one.value[0], "standard_deviation": one.value and one.value[1],
        "limit_95": one.limit, "prior_standard_deviation": one.prior, "needed": one.needed,
    }  # fmt: skip
