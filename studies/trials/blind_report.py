"""Report of the blind trials: what was hidden against what was named.

In: folders of diagnosed trials. Out: ``trials.json`` and ``.csv``, ``confusion.csv``, ``summary.json``, ``tables.md``, ``report.html``
and a text answer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from studies.trials.blind_case import GLOBAL_LIMIT, judge

FIELD = "stiffness field"
NOTHING, UNEXPLAINED = "nothing", "unexplained"


def write_report(
    folder: Path, homes: Sequence[Path], failures: dict[str, str], known: Mapping[str, dict[str, Any]] | None = None
) -> str:
    """Judge every trial that is not `known` by its name, write tables and report, and return the answer in words."""
    from studies.output.manifest import Manifest
    from studies.output.report import Report
    from studies.output.writing import write_csv, write_json, write_text

    known = known or {}
    judged = [
        known[home.name] if home.name in known else judge(home)
        for home in homes
        if home.name in known or (home / "diagnosis.json").exists()
    ]
    names, matrix, columns = confusion(judged)
    numbers = summary(judged)
    numbers["failures"] = failures
    rows = [[hidden, *map(int, line)] for hidden, line in zip(names, matrix, strict=True)]
    write_csv(folder / "confusion.csv", ["hidden", *columns], rows)
    write_csv(folder / "effects.csv", EFFECT_COLUMNS, numbers["effects"])
    write_csv(folder / "trials.csv", TRIAL_COLUMNS, [_line(one) for one in judged])
    write_json(folder / "trials.json", judged)
    write_json(folder / "summary.json", numbers)
    write_text(folder / "tables.md", markdown(numbers))
    text = words(numbers)
    report = Report("Blind trials")
    report.paragraph(text)
    report.heading("Named against hidden")
    report.paragraph(
        "Rows: hidden. Columns: named first; 'nothing': nothing significant; 'unexplained': significant, not explained."
    )
    report.table(["hidden", *columns], rows)
    report.heading("Every effect")
    report.table(EFFECT_COLUMNS, numbers["effects"])
    report.heading("Every trial")
    report.table(TRIAL_COLUMNS, [_line(one) for one in judged])
    report.save(folder / "report.html")
    Manifest(settings={"study": "blind"}).beside(
        folder / "report.html", folder / "confusion.csv", folder / "effects.csv"
    )
    return text


EFFECT_COLUMNS = ["effect", "trials", "strong", "group named (strong)", "itself named (strong)", "wrong (all)",
                  "missed or unexplained (all)", "amplitudes", "within 95 %", "absent: trials", "absent: wrong name"]  # fmt: skip
TRIAL_COLUMNS = ["trial", "hidden", "score", "verdict", "named", "closest", "pulls", "seconds"]


def confusion(judged: Sequence[dict[str, Any]]) -> tuple[list[str], np.ndarray, list[str]]:
    """Hidden names, counts (hidden, named), column names, of trials with at most one effect."""
    single = [one for one in judged if len(one["hidden"]) < 2]
    names = sorted({(one["hidden"] or ["none"])[0] for one in single}, key=lambda n: (n != "none", n))
    outcomes = [_outcome(one) for one in single]
    columns = [NOTHING, UNEXPLAINED, *sorted(set(outcomes) - {NOTHING, UNEXPLAINED})]
    matrix = np.zeros((len(names), len(columns)))
    for one, outcome in zip(single, outcomes, strict=True):
        matrix[names.index((one["hidden"] or ["none"])[0]), columns.index(outcome)] += 1
    return names, matrix, columns


def _outcome(one: dict[str, Any]) -> str:
    if one["named"]:
        hidden = set(one["hidden"])
        return next((n for n in one["named"] if n in hidden), one["named"][0])
    return NOTHING if one["verdict"] == "nothing significant" else UNEXPLAINED


def summary(judged: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Rates over all trials, and a line for each effect."""
    nulls = [one for one in judged if not one["hidden"]]
    single = [one for one in judged if len(one["hidden"]) == 1]
    pairs = [one for one in judged if len(one["hidden"]) == 2]
    lines = []
    for name in sorted({one["hidden"][0] for one in single}):
        own = [one for one in single if one["hidden"][0] == name]
        strong = [one for one in own if one["strong"]]
        pulls = [p for one in own for p in _pulls(one)]
        absent = [one["absent"] for one in own if "absent" in one]
        lines.append([
            name, len(own), len(strong), sum(one["hit"][0] for one in strong), sum(one["exact"][0] for one in strong),
            sum(bool(one["named"]) and not one["hit"][0] for one in own), sum(not one["named"] for one in own),
            len(pulls), sum(abs(p) < 1.96 for p in pulls), len(absent), sum(bool(a["wrong"]) for a in absent),
        ])  # fmt: skip
    strong_pairs = [one for one in pairs if "beside" in one and min(one["beside"].values()) > GLOBAL_LIMIT]
    at_first = [one for one in pairs if min(one["scores"].values()) > GLOBAL_LIMIT]
    total = np.array([line[1:] for line in lines]).sum(axis=0) if lines else np.zeros(10)
    return {
        "nulls": len(nulls),
        "null_detections": sum(one["verdict"] != "nothing significant" for one in nulls),
        "null_names": sum(bool(one["named"]) for one in nulls),
        "strong": int(total[1]),
        "strong_group_named": int(total[2]),
        "strong_named": int(total[3]),
        "amplitudes": int(total[6]),
        "amplitudes_within": int(total[7]),
        "absent": int(total[8]),
        "absent_wrong": int(total[9]),
        "pairs": len(strong_pairs),
        "pairs_found": sum(all(one["hit"]) for one in strong_pairs),
        "pairs_at_first": len(at_first),
        "pairs_at_first_found": sum(all(one["hit"]) for one in at_first),
        "pairs_in_model": sum(
            all(hit or name in one["closest"] for name, hit in zip(one["hidden"], one["hit"], strict=True))
            for one in strong_pairs
        ),
        "field_correlation": [f for one in judged for f in one["field"] if f is not None],
        "seconds": float(np.median([one["seconds"] for one in judged])) if judged else 0.0,
        "effects": lines,
    }


def _pulls(one: dict[str, Any]) -> list[float]:
    """Of the amplitudes of hidden effects that were named; a field's coefficients, which cannot follow a patch, are not among them."""
    found = [a for a in one["amplitudes"] if a is not None and a["effect"] in one["named"] and a["effect"] != FIELD]
    return [p for a in found for p in a["pulls"].values()]


def _line(one: dict[str, Any]) -> list[Any]:
    return [
        one["trial"], ", ".join(one["hidden"]) or "none", ", ".join(f"{v:.1f}" for v in one["scores"].values()),
        one["verdict"], ", ".join(one["named"]), ", ".join(one["closest"]),
        ", ".join(f"{p:+.1f}" for p in _pulls(one)), round(one["seconds"], 1),
    ]  # fmt: skip


def share(part: int, whole: int) -> str:
    """'3 of 4 (75 %)', or 'none made'."""
    return f"{part} of {whole} ({100 * part / whole:.0f} %)" if whole else "none made"


def markdown(numbers: dict[str, Any]) -> str:
    """The rates and a line for each effect as tables of Markdown, for docs/discover.md."""
    n, fields = numbers, numbers["field_correlation"]
    rates = [
        ["question", "found", "aim"],
        ["---"] * 3,
        [
            "nothing hidden: something named, or called significant",
            share(n["null_detections"], n["nulls"]),
            "at most 5 %",
        ],
        ["one effect with a score above 10: its group named", share(n["strong_group_named"], n["strong"]), "90 %"],
        ["the effect itself named", share(n["strong_named"], n["strong"]), ""],
        ["amplitude within its 95 % interval", share(n["amplitudes_within"], n["amplitudes"]), "85 %"],
        ["effect removed from the catalogue: a wrong name", share(n["absent_wrong"], n["absent"]), "at most 15 %"],
        [
            "two effects, each with a score above 10 beside the other: both found",
            share(n["pairs_found"], n["pairs"]),
            "70 %",
        ],
        [
            "two effects, each with a score above 10 before either is found: both found",
            share(n["pairs_at_first_found"], n["pairs_at_first"]),
            "",
        ],
        [
            "both in the model, named or too small beside the other to be named",
            share(n["pairs_in_model"], n["pairs"]),
            "",
        ],
        ["stiffness field: correlation with the hidden one, median", f"{np.median(fields):.2f}" if fields else "-", ""],
        ["CPU time of a diagnosis, median", f"{n['seconds']:.0f} s", ""],
    ]
    lines = [["hidden", "trials", "strong", "group named", "amplitude within", "removed: wrong name"], ["---"] * 6]
    for name, trials, strong, group, _, _, _, amplitudes, within, absent, wrong in n["effects"]:
        inside = "see the correlation" if name == FIELD else f"{within} of {amplitudes}" if amplitudes else "-"
        lines.append([name, str(trials), str(strong), str(group), inside, f"{wrong} of {absent}"])
    tables = ["\n".join(f"| {' | '.join(row)} |".replace("|  |", "| |") for row in table) for table in (rates, lines)]
    return "\n\n".join(tables) + "\n"


def words(numbers: dict[str, Any]) -> str:
    """The answer."""
    n = numbers
    fields = n["field_correlation"]
    likeness = f"Stiffness field: correlation with the hidden one, median {np.median(fields):.2f}. " if fields else ""
    failed = "; ".join(f"{name} ({why})" for name, why in n.get("failures", {}).items())
    return (
        f"Nothing hidden: something was found in {share(n['null_detections'], n['nulls'])}. "
        f"One effect with a score above 10: its group named in {share(n['strong_group_named'], n['strong'])}, "
        f"the effect itself in {share(n['strong_named'], n['strong'])}. "
        f"Amplitude within its 95 % interval: {share(n['amplitudes_within'], n['amplitudes'])}. "
        f"{likeness}"
        f"Effect taken out of the catalogue: wrongly named {share(n['absent_wrong'], n['absent'])}. "
        f"Two effects strong beside each other: both found in {share(n['pairs_found'], n['pairs'])}, "
        f"both in the model in {share(n['pairs_in_model'], n['pairs'])}. "
        f"CPU time of a diagnosis, median: {n['seconds']:.1f} s."
        + (f" Ended with an error and counted nowhere: {failed}." if failed else "")
    )
