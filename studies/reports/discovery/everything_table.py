"""Models of a test that nothing explains, of all effects at once and of few: `Everything` and `FewEffects` in; tables, data of sentences and of discovery.json out."""

from __future__ import annotations

from typing import Any

from calibrate.diagnosis.joint.shares import Everything, Share
from calibrate.diagnosis.misfit import Misfit
from calibrate.diagnosis.replayed.checked_replay import NoReplayCheck, Replayed
from calibrate.diagnosis.replayed.few_effects import FewEffects, FittedSet
from calibrate.diagnosis.replayed.updating import Updated
from calibrate.models.addition_json import amplitude_unit
from studies.output.words import plus_minus, with_unit
from studies.reports.discovery.view import BAND

Table = tuple[list[str], list[list[Any]]]
SAID = 0.05  # probability of an effect, from which it is told


def shares_table(found: Everything, unit: str) -> Table:
    """Every effect, the most needed first."""
    columns = [
        "effect",
        "amplitude",
        "value",
        "prior",
        "value over prior",
        "misfit without it",
        "R² on the others",
        "this fit",
    ]
    return columns, [_row(one, unit) for one in found.shares]


def _row(one: Share, unit: str) -> list[Any]:
    i = one.largest
    symbol = _symbol(one.effect.amplitudes[i].name, amplitude_unit(one.effect.amplitudes[i], unit))
    said = "implausible" if one.is_far else "at its limit" if one.is_at_limit else "needed"
    value = plus_minus(one.amplitudes[i], BAND * one.deviations[i])
    return [
        one.effect.name, symbol, value, f"{one.priors[i]:.2g}", f"{one.over_prior:.1f}", f"{one.rise:+.0f}",
        f"{one.r_squared:.1%}", said if one.is_seen else "not needed",
    ]  # fmt: skip


def errors_table(found: Everything) -> Table:
    """Errors of neo-Hooke, of the fit, and of that of plausible effects."""
    models = [("neo-Hooke", found.before), ("all effects at once", found.after)]
    models += [] if found.plausible is None else [("plausible effects", found.plausible.after)]
    rows = [[name, *_errors(fitted), *_errors(held)] for name, (fitted, held) in models]
    return ["model", "force error, fitted, %", "field error, fitted, %",
            "force error, held out, %", "field error, held out, %"], rows  # fmt: skip


def _errors(misfit: Misfit | None) -> list[float | None]:
    if misfit is None:
        return [None, None]
    return [100 * misfit.force if misfit.force == misfit.force else None, 100 * misfit.field]


def updated_table(found: Everything, unit: str) -> Table | None:
    """Amplitudes and shapes as the equations and as the forces of replays have them; None where nothing was updated."""
    new = found.updated
    if not isinstance(new, Updated):
        return None
    own = {one.effect.name: one for one in found.shares}
    rows: list[list[Any]] = []
    for a, deviations, of_shapes in zip(new.additions, new.deviations, new.shape_deviations, strict=True):
        share = own[a.effect.name]
        for p, old, old_deviation, value, deviation in zip(
            a.effect.amplitudes, share.amplitudes, share.deviations, a.amplitudes, deviations, strict=True
        ):
            pair = (plus_minus(old, BAND * old_deviation), plus_minus(value, BAND * deviation))
            rows.append([a.effect.name, _symbol(p.name, amplitude_unit(p, unit)), *pair])
        for p, old, value, deviation in zip(a.effect.shapes, share.shape, a.shape, of_shapes, strict=True):
            rows.append([a.effect.name, _symbol(p.name, p.unit), f"{old:.3g}", plus_minus(value, BAND * deviation)])
    return ["effect", "amplitude or shape", "by the equations", "updated"], rows


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
        for p, mean, deviation in zip(a.effect.amplitudes, *one.priors[a.effect.name], strict=True):
            said.append(with_unit(f"{p.name} = {plus_minus(mean, BAND * deviation)}", amplitude_unit(p, unit)))
        said += [with_unit(f"{p.name} = {v:.2g}", p.unit) for p, v in zip(a.effect.shapes, a.shape, strict=True)]
    return [", ".join(said), f"{one.errors.field:.2g}"]


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
                         "standard_deviations": one.priors[a.effect.name][1].tolist()} for a in one.additions],
            "log_odds": one.log_odds, "fitted": one.errors.to_dict(), "discrepancy_mm": one.discrepancy,
        }
        for one in found.fitted
    ]  # fmt: skip
    return {
        "neo_hooke_fitted": found.base.to_dict(),
        "sets": [{"effects": list(names), "probability": p} for names, p in found.sets],
        "inclusion": found.inclusion,
        "fitted": fitted,
        "updated": None if found.updated is None else update_record(found.updated),
    }


def _symbol(name: str, unit: str) -> str:
    return name if unit == "1" else f"{name} ({unit})"


def everything_data(found: Everything) -> dict[str, Any]:
    """For one sentence: what was needed, what of it is implausible, and errors, held out where something was."""
    which = 0 if found.before[1] is None else 1
    before, after = found.before[which], found.after[which]
    assert before is not None
    assert after is not None
    seen = [one for one in found.shares if one.is_seen]
    return {
        "needed": [one.effect.name for one in seen if not (one.is_far or one.is_at_limit)],
        "at_limit": [one.effect.name for one in seen if one.is_at_limit],
        "implausible": [one.effect.name for one in seen if one.is_far],
        "held": bool(which),
        "worse": list(found.worse),
        "before": {"force": before.force, "field": before.field},
        "after": {"force": after.force, "field": after.field},
        "smooth": float(((1 + found.variance) * found.field_variance) ** 0.5),
        "rest": float(found.field_variance**0.5),
    }


def everything_record(found: Everything | None) -> dict[str, Any] | None:
    """As discovery.json holds it."""
    if found is None:
        return None
    shares = [
        {
            "effect": one.effect.name, "amplitudes": list(one.amplitudes), "standard_deviations": list(one.deviations),
            "prior_standard_deviations": list(one.priors), "shape": list(one.shape), "over_prior": one.over_prior,
            "misfit_without_it": one.rise, "r_squared_on_others": one.r_squared, "needed": bool(one.is_seen), "implausible": one.is_far, "at_limit": one.is_at_limit,
        }
        for one in found.shares
    ]  # fmt: skip
    errors = {
        name: [None if m is None else m.to_dict() for m in pair]
        for name, pair in (("before", found.before), ("after", found.after))
    }
    return {
        "effects": shares, "fitted_and_held_out": errors, "discrepancy_over_noise": (found.variance * found.field_variance) ** 0.5, "fields_over_noise": found.field_variance**0.5,
        "reduced_chi_square": found.dispersion, "converged": found.fit.converged, "predicts": found.predicts,
        "plausible": everything_record(found.plausible), "replay": _replayed(found.replayed), "updated": _updated(found), "neo_hooke": _replayed(found.neo_hooke_replayed),
    }  # fmt: skip


def _updated(found: Everything) -> dict[str, Any] | None:
    new = found.updated
    return None if new is None else {**update_record(new), "used": found.update_in_use is not None}


def update_record(new: Updated | NoReplayCheck) -> dict[str, Any]:
    """Of a model whose forces were fitted."""
    if isinstance(new, NoReplayCheck):
        return {"not_made": new.reason}
    effects = [
        {"effect": a.effect.name, "amplitudes": list(a.amplitudes), "standard_deviations": list(d), "shape": list(a.shape), "shape_standard_deviations": list(s)}
        for a, d, s in zip(new.additions, new.deviations, new.shape_deviations, strict=True)
    ]  # fmt: skip
    return {
        "effects": effects, "fitted_before": new.before.to_dict(), "fitted_after": new.after.to_dict(), "converged": new.converged, "forces": new.forces, "left_out": list(new.left_out),
        "replay": None if new.check is None else new.check.to_dict(),
    }  # fmt: skip


def _replayed(found: Replayed | NoReplayCheck | None) -> dict[str, Any] | None:
    if isinstance(found, NoReplayCheck):
        return {"not_made": found.reason}
    return None if found is None else found.to_dict()
