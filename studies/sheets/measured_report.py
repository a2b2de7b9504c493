"""The report on measured data: results of `studies.commands.measured` in; HTML with pictures, JSON and CSV out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from studies.output import write_csv, write_figure, write_json
from studies.output.report import Report
from studies.sheets import measured_words as words
from studies.sheets.measured_figures import FIGURES

RELAXED = (
    "What pays, beside bases that are softer at larger strain (splines), with and without relaxation. On one ramp at one speed "
    "strain and time go together, so that both fit; what they predict differs. A pause in the loading, a second speed or an "
    "unloading would tell."
)
CONTRACTION = (
    "Compressibility, fibres across the pull and motion out of plane all make a sheet contract less than an incompressible one. "
    "Motion out of plane would make gripped edges contract in the pictures, too. A gauge of the thickness during the pull tells "
    "compressibility, a sheet printed or cut at a right angle tells fibres."
)
WARP = (
    "A strain left at no load is no stress if it has no contraction with it and the same pattern in sheets of different stiffness: "
    "a sheet that was not flat in the first picture does this. A reference picture under a small load, or a second camera, would tell."
)

WORTH = (
    "All effects are fitted together, with a weak prior; then those are taken out that do not pay. Rise: of the misfit, over the "
    "dispersion that all effects leave, when the rest is fitted again without the effect; price: log of the number of equations for each "
    "parameter. Doubtful: the likelihood without it is less than 100 times smaller. Imitated: share of what the effect changes "
    "that the others could do. Errors in increments that were never fitted."
)
VARIANTS = (
    "The first start is from no effect, the others from random amplitudes of the typical size. Misfit over dispersion; of bases "
    "also the price of their functions. Foreseen: the last third of what is fitted, predicted from the rest; a finer base is chosen "
    "only if it does not foresee worse than neo-Hooke."
)
SEARCHES = (
    "The search for effects once more, beside neo-Hooke, without each of the increments fitted. What differs between the lines is not decided by the data; "
    "the mean of their predictions is what the report counts on (Breiman 1996)."
)


def write(folder: Path, results: dict[str, Any], manifest: Any) -> tuple[Path, str]:
    """Write everything into `folder`; returns the report's path and the answer in words."""
    answer = words.answers(results)
    files = [folder / "report.html", *_data(folder, results)]
    pictures = _pictures(folder, results)
    report = Report("Measured data: what a hyperelastic model leaves", "printed sheets under 2D DIC; homogeneous tests")
    report.heading("Findings").paragraph(".\n".join(answer) + ".")
    report.heading("The records").table(*words.record_table(results))
    report.paragraph(WARP)
    _figure(report, pictures, "records")
    learnt = results["first"]
    report.heading(f"Learnt on {learnt['name']}").paragraph(words.verdict(learnt) + ".")
    report.table(*words.error_table(learnt["models"])).table(*words.amplitude_table(learnt["models"]))
    report.table(*words.effect_table(learnt), WORTH).table(*words.search_table(learnt), SEARCHES)
    report.table(*words.variant_table(learnt), VARIANTS)
    report.heading("Strain or time").paragraph(RELAXED).table(*words.rival_table(results))
    report.heading("Contraction").paragraph(CONTRACTION)
    report.heading(f"Carried to {results['second']['name']}, one factor refitted")
    report.table(*words.error_table(results["second"]["models"]))
    own = results["own"]
    report.heading(f"The same loop on {own['name']} alone").paragraph(words.verdict(own) + ".")
    report.table(*words.error_table(own["models"])).table(*words.amplitude_table(own["models"]))
    report.table(*words.effect_table(own), WORTH).table(*words.search_table(own), SEARCHES)
    report.table(*words.variant_table(own), VARIANTS)
    _figure(report, pictures, "sections")
    _figure(report, pictures, "grips")
    report.heading(f"What differs in {results['hetero']['name']}")
    report.table(*words.error_table(results["hetero"]["models"])).table(*words.map_table(results["map"]))
    _figure(report, pictures, "stiffness")
    report.heading("Negative control").table(*words.control_table(results))
    if words.loop_table(results)[1]:
        report.heading("Homogeneous tests").table(*words.loop_table(results))
        for key, r in results.items():
            if key.startswith("loop_"):
                report.paragraph(f"{r['name']}: {r['question']} {r['verdict']}.")
        _figure(report, pictures, "homogeneous")
    record = manifest.to_dict()
    report.heading("How it was made").details("Settings", record["settings"]).details("Versions", record["versions"])
    report.save(files[0])
    manifest.beside(*files, *(path for path, _ in pictures.values()), in_words=answer)
    return files[0], "\n".join(answer)


def _figure(report: Report, pictures: dict[str, tuple[Path, str]], name: str) -> None:
    if name in pictures:
        report.figure(*pictures[name])


def _pictures(folder: Path, results: dict[str, Any]) -> dict[str, tuple[Path, str]]:
    drawn = {}
    for name, (draw, caption) in FIGURES.items():
        figure = draw(results)
        if figure is not None:
            write_figure(folder / f"{name}.png", figure, dpi=130)
            drawn[name] = folder / f"{name}.png", caption
    return drawn


def _data(folder: Path, results: dict[str, Any]) -> list[Path]:
    """measured.json, errors.csv, effects.csv, sections.csv, homogeneous.csv, control.csv, and model files."""
    write_json(folder / "measured.json", results)
    rows, sections = [], []
    for key in ("first", "second", "own", "hetero"):
        for model in results[key]["models"]:
            for part, errors in model["errors"].items():
                rows.append([results[key]["name"], key, model["name"], part, *errors.values()])
            for time, values in zip(results[key]["time"], model["sections"], strict=True):
                sections.append([results[key]["name"], key, model["name"], time, *values])
    for part, both in results["map"]["errors"].items():
        for when, errors in both.items():
            rows.append(
                [
                    results["map"]["name"],
                    "map",
                    f"stiffness that varies, {when}",
                    part,
                    *errors.values(),
                    None,
                    None,
                    None,
                ]
            )
    tables = {
        "errors": (
            [
                "sheet",
                "step",
                "model",
                "increments",
                "force",
                "field",
                "mean_force",
                "section_scatter",
                "lower_over_upper",
            ],
            rows,
        ),
        "sections": (
            ["sheet", "step", "model", "time_s", *(f"band_{i}" for i in range(1, len(sections[0]) - 3))],
            sections,
        ),
        "homogeneous": words.loop_table(results),
        "control": words.control_table(results),
    }
    columns, lines = words.effect_table(results["first"])
    more = words.effect_table(results["own"])[1]
    tables["effects"] = (
        ["sheet", *columns],
        [[results[key]["name"], *line] for key, part in (("first", lines), ("own", more)) for line in part],
    )
    paths = [folder / "measured.json"]
    for key in ("first", "own"):
        paths.append(folder / f"model_{results[key]['name']}.json")
        write_json(paths[-1], results[key]["models"][-2]["members"][0])
    for name, (columns, lines) in tables.items():
        write_csv(folder / f"{name}.csv", columns, lines)
        paths.append(folder / f"{name}.csv")
    return paths
