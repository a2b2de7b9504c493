"""Files and report of a replay."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from studies.output import Manifest, write_csv, write_figure, write_npz
from studies.output.findings import Finding, Macro
from studies.output.report import Report
from studies.output.viewer import write_viewer_file
from studies.output.words import Words
from studies.replay import figures
from studies.replay.replayed_experiment import Replay
from studies.reports import force_record
from studies.reports.alert_table import add_alerts, alert_records
from studies.reports.experiments.experiment_findings import pictures

WORDS = Words("replay")
COLUMNS = ("increment", "time, s", "residual, rms, mm", "residual, largest, mm", "largest displacement, mm")


class Remark(Macro):
    """What a reader of a replay should know; macros of ``templates/replay.txt``."""

    FORCE = "force_error"
    FIELD = "field_error"
    RECORD = "record_error"
    MESH = "mesh_effect"
    TAKEN_OUT = "taken_out"
    LEFT_OUT = "left_out"
    PRESCRIBED = "few_free"


def findings(found: Replay) -> list[Finding]:
    """Errors first, then what they rest on."""
    peak = found.experiment.most_deformed
    largest = float(np.linalg.norm(found.experiment.displacements[peak], axis=1).max())
    told: list[tuple[Remark, dict[str, Any]]] = [
        (Remark.FORCE, {"error": found.force_error}),
        (
            Remark.FIELD,
            {
                "peak": float(found.field_error[peak]),
                "most": float(found.field_error.max()),
                "noise": found.noise,
                "largest": largest,
            },
        ),
    ]
    record = found.record
    if record is not None:
        size, time = record.largest
        kind = found.experiment.record
        told.append((Remark.RECORD, {
            "error": record.error, "readings": len(record.time), "largest": size, "time": time,
            "by_crosshead": kind is not None and kind.crosshead is not None,
        }))  # fmt: skip
    if found.mesh_effect is not None:
        effect = found.mesh_effect
        told.append((Remark.MESH, {"field": effect.field, "force": effect.force, "refined": found.refined}))
    if found.law.taken_out:
        told.append(
            (
                Remark.TAKEN_OUT,
                {"effects": [a.effect.name for a in found.law.taken_out], "lost_record": found.lost_record},
            )
        )
    if found.law.left_out:
        told.append((Remark.LEFT_OUT, {"effects": list(found.law.left_out)}))
    told.append((Remark.PRESCRIBED, {"share": float((~found.judged).mean())}))
    return [*found.law.remarks, *pictures(found.experiment), *(Finding("replay", code, data) for code, data in told)]


def write_report(folder: Path, found: Replay, manifest: Manifest) -> Path:
    """``replay.npz``, ``replay.vtu``, tables, figures with manifests, and ``report.html``, whose path is returned. Raises `OutputWriteError`."""
    experiment = found.experiment
    results = {"alerts": alert_records(findings(found)), "force_error": found.force_error,
               "field_error_mm": found.field_error.tolist()}  # fmt: skip
    write_npz(folder / "replay.npz", points=experiment.points, triangles=experiment.triangles,
              displacements=found.displacements, residual=found.residual, judged=found.judged,
              **{f"force_{name}": force for name, force in found.forces.items()})  # fmt: skip
    write_viewer_file(experiment, folder / "replay.vtu", {"replayed": found.displacements, "residual": found.residual})
    columns, rows = force_record.rows(found.measured, found.forces, experiment.time)
    write_csv(folder / "forces.csv", columns, rows, ["N, of the grips on the specimen; predicted: replayed"])
    if found.record is not None:
        whole = force_record.rows(found.record.measured, found.record.replayed, found.record.time)
        write_csv(folder / "record.csv", *whole, ["N, of every reading of the machine; predicted: replayed"])
        manifest.beside(folder / "record.csv", **results, record_error=found.record.error)
    fields = field_rows(found)
    write_csv(folder / "fields.csv", COLUMNS, fields)
    report = Report(f"Replay of {experiment.name}", f"{WORDS.question()} Model: {found.law.title}.")
    add_alerts(report, findings(found)).heading("Evidence")
    for name, draw in (("maps", figures.residual_maps), ("growth", figures.growth), ("forces", figures.forces)):
        picture = folder / f"{name}.png"
        write_figure(picture, draw(found))
        manifest.beside(picture, **results)
        report.figure(picture, getattr(WORDS, f"{name}_caption")())
    manifest.beside(folder / "forces.csv", **results)
    manifest.beside(folder / "fields.csv", **results)
    report.table(COLUMNS, fields, WORDS.table_caption()).table(columns, rows)
    report.details("Law", found.law.sheet.to_dict()).details("Versions", manifest.to_dict()["versions"])
    return report.save(folder / "report.html")


def field_rows(found: Replay) -> list[tuple[Any, ...]]:
    """Of every increment, see `COLUMNS`."""
    sizes = np.linalg.norm(found.residual[:, found.judged], axis=2).max(axis=1)
    largest = np.linalg.norm(found.experiment.displacements, axis=2).max(axis=1)
    times = found.experiment.time if found.experiment.time is not None else [None] * len(sizes)
    return [(i + 1, t, float(e), float(s), float(m))
            for i, (t, e, s, m) in enumerate(zip(times, found.field_error, sizes, largest, strict=True))]  # fmt: skip
