"""Result files that follow from others: rates of the blind trials, and the catalogue of effects (`make numbers`).

In: `docs/blind.json` and the classes of `calibrate.effects`. Out: `trials.json` and `catalogue.json` in `docs/results`.

The definitions of the rates are those of `studies.trials.blind_report`. A strong effect is one with a score above 10. Of these are told apart:
named right; right with a wrong name beside it; right only through a group, which names an effect that the data cannot tell from it;
missed; and a wrong name only.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from calibrate.effects import CATALOGUE, Effect
from studies.trials import blind_report

FOLDER = Path(__file__).parent
FIELD = "stiffness field"
FEW = 5
NEVER = "never: a common factor of modulus, force, thickness and DIC scale"


def outcome(one: dict[str, Any]) -> str:
    """Of a trial with one effect."""
    others = set(one["named"]) - set(one["hidden"])
    if one["exact"][0]:
        return "beside" if others else "right"
    if one["hit"][0]:
        return "group"
    return "wrong" if one["named"] else "missed"


def numbers(trials: list[dict[str, Any]]) -> dict[str, Any]:
    """What the pages state."""
    found = blind_report.summary(trials)
    strong = [one for one in trials if len(one["hidden"]) == 1 and one["strong"]]
    outcomes = [outcome(one) for one in strong]
    removed = [one["absent"] for one in strong if "absent" in one]
    names = ("nulls", "null_detections", "null_names", "strong", "strong_group_named", "strong_named", "amplitudes",
             "amplitudes_within", "absent", "absent_wrong", "pairs", "pairs_found", "pairs_at_first",
             "pairs_at_first_found", "pairs_in_model")  # fmt: skip
    fields = [
        (a["amplitudes"][k] - true) / a["deviations"][k]
        for one in trials
        if one["hidden"] == [FIELD]
        for a in one["amplitudes"]
        if a["effect"] == FIELD
        for k, true in a["true"].items()
    ]
    return {
        "trials": len(trials),
        **{name: found[name] for name in names},
        "null_quiet": found["nulls"] - found["null_detections"],
        **{name: outcomes.count(name) for name in ("right", "beside", "group", "missed", "wrong")},
        "removed": len(removed),
        "removed_explained": sum(a["verdict"] == "explained" for a in removed),
        "removed_alike": sum(a["verdict"] == "explained" and not a["wrong"] for a in removed),
        "removed_wrong": sum(bool(a["wrong"]) for a in removed),
        "field_correlation": float(np.median(found["field_correlation"])),
        "fields": len(fields),
        "fields_within": sum(abs(pull) <= 1.96 for pull in fields),
        "seconds": found["seconds"],
    }


def share(part: int, whole: int) -> str:
    return f"{part} of {whole} ({100 * part / whole:.0f} %)"


def rates(n: dict[str, Any]) -> list[list[str]]:
    """The table of all trials."""
    aims = [
        ["nothing hidden: something called significant", share(n["null_detections"], n["nulls"]), "at most 5 %"],
        ["one strong effect: its group named", share(n["strong_group_named"], n["strong"]), "90 %"],
        ["- named right, and nothing else", share(n["right"], n["strong"]), ""],
        ["- named right, with a wrong name beside it", share(n["beside"], n["strong"]), ""],
        ["- right only through a group: one that the data cannot tell from it is named", share(n["group"], n["strong"]), ""],
        ["one strong effect: not named", share(n["missed"], n["strong"]), ""],
        ["one strong effect: a wrong name only", share(n["wrong"], n["strong"]), ""],
        ["amplitude within its 95 % interval", share(n["amplitudes_within"], n["amplitudes"]), "85 %"],
        ["effect removed from the catalogue: a name that is no declared look-alike", share(n["absent_wrong"], n["absent"]), "at most 15 %"],
        ["strong effect removed: verdict *explained*, by whatever name", share(n["removed_explained"], n["removed"]), ""],
        ["- of these by a declared look-alike, which the line above excuses", share(n["removed_alike"], n["removed"]), ""],
        ["two effects, each strong beside the other: both named", share(n["pairs_found"], n["pairs"]), "70 %"],
        ["two effects, each strong before either is found: both named", share(n["pairs_at_first_found"], n["pairs_at_first"]), ""],
        ["both in the model, named or too small beside the other to be named", share(n["pairs_in_model"], n["pairs"]), ""],
        ["stiffness field: correlation with the hidden one, median", f"{n['field_correlation']:.2f}", ""],
        ["CPU time of a diagnosis, median", f"{n['seconds']:.0f} s", ""],
    ]  # fmt: skip
    return [["question", "found", "aim"], *aims]


def effects(trials: list[dict[str, Any]]) -> list[list[str]]:
    """A line for each effect: how the strong ones ended, intervals, and what happens without it in the catalogue."""
    head = ["hidden", "strong", "right", "wrong name beside", "only its group", "missed", "wrong", "amplitude within",
            "removed: explained (strong)", "removed: wrong name (all)"]  # fmt: skip
    rows = []
    for name, _, n_strong, *_, n_amplitudes, within, absent, wrong in blind_report.summary(trials)["effects"]:
        own = [one for one in trials if one["hidden"] == [name] and one["strong"]]
        ends = [outcome(one) for one in own]
        removed = [one["absent"]["verdict"] for one in own if "absent" in one]
        inside = "see the correlation" if name == FIELD else f"{within} of {n_amplitudes}"
        counts = [str(ends.count(kind)) for kind in ("right", "beside", "group", "missed", "wrong")]
        explained = f"{removed.count('explained')} of {len(removed)}"
        rows.append([name, str(n_strong), *counts, inside, explained, f"{wrong} of {absent}"])
    return [head, *rows]


def trials() -> dict[str, Any]:
    """`trials.json`."""
    judged = json.loads((FOLDER / "blind.json").read_text())
    n = numbers(judged)
    return {
        "command": "python docs/derive_numbers.py, from docs/blind.json of equigap blind --seed 20000",
        "made": "2026-11-22",
        "how": "none of the trials was looked at before the diagnosis was fixed",
        "numbers": n,
        "tables": {"rates": rates(n), "effects": effects(judged)},
    }


def catalogue() -> dict[str, Any]:
    """`catalogue.json`: a row for each effect that is tested."""
    rows = [["effect", "stage", "formula", "amplitudes and shapes (unit)", "decided by", "source"]]
    for effect in CATALOGUE:
        formula = f"`{effect.formula}`".replace("|", "\\|")
        source = effect.source.replace("derived in docs/thickness.md", "[derived here](thickness.md)")
        rows.append([effect.name, effect.stage, formula, parameters(effect), effect.decided_by or NEVER, source])
    return {
        "command": "python docs/derive_numbers.py, from the classes of calibrate.effects",
        "numbers": {"effects": len(CATALOGUE)},
        "tables": {"effects": rows},
    }


def parameters(effect: Effect) -> str:
    """Names and units; the first and last of many."""
    words = [
        f"{p.name} ({p.unit})" if p.unit not in ("", "1") else p.name for p in (*effect.amplitudes, *effect.shapes)
    ]
    return ", ".join(words) if len(words) < FEW else f"{words[0]}, ..., {words[-1]}"


def main() -> dict[str, dict[str, Any]]:
    """Everything that is written, by file."""
    return {"trials": trials(), "catalogue": catalogue()}


if __name__ == "__main__":
    for name, content in main().items():
        (FOLDER / "results" / f"{name}.json").write_text(json.dumps(content, indent=1) + "\n")
