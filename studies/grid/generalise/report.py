"""The page of the study: `GeneraliseResults` in, sections with figures, matrices, statements and tables out. Nothing is judged here."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from calibrate.equations.deformation_modes import MODES
from studies.grid.generalise import figures
from studies.grid.generalise.generalise_results import GeneraliseResults, mean_score
from studies.grid.generalise.generalise_settings import CROSS, MEASURED, MIDDLE
from studies.grid.generalise.statements import RULES, Judged, judge
from studies.grid.report import Page, Part, Picture, Section, Table, Text
from studies.grid.results import Spread
from studies.output.words import Words

WORDS = Words("generalise")
STATEMENT_COLUMNS = ("the paper", "what we compare", "truth", "here", "verdict")
SET_COLUMNS = ("truth", "calibrated on", "inputs", "states covered (%)", "mean r2_F of the sheets", "error (%)", "ambiguity over sizes (%)",
               "beyond its data (%)", "over starts (%)", "starts that agree (%)", "loss per equation")  # fmt: skip
FIT_COLUMNS = (
    "truth",
    "seed",
    "calibrated on",
    "inputs",
    "layers",
    "loss per equation",
    "starts that agree (%)",
    "stopped",
    "seconds",
)


def page(results: GeneraliseResults) -> Page:
    """The report."""
    settings = results.settings
    sections = [Section("", [Text(WORDS.method(settings=settings))])]
    if settings.truths != (MEASURED,):
        judged = [one for truth in settings.truths for one in judge(results, truth)]
        table = Table(STATEMENT_COLUMNS, statement_rows(judged), WORDS.statements(), "statements.csv")
        sections.append(Section("Beside the paper", [table]))
    sections += [Section(WORDS.truth(name=truth), pictures(results, truth)) for truth in settings.truths]
    rows = [row for truth in settings.truths for row in set_rows(results, truth)]
    parts: list[Part] = [Table(SET_COLUMNS, rows, WORDS.sets(settings=settings), "sets.csv")]
    parts.append(Table(FIT_COLUMNS, fit_rows(results), "", "fits.csv", shown=False))
    sections.append(Section("All sets", parts))
    if settings.as_width:
        sections.append(
            Section("The width that is seen", [Text(WORDS.width()), Table(*width_table(results), file="width.csv")])
        )
    return Page("Generalisation", WORDS.question(), sections, settings.enough_seeds)


def statement_rows(judged: list[Judged]) -> list[list[Any]]:
    """See `STATEMENT_COLUMNS`."""
    rows = []
    for one in judged:
        name = one.statement.value
        found = "; ".join(f"{what}: {spread.text(3)}" for what, spread in one.found.items()) or "–"
        measure = getattr(WORDS, f"{name}_measure")(rules=RULES)
        rows.append([getattr(WORDS, f"{name}_claim")(), measure, WORDS.truth(name=one.truth), found, one.verdict.value])
    return rows


def pictures(results: GeneraliseResults, truth: str) -> list[Part]:
    """All figures of a truth."""
    inputs = results.settings.inputs[-1]
    layers = MIDDLE if MIDDLE in results.settings.sizes else results.settings.sizes[-1]
    return [
        Picture(f"states_{truth}", partial(figures.draw_states, results, truth), WORDS.states_figure()),
        Picture(f"predictions_{truth}", partial(figures.draw_predictions, results, truth), WORDS.predictions_figure()),
        Picture(
            f"matrix_{truth}",
            partial(figures.draw_matrix, results, truth, inputs, layers),
            WORDS.matrix_figure(inputs=inputs, layers=layers),
        ),
        Picture(f"matrices_{truth}", partial(figures.draw_grid, results, truth), WORDS.grid_figure()),
        Picture(f"ambiguity_{truth}", partial(figures.draw_ambiguity, results, truth), WORDS.ambiguity_figure()),
    ]


def set_rows(results: GeneraliseResults, truth: str) -> list[list[Any]]:
    """One a set and its invariants; median [range] over seeds of the median over sizes, of the worst mode."""
    rows = []
    for tests in results.settings.sets:
        for inputs in results.settings.inputs:
            numbers = zip(
                *(set_numbers(results, truth, seed, tests, inputs) for seed in results.settings.seeds), strict=True
            )
            spreads = [Spread.of(values) for values in numbers]
            texts = [spread.text(4 if k == 0 else 1) for k, spread in enumerate(spreads)]
            rows.append([truth, tests, inputs, round(100 * results.coverage(truth, tests), 1), *texts])
    return rows


def set_numbers(results: GeneraliseResults, truth: str, seed: int, tests: str, inputs: str) -> list[float]:
    """Mean r2_F, error, ambiguity over sizes and starts: whole, beyond the data; over starts alone; agreement; loss per equation."""
    group = results.chosen(truth, seed, tests=tests, inputs=inputs)
    worst = lambda number: max(number(mode) for mode in MODES)  # noqa: E731
    nan = float("nan")
    error = (
        nan if truth == MEASURED else worst(lambda m: float(np.median([results.error(truth, one, m) for one in group])))
    )
    return [
        float(np.median([mean_score(one) for one in group])),
        100 * error,
        100 * worst(lambda m: results.ambiguity(truth, group, m)),
        100 * worst(lambda m: results.ambiguity(truth, group, m, beyond=tests)),
        100 * worst(lambda m: float(np.median([results.ambiguity(truth, [one], m) for one in group]))),
        100 * float(np.median([one.agreement for one in group])),
        float(np.median([one.loss_per_equation for one in group])),
    ]


def fit_rows(results: GeneraliseResults) -> list[list[Any]]:
    """One a calibration."""
    return [
        [truth, seed, one.tests, one.inputs, " ".join(map(str, one.layers)), one.loss_per_equation, 100 * one.agreement,
         "; ".join(f"{reason}: {count}" for reason, count in one.reasons.items()), one.seconds]
        for (truth, seed), found in results.calibrations.items() for one in found
    ]  # fmt: skip


def width_table(results: GeneraliseResults) -> tuple[list[str], list[list[Any]]]:
    """Mean r2_F of the sheets with the strip beside the region of interest, and with the width that is seen; first seed, middle size."""
    columns = [
        "truth",
        "calibrated on",
        "inputs",
        "mean r2_F: with the strip",
        "width as seen",
        "error (%): with the strip",
        "width as seen",
    ]
    rows = []
    for truth in results.settings.truths:
        for one in results.widths(truth):
            if one.tests == CROSS:
                continue
            own = results.chosen(
                truth, results.settings.seeds[0], tests=one.tests, inputs=one.inputs, layers=one.layers
            )
            if own:
                pair = (own[0], one)
                errors = [
                    max(results.error(truth, fit, m) for m in MODES) if truth != MEASURED else float("nan")
                    for fit in pair
                ]
                rows.append([truth, one.tests, one.inputs, *map(mean_score, pair), *(100 * e for e in errors)])
    return columns, rows
