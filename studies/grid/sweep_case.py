"""The steps of a sweep, each one a job of the workflow `studies/sweep.smk`.

In: the settings in the folder's ``run.json``. Out, in the same folder:
``forward/SPECIMEN_THICKNESS.npz`` (`SurfaceSolution` of a quarter: plane stress, or the surface of a 3D solution),
``meshes/SPECIMEN_RESOLUTION.npz`` (points of the camera on the whole specimen),
``clean/SPECIMEN_THICKNESS.npz`` and ``.json`` (what the camera sees of it at the finest resolution without noise, and
the range of I1 there, within which every model of this specimen and thickness is judged),
``cases/SPECIMEN/THICKNESS_RESOLUTION_NOISE_SEED.json`` (a calibrated model and its errors) and what
`studies.grid.sweep_report` makes of the cases. THICKNESS is in mm or "2D" (plane stress, 1 mm thick), RESOLUTION in percent of
the nodes, NOISE in mm; SEED is a number, or "clean" where the noise is 0. A camera with fewer points averages: its data
are the finest ones, noise included, projected as in the resolution study. The noise of a seed is the same field for
every thickness and, but for its size, for every noise.

Run as ``python -m studies.grid.sweep_case STEP FOLDER [KEYS]``.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import astuple, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

from studies.grid.cases import LOSSES, CaseSettings, run_step

PLANE = "2D"
PLANE_THICKNESS = 1.0  # mm
CLEAN = "clean"


@dataclass(frozen=True)
class Case:
    """One calibration of a sweep, as `Settings` name it."""

    specimen: str
    thickness: str
    resolution: str
    noise: str
    seed: str

    def path(self, folder: Path) -> Path:
        """Where its result is."""
        return folder / "cases" / self.specimen / f"{'_'.join(astuple(self)[1:])}.json"


@dataclass(frozen=True)
class Settings(CaseSettings):
    """`CaseSettings` and the values that are combined, as used in file names, each one once.

    thicknesses: mm, or `PLANE`; resolutions: percent of `nodes`, finest first; noises: standard deviation of a
    displacement, mm. displacement: of each arm of the cross; another specimen is pulled in proportion
    (`studies.commands.simulate.EXTENT`).
    """

    nodes: int = 9500
    specimens: tuple[str, ...] = ("cross", "plate_with_hole")
    thicknesses: tuple[str, ...] = (PLANE, "10", "20", "40")
    resolutions: tuple[str, ...] = ("100", "50", "25", "12.5")
    noises: tuple[str, ...] = ("0", "0.05", "0.1", "0.2")

    @property
    def cases(self) -> list[Case]:
        """Every combination; clean data (noise 0) know no seed, so they are one case instead of one a seed."""
        kinds = product(self.specimens, self.thicknesses, self.resolutions, self.noises)
        return [Case(*kind, seed) for kind in kinds for seed in self.seeds_with(kind[-1])]

    def seeds_with(self, noise: str) -> list[str]:
        """Seeds of a noise, as used in file names."""
        return [CLEAN] if float(noise) == 0 else list(map(str, self.seeds))

    def pull(self, specimen: str) -> float:
        """Displacement of each grip of a specimen, mm."""
        from studies.commands.simulate import EXTENT

        return self.displacement * EXTENT[specimen] / EXTENT["cross"]


def targets(folder: Path, settings: Settings) -> list[Path]:
    """Every case and the report."""
    return [*(case.path(folder) for case in settings.cases), folder / "report.html"]


def memory(settings: Settings, thickness: str) -> int:
    """MB that a forward solution is given."""
    from studies.grid import thickness_case

    size = settings.forward_size
    return 1500 if thickness == PLANE else thickness_case.solid_memory(thickness_case.Settings(forward_size=size))


def forward(folder: Path, settings: Settings, specimen: str, thickness: str) -> None:
    """Solve the quarter in plane stress, or the eighth in 3D on the same plane mesh; keep what a camera can see.

    A 3D solution goes on from ``forward/SPECIMEN_THICKNESS.checkpoint.npz``, which is there until it is done.
    """
    from forward.loading import Loading
    from forward.materials import ArrudaBoyce
    from forward.sheet import plane_stress
    from forward.solid import solid_model
    from meshes import extrude, quads
    from meshes.specimens import SPECIMENS

    shape, pull = SPECIMENS[specimen](), settings.pull(specimen)
    plane = quads(shape, quarter=True, size_factor=settings.forward_size)
    path = folder / "forward" / f"{specimen}_{thickness}.npz"
    path.parent.mkdir(exist_ok=True)
    if thickness == PLANE:
        loading = Loading.clamped(shape.loaded, pull)
        plane_stress.solve(plane, ArrudaBoyce(), loading, settings.increments, PLANE_THICKNESS).save(path)
        return
    checkpoint = path.with_suffix(".checkpoint.npz")
    hexes = extrude(plane, float(thickness), solid_model.default_layers(float(thickness)))
    loading = Loading.clamped(shape.loaded, pull, dimension=3)
    solution = solid_model.solve(
        hexes, ArrudaBoyce(), loading, settings.increments, progress=sys.stderr.isatty(), checkpoint=checkpoint
    )
    solution.surface().save(path)
    checkpoint.unlink(missing_ok=True)


def mesh(folder: Path, settings: Settings, specimen: str, resolution: str) -> None:
    """Triangulate the specimen with `resolution` percent of the nodes."""
    from meshes import triangles
    from meshes.specimens import SPECIMENS

    path = folder / "meshes" / f"{specimen}_{resolution}.npz"
    path.parent.mkdir(exist_ok=True)
    triangles(SPECIMENS[specimen](), n_nodes=round(settings.nodes * float(resolution) / 100)).save(path)


def observe(folder: Path, settings: Settings, specimen: str, thickness: str) -> None:
    """The Experiment without noise at the finest resolution, and the range of I1 in it."""
    from forward.solution import SurfaceSolution
    from meshes import Mesh
    from meshes.specimens import SPECIMENS
    from studies.grid.cases import calibrated_limit
    from studies.output import write_json
    from studies.synthetic import camera

    solution = SurfaceSolution.load(folder / "forward" / f"{specimen}_{thickness}.npz")
    provenance = {"study": "sweep", "specimen": SPECIMENS[specimen]().to_dict(), "solution": solution.description}
    clean = camera.observe(
        solution.mirrored(),
        Mesh.load(folder / "meshes" / f"{specimen}_{settings.resolutions[0]}.npz"),
        name=f"{specimen}, {thickness if thickness == PLANE else thickness + ' mm'}",
        provenance=provenance,
    )
    path = folder / "clean" / f"{specimen}_{thickness}.npz"
    path.parent.mkdir(exist_ok=True)
    clean.save(path)
    write_json(path.with_suffix(".json"), {"calibrated_I1": calibrated_limit(clean)})


def case(folder: Path, settings: Settings, *keys: str) -> None:
    """Record, calibrate, judge. Data that cannot be calibrated are a result too: `failed` says why."""
    from calibrate.data.experiment import Experiment
    from calibrate.errors import ExperimentError, FitError
    from meshes import Mesh
    from studies.grid import cases
    from studies.output import write_json

    chosen = Case(*keys)
    known = folder / "clean" / f"{chosen.specimen}_{chosen.thickness}.npz"
    clean, limit = Experiment.load(known), json.loads(known.with_suffix(".json").read_text())["calibrated_I1"]
    grid = Mesh.load(folder / "meshes" / f"{chosen.specimen}_{chosen.resolution}.npz")
    content: dict[str, Any] = {**vars(chosen), "nodes": len(grid.points), "calibrated_I1": limit}
    try:
        result, found = cases.fit(record(clean, settings, chosen, grid), settings, LOSSES[0], limit)
        found["model"] = replace(result.model, uncertainty=None).to_dict()  # its covariance is larger than all the rest
        content |= {key: value for key, value in found.items() if key not in ("curves", "losses_of_starts")}
    except (ExperimentError, FitError) as error:
        content["failed"] = f"{type(error).__name__}: {error}"
    write_json(chosen.path(folder), content)


def record(clean: Any, settings: Settings, chosen: Case, grid: Any) -> Any:
    """The Experiment of a case: noise at the finest resolution, then the projection to the case's own."""
    from studies.synthetic import camera, coarsening

    seen, noise = clean, float(chosen.noise)
    if noise > 0:
        field = camera.GaussianField(normalisation=settings.normalisation)
        device = camera.Camera(field, relative_noise=noise, length_scale=1.0)
        seen = camera.record(clean, device, int(chosen.seed))
    return coarsening.coarsening(clean.points, clean.triangles, grid).apply(seen)


def collect(folder: Path, settings: Settings) -> None:
    """Table, figure and report of all cases."""
    from studies.grid import sweep_report

    sweep_report.write(folder, settings)


STEPS: dict[str, Callable[..., None]] = {
    "forward": forward, "mesh": mesh, "observe": observe, "case": case, "collect": collect,
}  # fmt: skip


if __name__ == "__main__":
    run_step(__doc__, STEPS, Settings)
