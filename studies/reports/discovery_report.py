"""The report of a discovery: a `View` in; HTML with pictures, and the same as JSON, CSV and NPZ, out."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from calibrate.models.extended_model import ExtendedModel
from calibrate.models.network_model import Model
from studies.output import write_csv, write_figure, write_json, write_npz
from studies.output.report import Report
from studies.reports import discovery_figures as figures
from studies.reports.discovery_review import View, content, decorrelated, forces, held_increments, model_name, nodal
from studies.reports.discovery_words import (
    CANDIDATE_CAPTION,
    CATALOGUE_CAPTION,
    MISFIT_CAPTION,
    MODEL_CAPTION,
    candidate_table,
    catalogue_table,
    misfit_table,
    model_table,
    remarks,
    untestable,
    verdict,
)

MOST_TESTS = 4  # that get pictures
QUICK_FIGURES = ("residual_map", "forces", "scores")


def write(folder: Path, view: View, model: ExtendedModel, manifest: Any) -> Path:
    """Write model, data, figures, report and manifest into `folder`; returns the report's path."""
    files = [folder / "report.html", folder / "model.json", *_data(folder, view)]
    model.save(files[1])
    report = Report("What the model leaves", _subtitle(view))
    report.heading("Verdict").paragraph(verdict(view)[0].upper() + verdict(view)[1:] + ".")
    for remark in remarks(view):
        report.paragraph(remark)
    report.heading("Models").table(*model_table(view), MODEL_CAPTION)
    if view.discovery.problem.noise_is_known:
        report.heading("More than noise?").table(*misfit_table(view), MISFIT_CAPTION)
    report.heading("Where and when")
    for path, figure, caption in pictures(folder, view):
        write_figure(path, figure, dpi=140)
        report.figure(path, caption)
    for i, now in enumerate(view.discovery.rounds, start=1):
        report.heading(f"Round {i}: what {model_name(now.fit)} leaves")
        report.table(*candidate_table(now, view.unit), CANDIDATE_CAPTION)
    report.heading("Not testable with these data").paragraph(_list(untestable(view.discovery.rounds[0])))
    report.heading("The catalogue").table(*catalogue_table(view), CATALOGUE_CAPTION)
    report.heading("The extended model").paragraph(model_words(model))
    report.heading("How it was made")
    for part in content(view)["experiments"]:
        numbers = _numbers(part["held_out_increments"])
        report.details(f"Experiment {part['name']}", {**part, "held_out_increments": numbers})
    record = manifest.to_dict()
    report.details("Settings", record["settings"])
    report.details("Versions", record["versions"])
    report.save(files[0])
    # the manifest is written last: where it is, everything is
    manifest.beside(*files, verdict=view.discovery.verdict, in_words=verdict(view), hold_out=view.hold_out)
    return files[0]


def _subtitle(view: View) -> str:
    parts = view.discovery.problem.parts
    names = [p.experiment.name for p in parts if p.train.size]
    held = [p.experiment.name for p in parts if not p.train.size]
    return f"{', '.join(names)}; {'held out: ' + ', '.join(held) if held else 'held out: ' + view.hold_out}"


def _list(lines: list[str]) -> str:
    return "\n".join(lines) or "Every effect of the catalogue can be tested with these data."


def _numbers(values: list[int]) -> str:
    return ", ".join(map(str, values)) or "none"


def model_words(model: ExtendedModel) -> str:
    """What the model file holds and how good its network is."""
    names = ", ".join(a.effect.name for a in model.additions) or "no effect"
    text = f"model.json holds the base energy as a spline of I1, in {model.unit}, and {names}."
    own = [a.effect.name for a in model.additions if not a.effect.of_material]
    if own:
        text += f" Of this test alone, and left out when another one is predicted: {', '.join(own)}."
    if isinstance(model.network, Model):
        text += f" {model.network_loss['remark']}"
    return text


def pictures(folder: Path, view: View) -> Iterator[tuple[Path, Any, str]]:
    """Path, figure and caption of every picture."""
    parts = view.discovery.problem.parts[:MOST_TESTS]
    for name, (draw, caption) in figures.OF_A_TEST.items():
        for i, part in enumerate(parts, start=1):
            if view.quick and i > 1 and name != "forces":
                continue
            number = f"_{i}" if len(parts) > 1 else ""
            title = part.experiment.name + ("" if part.train.size else " (held out)")
            yield folder / f"{name}{number}.png", draw(view, part), caption.format(name=title)
    for name, (draw_all, caption) in figures.OF_ALL.items():
        if view.quick and name not in QUICK_FIGURES:
            continue
        figure = draw_all(view)
        if figure is not None:
            yield folder / f"{name}.png", figure, caption


def _data(folder: Path, view: View) -> list[Path]:
    """Write discovery.json, effects.csv, amplitudes.csv, forces.csv and residuals.npz."""
    everything = {**content(view), "in_words": verdict(view), "remarks": remarks(view)}
    write_json(folder / "discovery.json", everything)
    rows = [_flat(i, c) for i, now in enumerate(everything["rounds"], start=1) for c in now["candidates"]]
    write_csv(folder / "effects.csv", list(rows[0]) if rows else ["round"], [list(row.values()) for row in rows],
              ["one row a candidate and round; improvements and errors are shares, p adjusted for the search"])  # fmt: skip
    rows = [
        {"round": i, "effect": c["effect"], **amplitude}
        for i, now in enumerate(everything["rounds"], start=1)
        for c in now["candidates"]
        for amplitude in c["amplitudes"]
    ]
    write_csv(folder / "amplitudes.csv", list(rows[0]) if rows else ["round"], [list(row.values()) for row in rows],
              ["tested: by the score test; fitted: together with the base, 95 % interval; lowest, highest: admissible"])  # fmt: skip
    columns, lines = force_rows(view)
    write_csv(folder / "forces.csv", columns, lines, ["forces of the grip on the specimen, N; time in s"])
    write_npz(folder / "residuals.npz", **_maps(view))
    return [folder / name for name in
            ("discovery.json", "effects.csv", "amplitudes.csv", "forces.csv", "residuals.npz")]  # fmt: skip


def _flat(number: int, candidate: dict[str, Any]) -> dict[str, Any]:
    """A candidate as one row: misfits spread over columns, lists as words, amplitudes left to their own table."""
    row: dict[str, Any] = {"round": number}
    for key, value in candidate.items():
        if key == "amplitudes":
            continue
        if key.endswith(("_before", "_after")):
            for name in ("force_error", "field_error", "chi_square_per_equation"):
                row[f"{key}_{name}"] = None if value is None else value[name]
        elif key == "collinear_with":
            row[key] = "; ".join(f"{v['effect']} {v['cosine']:.4f}" for v in value)
        elif key == "shape":
            row[key] = "; ".join(f"{v['name']} {v['value']:.6g} {v['unit']}" for v in value)
        else:
            row[key] = "; ".join(value) if isinstance(value, list) else value
    return row


def force_rows(view: View) -> tuple[list[str], list[list[Any]]]:
    """Columns and rows: forces read, predicted by each model, and the deviation that noise explains."""
    columns = ["experiment", "increment", "time", "held_out", "boundary", "component", "measured"]
    columns += [name.replace(" ", "_") for name in view.models] + ["deviation"]
    rows = []
    for part in view.discovery.problem.parts:
        found = [forces(part, fit) for fit in view.models.values()]
        held, time = held_increments(part), part.experiment.time
        for boundary, (measured, _, spread) in found[0].items():
            for i, k in np.ndindex(measured.shape):
                rows.append([
                    part.experiment.name, i + 1, None if time is None else float(time[i]), int(held[i]), boundary, "xy"[k],
                    float(measured[i, k]), *(float(f[boundary][1][i, k]) for f in found), float(spread[i, k]),
                ])  # fmt: skip
    return columns, rows


def _maps(view: View) -> dict[str, Any]:
    """Nodes, triangles and decorrelated residuals (t, n) of every experiment and model."""
    arrays: dict[str, Any] = {"unit": "standard deviations"}
    for i, part in enumerate(view.discovery.problem.parts, start=1):
        arrays[f"experiment_{i}_name"] = part.experiment.name
        arrays[f"experiment_{i}_points"] = part.experiment.points
        arrays[f"experiment_{i}_triangles"] = part.experiment.triangles
        for name, fit in view.models.items():
            arrays[f"experiment_{i}_{name.replace(' ', '_')}"] = nodal(part, decorrelated(part, fit)).astype(np.float32)
    return arrays
