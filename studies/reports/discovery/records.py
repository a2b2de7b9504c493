"""Everything that the report of a discovery says as plain data: what ``discovery.json`` and the CSV files hold.

In: a `View`. Out: dataclasses, each with `to_dict`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from calibrate.diagnosis.distillation import bulk_modulus
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.evidence.signatures import modulus
from calibrate.diagnosis.misfit import Misfit
from calibrate.diagnosis.problem import Part, Problem
from calibrate.diagnosis.replayed.checked_replay import replay_record
from calibrate.diagnosis.residual_tests import ChiSquare
from calibrate.diagnosis.score_tests import Status
from calibrate.diagnosis.selection.rounds import Candidate, Round
from calibrate.diagnosis.selection.thresholds import DEFAULT, Thresholds
from calibrate.effects import Effect
from calibrate.effects.chain import Addition
from calibrate.fitting.noise.noise_check import NoiseCheck
from calibrate.models.addition_json import amplitude_unit
from calibrate.models.parameter_covariance import Z95
from studies.reports.discovery.candidate_outcome import indistinguishable, outcome_words, round_remarks
from studies.reports.discovery.own_effects_table import own_effects_record
from studies.reports.discovery.replays.few_effects_table import few_record
from studies.reports.discovery.view import View, held_increments
from studies.reports.discovery.weighing_tables import weighing_record

MISFITS = ("all", "no discretisation error", "slow")  # names of the tests of `Round.misfits` in discovery.json


@dataclass(frozen=True)
class AmplitudeRecord:
    """An amplitude: as the score test estimates it, and refitted with the base (None: no refit was made), with 95 % interval."""

    name: str
    unit: str
    null: float
    lowest: float | None
    highest: float | None
    tested: float
    tested_deviation: float
    fitted: float | None = None
    fitted_deviation: float | None = None
    low_95: float | None = None
    high_95: float | None = None


@dataclass(frozen=True)
class ShapeRecord:
    """A shape with its unit."""

    name: str
    unit: str
    value: float


@dataclass(frozen=True)
class SimilarRecord:
    """An effect with a similar signature."""

    effect: str
    cosine: float


@dataclass(frozen=True)
class CandidateRecord:
    """A candidate of a round; improvement: share of the training misfit that the score predicts, in the weights of the round: a refit has its
    own. None: not tested, or not refitted."""

    effect: str
    stage: str
    formula: str
    status: str
    outcome: str
    indistinguishable: list[str]
    score: float | None
    degrees: int | None
    p_value: float | None
    adjusted_p_value: float | None
    predicted_improvement: float | None
    absorbed_by_base: float | None
    amplitudes: list[AmplitudeRecord]
    shape: list[ShapeRecord]
    admissible: bool | None
    train_before: dict[str, Any] | None
    train_after: dict[str, Any] | None
    held_out_before: dict[str, Any] | None
    held_out_after: dict[str, Any] | None
    collinear_with: list[SimilarRecord]
    decided_by: str
    of_material: bool

    def to_dict(self) -> dict[str, Any]:
        """As discovery.json holds it."""
        return asdict(self)


def amplitude_records(candidate: Candidate, unit: str, level: float = 1.0) -> list[AmplitudeRecord]:
    """Every amplitude of a tested effect. level: by which stiffness is multiplied."""
    score = candidate.score
    if not score.is_tested:
        return []
    tested = list(zip(score.amplitudes, score.errors, strict=True))
    return _amplitude_records(score.effect, tested, candidate.addition, candidate.deviations, unit, level)


def model_amplitude_records(fit: Fit, unit: str, level: float = 1.0) -> list[tuple[str, AmplitudeRecord]]:
    """Every amplitude of every effect of a model, with the name of the effect; no score test is of a model (NaN)."""
    return [
        (a.effect.name, one)
        for a, errors in zip(fit.additions, fit.deviations, strict=True)
        for one in _amplitude_records(a.effect, [(np.nan, np.nan)] * len(errors), a, errors, unit, level)
    ]


def _amplitude_records(
    effect: Effect,
    tested: Sequence[tuple[float, float]],
    addition: Addition | None,
    deviations: Sequence[float],
    unit: str,
    level: float,
) -> list[AmplitudeRecord]:
    found = []
    for i, p in enumerate(effect.amplitudes):
        low, high = (float(v) if np.isfinite(v) else None for v in (p.lower, p.upper))
        factor = level**p.stiffness_power
        fitted: tuple[float, ...] = ()
        if addition is not None:
            value, deviation = factor * addition.amplitudes[i], factor * deviations[i]
            fitted = (value, deviation, value - Z95 * deviation, value + Z95 * deviation)
        test, error = tested[i]
        found.append(
            AmplitudeRecord(p.name, amplitude_unit(p, unit), p.null, low, high, factor * test, factor * error, *fitted)
        )
    return found


def shape_records(effect: Effect, values: tuple[float, ...], unit: str) -> list[ShapeRecord]:
    """Every shape with its unit."""
    return [ShapeRecord(p.name, amplitude_unit(p, unit), v) for p, v in zip(effect.shapes, values, strict=True)]


def told_shapes(effect: Effect, values: tuple[float, ...], unit: str) -> list[ShapeRecord]:
    """Those that mean something beside a known amplitude."""
    return shape_records(effect, values, unit) if effect.shapes_vary else []


def candidate_record(
    candidate: Candidate, now: Round, unit: str, thresholds: Thresholds = DEFAULT, level: float = 1.0
) -> CandidateRecord:
    """A candidate with every number."""
    score, effect = candidate.score, candidate.score.effect
    tested = score.is_tested
    shape = score.shape if candidate.addition is None else candidate.addition.shape or score.shape
    return CandidateRecord(
        effect=effect.name,
        stage=effect.stage,
        formula=effect.formula,
        status=score.status,
        outcome=outcome_words(candidate, now, thresholds),
        indistinguishable=list(indistinguishable(candidate, now, thresholds)),
        score=score.score if tested else None,
        degrees=score.degrees if tested else None,
        p_value=score.p_value if tested else None,
        adjusted_p_value=score.adjusted if tested else None,
        predicted_improvement=score.share if tested else None,
        absorbed_by_base=score.absorbed if score.status in (Status.TESTED, Status.ABSORBED) else None,
        amplitudes=amplitude_records(candidate, unit, level),
        shape=shape_records(effect, shape, unit) if tested else [],
        admissible=score.admissible if tested else None,
        train_before=_misfit(now.train),
        train_after=_misfit(candidate.train),
        held_out_before=_misfit(now.held),
        held_out_after=_misfit(candidate.held),
        collinear_with=[SimilarRecord(name, cosine) for name, cosine in candidate.like],
        decided_by=effect.decided_by,
        of_material=effect.of_material,
    )


def _misfit(misfit: Misfit | None) -> dict[str, Any] | None:
    return None if misfit is None else misfit.to_dict()


def model_name(fit: Fit) -> str:
    """'base', or 'base + second invariant + image rotation'."""
    return " + ".join(["base", *fit.names])


@dataclass(frozen=True)
class ExperimentRecord:
    """An experiment and how it was used."""

    name: str
    increments: int
    nodes: int
    triangles: int
    spacing_mm: float
    equations_fitted: int
    equations_held_out: int
    held_out_increments: list[int]
    noise_is_known: bool

    @classmethod
    def of(cls, part: Part) -> ExperimentRecord:
        """Of one part of a problem."""
        e, held = part.experiment, (np.flatnonzero(held_increments(part)) + 1).tolist()
        return cls(
            e.name, e.n_increments, len(e.points), len(e.triangles), part.system.fields.spacing, part.train.size,
            part.held.size, held, part.assembled.noise_is_known,
        )  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """As discovery.json holds it."""
        return asdict(self)


def round_record(now: Round, view: View) -> dict[str, Any]:
    """A round with every number, as discovery.json holds it."""
    problem, found = view.discovery.problem, bulk_modulus(view.discovery.problem, now.fit)
    known, thresholds = problem.noise_is_known, view.discovery.thresholds
    return {
        "bulk_modulus": None if found is None else {"value": found[0], "standard_deviation": found[1]},
        "model": model_name(now.fit),
        "loss": now.fit.loss,
        "equations": now.fit.n_rows,
        "degrees_of_freedom": now.fit.degrees,
        "reduced_chi_square": now.fit.reduced_chi_square,
        "p_value": now.misfits.p_value if known else None,
        "misfits": {name: _test(test) for name, test in zip(MISFITS, now.misfits, strict=True)},
        "predicted": None
        if now.predicted is None
        else {**_test(now.predicted), "p_value": now.predicted_p if known else None},
        "train": now.train.to_dict(),
        "held_out": _misfit(now.held),
        "candidates": [candidate_record(c, now, view.unit, thresholds, view.level).to_dict() for c in now.candidates],
        "added": now.added,
        "group": list(now.group),
        "remarks": round_remarks(now),
    }


def _test(test: ChiSquare) -> dict[str, float]:
    return {"chi_square": test.value, "degrees_of_freedom": test.degrees}


def _noise(check: NoiseCheck) -> dict[str, Any]:
    used = None if check.used is None else asdict(check.used)
    return {"stated_std_mm": check.stated and check.stated.total_std, "found_std_mm": check.found, "used": used}


def _duration(problem: Problem) -> float | None:
    """Of the longest test that has times, s."""
    ends = [float(part.experiment.time[-1]) for part in problem.parts if part.experiment.time is not None]
    return max(ends, default=None)


def content(view: View) -> dict[str, Any]:
    """Everything that the report says, as discovery.json holds it."""
    found = view.discovery
    return {
        "format": "equigap-discovery",
        "version": 3,
        "verdict": found.verdict,
        "named": list(found.named),
        "closest": list(found.closest),
        "groups": {name: list(group) for name, group in found.groups.items()},
        "dominant": None if found.dominant is None else asdict(found.dominant),
        "replaced": None if found.replaced is None else list(found.replaced),
        "hold_out": view.hold_out,
        "noise_is_known": found.problem.noise_is_known,
        "noise": [_noise(check) for check in found.noise],
        "stress_unit": view.unit,
        "plane": found.problem.parts[0].experiment.plane,
        "confirmation": None if found.confirmation is None else found.confirmation.to_dict(),
        "experiments": [ExperimentRecord.of(part).to_dict() for part in found.problem.parts],
        "rounds": [round_record(now, view) for now in found.rounds],
        "evidence": weighing_record(view.weighing, view.unit),
        "modulus": modulus(found.problem),
        "duration_s": _duration(found.problem),
        "replay": replay_record(found.replay_check),
        "few_effects": few_record(found.few),
        "own_effects": own_effects_record(found.own),
        "levels": [asdict(one) for one in found.levels],
    }
