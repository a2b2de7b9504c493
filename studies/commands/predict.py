"""`equigap predict`: uniaxial, equi-biaxial and pure-shear curves of a calibrated model.

In: a model file. Out: a table of nominal stress against stretch with 95 % bands where the model file holds an uncertainty,
a figure with the calibrated range marked, a report and a manifest.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from studies.commands.options import add_output, assignments, count, output_folder, settings
from studies.errors import OptionError

DESCRIPTION = """\
Predict the nominal stress (force over reference area) of the three homogeneous tests at a sheet's stretches:
uniaxial, equi-biaxial and pure shear. In MPa, or in N/mm (stress times thickness) where the thickness of the
calibrated sheet was unknown. What lies beyond the calibrated range is marked: there the model extrapolates.
The table gives the standard deviation and a 95 % band of each stress.
With --test: the forces of another test instead, from its measured displacements; also for extended models of `discover`."""
LARGEST = 20.0  # stretch


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `equigap predict`."""
    parser.add_argument(
        "model", type=Path, metavar="MODEL.json", help="model file of `equigap calibrate` or `discover`"
    )
    parser.add_argument(
        "--test", type=Path, metavar="EXPERIMENT.npz", help="predict the forces of this test instead of curves"
    )
    parser.add_argument(
        "--stretch", type=_stretch, metavar="X", help="largest stretch (default: a quarter beyond the calibrated range)"
    )
    parser.add_argument("--points", type=count, default=101, metavar="N", help="stretches a curve (%(default)s)")
    parser.add_argument(
        "--against", metavar="MATERIAL",
        help="draw a known material beside it: arruda_boyce, neo_hooke, mooney_rivlin, yeoh (as `simulate`)",
    )  # fmt: skip
    parser.add_argument(
        "--parameter", action="append", default=[], metavar="NAME=VALUE", help="of that material, such as mu=0.3"
    )
    add_output(parser, "predict")


def main(args: argparse.Namespace) -> int:
    """Write table, figure, report and manifest. Raises `ModelFileError`, `OptionError`, `OutputFolderError`."""
    if args.parameter and not args.against:
        raise OptionError("--parameter belongs to --against MATERIAL; name the material")
    if args.test is None:
        return _curves(args)
    if args.against or args.stretch:
        raise OptionError("--against and --stretch belong to curves; leave them out where --test is given")
    return _forces(args)


def _curves(args: argparse.Namespace) -> int:
    from calibrate.models.network_model import Model
    from studies.output import Manifest, open_output_folder
    from studies.reports.prediction.predicted_curves import findings, predict
    from studies.reports.prediction.report import write_curves

    model = Model.load(args.model)
    manifest = Manifest(settings=settings(args, "model"), inputs=[args.model])
    key = {**settings(args, "model"), "model": list(manifest.to_dict()["inputs"].values())}
    curves = predict(model, args.stretch, args.points, _truth(args))
    folder = open_output_folder(output_folder(args, "predict"), args.overwrite, key)
    report = write_curves(folder, model, curves, manifest, args.against)
    for finding in findings(model, curves):
        print(f"- {finding.text}")
    print(f"curves: {folder / 'curves.csv'}\nreport: {report}")
    return 0


def _forces(args: argparse.Namespace) -> int:
    from calibrate.data.experiment import Experiment
    from studies.output import Manifest, open_output_folder
    from studies.reports.prediction.predicted_forces import forecast
    from studies.reports.prediction.report import write_forces

    found = forecast(args.model, Experiment.load(args.test))
    manifest = Manifest(settings=settings(args, "model", "test"), inputs=[args.model, args.test])
    key = {**settings(args, "model", "test"), "inputs": list(manifest.to_dict()["inputs"].values())}
    folder = open_output_folder(output_folder(args, "predict"), args.overwrite, key)
    report = write_forces(folder, found, manifest)
    for finding in found.findings:
        print(f"- {finding.text}")
    print(f"forces: {folder / 'forces.csv'}\nreport: {report}")
    return 0


def _stretch(text: str) -> float:
    value = float(text)
    if not 1 < value <= LARGEST:
        raise argparse.ArgumentTypeError(f"'{text}' must be a stretch above 1 and at most {LARGEST:g}")
    return value


def _truth(args: argparse.Namespace) -> Any:
    """d psi / d(I1, I2) of the material to compare with, or None."""
    if args.against is None:
        return None
    import jax
    import jax.numpy as jnp

    from studies.commands.simulate import read_material

    material = read_material(args.against, assignments(args.parameter))
    slope = jax.vmap(jax.grad(lambda invariants: jnp.asarray(material.energy(invariants[0], invariants[1]))))
    return lambda invariants: slope(jnp.asarray(invariants))
