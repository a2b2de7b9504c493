"""Report of the blind trials: what was hidden against what was named.

In: folders of diagnosed trials. Out: ``trials.json`` and ``.csv``, ``confusion.csv``, ``effects.csv``, ``summary.json``,
``report.html`` and a text answer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from calibrate.diagnosis.selection import Verdict
from studies.output.manifest import Manifest
from studies.output.report import Report
from studies.output.words import Words
from studies.output.writing import write_csv, write_json
from studies.trials.judgement import JudgedTrial, judge
from studies.trials.trial_summary import EFFECT_COLUMNS, pulls, summary

NOTHING, UNEXPLAINED = "nothing", "unexplained"
TRIAL_COLUMNS = ["trial", "hidden", "score", "verdict", "named", "closest", "pulls", "seconds"]
RELIABILITY_COLUMNS = ["probability from", "to", "effects", "mean probability", "of these hidden"]
WORDS = Words("blind")


def write_report(
    folder: Path, homes: Sequence[Path], failures: Mapping[str, str], manifest: Manifest, known: Mapping[str, JudgedTrial] | None = None
) -> str:  # fmt: skip
    """Judge every trial that is not `known` by its name, write tables and report, and return the answer in words. manifest: of the run."""
    known = known or {}
    judged = [
        known[home.name] if home.name in known else judge(home)
        for home in homes
        if home.name in known or (home / "diagnosis.json").exists()
    ]
    names, matrix, columns = confusion(judged)
    found = summary(judged)
    rows = [[hidden, *map(int, line)] for hidden, line in zip(names, matrix, strict=True)]
    effects, lines = [one.row() for one in found.effects], [_line(one) for one in judged]
    write_csv(folder / "confusion.csv", ["hidden", *columns], rows)
    write_csv(folder / "effects.csv", EFFECT_COLUMNS, effects)
    write_csv(folder / "trials.csv", TRIAL_COLUMNS, lines)
    write_json(folder / "trials.json", [one.to_dict() for one in judged])
    write_json(folder / "summary.json", {**found.to_dict(), "failures": dict(failures)})
    text = WORDS.rates(n=found, failures=failures)
    report = Report("Blind trials")
    report.paragraph(text)
    report.heading("Named against hidden").table(["hidden", *columns], rows, WORDS.confusion_caption())
    report.heading("Every effect").table(EFFECT_COLUMNS, effects)
    report.heading("How often what is probable is there")
    report.table(
        RELIABILITY_COLUMNS, [list(asdict(one).values()) for one in found.reliability], WORDS.reliability_caption()
    )
    report.heading("Every trial").table(TRIAL_COLUMNS, lines)
    report.save(folder / "report.html")
    manifest.beside(folder / "report.html", folder / "confusion.csv", folder / "effects.csv")
    return text


def confusion(judged: Sequence[JudgedTrial]) -> tuple[list[str], np.ndarray, list[str]]:
    """Hidden names, counts (hidden, named), column names, of trials with at most one effect."""
    single = [one for one in judged if len(one.hidden) < 2]
    names = sorted({(one.hidden or ["none"])[0] for one in single}, key=lambda n: (n != "none", n))
    outcomes = [_outcome(one) for one in single]
    columns = [NOTHING, UNEXPLAINED, *sorted(set(outcomes) - {NOTHING, UNEXPLAINED})]
    matrix = np.zeros((len(names), len(columns)))
    for one, outcome in zip(single, outcomes, strict=True):
        matrix[names.index((one.hidden or ["none"])[0]), columns.index(outcome)] += 1
    return names, matrix, columns


def _outcome(one: JudgedTrial) -> str:
    if one.named:
        hidden = set(one.hidden)
        return next((n for n in one.named if n in hidden), one.named[0])
    return NOTHING if one.verdict == Verdict.NOTHING_SIGNIFICANT else UNEXPLAINED


def _line(one: JudgedTrial) -> list[Any]:
    return [
        one.trial, ", ".join(one.hidden) or "none", ", ".join(f"{v:.1f}" for v in one.scores.values()),
        one.verdict, ", ".join(one.named), ", ".join(one.closest),
        ", ".join(f"{p:+.1f}" for p in pulls(one)), round(one.seconds, 1),
    ]  # fmt: skip
