"""The report of a discovery: a `View` in; HTML with pictures, and the same as JSON, CSV and NPZ, out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from calibrate.diagnosis.replayed.checked_replay import ReplayCheck
from calibrate.diagnosis.replayed.few_effects import FewEffects
from calibrate.equations.basis import energy_basis
from calibrate.equations.deformation_modes import largest_stretch, stretches_to_gradient
from calibrate.models.extended_model import ExtendedModel
from calibrate.models.fitness import Use
from calibrate.models.network_model import Model
from studies.output import write_csv, write_figure, write_json, write_npz
from studies.output.report import Report
from studies.reports.alert_table import add_alerts, alert_records
from studies.reports.discovery import figures
from studies.reports.discovery.candidate_outcome import WORDS
from studies.reports.discovery.discovery_findings import remarks
from studies.reports.discovery.discovery_quality import discovery_headline
from studies.reports.discovery.own_effects_table import own_effects_table
from studies.reports.discovery.records import ExperimentRecord, content, model_amplitude_records, model_name
from studies.reports.discovery.replays.few_effects_table import few_table
from studies.reports.discovery.replays.replay_section import replay_table
from studies.reports.discovery.replays.replayed_forces import band_fields, band_rows, course_rows, force_courses
from studies.reports.discovery.replays.replayed_models import (
    FEW_FILES,
    NEO_HOOKE_FILE,
    average_of_few,
    replayed_models,
    to_predict_with,
    updated_bands,
)
from studies.reports.discovery.statement import clauses, untestable, use_of_models, verdict
from studies.reports.discovery.tables import candidate_table, catalogue_table, misfit_table, model_table
from studies.reports.discovery.view import View, held_increments, stiffness_of_triangles
from studies.reports.discovery.weighing_tables import alternatives_table, power_table
from studies.reports.prediction.material_curves import PICTURE, TABLE, add_curves

MOST_TESTS = 4  # that get pictures
QUICK_FIGURES = ("residual_map", "forces", "scores")
STIFFNESS = "stiffness.csv"


def write(
    folder: Path, view: View, model: ExtendedModel, manifest: Any, beside: Mapping[str, ExtendedModel] | None = None
) -> Path:
    """Write model, data, figures, report and manifest into `folder`; returns the report's path. beside: further models by the
    names of their files."""
    for name in (*FEW_FILES, NEO_HOOKE_FILE, PICTURE, TABLE, STIFFNESS):  # of an earlier version, if they are there
        (folder / name).unlink(missing_ok=True)
    files = [folder / "report.html", folder / "model.json", *_data(folder, view)]
    model.save(files[1])
    for name, other in (beside or {}).items():
        files.append(folder / name)
        other.save(files[-1])
    report = Report("Diagnosis", _subtitle(view))
    report.heading("Verdict").paragraph("\n".join(f"{one[0].upper()}{one[1:]}." for one in clauses(view)))
    for text in use_of_models(view):
        report.paragraph(text)
    add_alerts(report, remarks(view))
    used = to_predict_with(view.discovery)
    if used is not None or discovery_headline(view).verdict is not Use.NOT:
        files += add_curves(report, folder, {"model.json": model, **(beside or {})}, used or "model.json")
    _results(report, folder, view)
    report.heading("The extended model").paragraph(model_words(model))
    report.heading("How it was made")
    for part in map(ExperimentRecord.of, view.discovery.problem.parts):
        numbers = ", ".join(map(str, part.held_out_increments)) or "none"
        report.details(f"Experiment {part.name}", {**part.to_dict(), "held_out_increments": numbers})
    record = manifest.to_dict()
    report.details("Settings", record["settings"])
    report.details("Versions", record["versions"])
    report.save(files[0])
    # the manifest is written last: where it is, everything is
    use = discovery_headline(view).to_dict()
    manifest.beside(
        *files,
        *report.pictures,
        headline=use,
        verdict=view.discovery.verdict,
        in_words=verdict(view),
        hold_out=view.hold_out,
    )
    return files[0]


def _results(report: Report, folder: Path, view: View) -> None:
    """Tables and figures of the models and candidates."""
    rounds = view.discovery.rounds
    report.heading("Models").table(*model_table(view), WORDS.model_caption())
    if view.discovery.problem.noise_is_known:
        report.heading("Residual against noise").table(*misfit_table(view), WORDS.misfit_caption())
    found, check = view.discovery, view.discovery.replay_check
    if isinstance(check, ReplayCheck):
        table = replay_table(check, replayed_models(found), updated_bands(found), average_of_few(found))
        report.heading("Replay").table(*table, WORDS.replay_caption())
    if view.weighing is not None and discovery_headline(view).verdict is not Use.NOT:
        report.heading("All explanations").table(*alternatives_table(view.weighing), WORDS.alternatives_caption())
        report.heading("What this test shows of every effect")
        report.table(*power_table(view.weighing, view.unit), WORDS.power_caption())
    if isinstance(view.discovery.few, FewEffects):
        report.heading("Few effects by the fields of replays")
        report.table(*few_table(view.discovery.few, view.unit), WORDS.few_caption())
    if view.discovery.own:
        report.heading("What each test has for itself")
        report.table(*own_effects_table(view.discovery.own, view.unit), WORDS.own_caption())
    report.heading("Residuals in place and time")
    for path, figure, caption in pictures(folder, view):
        write_figure(path, figure, dpi=140)
        report.figure(path, caption)
    for i, now in enumerate(rounds, start=1):
        report.heading(f"Round {i}: residual of {model_name(now.fit)}")
        report.table(*candidate_table(now, view), WORDS.candidate_caption())
    lines = "\n".join(untestable(rounds[0])) or WORDS.all_testable()
    report.heading("Not testable with these data").paragraph(lines)
    report.heading("The catalogue").table(*catalogue_table(view), WORDS.catalogue_caption())


def _subtitle(view: View) -> str:
    parts = view.discovery.problem.parts
    names = [p.experiment.name for p in parts if p.train.size]
    held = [p.experiment.name for p in parts if not p.train.size]
    return f"{', '.join(names)}; {'held out: ' + ', '.join(held) if held else 'held out: ' + view.hold_out}"


def model_words(model: ExtendedModel) -> str:
    """What the model file holds and how good its network is."""
    names = [a.effect.name for a in model.additions]
    own = [a.effect.name for a in model.additions if not a.effect.of_material]
    remark = model.network_loss["remark"] if isinstance(model.network, Model) else ""
    end = model.calibrated_range.get("I1", (3.0, 3.0))[1]
    base = {"moduli": base_moduli(model, end), "largest": end, "stretch": largest_stretch("uniaxial", end)}
    return WORDS.model(unit=model.unit, names=names, own=own, remark=remark, base=base)


def base_moduli(model: ExtendedModel, end: float) -> list[float]:
    """2 d psi / d I1 of the base at rest and at the I1 `end`: the shear modulus of a neo-Hookean material that is as stiff."""
    energy = energy_basis(model.basis)
    F = stretches_to_gradient("uniaxial", np.array([1.0, largest_stretch("uniaxial", end)]))
    psi, _ = energy.second(F, model.c[: energy.n_functions])
    return [float(v) for v in 2 * psi[:, 0]]


def pictures(folder: Path, view: View) -> Iterator[tuple[Path, Any, str]]:
    """Path, figure and caption of every picture."""
    parts = view.discovery.problem.parts[:MOST_TESTS]
    for name, draw in figures.OF_A_TEST.items():
        for i, part in enumerate(parts, start=1):
            if view.quick and i > 1 and name != "forces":
                continue
            number = f"_{i}" if len(parts) > 1 else ""
            title = part.experiment.name + ("" if part.train.size else " (held out)")
            drawn = draw(view, part)
            if drawn is not None:
                yield folder / f"{name}{number}.png", drawn, figures.caption(name, test=title)
    for name, draw_all in figures.OF_ALL.items():
        if view.quick and name not in QUICK_FIGURES:
            continue
        figure = draw_all(view)
        if figure is not None:
            yield folder / f"{name}.png", figure, figures.caption(name)


def _data(folder: Path, view: View) -> list[Path]:
    """Write discovery.json, effects.csv, amplitudes.csv, forces.csv, residuals.npz and, where there is any, what varies over the sheet and the replay."""
    everything = {
        **content(view),
        "headline": discovery_headline(view).to_dict(),
        "in_words": verdict(view),
        "alerts": alert_records(remarks(view)),
    }
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
    final = model_amplitude_records(view.discovery.final, view.unit, view.level)
    rows += [{"round": "model", "effect": name, **asdict(one)} for name, one in final]
    write_csv(folder / "amplitudes.csv", list(rows[0]) if rows else ["round"], [list(row.values()) for row in rows],
              ["tested: by the score test; fitted: together with the base, 95 % interval; lowest, highest: admissible; round 'model': of the final model"])  # fmt: skip
    columns, lines = force_rows(view)
    write_csv(folder / "forces.csv", columns, lines, ["forces of the grip on the specimen, N; time in s"])
    write_npz(folder / "residuals.npz", **_maps(view))
    written = ("discovery.json", "effects.csv", "amplitudes.csv", "forces.csv", "residuals.npz")
    return [*(folder / name for name in written), *_stiffness(folder, view), *_replay_data(folder, view)]


def _stiffness(folder: Path, view: View) -> list[Path]:
    """Write stiffness.csv, where the final model varies it over a sheet."""
    rows = [
        [part.experiment.name, *map(float, centre), float(value)]
        for part in view.discovery.problem.parts
        if (values := stiffness_of_triangles(part, view.discovery.final)) is not None
        for centre, value in zip(part.experiment.points[part.experiment.triangles].mean(axis=1), values, strict=True)
    ]
    if not rows:
        return []
    path = folder / STIFFNESS
    write_csv(
        path,
        ["experiment", "x", "y", "factor"],
        rows,
        ["of each triangle over that of the material; x, y of its middle, mm"],
    )
    return [path]


def _replay_data(folder: Path, view: View) -> list[Path]:
    """Write replay_forces.csv, replay_fields.csv and replayed_forces.csv, where there was a replay."""
    check, tests = view.discovery.replay_check, [part.experiment for part in view.discovery.problem.parts]
    if not isinstance(check, ReplayCheck):
        return []
    names, times = [e.name for e in tests], [None if e.time is None else e.time[e.pictures] for e in tests]
    paths = [folder / name for name in ("replay_forces.csv", "replay_fields.csv", "replayed_forces.csv")]
    write_csv(paths[0], *band_rows(check, names, times), ["forces of the grip on the specimen, N, as the effects of the measurement correct them; "
              "half_band: half of the 95 % band; time in s"])  # fmt: skip
    write_csv(
        paths[1],
        *band_fields(check, names),
        ["root mean squares of measured minus replayed displacement, mm; half_band: of smooth_final"],
    )
    write_csv(
        paths[2],
        *course_rows(force_courses(view.discovery), tests),
        ["root mean square over the grips of the size of their forces, N; time in s"],
    )
    return paths


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
        found = [view.forces(part, fit) for fit in view.models.values()]
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
        for name, values in view.maps[i - 1].items():
            arrays[f"experiment_{i}_{name.replace(' ', '_')}"] = values.astype(np.float32)
    return arrays
