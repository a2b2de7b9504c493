"""`equigap simulate`: a specimen, a material and a pull in, the Experiment a camera would have recorded out.

Also leaves the exact solution, pictures of both, the force curve and a report.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from calibrate.data.experiment import Experiment
from calibrate.models.model_file import load_model
from calibrate.models.network_model import Model
from forward.loading import Loading
from forward.materials import MATERIALS, Material, material_from_dict
from forward.materials.network_energy import Pann
from forward.sheet.inelastic import solve_history
from forward.sheet.plane_stress import solve as solve_plane_stress
from forward.sheet.thin_sheet import Sheet
from forward.solution import SurfaceSolution
from meshes import Mesh, quads, triangles
from meshes.known_specimens import SPECIMENS
from studies.commandline.option_types import (
    Assignments,
    Count,
    OutputFolder,
    Overwrite,
    Positive,
    Seed,
    default_folder,
    nearest,
)
from studies.commandline.outcome import Outcome
from studies.errors import OptionError
from studies.grid.axes import EXTENT
from studies.output import Manifest, open_output_folder
from studies.output.findings import Finding
from studies.output.viewer import write_viewer_file
from studies.reports.alert_table import alert_lines, alert_records
from studies.reports.experiments.simulation_report import write_report
from studies.reports.model_remarks import remarks_of_file
from studies.synthetic.camera import Camera, GaussianField
from studies.synthetic.camera import observe as record
from studies.synthetic.history_file import History, read_history, sheet_of

QUICK = {"increments": 4, "nodes": 900, "size_factor": 2.5}
FULL = {"increments": 10, "nodes": 5000, "size_factor": 1.0}


@Parameter(name="*", group="Test")
@dataclass(frozen=True)
class TensionTest:
    """What is solved. None: depends on the specimen or on --quick, see `completed`."""

    specimen: Annotated[str, Parameter(help=", ".join(EXTENT))] = "cross"
    material: Annotated[str, Parameter(help=f"{', '.join(MATERIALS)}, or a calibrated model .json")] = "arruda_boyce"
    parameter: Assignments = ()
    """material parameter such as mu=0.3 (MPa) or N=25; may be repeated"""
    displacement: Positive | None = None
    """of each grip, mm (cross: 60)"""
    increments: Count | None = None
    """load steps (10; quick: 4)"""
    thickness: Positive = 1.0
    """mm"""
    bulk_modulus: Positive | None = None
    """plane strain of a compressible body with this bulk modulus, MPa, instead of plane stress of an incompressible sheet"""
    size_factor: Positive | None = None
    """of the element sizes (1; quick: 2.5)"""
    history: str | None = None
    """TOML file with times, load factors and what the law has beside the material: damage, fibres, viscosity (docs/forward.md)"""


@Parameter(name="*", group="Camera and load cell")
@dataclass(frozen=True)
class Recording:
    """What the camera and the load cell make of it."""

    nodes: Count | None = None
    """measured points (5000; quick: 900)"""
    seed: Seed = 0
    """of the noise"""
    no_noise: bool = False
    """record the exact fields"""
    relative_noise: float = 5e-4
    """standard deviation of the displacements, of 200 mm"""
    pattern_noise: float = 0.0
    """the same, of what stays with the speckle pattern and grows with the deformation"""
    reference_noise: float = 0.0
    """the same, of the reference picture, which all pictures share"""
    correlation_length: Positive = 4.0
    """of the displacement noise, mm"""
    force_noise: float = 1e-4
    """relative"""


@dataclass(frozen=True)
class Simulated(Outcome):
    """A simulated test. folder: with ``experiment.npz`` and ``solution.npz``."""

    folder: Path
    solution: SurfaceSolution
    experiment: Experiment
    report: Path
    remarks: tuple[Finding, ...] = ()

    def lines(self) -> Iterable[str]:
        """What the model file says of itself, and files."""
        yield from alert_lines(self.remarks)
        yield f"experiment: {self.folder / 'experiment.npz'}"
        yield f"report: {self.report}"


def simulate(
    *,
    test: TensionTest = TensionTest(),
    recording: Recording = Recording(),
    quick: bool = False,
    output: OutputFolder = None,
    overwrite: Overwrite = False,
) -> Simulated:
    """Solve a tension test of a thin rubber sheet and record it with a synthetic camera and load cell.

    Plane stress; with --bulk-modulus plane strain; with --history loading and unloading over time, with damage, fibres or
    viscosity. Default: the cross, 60 mm at each arm in 10 increments, Arruda-Boyce rubber, noise of
    0.1 mm with a correlation length of 4 mm, force noise of 1e-4. Lengths in mm, forces in N, stresses in MPa.

    Args:
        quick: coarse, a few seconds

    Raises:
        OptionError: unknown specimen, material or parameter.
        ForwardError, MeshError, EquigapError: what cannot be solved, meshed or recorded.
    """
    test, recording = completed(test, recording, quick)
    material, camera = read_material(test.material, dict(test.parameter)), camera_of(recording, quick)
    history = None if test.history is None else read_history(test.history)
    sheet = None if history is None else sheet_of(str(test.history), history, material, test.thickness)
    points = triangles(SPECIMENS[test.specimen](), n_nodes=recording.nodes)
    key = {"command": "simulate", "quick": quick, **asdict(test), **asdict(recording), "material": material.to_dict()}
    if sheet is not None and history is not None:
        key |= {"history": history.model_dump(mode="json"), "sheet": sheet.to_dict()}
    folder = open_output_folder(output or default_folder("simulate", quick), overwrite, key)
    seed = None if recording.no_noise else recording.seed
    manifest = Manifest(seed=seed, settings=key)
    solution = solve(test, sheet or material, history, folder / "checkpoint.npz")
    solution.save(folder / "solution.npz")
    (folder / "checkpoint.npz").unlink(missing_ok=True)
    experiment = observe(test, solution, points, camera, seed)
    experiment.save(folder / "experiment.npz")
    write_viewer_file(experiment, folder / "experiment.vtu")
    remarks = tuple(remarks_of_file(test.material))
    said = {"alerts": alert_records(remarks)} if remarks else {}
    manifest.beside(folder / "experiment.npz", folder / "solution.npz", **numbers(solution, experiment), **said)
    return Simulated(
        folder, solution, experiment, write_report(folder, solution, experiment, manifest, remarks), remarks
    )


def completed(test: TensionTest, recording: Recording, quick: bool) -> tuple[TensionTest, Recording]:
    """Options with what depends on others filled in. Raises `OptionError`."""
    if test.specimen not in EXTENT:
        raise OptionError(
            f"specimen '{test.specimen}' is none that rigid grips can pull{nearest(test.specimen, EXTENT)}; those are "
            + ", ".join(EXTENT)
        )
    if test.history and (test.increments or test.bulk_modulus):
        raise OptionError(
            "--increments and --bulk-modulus do not go with --history: give times and factors, and bulk_modulus, in the file"
        )
    usual = QUICK if quick else FULL
    test = replace(
        test,
        displacement=test.displacement or EXTENT[test.specimen],
        increments=test.increments or int(usual["increments"]),
        size_factor=test.size_factor or usual["size_factor"],
    )
    return test, replace(recording, nodes=recording.nodes or int(usual["nodes"]))


def read_material(name: str, parameters: Mapping[str, float]) -> Material:
    """A material by name and parameters, or from a model file. Raises `OptionError`, `MaterialError`."""
    if name.endswith(".json"):
        if parameters:
            raise OptionError(f"--parameter does not apply to the model file {name}; leave it out")
        return network_material(name)
    if name not in MATERIALS:
        raise OptionError(
            f"material '{name}' is unknown{nearest(name, MATERIALS)}; choose from {', '.join(MATERIALS)} or a model .json"
        )
    known = [key for key in MATERIALS[name]().to_dict() if key != "material"]
    for key in parameters:
        if key not in known:
            raise OptionError(f"--parameter {key}: {name} has {', '.join(known)}{nearest(key, known)}")
    return material_from_dict({"material": name, **parameters})


def network_material(name: str) -> Pann:
    """The network of a model file of `equigap calibrate`. Raises `OptionError` for another kind."""
    content = load_model(Path(name))
    if not isinstance(content, Model):
        raise OptionError(
            f"{name} is a model of `equigap discover`, a spline with effects, which `simulate` has no law for; give one of "
            "`equigap calibrate`, or predict forces with `equigap predict --test`"
        )
    return Pann.from_file(name)


def solve(test: TensionTest, law: Material | Sheet, history: History | None, checkpoint: Path) -> SurfaceSolution:
    """Solve a completed test: a quarter of the specimen, mirrored, or with a history the whole, which need not be symmetric."""
    specimen = SPECIMENS[test.specimen]()
    assert test.displacement is not None and test.increments is not None and test.size_factor is not None
    loading, progress = Loading.clamped(specimen.loaded, test.displacement), sys.stderr.isatty()
    if isinstance(law, Sheet):
        assert history is not None
        return solve_history(
            quads(specimen, size_factor=test.size_factor), law, loading, history.factors, history.times,
            history.substeps, progress=progress, checkpoint=checkpoint, readings=history.readings,
        )  # fmt: skip
    return solve_plane_stress(
        quads(specimen, quarter=True, size_factor=test.size_factor), law, loading, test.increments, test.thickness,
        progress=progress, checkpoint=checkpoint, bulk_modulus=test.bulk_modulus,
    ).mirrored()  # fmt: skip


def camera_of(recording: Recording, quick: bool = False) -> Camera:
    """The camera and load cell asked for. Raises `ConfigError`."""
    field = GaussianField(recording.correlation_length, resolution=512 if quick else 2048)
    return Camera(
        field, relative_noise=recording.relative_noise, force_noise=recording.force_noise,
        pattern_noise=recording.pattern_noise, reference_noise=recording.reference_noise,
    )  # fmt: skip


def observe(test: TensionTest, solution: SurfaceSolution, mesh: Mesh, camera: Camera, seed: int | None) -> Experiment:
    """The Experiment that the camera records of a solution at the nodes of `mesh`. seed: None for no noise."""
    provenance = {"specimen": SPECIMENS[test.specimen]().to_dict(), "solution": solution.description}
    return record(
        solution, mesh, camera, seed, name=f"{test.specimen}, {test.displacement:g} mm",
        provenance=json.loads(json.dumps(provenance)),
    )  # fmt: skip


def numbers(solution: SurfaceSolution, experiment: Experiment) -> dict[str, Any]:
    """What a manifest and a report say about the test."""
    return {
        "points": len(experiment.points),
        "triangles": len(experiment.triangles),
        "increments": experiment.n_increments,
        "final_forces_N": {side: force[-1] for side, force in solution.reactions.items()},
        "solver_iterations": solution.iterations,
        "stored_energy_Nmm": float(solution.energy[-1]),
    }
