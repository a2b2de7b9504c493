"""What `equigap import` says and shows about the Experiment it made.

In: an Experiment and the Series it came from. Out: numbers for a manifest, a summary in words, a picture, a report.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from calibrate.data.experiment import Experiment
from studies.importers.recording.series import Series
from studies.output import Manifest, style, write_figure
from studies.output.report import Report
from studies.output.words import Words
from studies.reports.experiments.good_practice import good_practice_rows

WORDS = Words("experiment")


def summary(experiment: Experiment) -> dict[str, Any]:
    """Numbers of an Experiment for a manifest."""
    assert experiment.noise is not None
    return {
        "points": len(experiment.points),
        "triangles": len(experiment.triangles),
        "increments": experiment.n_increments,
        "machine_readings": 0 if experiment.record is None else len(experiment.record.time),
        "size_mm": np.ptp(experiment.points, axis=0).tolist(),
        "largest_force_N": {b.name: float(np.nanmax(np.abs(b.force))) for b in experiment.loaded},
        "largest_displacement_mm": float(np.abs(experiment.displacements).max()),
        "stress_unit": experiment.stress_unit,
        "noise": asdict(experiment.noise),
        "provenance": experiment.provenance,
    }


def report_lines(experiment: Experiment, target: Path) -> Iterator[str]:
    """What a terminal shows of an import."""
    size, noise = np.ptp(experiment.points, axis=0), experiment.noise
    assert noise is not None
    yield WORDS.imported_size(experiment=experiment, width=size[0], height=size[1])
    for b in experiment.loaded:
        yield f"  {WORDS.imported_boundary(boundary=b, force=np.nanmax(np.abs(b.force)))}"
    yield f"  {WORDS.imported_noise(noise=noise, found=experiment.provenance['noise'])}"
    yield f"  {WORDS.imported_strain(signal=experiment.strain_signal)}"
    if experiment.record is not None:
        yield f"  {WORDS.imported_record(record=experiment.record)}"
    if experiment.is_synchronised:
        yield f"  {WORDS.imported_clocks(clocks=experiment.provenance['clocks'])}"
    if experiment.thickness is None:
        yield f"  {WORDS.imported_without_thickness()}"
    for line in experiment.provenance.get("found", []):
        yield f"  found: {line}"
    for note in experiment.provenance["notes"]:
        yield f"  note: {note}"
    yield f"wrote {target}"


def picture(experiment: Experiment, series: Series, path: Path) -> None:
    """Deformed mesh at the largest deformation over the reference, and the force record with the chosen frames."""
    with style.figure(9.5, 4.5) as figure:
        left, right = figure.subplots(1, 2)
        largest = experiment.displacements[experiment.most_deformed]
        moved, size = experiment.points + largest, np.linalg.norm(largest, axis=1)
        left.triplot(*experiment.points.T, experiment.triangles, color="0.8", linewidth=0.3, linestyle="-")
        mapped = left.tripcolor(*moved.T, experiment.triangles, size, shading="gouraud", cmap=style.SEQUENTIAL)
        for b in experiment.loaded:
            left.plot(*moved[b.nodes].T, "s", markersize=3, color=style.COLOURS["vermilion"])
        left.plot(*moved[experiment.free_nodes].T, ".", markersize=2, color="black")
        spurious = experiment.provenance.get("masked", {}).get("spurious", [])
        for places, colour in ((series.masked, "0.6"), (np.reshape(spurious, (-1, 2)), style.COLOURS["blue"])):
            left.plot(*places.T, "x", markersize=4, color=colour)
        figure.colorbar(mapped, ax=left, label="displacement, mm", shrink=0.7)
        left.set(aspect="equal", xlabel="x, mm", ylabel="y, mm", title="squares: loaded, dots: free, crosses: left out")
        left.grid(False)
        right.plot(series.record.time, series.record.force, color="0.6", linestyle="-", label="load cell")
        if experiment.time is not None:
            for marker, b in zip("ox+^", experiment.loaded, strict=False):
                known = np.isfinite(b.force).all(axis=0)
                for k in np.flatnonzero(known & (np.abs(b.force).max(axis=0) > 0)):
                    pulled = b.force[:, k] * np.sign(b.force[np.abs(b.force[:, k]).argmax(), k])
                    right.plot(experiment.time, pulled, marker, mfc="none", ls="", label=f"{b.name}, {'xy'[k]}")
        right.set(xlabel="time, s", ylabel="force, N", title=experiment.name)
        right.legend()
        write_figure(path, figure, dpi=150)


def write_report(experiment: Experiment, folder: Path, manifest: Manifest) -> Path:
    """``report.html``: the picture, what was read, and what to look at before going on."""
    numbers = summary(experiment)
    noise, provenance = experiment.noise, experiment.provenance
    assert noise is not None
    page = Report(experiment.name, "What was read from the measurement")
    page.paragraph(WORDS.imported_boundaries())
    page.figure(folder / "experiment.png", WORDS.imported_figure())
    width, height = numbers["size_mm"]
    unit = experiment.stress_unit
    rows: list[list[Any]] = [
        ["points", numbers["points"], ""],
        ["triangles", numbers["triangles"], ""],
        ["increments", numbers["increments"], ""],
        ["readings of the machine record", numbers["machine_readings"], ""],
        ["width", width, "mm"],
        ["height", height, "mm"],
        *([f"largest force, {name}", force, "N"] for name, force in numbers["largest_force_N"].items()),
        ["largest displacement", numbers["largest_displacement_mm"], "mm"],
        [f"noise of the displacements ({provenance['noise']['displacement']})", noise.total_std, "mm"],
        *(
            [["of it with the pattern, at the largest deformation", noise.pattern_std, "mm"]]
            if noise.pattern_std
            else []
        ),
        *([["of it of the reference picture", noise.reference_std, "mm"]] if noise.reference_std else []),
        ["its correlation length", noise.correlation_length, "mm"],
        *([["its correlation time", noise.correlation_time, experiment.clock_unit]] if noise.correlation_time else []),
        [f"noise of the force ({provenance['noise']['force']})", noise.force_std, "N"],
        *([["in proportion to the force", 100 * noise.force_std_relative, "%"]] if noise.force_std_relative else []),
        ["strain, largest increment", 100 * experiment.strain_signal.strain, "%"],
        ["its scatter between neighbours", 100 * experiment.strain_signal.scatter, "%"],
        ["signal to noise of the strain", experiment.strain_signal.ratio, ""],
        ["plane", experiment.plane, ""],
        ["stresses will be in", unit if unit == "MPa" else "N/mm, as the thickness is unknown", ""],
    ]
    page.table(["quantity", "value", "unit"], rows)
    for note in provenance["notes"]:
        page.paragraph(f"Note: {note}.")
    if provenance.get("found"):
        page.paragraph(WORDS.imported_found())
        page.table(["found in the export"], [[line] for line in provenance["found"]])
    page.table(["how it was measured", "value"], good_practice_rows(experiment))
    record = manifest.to_dict()
    page.details("Decisions", {k: v for k, v in provenance.items() if k not in ("noise", "notes", "found")})
    page.details("Noise", provenance["noise"])
    page.details("Settings", record["settings"]).details("Versions", record["versions"])
    return page.save(folder / "report.html")
