"""The loop on a measured homogeneous test: errors before and after on data that were not fitted; plain numbers out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from calibrate.data.experiment import Experiment, Noise
from calibrate.diagnosis import selection
from studies.reports.discovery.candidate_outcome import round_remarks, untested_words
from studies.sheets.homogeneous.homogeneous_loops import Loop

RELATIVE = {"hnbr50": 0.02}  # noise of a smoothed record, from two cycles of one test that should be alike


def close(loop: Loop, say: Callable[[str], None]) -> dict[str, Any]:
    """Verdict of a loop, and the relative error of the force on what was fitted and on each held-out test."""

    def noisy(e: Experiment) -> Experiment:
        noise = e.noise or Noise(1e-6)
        relative = RELATIVE.get(loop.name.split("-")[0], 0.0)
        return replace(e, noise=replace(noise, force_std_relative=max(noise.force_std_relative, relative)))

    training, held = [noisy(e) for e in loop.training], [noisy(e) for e in loop.held_out]
    found = selection.discover(
        training, None, held, base="positive", whole_table=False, progress=lambda text: say(f"{loop.name}: {text}")
    )
    tests = []
    for part in found.problem.parts:
        line: dict[str, Any] = {"name": part.experiment.name, "fitted": bool(part.train.size)}
        for when, fit in (("before", found.base), ("after", found.final)):
            additions = part.valid(fit.additions)
            r, loads = part.residual(fit.c, additions), part.system.loads
            known = np.isfinite(loads) & (loads != 0)
            line[when] = float(np.linalg.norm(r[known]) / np.linalg.norm(loads[known]))
        tests.append(line)
    return {
        "name": loop.name,
        "question": loop.question,
        "verdict": found.verdict,
        "named": list(found.named),
        "closest": list(found.closest),
        "groups": {name: list(group) for name, group in found.groups.items()},
        "amplitudes": [
            {"effect": a.effect.name, "name": p.name, "unit": p.unit, "value": v, "deviation": d}
            for a, deviations in zip(found.final.additions, found.final.errors, strict=True)
            for p, v, d in zip(a.effect.amplitudes, a.amplitudes, deviations, strict=True)
        ],
        "before_chi_square": found.base.reduced_chi_square,
        "after_chi_square": found.final.reduced_chi_square,
        "tests": tests,
        "candidates": [
            {
                "round": i,
                "effect": row.name,
                "status": row.score.status,
                "why": "" if row.score.is_tested else untested_words(row.score),
                "score": row.score.score,
                "adjusted_p": row.score.adjusted,
                "share": row.score.share,
                "admissible": row.score.admissible,
            }
            for i, now in enumerate(found.rounds, start=1)
            for row in now.candidates
        ],
        "remarks": [remark for now in found.rounds for remark in round_remarks(now)],
    }
