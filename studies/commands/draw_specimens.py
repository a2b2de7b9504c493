"""`equigap specimens`: every specimen as meshes and pictures.

In: names of specimens and changed dimensions, mm. Out: a picture and a mesh file each for the forward model
(quads) and the camera (triangles), a table of areas and qualities, a report.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from meshes import Specimen, quads, triangles
from meshes.known_specimens import SPECIMENS
from meshes.picture import draw
from studies.commandline.option_types import Assignments, OutputFolder, Overwrite, Several, default_folder, nearest
from studies.commandline.outcome import Outcome
from studies.errors import OptionError
from studies.output import Manifest, atomic_path, open_output_folder, track, write_csv
from studies.output.report import Report

CHOSEN_DIMENSIONS = (
    "The dimensions of the cross other than its length (200 mm) and the semi-minor axis of its holes (3.75 mm) are this "
    "project's choice, because the published drawing is not available; each can be changed with --set."
)
COLUMNS = ("specimen", "cells", "nodes", "area, mm²", "area / exact", "min. quality", "loaded sides")
QUICK_SIZE_FACTOR = 2.5


@dataclass(frozen=True)
class Drawn(Outcome):
    """Specimens that were drawn. rows: one a mesh, see `COLUMNS`."""

    specimens: tuple[Specimen, ...]
    rows: tuple[tuple[Any, ...], ...]
    report: Path

    def lines(self) -> Iterable[str]:
        """Where the report is."""
        yield f"report: {self.report}"


def specimens(
    *,
    only: Several = (),
    dimensions: Annotated[Assignments, Parameter(name="--set")] = (),
    quick: bool = False,
    output: OutputFolder = None,
    overwrite: Overwrite = False,
) -> Drawn:
    """Mesh every specimen and draw it. Lengths are in mm.

    The dimensions of the cross other than its length (200 mm) and the semi-minor axis of its holes (3.75 mm) are
    this project's choice, because the published drawing is not available; each can be changed with --set.

    Args:
        only: these specimens (default: all)
        dimensions: change a dimension of the specimens that have it, such as half_width=35; may be repeated
        quick: coarse meshes

    Raises:
        OptionError: unknown specimen or dimension.
        SpecimenError: dimensions that do not go together.
    """
    chosen = with_dimensions(only, dict(dimensions))
    key = {"command": "specimens", "only": only, "set": dict(dimensions), "quick": quick}
    folder = open_output_folder(output or default_folder("specimens", quick), overwrite, key)
    manifest = Manifest(settings={specimen.name: specimen.to_dict() for specimen in chosen})
    report = Report("Specimens", "Meshes of the forward models (quads) and of the camera (triangles), in mm")
    report.paragraph(CHOSEN_DIMENSIONS)
    rows: list[tuple[Any, ...]] = []
    for specimen in track(chosen, "meshing", unit="specimens"):
        rows += _draw(specimen, folder, report, QUICK_SIZE_FACTOR if quick else 1.0)
    report.table(COLUMNS, rows, "Quality: inverse condition number of a cell, 1 is ideal.")
    table = folder / "specimens.csv"
    write_csv(table, COLUMNS, rows)
    manifest.beside(table)
    return Drawn(tuple(chosen), tuple(rows), report.save(folder / "report.html"))


def with_dimensions(names: Sequence[str], dimensions: dict[str, float]) -> list[Specimen]:
    """Specimens by name (none: all), those that have a dimension with its new value, mm. Raises `OptionError`, `SpecimenError`."""
    for name in names:
        if name not in SPECIMENS:
            raise OptionError(
                f"specimen '{name}' is unknown{nearest(name, SPECIMENS)}; choose from {', '.join(SPECIMENS)}"
            )
    kinds = [SPECIMENS[name] for name in names or SPECIMENS]
    known = sorted({dimension for kind in kinds for dimension in kind().dimensions()})
    for dimension in dimensions:
        if dimension not in known:
            raise OptionError(
                f"dimension '{dimension}' is unknown{nearest(dimension, known)}; there are {', '.join(known)}"
            )
    return [kind(**{k: v for k, v in dimensions.items() if k in kind().dimensions()}) for kind in kinds]


def _draw(specimen: Specimen, folder: Path, report: Report, size_factor: float) -> list[tuple[Any, ...]]:
    """Meshes and pictures of one specimen; returns the rows of the table."""
    rows: list[tuple[Any, ...]] = []
    report.heading(specimen.name.replace("_", " "))
    for kind, generate in (("quads", quads), ("triangles", triangles)):
        manifest = Manifest(settings={**specimen.to_dict(), "size_factor": size_factor})
        mesh = generate(specimen, size_factor=size_factor)
        picture = folder / f"{specimen.name}_{kind}.png"
        file = picture.with_suffix(".npz")
        mesh.save(file)
        with atomic_path(picture) as temporary:
            draw(mesh, temporary)
        manifest.beside(picture, file, cells=len(mesh.cells), nodes=len(mesh.points))
        report.figure(picture, f"{specimen.name}: {len(mesh.cells)} {kind}; loaded sides: thick, vermilion")
        share = mesh.area() / specimen.exact_area()
        rows.append((
            f"{specimen.name}, {kind}", len(mesh.cells), len(mesh.points), mesh.area(), share,
            float(mesh.quality.min()), ", ".join(specimen.loaded),
        ))  # fmt: skip
    return rows
