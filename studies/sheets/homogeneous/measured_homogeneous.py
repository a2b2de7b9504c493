"""The loop on a measured homogeneous test: errors before and after on data that were not fitted; a `HomogeneousResult` out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibrate.data.experiment import Experiment, Noise
from calibrate.diagnosis import discovery
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.problem import Part
from calibrate.diagnosis.selection.rounds import Candidate
from studies.reports.discovery.candidate_outcome import round_remarks, untested_words
from studies.sheets.homogeneous.homogeneous_loops import Loop
from studies.sheets.sheet_results import Amplitude, CandidateResult, HomogeneousErrors, HomogeneousResult

RELATIVE = {"hnbr50": 0.02}  # noise of a smoothed record, from two cycles of one test that should be alike


def close(loop: Loop) -> HomogeneousResult:
    """Verdict of a loop, and the relative error of the force on what was fitted and on each held-out test."""

    def noisy(e: Experiment) -> Experiment:
        noise = e.noise or Noise(1e-6)
        relative = RELATIVE.get(loop.name.split("-")[0], 0.0)
        return replace(e, noise=replace(noise, force_std_relative=max(noise.force_std_relative, relative)))

    training, held = [noisy(e) for e in loop.training], [noisy(e) for e in loop.held_out]
    found = discovery.discover(
        training,
        None,
        held,
        base="positive",
        few_effects=False,
    )
    return HomogeneousResult(
        name=loop.name,
        question=loop.question,
        verdict=found.verdict,
        named=list(found.named),
        closest=list(found.closest),
        groups={name: list(group) for name, group in found.groups.items()},
        amplitudes=[
            Amplitude(a.effect.name, p.name, p.unit, v, d)
            for a, deviations in zip(found.final.additions, found.final.deviations, strict=True)
            for p, v, d in zip(a.effect.amplitudes, a.amplitudes, deviations, strict=True)
        ],
        before_chi_square=found.base.reduced_chi_square,
        after_chi_square=found.final.reduced_chi_square,
        tests=[
            HomogeneousErrors(
                part.experiment.name, bool(part.train.size), _error(part, found.base), _error(part, found.final)
            )
            for part in found.problem.parts
        ],
        candidates=[_candidate(i, row) for i, now in enumerate(found.rounds, start=1) for row in now.candidates],
        remarks=[remark for now in found.rounds for remark in round_remarks(now)],
    )


def _error(part: Part, fit: Fit) -> float:
    """Relative error of the measured forces of a test that are not zero."""
    r, loads = part.residual(fit.c, part.valid(fit.additions)), part.system.loads
    known = np.isfinite(loads) & (loads != 0)
    return float(np.linalg.norm(r[known]) / np.linalg.norm(loads[known]))


def _candidate(number: int, row: Candidate) -> CandidateResult:
    score = row.score
    why = "" if score.is_tested else untested_words(score)
    return CandidateResult(
        number, row.name, score.status, why, score.score, score.adjusted, score.share, score.admissible
    )
