"""Pictures and report of a simulated test.

In: the exact solution and the Experiment recorded from it. Out: PNG files, a table and an HTML report.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from calibrate.data.experiment import Experiment
from calibrate.equations import isochoric as plane_strain
from calibrate.equations.kinematics import deformation_gradients, gradient_operator, invariants_and_derivatives
from forward.solution import SurfaceSolution
from studies.output import Manifest, style, write_csv, write_figure
from studies.output.findings import Finding
from studies.output.report import Report
from studies.output.words import Words
from studies.reports.alert_table import add_alerts

WORDS = Words("experiment")


def write_report(
    folder: Path, solution: SurfaceSolution, experiment: Experiment, manifest: Manifest, remarks: Sequence[Finding] = ()
) -> Path:
    """Draw everything into `folder` and return the path of the report. remarks: on the material."""
    fields, forces, table = folder / "fields.png", folder / "forces.png", folder / "forces.csv"
    draw_fields(experiment, fields)
    draw_forces(solution, experiment, forces)
    label = "time, s" if "times" in solution.description else "load factor"
    columns, rows = force_table(experiment, label)
    write_csv(table, columns, rows, ["force of each grip on the specimen, N"])
    manifest.beside(fields)
    manifest.beside(forces, table)
    report = Report(
        f"Simulated test: {experiment.name}",
        f"Plane {experiment.plane} finite elements, synthetic camera and load cell",
    )
    report.paragraph(WORDS.simulated_test(experiment=experiment, noise=experiment.noise))
    report.figure(fields, WORDS.simulated_fields())
    report.figure(forces, WORDS.simulated_forces())
    report.table(columns, rows, WORDS.simulated_table())
    add_alerts(report, remarks)
    report.details("Settings", manifest.to_dict()["settings"])
    report.details("Versions", manifest.to_dict()["versions"])
    return report.save(folder / "report.html")


def draw_fields(experiment: Experiment, path: Path) -> None:
    """Displacement magnitude and I1 on the deformed triangles of the last increment."""
    u = experiment.displacements[-1]
    x, y = (experiment.points + u).T
    F = deformation_gradients(gradient_operator(experiment.points, experiment.triangles), u)
    f = jnp.asarray(F) if experiment.plane == "stress" else plane_strain.isochoric(jnp.asarray(F))
    I1 = np.asarray(invariants_and_derivatives(f)[0])[..., 0]
    with style.figure(8.4, 4.2) as figure:
        left, right = figure.subplots(1, 2, sharex=True, sharey=True)
        size = left.tripcolor(x, y, experiment.triangles, np.linalg.norm(u, axis=1), shading="gouraud")
        figure.colorbar(size, ax=left, label="displacement, mm", shrink=0.8)
        limit = float(np.quantile(I1, 0.99))
        shade = right.tripcolor(x, y, experiment.triangles, I1, vmin=3, vmax=limit, rasterized=True)
        figure.colorbar(shade, ax=right, label=f"I1 (99 % below {limit:.2f})", shrink=0.8, extend="max")
        for axes in (left, right):
            axes.set(aspect="equal", xlabel="x, mm")
            axes.grid(False)
        left.set_ylabel("y, mm")
        write_figure(path, figure)


def draw_forces(solution: SurfaceSolution, experiment: Experiment, path: Path) -> None:
    """Force along the pull of each side against the displacement of the grips, as a share of the largest, or the time of a history."""
    exact_time = np.concatenate([[0.0], solution.time])
    measured_time = experiment.time if experiment.time is not None else solution.time
    with style.figure(5.2, 3.4) as figure:
        axes = figure.subplots()
        for boundary in experiment.loaded:
            exact = solution.reactions[boundary.name]
            axis = int(np.argmax(np.abs(exact).max(axis=0)))
            (line,) = axes.plot(exact_time, np.abs(np.concatenate([[0.0], exact[:, axis]])), label=boundary.name)
            axes.plot(measured_time, np.abs(boundary.force[:, axis]), ".", color=line.get_color())
        history = "times" in solution.description
        axes.set(
            xlabel="time, s" if history else "load factor (1: full displacement)", ylabel="force along the pull, N"
        )
        axes.legend()
        write_figure(path, figure)


def force_table(experiment: Experiment, label: str = "load factor") -> tuple[list[str], list[list[float]]]:
    """Load factor or time (`label`) and both force components, N, of every loaded side."""
    columns = [label, *(f"{b.name}, {c}" for b in experiment.loaded for c in "xy")]
    time = experiment.time if experiment.time is not None else np.arange(1.0, experiment.n_increments + 1)
    forces = np.concatenate([b.force for b in experiment.loaded], axis=1)
    return columns, np.column_stack([time, forces]).tolist()
