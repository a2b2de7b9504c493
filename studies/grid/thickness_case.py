"""The steps of the thickness study, each one a job of the workflow `studies/thickness.smk`.

In: the settings in the folder's ``run.json``. Out, in the same folder:
``plane.npz`` (2D plane stress, a quarter, 1 mm thick), ``solid_H.npz`` (3D on the same plane mesh, an eighth),
``epsilon_H.npz`` (`studies.accuracy.epsilon`), ``states.npz`` (`studies.accuracy.stress_error.States` of the 2D solution),
``mesh.npz`` (points of the camera on the whole cross), ``experiments/CONDITION_SEED.npz``: what the camera sees of the
surface, and ``cases/CONDITION_SEED.json``: for each of `LOSSES` the model calibrated in plane stress and its errors;
`CORRECTED` is the default loss on displacements of the mean over the thickness, as `calibrate.effects.finite_thickness` has them.
H is the thickness in mm, CONDITION is H or "plane", SEED a number or "clean". The noise of a seed is the same in all
conditions, so that differences between them are those of the specimens.

Run as ``python -m studies.grid.thickness_case STEP FOLDER [KEYS]``; `observe` and `case` take a condition and any number of
seeds: what a process needs to start and to compile is paid once. What exists already is skipped.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from studies.grid import cases
from studies.grid.cases import EXTRAPOLATION, CaseSettings, run_step

if TYPE_CHECKING:
    from forward.solution import SurfaceSolution

__all__ = ["CORRECTED", "EXTRAPOLATION", "LOSSES", "PLANE", "Settings"]

PLANE = "plane"
PLANE_THICKNESS = 1.0  # mm
BATCH = 6  # seeds a job calibrates at most
CORRECTED = "thickness-corrected"
LOSSES = (cases.LOSSES[0], CORRECTED, *cases.LOSSES[1:])


@dataclass(frozen=True)
class Settings(CaseSettings):
    """`CaseSettings` and thicknesses, mm, rising; extra_layers: of hexes in half the thickness, above the default.

    forward_size: of the plane mesh under both models; 1 is 1.2 mm at the holes, 0.5 is 0.6 mm. The clean data are fitted
    with the dependent scaling whatever dependent_seeds.
    """

    thicknesses: tuple[float, ...] = (10.0, 15.0, 20.0, 40.0)
    extra_layers: int = 0

    @property
    def conditions(self) -> list[str]:
        """The 2D reference and every thickness, as used in file names."""
        return [PLANE, *map(format_thickness, self.thicknesses)]

    @property
    def batches(self) -> list[list[str]]:
        """Seeds that one job calibrates, of about equal number."""
        count = -(-len(self.noise_seeds) // BATCH)
        return [self.noise_seeds[k::count] for k in range(count)]


def format_thickness(thickness: float) -> str:
    """12.5 -> '12.5', 10.0 -> '10': as used in file names."""
    return f"{thickness:g}"


def targets(folder: Path, settings: Settings) -> list[Path]:
    """Every file that the report needs."""
    names = ["states.npz"]
    names += [f"{kind}_{condition}.npz" for condition in settings.conditions[1:] for kind in ("solid", "epsilon")]
    names += [f"cases/{condition}_{seed}.json" for condition in settings.conditions for seed in settings.noise_seeds]
    return [folder / name for name in names]


def solid_memory(settings: Settings, ranks: int = 1) -> int:
    """MB that a 3D solution is given: half as much again as 40 mm took at the default size (0.9 GB), and in proportion.

    A factorisation grows a little faster than the number of elements.
    """
    return round(1500 * settings.forward_size ** (-7 / 3) * (1 + settings.extra_layers / 5) + 300 * (ranks - 1))


def plane(folder: Path, settings: Settings) -> None:
    """Solve the quarter of the cross in plane stress."""
    from forward.loading import Loading
    from forward.materials import ArrudaBoyce
    from forward.sheet.plane_stress import solve
    from meshes import Cross, quads

    mesh = quads(Cross(), quarter=True, size_factor=settings.forward_size)
    loading = Loading.clamped(Cross.loaded, settings.displacement)
    solve(mesh, ArrudaBoyce(), loading, settings.increments, PLANE_THICKNESS).save(folder / "plane.npz")


def solid(folder: Path, settings: Settings, thickness: str) -> None:
    """Solve the eighth of the cross in 3D on the plane mesh of `plane`; runs under mpiexec as well.

    The increments reached are kept in ``solid_H.checkpoint.npz`` until the last one is.
    """
    from forward._dolfinx import MPI
    from forward.loading import Loading
    from forward.materials import ArrudaBoyce
    from forward.solid.solid_model import default_layers, solve
    from forward.solution import SurfaceSolution
    from meshes import Cross
    from meshes.extrusion import extrude

    h = float(thickness)
    mesh = extrude(SurfaceSolution.load(folder / "plane.npz").mesh, h, default_layers(h) + settings.extra_layers)
    loading = Loading.clamped(Cross.loaded, settings.displacement, dimension=3)
    checkpoint = folder / f"solid_{thickness}.checkpoint.npz"
    solution = solve(
        mesh, ArrudaBoyce(), loading, settings.increments, progress=sys.stderr.isatty(), checkpoint=checkpoint
    )
    if MPI.COMM_WORLD.rank == 0:
        solution.save(folder / f"solid_{thickness}.npz")
        checkpoint.unlink(missing_ok=True)


def epsilon(folder: Path, settings: Settings, thickness: str) -> None:
    """Compare the surface of the 3D solution with the 2D one."""
    from forward.solid.solid_solution import SolidSolution
    from forward.solution import SurfaceSolution
    from studies.accuracy.epsilon import epsilon_field

    solution = SolidSolution.load(folder / f"solid_{thickness}.npz")
    field = epsilon_field(SurfaceSolution.load(folder / "plane.npz"), solution)
    field.save(folder / f"epsilon_{thickness}.npz")


def states(folder: Path, settings: Settings) -> None:
    """Deformation states of the 2D solution, at which models are judged."""
    from forward.solution import SurfaceSolution
    from studies.accuracy.stress_error import States

    States.of(SurfaceSolution.load(folder / "plane.npz")).save(folder / "states.npz")


def mesh(folder: Path, settings: Settings) -> None:
    """The camera's triangulation of the whole cross."""
    from meshes import Cross, triangles

    triangles(Cross(), n_nodes=settings.nodes).save(folder / "mesh.npz")


def observe(folder: Path, settings: Settings, condition: str, *seeds: str) -> None:
    """The Experiments that the camera records of a condition's surface."""
    from meshes import Mesh
    from studies.synthetic import camera

    missing = [seed for seed in seeds if not experiment_path(folder, condition, seed).exists()]
    if not missing:
        return
    solution, words = surface(folder, condition)
    clean = camera.observe(
        solution.mirrored(),
        Mesh.load(folder / "mesh.npz"),
        name=f"perforated cross, {words}",
        provenance=provenance(settings, condition, solution),
    )
    device = camera.Camera(camera.GaussianField(normalisation=settings.normalisation))
    for seed in missing:
        seen = clean if seed == "clean" else camera.record(clean, device, int(seed))
        seen.save(experiment_path(folder, condition, seed))


def surface(folder: Path, condition: str) -> tuple[SurfaceSolution, str]:
    """Surface of a condition's solution (a quarter), and the condition in words."""
    from forward.solution import SurfaceSolution

    if condition == PLANE:
        return SurfaceSolution.load(folder / "plane.npz"), f"plane stress, {PLANE_THICKNESS:g} mm thick"
    from forward.solid.solid_solution import SolidSolution

    return SolidSolution.load(folder / f"solid_{condition}.npz").surface(), f"3D, {condition} mm thick"


def provenance(settings: Settings, condition: str, solution: SurfaceSolution) -> dict[str, Any]:
    """Where an Experiment of this study comes from; the camera adds its noise and seed."""
    from forward.materials import ArrudaBoyce
    from meshes import Cross

    hexes: dict[str, Any] = {}
    if condition != PLANE:
        from forward.solid.solid_model import default_layers
        from meshes.extrusion import GRADING

        layers = default_layers(float(condition)) + settings.extra_layers
        hexes = {"layers_of_half_the_thickness": layers, "grading": GRADING, "grips": "hold x and y, leave z free"}
    model = "2D plane stress, biquadratic quads" if condition == PLANE else "3D, Q2-P1 hexes, displacement of z = h/2"
    return {
        "study": "thickness",
        "forward_model": model,
        "specimen": Cross().to_dict(),
        "material": ArrudaBoyce().to_dict(),
        "thickness_mm": solution.thickness,
        "displacement_of_each_arm_mm": settings.displacement,
        "element_size_factor": settings.forward_size,
        **hexes,
        "solution": solution.description,
    }


def case(folder: Path, settings: Settings, condition: str, *seeds: str) -> None:
    """Calibrate a condition's Experiments with every loss and score the models; each case is written when it is done."""
    from calibrate.data.experiment import Experiment
    from studies.accuracy.stress_error import Reference, States
    from studies.grid.cases import calibrated_limit
    from studies.output import write_json

    missing = [seed for seed in seeds if not case_path(folder, condition, seed).exists()]
    if not missing:
        return
    limit = calibrated_limit(Experiment.load(experiment_path(folder, PLANE, "clean")))
    reference = Reference.at(States.load(folder / "states.npz").within(limit))
    for seed in missing:
        experiment = Experiment.load(experiment_path(folder, condition, seed))
        content = {
            "condition": condition,
            "thickness": experiment.thickness,
            "seed": seed,
            "nodes": len(experiment.points),
            "triangles": len(experiment.triangles),
            "calibrated_I1": limit,
            "losses": {
                loss: fit_loss(experiment, settings, loss, reference, limit)
                for loss in losses_for(settings, condition, seed)
            },
        }
        write_json(case_path(folder, condition, seed), content)


def fit_loss(experiment: Any, settings: Settings, loss: str, reference: Any, limit: float) -> dict[str, Any]:
    """A loss's part of a case."""
    from calibrate.effects.finite_thickness import of_the_mean
    from studies.accuracy.stress_error import summary

    if loss == CORRECTED:
        experiment, loss = of_the_mean(experiment), LOSSES[0]
    result, content = cases.fit(experiment, settings, loss, limit)
    return {**content, **summary(result.model, reference)}


def losses_for(settings: Settings, condition: str, seed: str) -> tuple[str, ...]:
    """Which losses a case is fitted with: the dependent scaling only for clean data and the first seeds, the correction
    only for what is thick (a solution in plane stress is its own mean)."""
    few = ["clean", *map(str, settings.seeds[: settings.dependent_seeds])]
    left_out = {CORRECTED} if condition == PLANE else set()
    if seed not in few:
        left_out.add(LOSSES[-1])
    return tuple(loss for loss in LOSSES if loss not in left_out)


def experiment_path(folder: Path, condition: str, seed: str) -> Path:
    """Of the Experiment of a condition and a noise seed."""
    return folder / "experiments" / f"{condition}_{seed}.npz"


def case_path(folder: Path, condition: str, seed: str) -> Path:
    """Of the numbers of a condition and a noise seed."""
    return folder / "cases" / f"{condition}_{seed}.json"


STEPS: dict[str, Callable[..., None]] = {
    "plane": plane, "solid": solid, "epsilon": epsilon, "states": states, "mesh": mesh, "observe": observe, "case": case,
}  # fmt: skip


if __name__ == "__main__":
    run_step(__doc__, STEPS, Settings)
