"""What edges that the points do not reach do to a test: `python -m benchmarks.true_edges FOLDER`.

In: nothing; a plate and a cross of Mooney and Rivlin, solved with biquadratic quadrilaterals and seen by grids of points that end before the edges, 10 um of noise. Out:
`docs/results/true_edges.json`. Each is imported by a column map as the points end, with the holes fitted, with the holes given, and with sides or fillets given too. What the true
law misses in a replay: force (relative), displacements of the last picture at points that are not prescribed, mm.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from forward.loading import Loading
from forward.materials import MooneyRivlin
from forward.sheet.plane_stress import solve
from forward.solution import SurfaceSolution
from meshes import Specimen, quads
from meshes.measured.unseen_rims import distance_beyond
from meshes.specimens import Cross, PlateWithHole
from studies.importers import importer_of
from studies.importers.recording.importer import SheetOptions
from studies.replay.model_law import material_law
from studies.replay.replayed_experiment import replay
from studies.synthetic.specimen_edges import inside

Array = NDArray[np.float64]
RESULTS = Path(__file__).parents[1] / "docs" / "results" / "true_edges.json"
LAW, THICKNESS, INCREMENTS, NOISE, FORCE_NOISE, SEED = MooneyRivlin(0.25, 0.05), 2.0, 8, 0.01, 0.02, 1
HEAD = ["test", "points", "edges as the points end", "holes fitted", "holes given", "and fillets or sides"]


@dataclass(frozen=True)
class Case:
    """A grid of points `pitch` mm apart on a specimen, none nearer to a hole than `margin` mm; cut: how far the outermost rows are from the free sides, mm."""

    specimen: Specimen
    title: str
    pitch: float
    margin: float
    cut: float = 0.0

    @property
    def grid(self) -> Array:
        """Points (n, 2), mm."""
        ends = np.array(self.specimen.half_extent) - [0.0, self.cut]
        x, y = (np.arange(-end, end + 1e-9, self.pitch) for end in ends)
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        points = points[inside(self.specimen, points)]
        for hole in self.specimen.holes():
            points = points[distance_beyond(hole, points) > self.margin]
        return points

    @property
    def holes(self) -> str:
        """Tables of the column map."""
        return "".join(
            f"[[edges.holes]]\ncentre = [{h.x:.1f}, {h.y:.1f}]\ndiameters = [{2 * h.a}, {2 * h.b}]\nangle_deg = {np.degrees(h.angle)}\n"
            for h in self.specimen.holes()
        )

    @property
    def arcs(self) -> str:
        """Fillets of the cross."""
        if not isinstance(self.specimen, Cross):
            return ""
        at, radius = self.specimen.half_width + self.specimen.fillet_radius, self.specimen.fillet_radius
        corners = ((1, 1, 180), (-1, 1, 270), (-1, -1, 0), (1, -1, 90))
        return "".join(
            f"[[edges.arcs]]\ncentre = [{sx * at}, {sy * at}]\nradius = {radius}\nfrom_deg = {first}.0\nto_deg = {first + 90}.0\n"
            for sx, sy, first in corners
        )

    @property
    def edges(self) -> list[str]:
        """What is said of the edges, from nothing on."""
        sides = f"beyond_mm = {{bottom = {self.cut}, top = {self.cut}}}\n" if self.cut else ""
        more = [sides + self.holes + self.arcs] if sides or self.arcs else []
        return ["fit_holes = false\n", "", self.holes, *more]


PLATE = PlateWithHole()
CASES = (
    Case(PLATE, "plate, hole of 20 mm", 1.5, 0.6),
    Case(PLATE, "plate, hole of 20 mm", 1.5, 0.6, 0.75),
    Case(Cross(), "cross, nine holes", 1.0, 0.4),
    Case(Cross(), "cross, nine holes", 2.0, 0.8),
)


@cache
def solution(specimen: Specimen) -> SurfaceSolution:
    """Pulled at all its grips."""
    pull = (specimen.displacement or 0.0) / 2
    mesh = quads(specimen, quarter=True, size_factor=0.7)
    return solve(mesh, LAW, Loading.clamped(specimen.loaded, pull), INCREMENTS, THICKNESS).mirrored()


def write(case: Case, folder: Path) -> None:
    """Tables of a DIC program and a testing machine."""
    folder.mkdir(parents=True, exist_ok=True)
    found, rng, points = solution(case.specimen), np.random.default_rng(SEED), case.grid
    fields = np.concatenate([np.zeros((1, *points.shape)), found.evaluate(points)])
    for k, u in enumerate(fields + NOISE * rng.standard_normal(fields.shape)):
        np.savetxt(folder / f"frame_{k:02d}.csv", np.column_stack([points, u]), fmt="%.6f", delimiter=",", header="x,y,u,v", comments="")  # fmt: skip
    pairs = [(side, axis) for side, axis in (("right", 0), ("top", 1)) if side in case.specimen.loaded]
    forces = [np.append(0.0, found.reactions[side][:, axis]) for side, axis in pairs]
    table = np.array(forces).T + FORCE_NOISE * rng.standard_normal((INCREMENTS + 1, len(pairs)))
    names = [f"F{axis}" for _, axis in pairs]
    np.savetxt(folder / "machine.csv", table, fmt="%.6f", delimiter=",", header=",".join(names), comments="")


def column_map(case: Case, edges: str) -> str:
    """Of the tables of a test."""
    both = "bottom" in case.specimen.loaded
    cells = [("F0", '"left", "right"'), *([("F1", '"bottom", "top"')] if both else [])]
    force = "".join(
        f'[[force]]\nfile = "machine.csv"\nforce = "{name}"\nper_frame = true\nsides = [{s}]\n' for name, s in cells
    )
    loaded, free = ", ".join(s for _, s in cells), '"holes"' if both else '"bottom", "top", "holes"'
    return (
        f'name = "test"\nthickness_mm = {THICKNESS}\n[points]\nfiles = "frame_*.csv"\nx = "x"\ny = "y"\nu = "u"\nv = "v"\n{force}'
        f"[noise]\ndisplacement_std_mm = {NOISE}\nforce_std_N = {FORCE_NOISE}\n[edges]\nloaded = [{loaded}]\nfree = [{free}]\n{edges}"
    )


def missed(folder: Path, text: str) -> str:
    """What the true law misses of the test that a column map makes of a folder."""
    path = folder / "columns.toml"
    path.write_text(text)
    test = importer_of(str(path)).read(str(path), SheetOptions(), None, None).experiment()
    found = replay(test, material_law(LAW, "", test), check_mesh=False)
    return f"{100 * found.force_error:.2g} %, {found.field_error[-1]:.2g} mm"


def main(argv: Sequence[str] | None = None) -> int:
    """Status 0."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="for the tables")
    parser.add_argument("--output", type=Path, default=RESULTS)
    given = parser.parse_args(argv)
    rows = [HEAD]
    for k, case in enumerate(CASES):
        folder = given.folder / str(k)
        write(case, folder)
        cells = [missed(folder, column_map(case, edges)) for edges in case.edges]
        ends = f"{case.pitch:g} mm apart, {case.margin:g} mm from the holes" + (f", {case.cut:g} mm from the free sides" if case.cut else "")  # fmt: skip
        rows.append([case.title, ends, *cells, *[""] * (len(HEAD) - 2 - len(cells))])
        print(" | ".join(rows[-1]), flush=True)
    content = {"command": "python -m benchmarks.true_edges FOLDER", "made": datetime.now(UTC).date().isoformat(), "how": "one seed of the noise", "tables": {"missed": rows}}  # fmt: skip
    given.output.write_text(json.dumps(content, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
