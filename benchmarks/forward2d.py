"""Time of one plane-stress Newton step and of the whole cross experiment, beside felupe on the same mesh.

In: mesh size factors. Out: `forward2d.csv`, `forward2d.png` and a manifest in the output folder. One process,
one core, both codes in turn on the same mesh, same nine-node quads and 3 x 3 Gauss points. Run from the
project's folder: `python benchmarks/forward2d.py --output results/forward2d`. Times are CPU seconds of the process,
which other work on the machine disturbs little.
"""
# ruff: noqa: E402  (the number of threads must be set before anything numerical is imported)

from __future__ import annotations

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import platform
import sys
import time
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse.linalg
from matplotlib.figure import Figure
from tqdm import tqdm

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[1] / "tests" / "fixtures")]

import felupe
import forward_felupe

from forward import ArrudaBoyce, Loading
from forward._dolfinx import dolfinx
from forward.sheet.plane_stress import solve
from forward.sheet.plane_stress_problem import PlaneStressProblem
from meshes import Cross, Mesh, quads
from studies.output import Manifest, open_output_folder, write_csv, write_figure

try:
    import pypardiso
except ImportError:
    pypardiso = None

SIZE_FACTORS = (2.0, 1.0, 0.5, 0.3, 0.2)
DISPLACEMENT, INCREMENTS = 60.0, 10
MATERIAL = ArrudaBoyce()
COLUMNS = (
    "cells", "unknowns",
    "equigap_assembly_s", "equigap_solve_s", "equigap_run_s", "equigap_iterations",
    "felupe_assembly_s", "felupe_solve_s", "felupe_run_s", "felupe_iterations", "felupe_increments",
    "reaction_difference",
)  # fmt: skip


def best_of(action: Callable[[], Any], repetitions: int = 3) -> float:
    """Shortest CPU time of an action, s."""
    times = []
    for _ in range(repetitions):
        start = time.process_time()
        action()
        times.append(time.process_time() - start)
    return min(times)


def stretched(mesh: Mesh) -> np.ndarray:
    """A smooth state, so that neither code assembles at rest."""
    return mesh.points * [0.3, 0.2]


def time_equigap(mesh: Mesh) -> tuple[float, float]:
    """Assembly of forces and tangent, and one factorisation with solution, s."""
    held, values = Loading.clamped(Cross.loaded, DISPLACEMENT).on(mesh).prescribed(mesh)
    problem = PlaneStressProblem(mesh, MATERIAL, 1.0, held, values, 1e-10, 25)
    problem.unknowns = (stretched(mesh),)
    newton, bcs = problem.problem, [support.bc for support in problem.supports]
    rhs, x = newton.b.duplicate(), newton.b.duplicate()
    rhs.set(1.0)

    def assemble() -> None:
        newton.A.zeroEntries()
        dolfinx.fem.petsc.assemble_matrix(newton.A, newton.J, bcs=bcs)
        newton.A.assemble()
        problem.nodal_forces()

    def factorise() -> None:
        newton.A.assemble()  # marks the matrix as new, so that it is factorised again
        newton.solver.getKSP().setOperators(newton.A)
        newton.solver.getKSP().solve(rhs, x)

    return best_of(assemble), best_of(factorise)


def time_felupe(mesh: Mesh, linear_solver: Callable) -> tuple[float, float]:
    """The same two times for felupe, s."""
    field, solid = forward_felupe.sheet(mesh, MATERIAL)
    field[0].values[:] = stretched(mesh)
    held, _ = Loading.clamped(Cross.loaded, DISPLACEMENT).on(mesh).prescribed(mesh)
    free = np.flatnonzero(~held)

    def assemble() -> None:
        solid.assemble.vector(field)
        solid.assemble.matrix(field)

    assembly = best_of(assemble)
    matrix = solid.assemble.matrix(field).tocsr()[free][:, free]
    scales = count(1)

    def factorise() -> None:
        # another matrix each time: PARDISO's wrapper keeps the factors of the last one
        linear_solver(matrix * next(scales), np.ones(len(free)))

    return assembly, best_of(factorise)


def run_felupe(mesh: Mesh, linear_solver: Callable) -> tuple[float, int, int, float]:
    """Whole experiment: time, s; Newton iterations; increments (10, doubled until Newton holds); reaction, N."""
    increments = INCREMENTS
    while increments <= 8 * INCREMENTS:
        start = time.process_time()
        try:
            result = forward_felupe.solve(mesh, MATERIAL, DISPLACEMENT, increments, solver=linear_solver)
        except ValueError:  # felupe's Newton method did not converge
            increments *= 2
        else:
            return time.process_time() - start, result.iterations, increments, result.right
    return np.nan, 0, increments, np.nan


def measure(size_factor: float, linear_solver: Callable) -> list[Any]:
    """One row of the table."""
    mesh = quads(Cross(), quarter=True, size_factor=size_factor)
    assembly, factorisation = time_equigap(mesh)
    start = time.process_time()
    solution = solve(mesh, MATERIAL, Loading.clamped(Cross.loaded, DISPLACEMENT), INCREMENTS)
    run = time.process_time() - start
    other_assembly, other_solve = time_felupe(mesh, linear_solver)
    *other_run, right = run_felupe(mesh, linear_solver)
    difference = right / solution.reactions["right"][-1, 0] - 1
    ours = [assembly, factorisation, run, int(solution.iterations.sum())]
    theirs = [other_assembly, other_solve, *other_run]
    return [len(mesh.cells), 2 * len(mesh.points), *ours, *theirs, difference]


def draw(rows: np.ndarray, solver_name: str) -> Figure:
    """Times over unknowns, of one Newton step and of the run."""
    table = dict(zip(COLUMNS, rows.T, strict=True))
    figure = Figure(figsize=(9, 4), layout="constrained")
    step, run = figure.subplots(1, 2)
    for part, style in (("assembly", "o-"), ("solve", "s--")):
        for code, colour in (("equigap", "#0072B2"), ("felupe", "#D55E00")):
            step.loglog(table["unknowns"], table[f"{code}_{part}_s"], style, color=colour, label=f"{code}, {part}")
    for code, colour in (("equigap", "#0072B2"), ("felupe", "#D55E00")):
        run.loglog(table["unknowns"], table[f"{code}_run_s"], "o-", color=colour, label=code)
    step.set(xlabel="unknowns", ylabel="CPU time, s", title="one Newton step")
    run.set(xlabel="unknowns", ylabel="CPU time, s", title=f"cross to {DISPLACEMENT:g} mm")
    for axes in (step, run):
        axes.grid(alpha=0.3)
        axes.legend()
    figure.suptitle(f"One core. equigap: MUMPS Cholesky; felupe: {solver_name}", fontsize=10)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("results/forward2d"))
    parser.add_argument("--size-factors", type=float, nargs="+", default=list(SIZE_FACTORS))
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier run in the output folder")
    arguments = parser.parse_args()
    linear_solver = pypardiso.spsolve if pypardiso else scipy.sparse.linalg.spsolve
    solver_name = f"PARDISO {pypardiso.__version__}" if pypardiso else "scipy spsolve"
    settings = {
        "size_factors": arguments.size_factors,
        "felupe": felupe.__version__,
        "felupe_solver": solver_name,
        "cpu": platform.processor() or platform.machine(),
    }
    folder = open_output_folder(arguments.output, arguments.overwrite, settings)
    manifest = Manifest(settings=settings)
    measure(4.0, linear_solver)  # compiles the forms
    rows = [measure(factor, linear_solver) for factor in tqdm(arguments.size_factors, desc="forward2d", unit="mesh")]
    write_csv(folder / "forward2d.csv", COLUMNS, rows)
    write_figure(folder / "forward2d.png", draw(np.array(rows), solver_name), dpi=150)
    manifest.beside(folder / "forward2d.csv", folder / "forward2d.png")
    for row in rows:
        print("  ".join(f"{name} {value:.4g}" for name, value in zip(COLUMNS, row, strict=True)))
    print(f"written to {folder}")


if __name__ == "__main__":
    main()
