"""`equigap specimens`: every specimen as meshes and pictures.

In: names of specimens and changed dimensions, mm. Out: a picture and a mesh file each for the forward model
(quads) and the camera (triangles), a table of areas and qualities, a report.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from studies.commands.options import add_output, nearest, output_folder, settings
from studies.errors import OptionError

if TYPE_CHECKING:
    from meshes import Specimen

DESCRIPTION = """\
Mesh every specimen and draw it. Lengths are in mm.
The dimensions of the cross other than its length (200 mm) and the semi-minor axis of its holes (3.75 mm) are
this project's choice, because the published drawing is not available; each can be changed with --set."""
COLUMNS = ("specimen", "cells", "nodes", "area, mm²", "area / exact", "min. quality", "loaded sides")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `equigap specimens`."""
    parser.add_argument("--only", nargs="+", metavar="NAME", help="these specimens (default: all)")
    parser.add_argument(
        "--set", action="append", default=[], metavar="DIMENSION=MM",
        help="change a dimension of the specimens that have it, such as half_width=35; may be repeated",
    )  # fmt: skip
    parser.add_argument("--quick", action="store_true", help="coarse meshes")
    add_output(parser, "specimens")


def main(args: argparse.Namespace) -> int:
    """Write meshes, pictures, table and report. Raises `OptionError`, `SpecimenError`, `MeshQualityError`."""
    from studies.output import Manifest, open_output_folder, track, write_csv
    from studies.output.report import Report

    chosen = specimens(args.only, args.set)
    folder = open_output_folder(output_folder(args, "specimens"), args.overwrite, settings(args))
    manifest = Manifest(settings={specimen.name: specimen.to_dict() for specimen in chosen})
    report = Report("Specimens", "Meshes of the forward models (quads) and of the camera (triangles), in mm")
    report.paragraph(DESCRIPTION.split("\n", 1)[1].replace("\n", " "))
    rows: list[list[Any]] = []
    for specimen in track(chosen, "meshing", unit="specimens"):
        rows += _draw(specimen, folder, report, 2.5 if args.quick else 1.0)
    report.table(COLUMNS, rows, "Quality: inverse condition number of a cell, 1 is ideal.")
    table = folder / "specimens.csv"
    write_csv(table, COLUMNS, rows)
    manifest.beside(table)
    print(f"report: {report.save(folder / 'report.html')}")
    return 0


def specimens(names: Sequence[str] | None, changes: Sequence[str]) -> list[Specimen]:
    """Specimens by name with changed dimensions ('half_width=35'). Raises `OptionError`, `SpecimenError`."""
    from meshes.specimens import SPECIMENS

    for name in names or ():
        if name not in SPECIMENS:
            raise OptionError(
                f"specimen '{name}' is unknown{nearest(name, SPECIMENS)}; choose from {', '.join(SPECIMENS)}"
            )
    kinds = [SPECIMENS[name] for name in names or SPECIMENS]
    values = dict(_dimension(change) for change in changes)
    known = sorted({dimension for kind in kinds for dimension in kind().dimensions()})
    for dimension in values:
        if dimension not in known:
            raise OptionError(
                f"dimension '{dimension}' is unknown{nearest(dimension, known)}; there are {', '.join(known)}"
            )
    return [kind(**{k: v for k, v in values.items() if k in kind().dimensions()}) for kind in kinds]


def _dimension(change: str) -> tuple[str, float]:
    name, _, value = change.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise OptionError(f"--set {change}: write DIMENSION=MM, such as half_width=35") from None


def _draw(specimen: Specimen, folder: Path, report: Any, size_factor: float) -> list[list[Any]]:
    """Meshes and pictures of one specimen; returns the rows of the table."""
    from meshes import quads, triangles
    from meshes.picture import draw
    from studies.output import Manifest, atomic_path

    rows = []
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
        rows.append([
            f"{specimen.name}, {kind}", len(mesh.cells), len(mesh.points), mesh.area(), share,
            float(mesh.quality.min()), ", ".join(specimen.loaded),
        ])  # fmt: skip
    return rows
