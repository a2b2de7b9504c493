"""Report of the thickness study: how thick may a specimen be before a plane-stress calibration misleads?

In: the folder that `studies.grid.thickness_case` has filled. Out: ``figures/*.png``, ``fits.csv``, ``fields.csv``,
``forces.csv``, ``verdicts.csv``, a manifest beside each, and ``report.html``. Every number is computed from the files.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from studies.grid import thickness_figures, thickness_models, thickness_tables, thickness_words
from studies.grid.thickness_case import LOSSES
from studies.grid.thickness_results import Results
from studies.grid.thickness_tables import AGREEMENT, FIELD_COLUMNS, FIT_COLUMNS, FORCE_COLUMNS, NOISES, STRESSES
from studies.grid.thickness_words import LABELS
from studies.output import Manifest, track, write_csv, write_figure
from studies.output.report import Report
from studies.reports import solid_pictures, solid_view

VERDICT_COLUMNS = ("condition", "loss", "noise", "worst median bias (%)", "mode", "worst P5 or P95 of the stress error (%)",
                   "component", "largest error (% of largest stress)", "trustworthy")  # fmt: skip
CAPTIONS = {
    "maps": "ε = |C2D − C3D| / |C2D| of the in-plane components of C = FᵀF at the Gauss points of the 3D model's surface "
    "z = h/2, at the last increment, mirrored to the whole cross; below the first quadrant, circle: maximum. One "
    "logarithmic colour scale for all panels, which begins below what the mesh resolves (a sheet of 1 mm shows a P95 of 0.004 "
    "at this mesh, docs/thickness.md): dark speckle is discretisation. P95 and max are by area over the whole surface.",
    "lines": "ε at the last increment along straight lines from the rims of two holes outward. Above: distance in mm; "
    "below: in thicknesses. A line ends after 25 mm or half-way to the next hole; small steps are the borders of elements.",
    "growth": "ε over the surface against the displacement of each arm.",
    "forces": "Force of an arm divided by the thickness, and its difference from plane stress.",
    "contraction": "The deformed specimen at the last increment, true to scale. Above: whole, made of its mirror images. "
    "Below: cut at y = 0 through the hole at the outer end of an arm; lines: edges of the hexes; vermilion: the original "
    "thickness.",
    "view": "The same specimens, to be turned. Cut open: without the half y < 0.",
    "pressure": "Mean stress p, the negative of the pressure, as each hex holds it: linear within, free to jump between hexes, "
    "neither averaged nor smoothed. Colours follow the root of the distance from the lowest value, so that what is between the holes can be seen.",
    "densities": "Signed stress error of the calibrated models at the states of the 2D reference within the calibrated range: "
    "weighted kernel densities on a logarithmic scale; 98 % of every condition is shown. Positive: too stiff. The error is over the norm of P, so a component is near 0 where the stress points elsewhere. Shaded where the axis reaches beyond it: ±5 %.",
    "energies": "Relative error of the strain energy of the calibrated models over the invariant plane. Black: uniaxial "
    "(below) and equi-biaxial (above) tension, the borders of what an incompressible solid can reach. Vermilion, dashed: "
    "convex hull of the states of the 2D reference within the calibrated range; blue, dotted: end of the calibrated range. With noise: the seed with the "
    "median bias. In each panel the extremes within the calibrated range; lines: levels of the colours, dashed where negative.",
    "predictions": "Nominal stress in the homogeneous modes, and its deviation from the truth: median (line) and full range "
    "(band) over seeds. Shaded: calibrated range.",
}


def write(folder: Path, settings: Any) -> Path:
    """Write everything; returns the path of the report."""
    results = Results(Path(folder), settings)
    manifest = Manifest(seed=list(settings.seeds), settings=asdict(settings), inputs=results.inputs())
    figures = draw(results, manifest)
    tables = tabulate(results, manifest)
    return compose(results, figures, tables)


def draw(results: Results, manifest: Manifest) -> dict[str, Path]:
    """Every figure, by its name."""
    ends = dict.fromkeys((results.thicknesses[0], results.thicknesses[-1]))
    solids = {name: results.solid(name) for name in ends}
    makers: dict[str, tuple[Any, ...]] = {
        name: (getattr(thickness_figures, name), results) for name in ("maps", "lines", "growth", "forces")
    }
    makers |= {name: (getattr(solid_pictures, name), solids) for name in ("contraction", "pressure")}
    for loss in fitted(results):
        for name in ("densities", "energies", "predictions"):
            makers[f"{name}_{loss}"] = (getattr(thickness_models, name), results, loss)
    paths = {}
    for name, (make, *arguments) in track(makers.items(), "figures", len(makers), "figures"):
        paths[name] = results.folder / "figures" / f"{name}.png"
        write_figure(paths[name], make(*arguments))
        manifest.beside(paths[name])
    return paths


def fitted(results: Results) -> list[str]:
    """Losses that some case was fitted with."""
    return [loss for loss in LOSSES if any(loss in case["losses"] for case in results.cases)]


def tabulate(results: Results, manifest: Manifest) -> dict[str, tuple[Sequence[str], list[list[Any]]]]:
    """Columns and rows of every table, written as CSV as well."""
    judged = [v for loss in LOSSES for noisy in NOISES for v in thickness_tables.verdicts(results, loss, noisy)]
    tables: dict[str, tuple[Sequence[str], list[list[Any]]]] = {
        "fits": (FIT_COLUMNS, thickness_tables.fit_rows(results)),
        "fields": (FIELD_COLUMNS, thickness_tables.field_rows(results)),
        "forces": (FORCE_COLUMNS, thickness_tables.force_rows(results)),
        "verdicts": (VERDICT_COLUMNS, [[results.name(v.condition), v.loss, NOISES[v.noisy], v.bias, v.bias_mode, v.stress, v.component, v.largest,
                                        v.ok] for v in judged]),
    }  # fmt: skip
    for name, (columns, rows) in tables.items():
        write_csv(results.folder / f"{name}.csv", columns, rows)
        manifest.beside(results.folder / f"{name}.csv")
    return tables


def compose(results: Results, figures: dict[str, Path], tables: dict[str, Any]) -> Path:
    """The HTML report."""
    report = Report("Thickness study", "How thick may a specimen be before a plane-stress calibration misleads?")

    def show(name: str) -> None:
        report.figure(figures[name], CAPTIONS[name.split("_")[0]])

    def tabled(name: str, caption: str) -> None:
        columns, rows = tables[name]
        report.table(columns, rows, caption)

    report.paragraph(setting(results))
    for text in thickness_words.reservations(results):
        report.paragraph(text)
    report.heading("Answer")
    for text in thickness_words.answer(results):
        report.paragraph(text)
    tabled("verdicts", f"Judged by our definition; medians over seeds; see verdicts.csv. Losses: {names(results)}")
    report.heading("Beside the paper").table(
        thickness_words.CLAIM_COLUMNS,
        thickness_words.claims(results),
        "Agreement is judged by our limits, named in the table",
    )
    for text in thickness_words.reasons(results):
        report.paragraph(text)
    report.heading("Where 2D and 3D differ")
    for text in thickness_words.deformation(results):
        report.paragraph(text)
    for name in ("maps", "lines", "growth"):
        show(name)
    tabled("fields", "ε at the last increment, by area; see fields.csv")
    report.heading("Forces")
    show("forces")
    tabled("forces", "Forces of whole arms; see forces.csv")
    report.heading("The solid")
    show("contraction")
    solids = {name: results.solid(name) for name in dict.fromkeys((results.thicknesses[0], results.thicknesses[-1]))}
    report.view(solid_view.contraction_scenes(solids), solid_view.LABEL, CAPTIONS["view"])
    report.paragraph(checkerboard(results))
    show("pressure")
    for loss in fitted(results):
        report.heading(LABELS[loss][0].upper() + LABELS[loss][1:])
        for name in ("densities", "energies", "predictions"):
            show(f"{name}_{loss}")
        for quantities, words in ((AGREEMENT, "Predictions inside the calibrated range"), (STRESSES, "Stress errors")):
            rows = thickness_tables.wide_rows(results, quantities, loss)
            columns = ("condition", "noise", "fits", *quantities)
            report.table(columns, rows, f"{words}: median [lowest, highest] over seeds; see fits.csv")
    report.details("Settings", asdict(results.settings))
    return report.save(results.folder / "report.html")


def names(results: Results) -> str:
    """What the short names of the losses stand for."""
    return "; ".join(f"{loss}: {LABELS[loss]}" for loss in fitted(results))


def setting(results: Results) -> str:
    """What was done, in a paragraph."""
    settings = results.settings
    edges = results.plane.mesh
    rims = np.concatenate([edges.points[e[:, 1]] - edges.points[e[:, 0]] for n, e in edges.boundaries.items()
                           if n.startswith("hole_")])  # fmt: skip
    size = float(np.linalg.norm(rims, axis=1).mean())
    return (
        f"A perforated cross in Arruda-Boyce rubber, {settings.displacement:g} mm pulled at each arm in {settings.increments} "
        f"increments, {', '.join(f'{name} mm' for name in results.thicknesses)} thick: an eighth was solved with Q2-P1 hexes "
        f"({size:.2f} mm at the holes), the camera saw its surface on a triangulation with about {settings.nodes} nodes, and "
        "each record was calibrated as if in plane stress. The 2D reference is the same specimen in plane stress on the same "
        "mesh: its error is that of the calibration alone. Noise: standard deviation 0.1 mm, correlated over 4 mm, "
        f"{settings.normalisation}, the same for a seed in all conditions; forces to 1e-4. The calibrated range ends at I1 = {results.limit:.2f}, "
        "from the clean 2D reference, for all. Dimensions of the cross other than its length and the short semi-axis of its "
        "holes are our choice. N, mm, MPa."
    )


def checkerboard(results: Results) -> str:
    """Jumps of the pressure between hexes, in words."""
    parts = []
    for name in results.thicknesses:
        median, high = np.quantile(solid_pictures.pressure_jumps(results.solid(name)), (0.5, 0.95))
        parts.append(f"{name} mm: {100 * median:.2f} and {100 * high:.1f} %")
    return ("Jump of the pressure at the middle of the face between two hexes, in percent of the range of the pressure "
            "(1st to 99th percentile), median and 95th percentile: " + "; ".join(parts) + ". A checkerboard would make the "
            "median as large as the range.")  # fmt: skip
