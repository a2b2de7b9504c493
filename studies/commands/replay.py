"""`equigap replay`: the measured test solved by finite elements with a model.

In: an Experiment and a model file, or a known material. Out: predicted fields and forces beside the measured ones, maps of what is left,
a file for ParaView, a report.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from calibrate.data.chosen_pictures import chosen
from calibrate.data.experiment import Experiment
from calibrate.models.model_file import load_model
from forward.materials import MATERIALS
from studies.commandline.option_types import Assignments, OutputFolder, Overwrite, Pictures, default_folder
from studies.commandline.outcome import Outcome
from studies.commands.simulate import read_material
from studies.errors import OptionError
from studies.output import Manifest, open_output_folder
from studies.replay.model_law import Law, law_of, material_law
from studies.replay.replayed_experiment import Replay
from studies.replay.replayed_experiment import replay as replayed
from studies.replay.report import findings, write_report
from studies.reports.alert_table import alert_lines


@dataclass(frozen=True, eq=False)
class Replayed(Outcome):
    """A finished replay."""

    found: Replay
    report: Path

    def lines(self) -> Iterable[str]:
        """Errors, what they rest on, and the report."""
        yield from alert_lines(findings(self.found))
        yield f"report: {self.report}"


def replay(
    experiment: Path,
    model: str,
    /,
    *,
    parameter: Assignments = (),
    skip_mesh_check: bool = False,
    pictures: Pictures = None,
    output: OutputFolder = None,
    overwrite: Overwrite = False,
) -> Replayed:
    """Solve a measured test by finite elements with a model, and compare fields and forces.

    The outline is that of the camera's points. Loaded edges and unmeasured rims move as measured; free edges are free. Forces are compared at the
    pictures, and over the whole machine record where the test has one. Lengths in mm, forces in N.

    Args:
        model: model file of `equigap calibrate` or `discover`, or a material of `equigap simulate`
        parameter: of that material, such as mu=0.3 (in MPa, in N/mm where the test has no thickness); may be repeated
        skip_mesh_check: do not solve the last increment on four times as many elements as well, to use these where they matter

    Raises:
        ConfigError: model and test do not go together.
        OptionError: an effect that the forward model has no law for.
        LoadingError, ConvergenceError: no equilibrium; the checkpoint in the folder is gone on from.
    """
    test = chosen(Experiment.load(experiment), pictures)
    law = read_law(model, dict(parameter), test)
    is_file = Path(model).suffix == ".json"
    settings = {
        "command": "replay",
        "parameter": dict(parameter),
        "skip_mesh_check": skip_mesh_check,
        "pictures": pictures,
    }
    manifest = Manifest(settings=settings, inputs=[experiment, *([Path(model)] if is_file else [])])
    key = {**settings, "model": None if is_file else model, "inputs": list(manifest.to_dict()["inputs"].values())}
    folder = open_output_folder(output or default_folder("replay"), overwrite, key)
    checkpoint = folder / "solution.checkpoint.npz"
    found = replayed(test, law, checkpoint, not skip_mesh_check, sys.stderr.isatty())
    report = write_report(folder, found, manifest)
    checkpoint.unlink(missing_ok=True)
    return Replayed(found, report)


def read_law(model: str, parameters: dict[str, float], test: Experiment) -> Law:
    """The law of a model file or of a known material. Raises `OptionError`, `ConfigError`, `ModelFileError`."""
    if Path(model).suffix != ".json":
        if model in MATERIALS and not parameters:
            raise OptionError(
                f"no parameter of {model} is stated; give those of your material in {test.stress_unit} with --parameter, such as mu=0.3, or a model file"
            )
        return material_law(read_material(model, parameters), model.replace("_", "-"), test)
    if parameters:
        raise OptionError(f"--parameter does not apply to the model file {model}; leave it out")
    return law_of(load_model(Path(model)), test)
