"""One 3D solution of the convergence study: how fine in, forces, epsilon, pressure, time and memory out.

Each run is a process of its own (`python -m studies.grid.convergence_runs FOLDER RUN`), so that its peak memory is its own;
it leaves one small JSON. Lengths in mm, forces in N.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Self

import numpy as np

from forward import ArrudaBoyce, Loading
from forward.sheet import plane_stress
from forward.solid import solid_model
from forward.solid.pardiso import pardiso_installed
from forward.solution import SurfaceSolution
from meshes import Cross, quads
from meshes.extrusion import extrude
from studies.accuracy.epsilon import epsilon_field
from studies.errors import WorkflowError
from studies.grid.presets.thickness_results import arm_forces, hole_edge
from studies.output import write_json
from studies.reports.solid_pictures import pressure_jumps

DISPLACEMENT, INCREMENTS = 60.0, 10
NEAR = 2.0  # mm from a rim, where the floor of epsilon is read
GRIP_ZONE = 10.0  # mm from a grip, left out of the inner surface
FINE = 0.5  # size factor of --fine


@dataclass(frozen=True)
class Run:
    """One 3D solution. thickness, mm; size_factor of the quads; layers of half the thickness; bulk over shear modulus.

    grips: 'held' hold all three components of a side, 'free' let it contract through the thickness, as the 2D model does.
    """

    thickness: float
    size_factor: float = 1.0
    layers: int = 2
    bulk: float = 1e4
    grips: str = "free"

    @property
    def name(self) -> str:
        """As used in file names."""
        return f"h{self.thickness:g}_s{self.size_factor:g}_l{self.layers}_k{self.bulk:g}_{self.grips}"


@dataclass(frozen=True)
class RunResult:
    """edge: of the quads at the holes, mm; cells, unknowns: numbers; force_x, force_y: of whole arms, N; p95 ... max_near: of
    epsilon everywhere, away from grips (inner), near rims; pressure_jump: median over the range; solves: of linear
    systems; seconds: CPU; memory: peak, MB.
    """

    run: Run
    edge: float
    cells: int
    unknowns: int
    force_x: float
    force_y: float
    p95: float
    max: float
    p95_inner: float
    max_inner: float
    mean_near: float
    p95_near: float
    max_near: float
    pressure_jump: float
    solves: int
    seconds: float
    memory: float
    solver: str

    def to_dict(self) -> dict[str, Any]:
        """Flat, for a file."""
        content = asdict(self)
        return {**content.pop("run"), **content}

    @classmethod
    def load(cls, path: Path) -> Self:
        """Of a run's file."""
        content = json.loads(path.read_text())
        run = Run(**{field.name: content.pop(field.name) for field in fields(Run)})
        return cls(run, **content)


@dataclass(frozen=True)
class Series:
    """Runs from coarse to fine in one setting. varied: what the table shows of a run as its setting."""

    name: str
    runs: list[Run]
    varied: Callable[[RunResult], str]


def series(quick: bool) -> list[Series]:
    """The study. quick: fewer and coarser runs."""
    sizes = (2.0, 1.0) if quick else (2.0, 1.4, 1.0, 0.7, FINE, 0.35)
    layers = (1, 2) if quick else (1, 2, 3, 4, 5)
    ratios = (1e3, 1e4) if quick else (1e3, 1e4, 1e5)

    def edge(row: RunResult) -> str:
        return f"{row.edge:.2f} mm at the holes"

    def count(row: RunResult) -> str:
        return f"{row.run.layers} layer{'s' * (row.run.layers > 1)} of the half"

    def ratio(row: RunResult) -> str:
        return f"{row.run.bulk:g} shear moduli"

    def grips(row: RunResult) -> str:
        return f"{row.run.grips}, {edge(row)}"

    def held_and_free(h: float) -> list[Run]:
        return [Run(h, s, grips=kind) for kind in ("held", "free") for s in (sizes[:1] if quick else (1.0, FINE))]

    return [
        Series("in-plane size, 10 mm thick", [Run(10.0, s) for s in sizes], edge),
        *(Series(f"layers, {h:g} mm thick", [Run(h, layers=n) for n in layers], count) for h in (10.0, 40.0)),
        Series("bulk modulus, 10 mm thick", [Run(10.0, bulk=k) for k in ratios], ratio),
        Series("floor of ε, 1 mm thick", [Run(1.0, s) for s in sizes], edge),
        Series("grips held or free, 10 mm thick", held_and_free(10.0), grips),
    ]


def result_path(folder: Path, run: Run) -> Path:
    """The JSON of a run."""
    return folder / "runs" / f"{run.name}.json"


def start(folder: Path, run: Run) -> None:
    """One run in a process of its own. Raises `WorkflowError` naming the log."""
    command = [
        sys.executable,
        "-m",
        "studies.grid.convergence_runs",
        str(folder.resolve()),
        json.dumps(asdict(run)),
    ]
    environment = {**os.environ, "TQDM_DISABLE": "1"} | {f"{n}_NUM_THREADS": "1" for n in ("OMP", "MKL", "OPENBLAS")}
    log = folder / "convergence.log"
    with log.open("a") as file:
        code = subprocess.run(command, stdout=file, stderr=subprocess.STDOUT, env=environment).returncode
    if code:
        raise WorkflowError(f"run {run.name} failed; the reason is in {log}. Finished runs are kept: "
                            "mend it and run the same command again")  # fmt: skip


def measure(folder: Path, run: Run) -> RunResult:
    """Solve in 2D (once a mesh) and in 3D; what the table needs."""
    material = ArrudaBoyce()
    plane_mesh = quads(Cross(), quarter=True, size_factor=run.size_factor)
    plane = plane_solution(folder, run, plane_mesh)
    mesh = extrude(plane_mesh, run.thickness, run.layers)
    pull = Loading.clamped(Cross.loaded, DISPLACEMENT, dimension=3, hold_thickness=run.grips == "held")
    begin = time.process_time()
    solid = solid_model.solve(mesh, material, pull, INCREMENTS, bulk_modulus=run.bulk * material.shear_modulus)
    seconds = time.process_time() - begin
    forces = arm_forces(solid.reactions)
    return RunResult(
        run, edge=hole_edge(plane_mesh), cells=len(mesh.cells), unknowns=mesh.points.size,
        force_x=float(forces["right"][-1]), force_y=float(forces["top"][-1]), **deviations(plane, solid),
        pressure_jump=float(np.median(pressure_jumps(solid))), solves=int(solid.iterations.sum()), seconds=seconds,
        memory=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        solver="pardiso" if pardiso_installed() else "mumps",
    )  # fmt: skip


def plane_solution(folder: Path, run: Run, mesh: Any) -> SurfaceSolution:
    """The plane-stress solution on the quads of a run, kept for other runs."""
    path = folder / "plane" / f"s{run.size_factor:g}.npz"
    if not path.exists():
        path.parent.mkdir(exist_ok=True)
        pull = Loading.clamped(Cross.loaded, DISPLACEMENT)
        plane_stress.solve(mesh, ArrudaBoyce(), pull, INCREMENTS).save(path)
    return SurfaceSolution.load(path)


def deviations(plane: Any, solid: Any) -> dict[str, float]:
    """Statistics of epsilon at the last increment: everywhere, away from grips, near rims."""
    field = epsilon_field(plane, solid)
    whole, near = field.statistics(), field.statistics(field.near_holes(NEAR))
    inner = field.statistics(field.away_from_grips(GRIP_ZONE))
    return {
        "p95": whole.p95, "max": whole.maximum, "p95_inner": inner.p95, "max_inner": inner.maximum,
        "mean_near": near.mean, "p95_near": near.p95, "max_near": near.maximum,
    }  # fmt: skip


if __name__ == "__main__":
    to_do = Run(**json.loads(sys.argv[2]))
    write_json(result_path(Path(sys.argv[1]), to_do), measure(Path(sys.argv[1]), to_do).to_dict())
