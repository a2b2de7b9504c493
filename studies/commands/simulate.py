"""`equigap simulate`: a specimen, a material and a pull in, the Experiment a camera would have recorded out.

Also leaves the exact solution, pictures of both, the force curve and a report.
"""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING, Any

from studies.commands.options import add_output, count, nearest, output_folder, positive, seed, settings
from studies.errors import OptionError
from studies.grid.axes import EXTENT

if TYPE_CHECKING:
    from calibrate.data.experiment import Experiment
    from forward.materials import Material
    from forward.solution import SurfaceSolution
    from meshes import Mesh
    from studies.synthetic.camera import Camera

DESCRIPTION = """\
Solve a tension test of a thin rubber sheet (plane stress; with --bulk-modulus plane strain) and record it with a synthetic
camera and load cell. Default: the cross, 60 mm at each arm in 10 increments, Arruda-Boyce rubber, noise of
0.1 mm with a correlation length of 4 mm, force noise of 1e-4. Lengths in mm, forces in N, stresses in MPa."""
QUICK = {"increments": 4, "nodes": 900, "size_factor": 2.5}
FULL = {"increments": 10, "nodes": 5000, "size_factor": 1.0}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `equigap simulate`."""
    group = parser.add_argument_group("test")
    group.add_argument("--specimen", default="cross", help=f"{', '.join(EXTENT)} (%(default)s)")
    group.add_argument(
        "--material", default="arruda_boyce", metavar="NAME|MODEL.json",
        help="arruda_boyce, neo_hooke, mooney_rivlin, yeoh, or a calibrated model (%(default)s)",
    )  # fmt: skip
    group.add_argument(
        "--parameter", action="append", default=[], metavar="NAME=VALUE",
        help="material parameter such as mu=0.3 (MPa) or N=25; may be repeated",
    )  # fmt: skip
    group.add_argument("--displacement", type=positive, metavar="MM", help="of each grip (cross: 60)")
    group.add_argument("--increments", type=count, metavar="N", help="load steps (10; quick: 4)")
    group.add_argument("--thickness", type=positive, default=1.0, metavar="MM", help="(%(default)s)")
    group.add_argument(
        "--bulk-modulus", type=positive, metavar="MPA",
        help="plane strain of a compressible body with this bulk modulus, instead of plane stress of an incompressible sheet",
    )  # fmt: skip
    group.add_argument("--size-factor", type=positive, metavar="X", help="of the element sizes (1; quick: 2.5)")
    group = parser.add_argument_group("camera and load cell")
    group.add_argument("--nodes", type=count, metavar="N", help="measured points (5000; quick: 900)")
    group.add_argument("--seed", type=seed, default=0, help="of the noise (%(default)s)")
    group.add_argument("--no-noise", action="store_true", help="record the exact fields")
    group.add_argument("--relative-noise", type=float, default=5e-4, metavar="X", help="of 200 mm (%(default)s)")
    group.add_argument("--correlation-length", type=positive, default=4.0, metavar="MM", help="(%(default)s)")
    group.add_argument("--force-noise", type=float, default=1e-4, metavar="X", help="relative (%(default)s)")
    parser.add_argument("--quick", action="store_true", help="coarse, a few seconds")
    add_output(parser, "simulate")


def main(args: argparse.Namespace) -> int:
    """Solve, record, draw, report. Raises `OptionError` and the named errors of meshes, forward and calibrate."""
    from meshes import triangles
    from meshes.specimens import SPECIMENS
    from studies.output import Manifest, open_output_folder
    from studies.output.viewer import write_viewer_file
    from studies.reports.simulation_report import write_report

    _complete(args)
    material, camera = read_material(args.material, args.parameter), camera_from(args)
    points = triangles(SPECIMENS[args.specimen](), n_nodes=args.nodes)
    key = settings(args) | {"material": material.to_dict()}
    folder = open_output_folder(output_folder(args, "simulate"), args.overwrite, key)
    manifest = Manifest(seed=None if args.no_noise else args.seed, settings=key)
    solution = solve(args, material, folder / "checkpoint.npz")
    solution.save(folder / "solution.npz")
    (folder / "checkpoint.npz").unlink(missing_ok=True)
    experiment = observe(args, solution, points, camera)
    experiment.save(folder / "experiment.npz")
    write_viewer_file(experiment, folder / "experiment.vtu")
    manifest.beside(folder / "experiment.npz", folder / "solution.npz", **numbers(solution, experiment))
    print(f"experiment: {folder / 'experiment.npz'}")
    print(f"report: {write_report(folder, solution, experiment, manifest)}")
    return 0


def _complete(args: argparse.Namespace) -> None:
    """Fill in what depends on other options. Raises `OptionError`."""
    if args.specimen not in EXTENT:
        raise OptionError(
            f"specimen '{args.specimen}' is none that rigid grips can pull{nearest(args.specimen, EXTENT)}; those are "
            + ", ".join(EXTENT)
        )
    for name, value in (QUICK if args.quick else FULL).items():
        if getattr(args, name) is None:
            setattr(args, name, value)
    if args.displacement is None:
        args.displacement = EXTENT[args.specimen]


def read_material(name: str, parameters: list[str]) -> Material:
    """A material by name and parameters ('mu=0.3'), or from a model file. Raises `OptionError`, `MaterialError`."""
    from forward.materials import MATERIALS, material_from_dict
    from forward.materials.network_energy import Pann

    if name.endswith(".json"):
        if parameters:
            raise OptionError(f"--parameter does not apply to the model file {name}; leave it out")
        return Pann.from_file(name)
    if name not in MATERIALS:
        raise OptionError(
            f"material '{name}' is unknown{nearest(name, MATERIALS)}; choose from {', '.join(MATERIALS)} or a model .json"
        )
    known, values = MATERIALS[name]().to_dict(), {}
    for parameter in parameters:
        key, _, value = parameter.partition("=")
        if key not in known or key == "material":
            names = [k for k in known if k != "material"]
            raise OptionError(f"--parameter {parameter}: {name} has {', '.join(names)}{nearest(key, names)}")
        try:
            values[key] = float(value)
        except ValueError:
            raise OptionError(f"--parameter {parameter}: write NAME=VALUE, such as mu=0.3") from None
    return material_from_dict({"material": name, **values})


def solve(args: argparse.Namespace, material: Material, checkpoint: Any) -> SurfaceSolution:
    """Solve a quarter of the specimen and mirror it."""
    from forward.loading import Loading
    from forward.sheet.plane_stress import solve as solve_plane_stress
    from meshes import quads
    from meshes.specimens import SPECIMENS

    specimen = SPECIMENS[args.specimen]()
    return solve_plane_stress(
        quads(specimen, quarter=True, size_factor=args.size_factor), material,
        Loading.clamped(specimen.loaded, args.displacement), args.increments, args.thickness,
        progress=sys.stderr.isatty(), checkpoint=checkpoint, bulk_modulus=args.bulk_modulus,
    ).mirrored()  # fmt: skip


def camera_from(args: argparse.Namespace) -> Camera:
    """The camera and load cell asked for. Raises `ConfigError`."""
    from studies.synthetic.camera import Camera, GaussianField

    field = GaussianField(args.correlation_length, resolution=512 if args.quick else 2048)
    return Camera(field, relative_noise=args.relative_noise, force_noise=args.force_noise)


def observe(args: argparse.Namespace, solution: SurfaceSolution, mesh: Mesh, camera: Camera) -> Experiment:
    """The Experiment that the camera records of a solution at the nodes of `mesh`."""
    from meshes.specimens import SPECIMENS
    from studies.synthetic.camera import observe as record

    provenance = {"specimen": SPECIMENS[args.specimen]().to_dict(), "solution": solution.description}
    return record(
        solution, mesh, camera, None if args.no_noise else args.seed,
        name=f"{args.specimen}, {args.displacement:g} mm", provenance=json.loads(json.dumps(provenance)),
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
