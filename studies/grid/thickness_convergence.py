"""`equigap thickness --convergence`: what the size of hexes, their layers and the bulk modulus are worth.

In: command-line options. Out: a folder with one small JSON a run, ``convergence.csv``, ``convergence.md``, a report. Each
run is a process of its own, so that its peak memory is its own; a killed study goes on with the runs that are missing.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from studies.errors import WorkflowError
from studies.grid.thickness_results import arm_forces

DISPLACEMENT, INCREMENTS = 60.0, 10
NEAR = 2.0  # mm from a rim, where the floor of epsilon is read
GRIP_ZONE = 10.0  # mm from a grip, left out of the inner surface
FINE = 0.5  # size factor of --fine
Row = dict[str, Any]


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
class Series:
    """Runs from coarse to fine in one setting. varied: what the table shows of a run as its setting."""

    name: str
    runs: list[Run]
    varied: Callable[[Row], str]


def series(quick: bool) -> list[Series]:
    """The study. quick: fewer and coarser runs."""
    sizes = (2.0, 1.0) if quick else (2.0, 1.4, 1.0, 0.7, FINE, 0.35)
    layers = (1, 2) if quick else (1, 2, 3, 4, 5)
    ratios = (1e3, 1e4) if quick else (1e3, 1e4, 1e5)

    def edge(row: Row) -> str:
        return f"{row['edge']:.2f} mm at the holes"

    def count(row: Row) -> str:
        return f"{row['layers']} layer{'s' * (row['layers'] > 1)} of the half"

    def ratio(row: Row) -> str:
        return f"{row['bulk']:g} shear moduli"

    def grips(row: Row) -> str:
        return f"{row['grips']}, {edge(row)}"

    def held_and_free(h: float) -> list[Run]:
        return [Run(h, s, grips=kind) for kind in ("held", "free") for s in (sizes[:1] if quick else (1.0, FINE))]

    return [
        Series("in-plane size, 10 mm thick", [Run(10.0, s) for s in sizes], edge),
        *(Series(f"layers, {h:g} mm thick", [Run(h, layers=n) for n in layers], count) for h in (10.0, 40.0)),
        Series("bulk modulus, 10 mm thick", [Run(10.0, bulk=k) for k in ratios], ratio),
        Series("floor of ε, 1 mm thick", [Run(1.0, s) for s in sizes], edge),
        Series("grips held or free, 10 mm thick", held_and_free(10.0), grips),
    ]


def loading(grips: str) -> Any:
    """The arms of the cross pulled, u_z of the grips 'held' or 'free'."""
    from forward import Loading
    from meshes import Cross

    return Loading.clamped(Cross.loaded, DISPLACEMENT, dimension=3, hold_thickness=grips == "held")


def main(arguments: argparse.Namespace) -> int:
    """Run what is missing, write tables and report. Raises `WorkflowError` where a run fails."""
    from studies.commands.options import output_folder
    from studies.grid.thickness_convergence_report import write
    from studies.output import open_output_folder, track

    study = series(arguments.quick)
    runs = list(dict.fromkeys(run for part in study for run in part.runs))
    settings = {"study": "thickness convergence", "runs": [asdict(run) for run in runs],
                "displacement": DISPLACEMENT, "increments": INCREMENTS}  # fmt: skip
    folder = open_output_folder(output_folder(arguments, "thickness-convergence"), arguments.overwrite, settings)
    for run in track(runs, "convergence", unit="runs"):
        if not result_path(folder, run).exists():
            start(folder, run)
    print(f"report: {write(folder, study)}")
    return 0


def result_path(folder: Path, run: Run) -> Path:
    """The JSON of a run."""
    return folder / "runs" / f"{run.name}.json"


def start(folder: Path, run: Run) -> None:
    """One run in a process of its own. Raises `WorkflowError` naming the log."""
    command = [
        sys.executable,
        "-m",
        "studies.grid.thickness_convergence",
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


def measure(folder: Path, run: Run) -> Row:
    """Solve in 2D (once a mesh) and in 3D; what the table needs."""
    from forward import ArrudaBoyce
    from forward.solid.pardiso import pardiso_installed
    from forward.solid.solid_model import solve
    from meshes import Cross, quads
    from meshes.extrusion import extrude
    from studies.reports.solid_pictures import pressure_jumps

    material = ArrudaBoyce()
    plane_mesh = quads(Cross(), quarter=True, size_factor=run.size_factor)
    plane = plane_solution(folder, run, plane_mesh)
    mesh = extrude(plane_mesh, run.thickness, run.layers)
    begin = time.process_time()
    solid = solve(mesh, material, loading(run.grips), INCREMENTS, bulk_modulus=run.bulk * material.shear_modulus)
    seconds = time.process_time() - begin
    forces = arm_forces(solid.reactions)
    return {
        **asdict(run), "edge": hole_edge(plane_mesh), "cells": len(mesh.cells), "unknowns": mesh.points.size,
        "force_x": float(forces["right"][-1]), "force_y": float(forces["top"][-1]), **deviations(plane, solid),
        "pressure_jump": float(np.median(pressure_jumps(solid))), "solves": int(solid.iterations.sum()),
        "seconds": seconds, "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "solver": "pardiso" if pardiso_installed() else "mumps",
    }  # fmt: skip


def plane_solution(folder: Path, run: Run, mesh: Any) -> Any:
    """The plane-stress solution on the quads of a run, kept for other runs."""
    from forward import ArrudaBoyce, Loading
    from forward.sheet.plane_stress import solve
    from forward.solution import SurfaceSolution
    from meshes import Cross

    path = folder / "plane" / f"s{run.size_factor:g}.npz"
    if not path.exists():
        path.parent.mkdir(exist_ok=True)
        solve(mesh, ArrudaBoyce(), Loading.clamped(Cross().loaded, DISPLACEMENT), INCREMENTS).save(path)
    return SurfaceSolution.load(path)


def hole_edge(mesh: Any) -> float:
    """Mean length, mm, of the edges on the rims of holes, as the mesh has them and not as they were asked for."""
    rims = np.concatenate([edges for name, edges in mesh.boundaries.items() if name.startswith("hole_")])
    return float(np.linalg.norm(mesh.points[rims[:, 1]] - mesh.points[rims[:, 0]], axis=1).mean())


def deviations(plane: Any, solid: Any) -> Row:
    """Statistics of epsilon at the last increment: everywhere, away from grips, near rims."""
    from studies.accuracy.epsilon import epsilon_field

    field = epsilon_field(plane, solid)
    whole, near = field.statistics(), field.statistics(field.near_holes(NEAR))
    inner = field.statistics(field.away_from_grips(GRIP_ZONE))
    return {
        "p95": whole.p95, "max": whole.maximum, "p95_inner": inner.p95, "max_inner": inner.maximum,
        "mean_near": near.mean, "p95_near": near.p95, "max_near": near.maximum,
    }  # fmt: skip


if __name__ == "__main__":
    from studies.output import write_json

    to_do = Run(**json.loads(sys.argv[2]))
    write_json(result_path(Path(sys.argv[1]), to_do), measure(Path(sys.argv[1]), to_do))
