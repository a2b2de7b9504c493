"""Files and report of what would decide: `Decision` in; HTML, figure, JSON and CSV out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from studies.decide.rivals import Rivals
from studies.output import Manifest, style, write_csv, write_figure, write_json
from studies.output.findings import Finding, Macro
from studies.output.plain import StepResult
from studies.output.report import Report
from studies.output.words import Words
from studies.reports.alert_table import add_alerts, alert_records

WORDS = Words("decide")
FORMAT, VERSION = "equigap-decision", 1
DECISIVE = float(np.log(20.0))  # ln evidence
DRAWN = 12  # tests


class DecideCode(Macro):
    """Macros of ``templates/decide.txt``."""

    DECIDES = "decides"
    NOTHING_DECIDES = "nothing_decides"
    NOT_SHOWN = "not_shown"
    NOTHING_OPEN = "nothing_open"
    REFUSED = "refused"


@dataclass(frozen=True)
class SpecimenResult(StepResult):
    """values {programme: ln evidence for every pair, None where the test cannot show it}; reason: why the specimen cannot be tested."""

    name: str
    values: dict[str, list[float | None]]
    reason: str = ""


@dataclass(frozen=True)
class Test:
    """A specimen under a programme; values: ln evidence for every pair."""

    specimen: str
    programme: str
    values: list[float | None]

    @property
    def title(self) -> str:
        """Both in words."""
        return f"{self.specimen}, {self.programme}"


@dataclass(frozen=True, eq=False)
class Decision:
    """What every specimen would say of every pair. unknown: see `Undecided`."""

    source: str
    rivals: tuple[Rivals, ...]
    specimens: tuple[SpecimenResult, ...]
    unknown: bool = False

    @property
    def tests(self) -> list[Test]:
        """Those that are possible, the best first: by how much they tell of the pair of which they tell least."""
        found = [
            Test(one.name, programme, values) for one in self.specimens for programme, values in one.values.items()
        ]
        return sorted(found, key=lambda test: -min((v or 0.0 for v in test.values), default=-np.inf))

    def best(self, i: int) -> tuple[Test, float] | None:
        """The test that tells most of the i-th pair; None where none shows it."""
        shown = [(test, v) for test in self.tests if (v := test.values[i]) is not None]
        return max(shown, key=lambda pair: pair[1], default=None)


def findings(found: Decision) -> list[Finding]:
    """What a reader should know."""
    return [Finding("decide", code, data) for code, data in _findings(found)]


def _findings(found: Decision) -> Iterator[tuple[DecideCode, dict[str, Any]]]:
    if not found.rivals:
        yield DecideCode.NOTHING_OPEN, {"unknown": found.unknown}
    for i, pair in enumerate(found.rivals):
        best = found.best(i)
        if best is None:
            yield DecideCode.NOT_SHOWN, {"rivals": pair.text}
            continue
        test, value = best
        data = {"rivals": pair.text, "specimen": test.specimen, "programme": test.programme, "expected": value}
        if value > DECISIVE:
            yield DecideCode.DECIDES, {**data, "now": pair.now}
        else:
            yield DecideCode.NOTHING_DECIDES, data
    refused = [f"{one.name} ({one.reason})" for one in found.specimens if one.reason]
    if refused:
        yield DecideCode.REFUSED, {"specimens": refused}


def table(found: Decision) -> tuple[list[str], list[list[Any]]]:
    """A line for each test."""
    rows = [[t.specimen, t.programme, *("" if v is None else f"{v:.1f}" for v in t.values)] for t in found.tests]
    return ["specimen", "loading", *(pair.text for pair in found.rivals)], rows


def record(found: Decision) -> dict[str, Any]:
    """Content of ``decision.json``."""
    pairs = [
        {"taken_as_right": list(pair.names), "against": list(pair.others), "ln_evidence_now": pair.now}
        for pair in found.rivals
    ]
    return {
        "format": FORMAT,
        "version": VERSION,
        "rivals": pairs,
        "specimens": [one.to_dict() for one in found.specimens],
    }


def write(folder: Path, found: Decision, manifest: Manifest) -> Path:
    """``decision.json``, ``tests.csv``, ``tests.png`` and ``report.html``, whose path is returned."""
    told = findings(found)
    write_json(folder / "decision.json", {**record(found), "alerts": alert_records(told)})
    write_csv(folder / "tests.csv", *table(found))
    made = ["decision.json", "tests.csv"]
    report = Report("What would decide", WORDS.subtitle(source=found.source))
    report.paragraph(".\n".join(one.text for one in told) + ".")
    if found.rivals and found.tests:
        write_figure(folder / "tests.png", draw(found))
        made.append("tests.png")
        report.heading("Tests").table(*table(found), WORDS.table()).figure(folder / "tests.png", WORDS.figure_tests())
    add_alerts(report, told)
    content = manifest.to_dict()
    report.heading("How it was made").details("Settings", content["settings"]).details("Versions", content["versions"])
    path = report.save(folder / "report.html")
    manifest.beside(path, *(folder / name for name in made), alerts=alert_records(told))
    return path


def draw(found: Decision) -> Figure:
    """Expected ln evidence of the best tests for every pair."""
    tests = found.tests[:DRAWN]
    at = np.arange(len(tests))[::-1]
    height = 0.8 / len(found.rivals)
    with style.figure(7.0, 1.2 + len(tests) * (0.15 + 0.12 * len(found.rivals))) as figure:
        ax = figure.subplots()
        for i, (pair, colour) in enumerate(zip(found.rivals, _colours(len(found.rivals)), strict=True)):
            values = [0.0 if (v := t.values[i]) is None else v for t in tests]
            ax.barh(at - height * i, values, height, color=colour, label=pair.text)
        ax.axvline(DECISIVE, color="0.3", linewidth=0.8)
        ax.set_xscale("symlog", linthresh=DECISIVE)
        ax.set_xlim(left=min(-1.0, 1.2 * min(v or 0.0 for t in tests for v in t.values)))
        ax.set_yticks(at - 0.4 + height / 2, [t.title for t in tests], fontsize=7)
        ax.set_xlabel("expected ln evidence")
        figure.legend(fontsize=7, loc="outside upper left")
        return figure


def _colours(count: int) -> Sequence[str]:
    own = list(style.COLOURS.values())
    return [own[i % len(own)] for i in range(count)]
