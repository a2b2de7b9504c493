"""Few effects of a test that nothing explains: `FewEffects` in; table, data of a sentence and of discovery.json out."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.replayed.checked_replay import NoReplayCheck, Replayed
from calibrate.diagnosis.replayed.few_effects import FewEffects, FittedSet
from calibrate.diagnosis.replayed.updating import Updated
from calibrate.effects.chain import Addition
from calibrate.models.addition_json import amplitude_unit
from calibrate.models.parameter_covariance import Z95
from studies.output.words import plus_minus, with_unit

Array = NDArray[np.float64]
Table = tuple[list[str], list[list[Any]]]
SAID = 0.05  # probability of an effect, from which it is told


def few_table(found: FewEffects, unit: str) -> Table:
    """Sets of effects by their probability; of those that were fitted, what they are and leave."""
    fitted = {one.effects: one for one in found.fitted}
    rows = [[" and ".join(names) or "neo-Hooke alone", f"{p:.1%}", *_of_set(fitted.get(names), unit)] for names, p in found.sets]  # fmt: skip
    return [
        "beside neo-Hooke",
        "probability",
        "amplitudes and shapes by the fields",
        "displacement error, fitted, mm",
    ], rows


def _of_set(one: FittedSet | None, unit: str) -> list[Any]:
    if one is None:
        return [None, None]
    said = []
    for a in one.additions:
        stopped = one.at_limit[a.effect.name]
        for p, mean, deviation, at_limit in zip(a.effect.amplitudes, *_of_amplitudes(one, a), stopped, strict=True):
            value = f"{mean:.3g}" if at_limit else plus_minus(mean, Z95 * deviation)
            value = with_unit(f"{p.name} = {value}", amplitude_unit(p, unit))
            said.append(f"{value} (where its prior stops it)" if at_limit else value)
        said += [with_unit(f"{p.name} = {v:.2g}", p.unit) for p, v in zip(a.effect.shapes, a.shape, strict=True)]
    return [", ".join(said), f"{one.errors.field:.2g}"]


def _of_amplitudes(one: FittedSet, a: Addition) -> tuple[Array, Array]:
    """Means and standard deviations (p,)."""
    mean, deviation = one.priors[a.effect.name]
    return mean[: len(a.amplitudes)], deviation[: len(a.amplitudes)]


def few_data(found: FewEffects) -> dict[str, Any]:
    """For one sentence."""
    best = found.best
    names = () if best is None else best.effects
    return {
        "names": list(names),
        "probability": dict(found.sets).get(names, 0.0),
        "before": found.base.field,
        "after": None if best is None else best.errors.field,
        "inclusion": sorted(([k, p] for k, p in found.inclusion.items() if p >= SAID), key=lambda one: -one[1]),
    }


def few_record(found: FewEffects | NoReplayCheck | None) -> dict[str, Any] | None:
    """As discovery.json holds it."""
    if found is None or isinstance(found, NoReplayCheck):
        return None if found is None else {"not_made": found.reason}
    fitted = [
        {
            "effects": [{"effect": a.effect.name, "amplitudes": list(a.amplitudes), "shape": list(a.shape),
                         "standard_deviations": _of_amplitudes(one, a)[1].tolist(), "at_limit_of_prior": one.at_limit[a.effect.name].tolist()}
                        for a in one.additions],
            "log_odds": one.log_odds, "fitted": one.errors.to_dict(), "discrepancy_mm": one.discrepancy,
        }
        for one in found.fitted
    ]  # fmt: skip
    return {
        "neo_hooke_fitted": found.base.to_dict(),
        "sets": [{"effects": list(names), "probability": p} for names, p in found.sets],
        "inclusion": found.inclusion,
        "fitted": fitted,
        "models": [
            {"set": list(one.effects), "probability": one.probability, **update_record(one.updated)}
            for one in found.models
        ],
        "average": None if found.average is None else found.average.to_dict(),
        "neo_hooke": _replayed(found.neo_hooke),
    }


def update_record(new: Updated | NoReplayCheck) -> dict[str, Any]:
    """Of a model whose forces were fitted."""
    if isinstance(new, NoReplayCheck):
        return {"not_made": new.reason}
    effects = [
        {"effect": a.effect.name, "amplitudes": list(a.amplitudes), "standard_deviations": list(d), "shape": list(a.shape), "shape_standard_deviations": list(s)}
        for a, d, s in zip(new.additions, new.deviations, new.shape_deviations, strict=True)
    ]  # fmt: skip
    return {
        "effects": effects, "fitted_before": new.before.to_dict(), "fitted_after": new.after.to_dict(), "converged": new.converged, "forces": new.forces,
        "replay": None if new.check is None else new.check.to_dict(),
    }  # fmt: skip


def _replayed(found: Replayed | NoReplayCheck | None) -> dict[str, Any] | None:
    if isinstance(found, NoReplayCheck):
        return {"not_made": found.reason}
    return None if found is None else found.to_dict()
