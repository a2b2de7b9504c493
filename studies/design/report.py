"""Report, tables and drawings of a design: ranking, search and validation in, files in a folder out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from calibrate.equations.deformation_modes import TITLES
from meshes import Specimen
from meshes.drawing import CUT, read_curves, write_drawing
from studies.design import figures
from studies.design.candidates import Candidate, Place, Ranking
from studies.design.design_plan import Plan, file_name
from studies.design.pattern_search import Search
from studies.design.validation import Validation
from studies.output import Manifest, atomic_path, write_csv
from studies.output.report import Report
from studies.output.words import Words

WORDS = Words("design")


@dataclass(frozen=True, eq=False)
class Design:
    """All that a report is made of. optimised: the specimen that a search found, judged as the others."""

    plan: Plan
    ranking: Ranking
    search: Search | None
    optimised: Place | None
    validation: Validation | None


def write_report(design: Design, folder: Path, manifest: Manifest) -> Path:
    """Figures, tables, drawings and ``report.html``. Raises `OutputWriteError`."""
    plan, ranking = design.plan, design.ranking
    report = Report("Design of the next specimen", WORDS.question())
    for sentence in answers(ranking):
        report.paragraph(sentence)
    report.paragraph(WORDS.limits(machine=plan.machine, sheet=plan.sheet, camera=plan.camera))
    report.paragraph(method(plan))
    if ranking.places:
        _add_candidates(report, ranking, folder, manifest)
    if ranking.refused:
        report.table(("specimen", "why"), [(c.title, c.reason) for c in ranking.refused], WORDS.refused())
    if design.search is not None and design.optimised is not None:
        _add_search(report, design, folder, manifest)
    if design.validation is not None:
        _add_validation(report, design, design.validation, folder, manifest)
    for place in ranking.places:
        write_dxf(place.candidate.specimen, place.candidate.title, plan, folder, manifest)
    report.details("Design file", plan.model_dump(mode="json"))
    return report.save(folder / "report.html")


def answers(ranking: Ranking) -> list[str]:
    """The specimen to cut next, and the one for a tensile machine where that is another."""
    if not ranking.places:
        return []
    best, single = ranking.places[0], ranking.best_on_one_axis
    worst = max(best.test.deviation, key=lambda mode: best.test.deviation[mode])
    found = [
        WORDS.answer(
            title=best.candidate.title, axes=best.candidate.axes, overall=best.test.overall, before=ranking.before.overall,
            worst_mode=TITLES[worst], worst=best.test.deviation[worst],
        )
    ]  # fmt: skip
    if single is not None and single is not best:
        found.append(WORDS.on_one_axis(title=single.candidate.title, overall=single.test.overall))
    return found


def method(plan: Plan) -> str:
    """What was assumed and computed."""
    law = plan.law
    return WORDS.method(
        law=law.material, deviation=law.deviation, correlation_length=law.correlation_length, knots=law.knots
    )


PULLS = ("rank", "specimen", "pulled, mm", "until", "force, N", "largest stretch", "field, mm", "noise, mm")


def columns(ranking: Ranking) -> tuple[str, ...]:
    """Of the table of what candidates tell."""
    modes = tuple(f"{TITLES[mode]}, %" for mode in ranking.family.stretches)
    return ("rank", "specimen", "axes", "D, bit", "E", *modes, "all, %", "all by equations, %")


def rows(places: Sequence[Place]) -> list[tuple[Any, ...]]:
    """Of the table of what candidates tell, see `columns`."""
    found: list[tuple[Any, ...]] = []
    for number, place in enumerate(places, start=1):
        test = place.test
        deviations = [100 * value for value in (*test.deviation.values(), test.overall)]
        equations = None if place.equations is None else 100 * place.equations.overall
        found.append(
            (number, place.candidate.title, place.candidate.axes, test.gain, test.worst, *deviations, equations)
        )
    return found


def pulls(places: Sequence[Place]) -> list[tuple[Any, ...]]:
    """Of the table of how far candidates are pulled, see `PULLS`."""
    ends = [(place.candidate.title, place.candidate.end) for place in places]
    return [
        (number, title, e.displacement, e.limit, e.force, e.stretch, e.field, e.noise)
        for number, (title, e) in enumerate(ends, start=1)
        if e is not None
    ]


def _add_candidates(report: Report, ranking: Ranking, folder: Path, manifest: Manifest) -> None:
    report.heading("Candidates").table(columns(ranking), rows(ranking.places), WORDS.candidates_table())
    report.table(PULLS, pulls(ranking.places), WORDS.pulls_table())
    _add_without_equations(report, ranking.places)
    table = folder / "table.csv"
    whole = [(*told, *pulled[2:]) for told, pulled in zip(rows(ranking.places), pulls(ranking.places), strict=True)]
    write_csv(table, (*columns(ranking), *PULLS[2:]), whole)
    manifest.beside(table)
    places = ranking.places
    shown = [places[i] for i in sorted({0, min(1, len(places) - 1), len(places) // 2, len(places) - 1})]
    for name, draw in (
        ("candidates", lambda path: figures.candidates_figure(path, ranking)),
        ("deviations", lambda path: figures.deviations_figure(path, ranking)),
        ("curves", lambda path: figures.curves_figure(path, ranking, shown)),
    ):
        picture = folder / f"{name}.png"
        draw(picture)
        manifest.beside(picture)
        report.figure(picture, getattr(WORDS, f"{name}_figure")())


def _add_without_equations(report: Report, places: Sequence[Place]) -> None:
    """Why the equations of some tell nothing."""
    failed = [(place.candidate.title, place.candidate.reason) for place in places if place.candidate.reason]
    if failed:
        report.table(("specimen", "why"), failed, WORDS.without_equations())


def _add_search(report: Report, design: Design, folder: Path, manifest: Manifest) -> None:
    search, place, ranking = design.search, design.optimised, design.ranking
    assert search is not None and place is not None and design.plan.optimise is not None
    assert place.candidate.states is not None
    best = next(iter(ranking.places), None)
    report.heading("Optimised specimen").paragraph(
        WORDS.search(
            kind=design.plan.optimise.kind, evaluations=len(search.evaluations), overall=place.test.overall,
            feasible=int(np.isfinite([e.score for e in search.evaluations]).sum()),
            best=best and best.candidate.title, best_overall=best and best.test.overall,
        )
    )  # fmt: skip
    report.table(columns(ranking), rows([place]), WORDS.optimised_table())
    report.table(PULLS, pulls([place]), WORDS.pulls_table())
    _add_without_equations(report, [place])
    report.table(("dimension", "value"), list(search.best.values.items()))
    picture = folder / "search.png"
    figures.search_figure(picture, search.evaluations, search.specimen, place.candidate.states, ranking.family.tops)
    manifest.beside(picture, best=search.best.to_dict(), criteria=place.test.to_dict())
    report.figure(picture, WORDS.search_figure())
    drawing = write_dxf(search.specimen, place.candidate.title, design.plan, folder, manifest)
    picture = folder / "drawing.png"
    figures.drawing_figure(picture, drawing)
    size = drawn_size(drawing)
    manifest.beside(picture, **size)
    report.figure(picture, WORDS.drawing(name=drawing.name, **size))


def _add_validation(report: Report, design: Design, validation: Validation, folder: Path, manifest: Manifest) -> None:
    ranking = design.ranking
    seeds = len(validation.correlation["test"])
    report.heading("Does the ranking predict the error?").paragraph(
        WORDS.validation(truth=validation.truth["material"], seeds=seeds, candidates=len(ranking.places))
    )
    found = validation.correlation["test"]
    report.paragraph(
        getattr(WORDS, validation.verdict)(median=float(np.median(found)), low=min(found), high=max(found))
    )
    rows = [
        (KINDS.get(kind, TITLES.get(kind, kind)), float(np.median(v)), min(v), max(v))
        for kind, v in validation.correlation.items()
    ]
    report.table(("predicted by", "rank correlation, median", "least", "largest"), rows)
    modes = list(ranking.family.stretches)
    errors = []
    for place in (*ranking.places, *([design.optimised] if design.optimised else [])):
        title = place.candidate.title
        cells = [spread(validation.of(title, mode)) for mode in (*modes, None)]
        errors.append((title, 100 * place.test.overall, *cells))
    report.table(("specimen", "predicted, all", *(TITLES[m] for m in modes), "all"), errors, WORDS.validation_table())
    picture = folder / "validation.png"
    figures.validation_figure(picture, ranking, validation)
    manifest.beside(picture, **validation.to_dict())
    report.figure(picture, WORDS.validation_figure())


KINDS = {"test": "the whole test", "equations": "the equations of a calibration"}


def spread(errors: np.ndarray) -> str:
    """Median and range in %."""
    return f"{100 * np.median(errors):.3g} ({100 * errors.min():.3g} to {100 * errors.max():.3g})"


def write_dxf(specimen: Specimen, title: str, plan: Plan, folder: Path, manifest: Manifest) -> Path:
    """The drawing of a specimen, in the folder's ``drawings``. Raises `OutputWriteError`."""
    path = folder / "drawings" / f"{file_name(title)}.dxf"
    path.parent.mkdir(exist_ok=True)
    note = f"{title}; rubber sheet {plan.sheet.thickness_mm:g} mm; dimensions in mm; cut layer {CUT} only"
    with atomic_path(path) as temporary:
        write_drawing(specimen, temporary, plan.machine.clamped_mm, note)
    manifest.beside(path, specimen=specimen.to_dict())
    return path


def drawn_size(path: Path) -> dict[str, float]:
    """Width, height, mm, and area, mm^2, of what is cut, as the file says."""
    curves = sorted((points for points in read_curves(path)[CUT]), key=_area, reverse=True)
    width, height = np.ptp(curves[0], axis=0)
    return {"width": float(width), "height": float(height), "area": _area(curves[0]) - sum(map(_area, curves[1:]))}


def _area(points: np.ndarray) -> float:
    """Area, mm^2, within a closed polygon (n, 2)."""
    x, y = points.T
    return float(abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))) / 2)


def summary(design: Design) -> dict[str, Any]:
    """Numbers for ``design.json``."""
    ranking = design.ranking
    return {
        "before": ranking.before.to_dict(),
        "candidates": [_record(place) for place in ranking.places],
        "refused": [{"title": c.title, "reason": c.reason} for c in ranking.refused],
        "optimised": None if design.optimised is None else _record(design.optimised),
        "search": None
        if design.search is None
        else {"best": design.search.best.to_dict(), "evaluations": len(design.search.evaluations)},
        "validation": None if design.validation is None else design.validation.to_dict(),
    }


def _record(place: Place) -> dict[str, Any]:
    candidate: Candidate = place.candidate
    return {
        "title": candidate.title,
        "specimen": candidate.specimen.to_dict(),
        "end": None if candidate.end is None else dict(vars(candidate.end)),
        "reason": candidate.reason,
        "test": place.test.to_dict(),
        "equations": None if place.equations is None else place.equations.to_dict(),
    }
