"""What every one of several tests has for itself: `OwnEffect`s in; a table, data of sentences and of discovery.json out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from calibrate.diagnosis.evidence.own_effects import OwnEffect
from calibrate.models.addition_json import amplitude_unit
from calibrate.models.parameter_covariance import Z95
from studies.output.words import plus_minus, with_unit

Table = tuple[list[str], list[list[Any]]]


def own_effects_table(found: Sequence[OwnEffect], unit: str) -> Table:
    """Amplitudes that are seen in any test, of effects that are there."""
    tests = list(dict.fromkeys(name for one in found for name in one.tests))
    rows: list[list[Any]] = []
    for one in found:
        for i, parameter in enumerate(one.effect.amplitudes):
            if not one.is_there or not any(one.is_seen(k, i) for k in range(len(one.tests))):
                continue
            own = amplitude_unit(parameter, unit)
            symbol = parameter.name if own == "1" else f"{parameter.name} ({own})"
            values = [_said(one, name, i) for name in tests]
            chances = [f"{chance:.3f}" for chance in (one.own, one.common)]
            rows.append([one.effect.name, symbol, f"{one.prior[i]:.2g}", *values, *chances])
    return ["effect", "amplitude", "prior", *tests, "P(each its own)", "P(alike)"], rows


def _said(one: OwnEffect, test: str, amplitude: int) -> str:
    if test not in one.tests:
        return "cannot be told"
    k = one.tests.index(test)
    return plus_minus(one.values[k][amplitude], Z95 * one.deviations[k][amplitude])


def alike(found: Sequence[OwnEffect], unit: str) -> list[str]:
    """Effects that are alike in all tests, with what they have in common."""
    return [f"{one.effect.name} ({_amplitudes(one, unit)})" for one in found if one.is_common and one.is_plausible]


def stand_ins(found: Sequence[OwnEffect]) -> list[str]:
    """Effects that are there, but larger than a specimen could have them."""
    return [one.effect.name for one in found if one.is_there and not one.is_plausible]


def _amplitudes(one: OwnEffect, unit: str) -> str:
    """Of an effect that is alike in all tests: those that are seen, all where none is."""
    rows = list(zip(one.effect.amplitudes, one.values[0], one.deviations[0], strict=True))
    seen = [row for i, row in enumerate(rows) if one.is_seen(0, i)] or rows
    return ", ".join(
        with_unit(f"{parameter.name} = {plus_minus(a, Z95 * d)}", amplitude_unit(parameter, unit))
        for parameter, a, d in seen
    )


def seen(found: Sequence[OwnEffect]) -> list[str]:
    """Effects of a test alone, with its name."""
    plausible = [one for one in found if one.is_plausible]
    tests = {name: [o.effect.name for o in plausible if name in o.seen_in] for o in found for name in o.tests}
    return [f"{', '.join(effects)} of {name}" for name, effects in tests.items() if effects]


def own_effects_record(found: Sequence[OwnEffect]) -> list[dict[str, Any]]:
    """As discovery.json holds them."""
    return [
        {
            "effect": one.effect.name,
            "amplitudes": [parameter.name for parameter in one.effect.amplitudes],
            "prior": list(one.prior),
            "tests": list(one.tests),
            "values": [list(row) for row in one.values],
            "deviations": [list(row) for row in one.deviations],
            "probability_of_each_its_own": one.own,
            "probability_of_alike": one.common,
            "seen_in": list(one.seen_in),
            "is_plausible": one.is_plausible,
        }
        for one in found
    ]
