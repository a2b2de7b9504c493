"""The skeleton of a study's report: a `Page` in; its tables as CSV, its figures as PNG, manifests and ``report.html`` out.

A preset says which sections there are; what every study has (settings, a note where a run is reduced, files and their
manifests) is added here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

from studies.grid.claims import CLAIM_COLUMNS, Claim, claim_rows
from studies.output import Manifest, track, write_csv, write_figure
from studies.output.report import Report
from studies.output.scene import Scene
from studies.output.words import Words

COMMON = Words("grid")


class Part(Protocol):
    """Something that a section holds."""

    def put(self, report: Report, folder: Path, manifest: Manifest) -> None:
        """Write its files, if it has any, and add it to the report."""


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    content: str

    def put(self, report: Report, folder: Path, manifest: Manifest) -> None:
        """Add it to the report."""
        report.paragraph(self.content)


@dataclass(frozen=True)
class Table:
    """Columns and rows. file: of a CSV, if there is to be one; shown: whether the report has it as well."""

    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]
    caption: str = ""
    file: str = ""
    shown: bool = True

    def put(self, report: Report, folder: Path, manifest: Manifest) -> None:
        """Write the CSV, add the table to the report."""
        if self.file:
            write_csv(folder / self.file, self.columns, self.rows)
            manifest.beside(folder / self.file)
        if self.shown:
            report.table(self.columns, self.rows, self.caption)


@dataclass(frozen=True)
class Picture:
    """A matplotlib figure, made by `draw`, as figures/NAME.png."""

    name: str
    draw: Callable[[], Any]
    caption: str = ""

    def put(self, report: Report, folder: Path, manifest: Manifest) -> None:
        """Draw it and add it to the report."""
        path = folder / "figures" / f"{self.name}.png"
        write_figure(path, self.draw())
        manifest.beside(path)
        report.figure(path, self.caption)


@dataclass(frozen=True)
class View:
    """Solids to be turned by the reader."""

    scenes: Sequence[Scene]
    label: str
    caption: str = ""

    def put(self, report: Report, folder: Path, manifest: Manifest) -> None:
        """Add it to the report."""
        report.view(self.scenes, self.label, self.caption)


@dataclass(frozen=True)
class Section:
    """Parts below a heading, which may be empty."""

    heading: str
    parts: Sequence[Part]


@dataclass(frozen=True)
class Page:
    """A report. question: what the study asks. enough_seeds: with fewer it says that it is a reduced run."""

    title: str
    question: str
    sections: Sequence[Section]
    enough_seeds: int = 10


def claims_section(claims: Sequence[Claim]) -> Section:
    """The paper's claims beside what was found."""
    return Section("Beside the paper", [Table(CLAIM_COLUMNS, claim_rows(claims), COMMON.claims_caption())])


class StudyResults(Protocol):
    """What a report asks of the results, besides its page. settings: a dataclass with seeds."""

    @property
    def folder(self) -> Path: ...

    @property
    def settings(self) -> Any: ...

    def inputs(self) -> list[Path]:
        """Files that the report is made of."""
        ...


def write(results: StudyResults, page: Page) -> Path:
    """Write every file of a page; returns the path of the report."""
    settings = results.settings
    manifest = Manifest(seed=list(settings.seeds), settings=asdict(settings), inputs=results.inputs())
    report = Report(page.title, page.question)
    if len(settings.seeds) < page.enough_seeds:
        report.paragraph(COMMON.reduced(seeds=len(settings.seeds)))
    for section in track(page.sections, "report", len(page.sections), "sections"):
        if section.heading:
            report.heading(section.heading)
        for part in section.parts:
            part.put(report, results.folder, manifest)
    report.details("Settings", asdict(settings))
    return report.save(results.folder / "report.html")
