"""The steps of a study, each one a job of the workflow `studies/grid/grid.smk`.

In: the settings in the folder's ``run.json``. Out, in the same folder, all of a SPECIMEN:
``forward/SPECIMEN_THICKNESS.npz`` (`SurfaceSolution` of a quarter: plane stress, or the surface of a 3D solution),
``solids/SPECIMEN_THICKNESS.npz`` (`SolidSolution` of an eighth, where the study keeps all),
``epsilon/SPECIMEN_THICKNESS.npz`` (`studies.accuracy.epsilon`), ``states/SPECIMEN.npz`` (`studies.accuracy.stress_error`),
``meshes/SPECIMEN_RESOLUTION.npz`` (points of the camera on the whole specimen),
``clean/SPECIMEN_THICKNESS.npz`` and ``.json`` (what the camera sees at the finest resolution, its calibrated range of I1),
``experiments/SPECIMEN/THICKNESS_RESOLUTION_NOISE_SEED.npz`` (where the study keeps all) and the same name in ``cases``
(`studies.grid.case.CaseResult`). A coarser camera averages: its data are the finest ones, noise included, projected. The
noise of a seed is the same field for every thickness and, but for its size, for every noise.

Run as ``python -m studies.grid.steps STEP FOLDER [KEYS]``. Files are written whole or not at all.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from calibrate.data.experiment import Experiment
from calibrate.errors import ExperimentError, FitError
from forward._dolfinx import MPI
from forward.loading import Loading
from forward.materials import ArrudaBoyce
from forward.sheet import plane_stress
from forward.solid import solid_model
from forward.solid.solid_solution import SolidSolution
from forward.solution import SurfaceSolution
from meshes import Mesh, quads, triangles
from meshes.extrusion import GRADING, extrude
from meshes.known_specimens import SPECIMENS
from studies.accuracy.epsilon import epsilon_field
from studies.accuracy.stress_error import Reference, States
from studies.grid import case
from studies.grid.axes import CLEAN, PLANE, PLANE_THICKNESS, Case, Settings
from studies.output import write_json
from studies.synthetic import camera, coarsening


def forward(folder: Path, settings: Settings, specimen: str, thickness: str) -> None:
    """Solve the quarter in plane stress, or the eighth in 3D on the same plane mesh; runs under mpiexec as well.

    A solution goes on from ``forward/SPECIMEN_THICKNESS.checkpoint.npz``, which is there until it is done.
    """
    shape, pull = SPECIMENS[specimen](), settings.pull(specimen)
    plane = quads(shape, quarter=True, size_factor=settings.forward_size)
    path = _file(folder, "forward", specimen, thickness)
    checkpoint = path.with_suffix(".checkpoint.npz")
    shown = sys.stderr.isatty()
    if thickness == PLANE:
        loading = Loading.clamped(shape.loaded, pull)
        solution = plane_stress.solve(plane, ArrudaBoyce(), loading, settings.increments, PLANE_THICKNESS,
                                      progress=shown, checkpoint=checkpoint)  # fmt: skip
        solution.save(path)
    else:
        hexes = extrude(plane, float(thickness), _layers(settings, thickness))
        loading = Loading.clamped(shape.loaded, pull, dimension=3)
        solid = solid_model.solve(
            hexes, ArrudaBoyce(), loading, settings.increments, progress=shown, checkpoint=checkpoint
        )
        if MPI.COMM_WORLD.rank > 0:
            return
        if settings.keep_all:
            solid.save(_file(folder, "solids", specimen, thickness))
        solid.surface().save(path)
    checkpoint.unlink(missing_ok=True)


def epsilon(folder: Path, settings: Settings, specimen: str, thickness: str) -> None:
    """Compare the surface of a 3D solution with the 2D one."""
    plane = SurfaceSolution.load(_file(folder, "forward", specimen, PLANE))
    solid = SolidSolution.load(_file(folder, "solids", specimen, thickness))
    epsilon_field(plane, solid, SPECIMENS[specimen]()).save(_file(folder, "epsilon", specimen, thickness))


def states(folder: Path, settings: Settings, specimen: str) -> None:
    """Deformation states of the 2D solution, at which models are judged."""
    plane = SurfaceSolution.load(_file(folder, "forward", specimen, PLANE))
    States.of(plane).save(_file(folder, "states", specimen))


def mesh(folder: Path, settings: Settings, specimen: str, resolution: str) -> None:
    """Triangulate the specimen with `resolution` percent of the nodes."""
    nodes = round(settings.nodes * float(resolution) / 100)
    triangles(SPECIMENS[specimen](), n_nodes=nodes).save(_file(folder, "meshes", specimen, resolution))


def observe(folder: Path, settings: Settings, specimen: str, thickness: str) -> None:
    """What the camera sees without noise at the finest resolution, and the range of I1 there."""
    solution = SurfaceSolution.load(_file(folder, "forward", specimen, thickness))
    clean = camera.observe(
        solution.mirrored(),
        Mesh.load(_file(folder, "meshes", specimen, settings.resolutions[0])),
        name=f"{specimen}, {'plane stress' if thickness == PLANE else '3D'}, {solution.thickness:g} mm thick",
        provenance=provenance(settings, specimen, thickness, solution),
    )
    path = _file(folder, "clean", specimen, thickness)
    clean.save(path)
    write_json(path.with_suffix(".json"), {"calibrated_I1": case.calibrated_limit(clean)})


def fit(folder: Path, settings: Settings, specimen: str, thickness: str, resolution: str, *records: str) -> None:
    """Record ('NOISE_SEED' each), calibrate, judge; a case is written when it is done, and one that exists is skipped."""
    cases = [Case(specimen, thickness, resolution, *record.split("_")) for record in records]
    missing = [one for one in cases if not one.path(folder).exists()]
    if not missing:
        return
    clean = Experiment.load(_file(folder, "clean", specimen, thickness))
    known = _file(folder, "clean", specimen, PLANE if settings.plane_reference else thickness).with_suffix(".json")
    limit = float(json.loads(known.read_text())["calibrated_I1"])
    reference = None
    if settings.plane_reference:
        reference = Reference.at(States.load(_file(folder, "states", specimen)).within(limit))
    grid = Mesh.load(_file(folder, "meshes", specimen, resolution))
    projection = coarsening.coarsening(clean.points, clean.triangles, grid)
    for one in missing:
        result = _fitted(folder, settings, one, clean, projection, limit, reference)
        write_json(one.path(folder), result.to_dict())


def _fitted(
    folder: Path, settings: Settings, one: Case, clean: Experiment, projection: coarsening.Coarsening, limit: float,
    reference: Reference | None,
) -> case.CaseResult:  # fmt: skip
    """A case with every loss. Raises `ExperimentError` and `FitError` unless failures are results."""
    known = (one, len(projection.mesh.points), len(projection.mesh.cells), limit)
    try:
        experiment = projection.apply(record(clean, settings, one))
        if settings.keep_all:
            one.experiment(folder).parent.mkdir(parents=True, exist_ok=True)
            experiment.save(one.experiment(folder))
        losses = settings.losses_of(one)
        return case.CaseResult(
            *known, {loss: case.fit(experiment, settings, loss, limit, reference) for loss in losses}
        )
    except (ExperimentError, FitError) as error:
        if not settings.record_failures:
            raise
        return case.CaseResult(*known, {}, f"{type(error).__name__}: {error}")


def record(clean: Experiment, settings: Settings, one: Case) -> Experiment:
    """What the camera of a case records of `clean` at the finest resolution."""
    if one.seed == CLEAN:
        return clean
    field = camera.GaussianField(normalisation=settings.normalisation)
    device = camera.Camera(field, relative_noise=float(one.noise), length_scale=1.0)
    return camera.record(clean, device, int(one.seed))


def provenance(settings: Settings, specimen: str, thickness: str, solution: SurfaceSolution) -> dict[str, Any]:
    """Where an Experiment of a study comes from; the camera adds its noise and seed."""
    hexes: dict[str, Any] = {}
    if thickness != PLANE:
        layers = _layers(settings, thickness)
        hexes = {"layers_of_half_the_thickness": layers, "grading": GRADING, "grips": "hold x and y, leave z free"}
    return {
        "study": settings.study,
        "forward_model": "2D plane stress, biquadratic quads" if thickness == PLANE else "3D, Q2-P1 hexes, displacement of z = h/2",
        "specimen": SPECIMENS[specimen]().to_dict(),
        "material": ArrudaBoyce().to_dict(),
        "thickness_mm": solution.thickness,
        "displacement_of_each_arm_mm": settings.pull(specimen),
        "element_size_factor": settings.forward_size,
        **hexes,
        "solution": solution.description,
    }  # fmt: skip


def _layers(settings: Settings, thickness: str) -> int:
    return solid_model.default_layers(float(thickness)) + settings.extra_layers


def _file(folder: Path, kind: str, *keys: str) -> Path:
    """KIND/KEY_KEY.npz, in a folder that exists."""
    path = folder / kind / f"{'_'.join(keys)}.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


STEPS: dict[str, Callable[..., None]] = {
    "forward": forward, "epsilon": epsilon, "states": states, "mesh": mesh, "observe": observe, "fit": fit,
}  # fmt: skip


def main(words: list[str]) -> None:
    """Run one step: its name, the folder, and keys."""
    if len(words) < 2 or words[0] not in STEPS:
        print(f"usage: python -m studies.grid.steps {'|'.join(STEPS)} FOLDER [KEY ...]", file=sys.stderr)
        raise SystemExit(2)
    step, folder = words[0], Path(words[1])
    STEPS[step](folder, Settings.read(folder), *words[2:])


if __name__ == "__main__":
    main(sys.argv[1:])
