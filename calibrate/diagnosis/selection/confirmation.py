"""What must hold beside the tests of the residual, before the effects of a model are called an explanation.

In: the base and the final model, each with the weights that belong to it. Out: `Doubt`, one for each condition that fails.

Tests of a residual weigh it with the noise that the model itself makes of the measured displacements: a stiff effect makes that
noise as large as it likes. Hence the errors in N, the weights of either model, and a bound on the force error that is left.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibrate.diagnosis.misfit import Misfit, deviances, misfit
from calibrate.diagnosis.selection.candidate_fit import Model, falls_in_either_weights, is_at_bounds
from calibrate.diagnosis.selection.rounds import Confirmation, Doubt
from calibrate.diagnosis.selection.thresholds import DEFAULT, Thresholds


def confirm(base: Model, final: Model, thresholds: Thresholds = DEFAULT) -> Confirmation:
    """Whether the errors of a model are such that its effects explain what the base left."""
    before, after = (_misfit(one) for one in (base, final))
    limit = allowed_force_error(before, after, thresholds)
    of_base, of_final = deviances([base.fit, final.fit])
    found = {
        Doubt.ERRORS_GROW: errors_grow(before, after, thresholds),
        Doubt.NO_CLEAR_FALL: not _falls_clearly(before, after, thresholds),
        Doubt.OTHER_WEIGHTS: not falls_in_either_weights(base, final),
        Doubt.LARGE_FORCE_ERROR: bool(np.isfinite(limit)) and not after.force <= limit,
        Doubt.NO_LIKELIER: not of_final < of_base,
        Doubt.AT_BOUNDS: is_at_bounds(final.problem, final.fit.additions),
    }
    return Confirmation(before, after, limit, tuple(doubt for doubt, holds in found.items() if holds))


def _misfit(one: Model) -> Misfit:
    """Of what was held out, or was fitted where nothing was; of forces that were fitted where none was held out, as in half a sheet."""
    fitted, held = (misfit(one.problem, one.fit.c, one.fit.additions, k, beside_own=True) for k in (False, True))
    assert fitted is not None
    if held is None or np.isfinite(held.force):
        return held or fitted
    return replace(held, force=fitted.force, noise=(fitted.noise[0], held.noise[1]))


def allowed_force_error(before: Misfit, after: Misfit, thresholds: Thresholds = DEFAULT) -> float:
    """Twice what noise makes of the forces of either model, but no less and no more than the two thresholds."""
    if not np.isfinite(after.force):
        return float("nan")
    uncertainty = 2 * float(np.sqrt(min(before.noise[0], after.noise[0])))
    return float(np.clip(uncertainty, thresholds.small_force_error, thresholds.large_force_error))


def errors_grow(before: Misfit, after: Misfit, thresholds: Thresholds) -> bool:
    """Whether force or field error, each by itself, grows beyond what noise does, and beyond what is negligible.

    A base that takes a small effect in has smaller errors in N than the true model.
    """
    least = thresholds.negligible_error**2
    pairs = zip((before.force, before.field), (after.force, after.field), before.noise, strict=True)
    return any(
        new**2 > max(thresholds.worse**2 * max(old**2 - noise, 0.0) + 2 * noise, least) for old, new, noise in pairs
    )


def _falls_clearly(before: Misfit, after: Misfit, thresholds: Thresholds) -> bool:
    """Whether force or field error falls by a clear share of its square above noise.

    True where both are so small that they say nothing: near noise, or below what an explanation may leave. There the weights of either
    model alone decide.
    """
    pairs = zip((before.force, before.field), (after.force, after.field), before.noise, strict=True)
    falls = [
        (old**2 - new**2) / (old**2 - noise)
        for old, new, noise in pairs
        if old**2 > max(thresholds.above_noise**2 * noise, thresholds.small_force_error**2)
    ]
    return not falls or max(falls) > thresholds.clear_fall
