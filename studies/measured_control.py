"""Negative control on measured sheets: between neighbouring pictures nothing happens, so that nothing may be found there.

Each odd picture is compared with the mean of the even ones before and after it. Every effect that grows slowly, known or
not, is in both and drops out of the difference; what is left is the noise that changes from picture to picture. The score
tests of `equigap discover` are then run on the difference, with that noise: none may be significant.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate import diagnosis, reduction
from calibrate.chain import Chain
from calibrate.diagnosis import Part, Problem
from calibrate.equilibrium import Equilibrium
from calibrate.experiment import Experiment, Noise
from calibrate.whitening import covariances, whitening
from studies.measured_loop import EVERY

Array = NDArray[np.float64]
MEAN_OF_TWO = np.sqrt(1.5)  # std of a value minus the mean of two others


def triplets(time: Array, count: int) -> list[int]:
    """Frames k - 1, k, k + 1 for `count` odd k spread over the record (t,), none across a gap."""
    interval = np.median(np.diff(time))
    odd = [k for k in range(3, len(time) - 1, 2) if time[k + 1] - time[k - 1] < 2.5 * interval]
    chosen = [odd[i] for i in np.unique(np.linspace(len(odd) // 8, len(odd) - 1, count).astype(int))]
    chosen = [k for i, k in enumerate(chosen) if i == 0 or k - chosen[i - 1] > 2]
    return [frame for k in chosen for frame in (k - 1, k, k + 1)]


def split_half(e: Experiment, spacing: float, seed: int = 0) -> dict[str, Any]:
    """Score tests of the difference between odd pictures and the even ones around them.

    e: its increments are triplets (k - 1, k, k + 1), its noise is that from picture to picture.
    """
    assert e.noise is not None and e.time is not None
    noise = Noise(
        MEAN_OF_TWO * e.noise.displacement_std, e.noise.correlation_length, 0.0, MEAN_OF_TWO * e.noise.force_std
    )
    parts = [e.select(np.arange(first, e.n_increments, 3)) for first in range(3)]
    quiet = [replace(part, noise=noise) for part in parts]
    plain = [replace(quiet[1], noise=None)]
    problem, fit = diagnosis.prepare(plain, [diagnosis.all_rows], spacing, False, "positive")
    problem = _with_noise(problem, fit.c, quiet[1])
    fit = diagnosis.refit(problem, fit.c, ())
    fields = problem.parts[0].system.fields
    residuals = [Chain(Equilibrium(part, fields), problem.basis).with_additions(fit.c) for part in quiet]
    later = ((e.time[1::3] - e.time[0::3]) / (e.time[2::3] - e.time[0::3]))[:, None]
    difference = residuals[1] - (1 - later) * residuals[0] - later * residuals[2]
    white = problem.white([difference])
    scores = diagnosis.score(problem, replace(fit, residual=white), EVERY, seed)
    tested = [s for s in scores if s.status == "tested"]
    U = fit.columns
    rest = white - U @ (U.T @ white)
    return {
        "name": e.name,
        "triplets": parts[1].n_increments,
        "reduced_chi_square": float(rest @ rest / (len(white) - U.shape[1])),
        "smallest_adjusted_p": min((s.adjusted for s in tested), default=1.0),
        "effects": [
            {"effect": s.effect.name, "score": s.score, "degrees": s.degrees, "adjusted_p": s.adjusted} for s in tested
        ],
    }


def _with_noise(problem: Problem, c: Array, e: Experiment) -> Problem:
    """The same problem with the noise of e and no allowance for discretisation, which drops out of a difference."""
    system = Equilibrium(e, problem.parts[0].system.fields)
    assembled = reduction.assemble(system, problem.basis)
    rows = diagnosis.all_rows(system)
    noise = covariances(assembled, c)
    part = Part(
        Chain(system, problem.basis), assembled, whitening(noise, rows), whitening(noise, rows & False),
        np.zeros(system.loads.shape), None,
    )  # fmt: skip
    return replace(problem, parts=(part,), noise_is_known=True)


def imported(name: str, count: int) -> Experiment:
    """A published sheet as triplets of frames, with the noise from picture to picture."""
    from studies.importing import import_experiment

    everything = import_experiment(name, frames="1000000", noise="temporal")  # every frame under load
    frames = np.array(everything.provenance["frames"])
    assert everything.time is not None
    chosen = [int(frames[i]) for i in triplets(everything.time, count)]
    return import_experiment(name, frames=",".join(map(str, chosen)), noise="temporal")
