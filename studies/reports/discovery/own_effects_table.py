"""What every one of several tests has for itself: `OwnEffect`s in; a table, data of sentences and of discovery.json out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from calibrate.diagnosis.evidence.own_effects import OwnEffect
from calibrate.models.addition_json import amplitude_unit
from studies.output.words import plus_minus
from studies.reports.discovery.view import BAND

Table = tuple[list[str], list[list[Any]]]


def own_effects_table(found: Sequence[OwnEffect], unit: str) -> Table:
    """Amplitudes that are seen in any test, or alike in all."""
    rows: list[list[Any]] = []
    for one in found:
        if not (one.is_common or one.seen_in):
            continue
        own = amplitude_unit(one.parameter, unit)
        symbol = one.parameter.name if own == "1" else f"{one.parameter.name} ({own})"
        values = [_said(a, d) for a, d in zip(one.estimates, one.errors, strict=True)]
        told = "alike in all" if one.is_common else f"of {', '.join(one.seen_in)}"
        rows.append([one.effect.name, symbol, f"{one.prior:.2g}", *values, told])
    names = found[0].tests if found else ()
    return ["effect", "amplitude", "prior", *names, "this fit"], rows


def _said(value: float, error: float) -> str:
    return plus_minus(value, BAND * error) if value == value else "not told"


def alike(found: Sequence[OwnEffect]) -> list[str]:
    """Effects that are alike in all tests, with their mean."""
    return [
        f"{one.effect.name} ({one.parameter.name} = {plus_minus(one.mean[0], BAND * one.mean[1])})"
        for one in found
        if one.is_common
    ]


def seen(found: Sequence[OwnEffect]) -> list[str]:
    """Effects of a test alone, with its name."""
    tests = {name: dict.fromkeys(o.effect.name for o in found if name in o.seen_in) for o in found for name in o.tests}
    return [f"{', '.join(effects)} of {name}" for name, effects in tests.items() if effects]


def own_effects_record(found: Sequence[OwnEffect]) -> list[dict[str, Any]]:
    """As discovery.json holds them."""
    rows = []
    for one in found:
        content = {key: _finite(value) for key, value in asdict(one).items() if key not in ("effect", "parameter")}
        names = {"effect": one.effect.name, "amplitude": one.parameter.name}
        rows.append(names | content | {"alike": one.is_common, "seen_in": list(one.seen_in)})
    return rows


def _finite(value: Any) -> Any:
    """With None for what a test does not tell."""
    if isinstance(value, tuple):
        return [None if isinstance(v, float) and v != v else v for v in value]
    return value
