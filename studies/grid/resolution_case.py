"""The steps of the resolution study, each one a job of the workflow `studies/resolution.smk`.

In: the settings in the folder's ``run.json``. Out, in the same folder:
``solution.npz`` (forward model), ``mesh_LEVEL.npz``, ``experiments/LEVEL_SEED.npz`` and
``cases/LEVEL_SEED.json``: for each loss the model, its agreement with the truth inside and outside the calibrated
range, and stress-stretch curves. LEVEL is the percentage of nodes kept, SEED a number or "clean".

Run as ``python -m studies.grid.resolution_case STEP FOLDER [KEYS]``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from studies.grid.cases import EXTRAPOLATION, LOSSES, CaseSettings, run_step

__all__ = ["EXTRAPOLATION", "LOSSES", "Settings"]


@dataclass(frozen=True)
class Settings(CaseSettings):
    """`CaseSettings` and levels: percent of the nodes that are kept, of the 100 % mesh with `nodes` nodes.

    With dependent_seeds = 0 the clean data are not fitted with the dependent scaling either.
    """

    nodes: int = 9500
    dependent_seeds: int = 2
    forward_size: float = 0.5
    levels: tuple[float, ...] = (100.0, 50.0, 25.0, 12.5)


def forward(folder: Path, settings: Settings) -> None:
    """Solve the cross (quarter model, Q2) and write the mirrored solution."""
    from forward.sheet.plane_stress import default_experiment

    solution = default_experiment(
        settings.displacement,
        settings.forward_size,
        n_increments=settings.increments,
        progress=True,
        checkpoint=folder / "solution_quarter.npz",
    )
    solution.save(folder / "solution.npz")


def mesh(folder: Path, settings: Settings, level: str) -> None:
    """Triangulate the cross with `level` percent of the nodes of the finest mesh."""
    from meshes import Cross, triangles

    triangles(Cross(), n_nodes=round(settings.nodes * float(level) / 100)).save(folder / f"mesh_{level}.npz")


def observe(folder: Path, settings: Settings, seed: str) -> None:
    """The Experiment that the camera records on the finest mesh, and its projections to the coarser ones."""
    from forward.solution import SurfaceSolution
    from meshes import Mesh
    from studies.synthetic import camera, coarsening

    levels = [format_level(level) for level in settings.levels]
    grids = [Mesh.load(folder / f"mesh_{level}.npz") for level in levels]
    solution = SurfaceSolution.load(folder / "solution.npz")
    clean = camera.observe(solution, grids[0], name="perforated cross")
    device = camera.Camera(camera.GaussianField(normalisation=settings.normalisation))
    seen = clean if seed == "clean" else camera.record(clean, device, int(seed))
    for level, grid in reversed(list(zip(levels, grids, strict=True))):
        projection = coarsening.coarsening(clean.points, clean.triangles, grid)
        projection.apply(seen).save(folder / "experiments" / f"{level}_{seed}.npz")


def case(folder: Path, settings: Settings, level: str, seed: str) -> None:
    """Calibrate one Experiment with every loss and score the models against the truth."""
    from calibrate.data.experiment import Experiment
    from studies.grid.cases import calibrated_limit, fit
    from studies.output import write_json

    experiment = Experiment.load(folder / "experiments" / f"{level}_{seed}.npz")
    reference = Experiment.load(folder / "experiments" / f"{format_level(settings.levels[0])}_clean.npz")
    limit = calibrated_limit(reference)
    content: dict[str, Any] = {
        "level": float(level),
        "seed": seed,
        "nodes": len(experiment.points),
        "triangles": len(experiment.triangles),
        "calibrated_I1": limit,
        "losses": {loss: fit(experiment, settings, loss, limit)[1] for loss in losses_for(settings, seed)},
    }
    write_json(folder / "cases" / f"{level}_{seed}.json", content)


def losses_for(settings: Settings, seed: str) -> tuple[str, ...]:
    """Which losses a case is fitted with: the dependent scaling only for clean data and the first seeds."""
    few = ["clean", *map(str, settings.seeds[: settings.dependent_seeds])]
    return LOSSES if seed in few and settings.dependent_seeds else LOSSES[:2]


def format_level(level: float) -> str:
    """12.5 -> '12.5', 100.0 -> '100': as used in file names."""
    return f"{level:g}"


STEPS: dict[str, Callable[..., None]] = {"forward": forward, "mesh": mesh, "observe": observe, "case": case}


if __name__ == "__main__":
    run_step(__doc__, STEPS, Settings)
