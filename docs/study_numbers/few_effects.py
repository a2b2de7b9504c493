"""Few effects by the fields of replays of the measured sheets: the folder of `equigap measured` in, and perhaps that of `equigap discover` on all three."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from sheets import EFFECTS, SHORT, modulus
from wording import share

from calibrate.models.addition_json import amplitude_unit
from studies.output.words import percent, plus_minus, with_unit

TOGETHER, LISTED = "all three together", 4  # sets of a sheet
INTERVAL = 1.96  # standard deviations of half a 95 % interval
PAIR = (
    "compressibility",
    "stiffness gradient",
)  # the most probable set of all three together, whose amplitudes are compared


def take(folder: Path, joint: Path | None = None) -> dict[str, Any]:
    """Sets with their probabilities, probability of every effect, and what the best with relaxation misses of what was held out."""
    homes = {name: folder / name for name in SHORT} | ({} if joint is None else {TOGETHER: joint})
    sets = [
        [
            "sheet",
            "beside neo-Hooke",
            "probability",
            "amplitudes and shapes by the fields",
            "displacements off by, fitted (mm)",
        ]
    ]
    numbers: dict[str, Any] = {}
    inclusion: dict[str, dict[str, float]] = {}
    for name, home in homes.items():
        found = json.loads((home / "discovery.json").read_text())
        few, unit, short = found["few_effects"], found["stress_unit"], SHORT.get(name, "joint")
        fitted = {tuple(sorted(e["effect"] for e in one["effects"])): one for one in few["fitted"]}
        for one in few["sets"][:LISTED]:
            own = fitted.get(tuple(one["effects"]))
            sets.append([name, ", ".join(one["effects"]) or "nothing", _probability(one["probability"]),
                         "" if own is None else _amplitudes(own, unit), "" if own is None else f"{own['fitted']['field']:.3f}"])  # fmt: skip
        inclusion[name] = few["inclusion"]
        numbers |= {f"{short}_p_{key.replace(' ', '_')}": _probability(p) for key, p in few["inclusion"].items()}
        numbers |= {
            f"{short}_best": " and ".join(few["sets"][0]["effects"]) or "none",
            f"{short}_best_p": _probability(few["sets"][0]["probability"]),
            f"{short}_p": _probability(sum(one["probability"] for one in few["sets"] if tuple(one["effects"]) == PAIR)),
        }
        numbers[f"{short}_neo_hooke_mm"] = f"{few['neo_hooke_fitted']['field']:.3f}"
        for effect in fitted[PAIR]["effects"] if PAIR in fitted else ():
            for p, value, deviation in zip(EFFECTS[effect["effect"]].amplitudes, effect["amplitudes"], effect["standard_deviations"], strict=True):  # fmt: skip
                numbers[f"{short}_{p.name}"] = plus_minus(value, INTERVAL * deviation)
                if p.name == "beta":
                    numbers[f"{short}_nu"] = f"{poisson(value * modulus(home)):.2f}"
        numbers |= {f"{short}_{key}": value for key, value in _updated(few["models"][0]).items()}
        numbers |= {f"{short}_{key}": value for key, value in _competing(found["alerts"]).items()}
    return {
        "command": "equigap measured; equigap discover Soft_Homo.npz Stiff2_Homo.npz Stiff2_Hetero.npz --hold-out after:15",
        "how": "24 pictures a sheet, the first 15 s fitted; rule committed before what comes after was looked at once; that a gradient and compressibility leave less had been found by hand before",
        "numbers": numbers,
        "tables": {"sets": sets, "inclusion": _inclusion(inclusion)},
    }  # fmt: skip


def poisson(ratio: float) -> float:
    """Poisson's ratio at rest, of the shear over the bulk modulus."""
    return (3 - 2 * ratio) / (6 + 2 * ratio)


def _probability(p: float) -> str:
    """'more than 99 %' of 0.999."""
    return "more than 99 %" if p > 0.99 else share(p)


def _amplitudes(one: dict[str, Any], unit: str) -> str:
    said = []
    for effect in one["effects"]:
        for p, value, deviation in zip(EFFECTS[effect["effect"]].amplitudes, effect["amplitudes"], effect["standard_deviations"], strict=True):  # fmt: skip
            said.append(with_unit(f"{p.name} = {plus_minus(value, INTERVAL * deviation)}", amplitude_unit(p, unit)))
        said += [with_unit(f"{p.name} = {v:.2g}", p.unit) for p, v in zip(EFFECTS[effect["effect"]].shapes, effect["shape"], strict=True)]  # fmt: skip
    return ", ".join(said)


def _updated(new: dict[str, Any]) -> dict[str, str]:
    """Errors of its replay, with the band, and relaxation."""
    if "not_made" in new or not new["replay"]:
        return {}
    final, band = new["replay"]["final"], new["replay"]["band"]
    numbers = {
        "force_fitted": percent(final["fitted"]["force"]),
        "force_held_out": percent(final["judged"]["force"]),
        "mm_held_out": f"{final['judged']['field']:.3f}",
        "band_force": percent(band["force"]),
        "band_mm": f"{band['field']:.3f}",
    }
    if new["replay"]["force_test"] is not None:  # of several tests none may judge
        p = new["replay"]["force_test"]["p"]
        numbers["force_p"] = f"{p:.2f}" if p >= 0.005 else f"{p:.0e}"
    for one in new["effects"]:
        if one["effect"] == "viscoelasticity":
            numbers |= {"g": f"{one['amplitudes'][0]:.2f}", "tau": f"{one['shape'][0]:.1f}"}
    return numbers


def _competing(alerts: list[dict[str, Any]]) -> dict[str, str]:
    """What the first of the sets that compete misses, and their average; nothing without one."""
    told = next((one["data"] for one in alerts if one["code"] == "R621"), None)
    if told is None or told["average"] is None:
        return {}
    missed = told["competing"][0]["model"]["missed"]
    return {
        "second_force": percent(missed["force"]),
        "second_mm": f"{missed['field']:.3f}",
        "average_force": percent(told["average"]["judged"]),
        "average_smooth_mm": f"{told['average']['smooth']:.3f}",
    }


def _inclusion(found: dict[str, dict[str, float]]) -> list[list[str]]:
    """Effects by their largest probability, of at least 5 % in one sheet."""
    effects = sorted({e for one in found.values() for e in one}, key=lambda e: -max(one.get(e, 0.0) for one in found.values()))  # fmt: skip
    rows = [[e, *(_probability(one[e]) if e in one else "" for one in found.values())] for e in effects if max(one.get(e, 0.0) for one in found.values()) >= 0.05]  # fmt: skip
    return [["effect", *found], *rows]
