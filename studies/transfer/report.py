"""Files and report of a transferred model: `Transferred` in; HTML, figures, JSON and CSV out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from studies.output import Manifest, style, write_csv, write_figure, write_json
from studies.output.findings import Finding, Macro
from studies.output.report import Report
from studies.output.words import Words, digits_if_any, percent
from studies.reports.alert_table import add_alerts, alert_records
from studies.reports.experiments.experiment_findings import pictures
from studies.transfer.transferred import AS_IT_IS, MAP, NEO_HOOKE, Row, Transferred

WORDS = Words("transfer")
FORMAT, VERSION = "equigap-transfer", 1
COLUMNS = ["model", "stiffness", "relaxation", "force error, fitted", "field error, fitted", "force error, held out",
           "field error, held out"]  # fmt: skip


class TransferCode(Macro):
    """Macros of ``templates/transfer.txt``."""

    TRANSFERRED = "transferred"
    WORSE = "worse_than_neo_hooke"
    MAP = "stiffness_varies"
    NO_MAP = "stiffness_is_even"
    LEFT_OUT = "left_out"
    OWN_TEST = "own_test"


def findings(found: Transferred) -> list[Finding]:
    """What a reader should know."""
    final, best, reference = found.final, found.best, found.row(NEO_HOOKE)
    name = found.experiment.name
    lines: list[tuple[TransferCode, dict[str, Any]]] = [
        (TransferCode.TRANSFERRED, {
            "name": name, "stiffness": final.stiffness, "relaxation": final.relaxation,
            "before": found.row(AS_IT_IS).held_out.to_dict(), "after": final.held_out.to_dict(),
        })
    ]  # fmt: skip
    if not best.held_out.is_no_larger_than(reference.held_out):
        lines.append((TransferCode.WORSE, {
            "name": name, "model": best.held_out.to_dict(), "neo_hooke": reference.held_out.to_dict(),
        }))  # fmt: skip
    share = {"name": name, "share": found.map.gain}
    if found.map.is_real:
        low, high = np.quantile(found.map.values, [0.05, 0.95])
        after = found.row(MAP).held_out.to_dict()
        lines.append((TransferCode.MAP, {**share, "low": float(low), "high": float(high), "after": after}))
    else:
        lines.append((TransferCode.NO_MAP, share))
    if found.left_out:
        lines.append((TransferCode.LEFT_OUT, {"effects": list(found.left_out)}))
    if found.was_fitted:
        lines.append((TransferCode.OWN_TEST, {"name": name}))
    return [*pictures(found.experiment), *(Finding("transfer", code, data) for code, data in lines)]


def table(found: Transferred) -> tuple[list[str], list[list[Any]]]:
    """A line for each variant."""
    return COLUMNS, [
        [row.name, digits_if_any(row.stiffness), digits_if_any(row.relaxation), *map(percent, (row.fitted.force, row.fitted.field, row.held_out.force, row.held_out.field))]
        for row in found.rows
    ]  # fmt: skip


def record(found: Transferred) -> dict[str, Any]:
    """Content of ``transfer.json``."""
    return {
        "format": FORMAT, "version": VERSION, "test": found.experiment.name, "hold_out": found.hold_out,
        "fitted_increments": np.flatnonzero(found.fitted).tolist(), "virtual_fields_mm": found.spacing,
        "models": [row.to_dict() for row in found.rows], "left_out": list(found.left_out),
        "map": {
            "is_real": found.map.is_real, "weight": found.map.weight, "unseen_without": found.map.without,
            "unseen_with_it": found.map.with_it,
        },
    }  # fmt: skip


def write(folder: Path, found: Transferred, manifest: Manifest) -> Path:
    """``transfer.json``, ``errors.csv``, ``stiffness.csv``, ``model.json``, pictures and ``report.html``, whose path is returned."""
    e, told = found.experiment, findings(found)
    write_json(folder / "transfer.json", {**record(found), "alerts": alert_records(told)})
    write_csv(folder / "errors.csv", *table(found))
    places = [[*point, value] for point, value in zip(e.points.tolist(), found.map.values.tolist(), strict=True)]
    write_csv(folder / "stiffness.csv", ["x_mm", "y_mm", "stiffness_over_model"], places)
    found.model.save(folder / "model.json")
    write_figure(folder / "forces.png", draw_forces(found))
    write_figure(folder / "stiffness.png", draw_map(found))
    report = Report(f"Transfer to {e.name}", WORDS.subtitle(hold_out=found.hold_out))
    report.paragraph(".\n".join(one.text.removesuffix(".") for one in told) + ".")
    report.heading("Errors").table(*table(found), WORDS.table())
    report.figure(folder / "forces.png", WORDS.figure_forces()).figure(
        folder / "stiffness.png", WORDS.figure_stiffness()
    )
    add_alerts(report, told)
    content = manifest.to_dict()
    report.heading("How it was made").details("Settings", content["settings"]).details("Versions", content["versions"])
    path = report.save(folder / "report.html")
    manifest.beside(
        path, *(folder / name for name in ("transfer.json", "errors.csv", "stiffness.csv", "model.json", "forces.png", "stiffness.png")),
        alerts=alert_records(told),
    )  # fmt: skip
    return path


def draw_forces(found: Transferred) -> Figure:
    """Force error of each variant over the increments; those that were fitted are filled."""
    e = found.experiment
    x, label = style.over(e.time, e.n_increments)
    with style.figure(6.0, 3.6) as figure:
        ax = figure.subplots()
        for row, colour in zip(_drawn(found), style.COLOURS.values(), strict=False):
            y = 100 * np.array(row.over_increments)
            ax.plot(x, y, color=colour, label=row.name)
            ax.plot(x[found.fitted], y[found.fitted], "o", color=colour, markersize=4)
        ax.set(xlabel=label, ylabel="force error over largest force (%)")
        ax.set_ylim(bottom=0)
        ax.legend(fontsize=8)
        return figure


def _drawn(found: Transferred) -> list[Row]:
    """The model as it is may be wrong by a factor, so that nothing else could be seen beside it."""
    return [row for row in found.rows if row.name != AS_IT_IS]


def draw_map(found: Transferred) -> Figure:
    """Stiffness over that of the model."""
    e = found.experiment
    with style.figure(5.0, 4.0) as figure:
        ax = figure.subplots()
        drawn = ax.tripcolor(*e.points.T, e.triangles, found.map.values, shading="gouraud", cmap=style.SEQUENTIAL)
        figure.colorbar(drawn, label="stiffness / that of the model")
        ax.set(aspect="equal", xlabel="x (mm)", ylabel="y (mm)")
        ax.grid(False)
        return figure
