"""`equigap transfer`: a model of one specimen and a test of another in; how well it predicts, factors, and a map of what differs, out.

Out: ``report.html``, ``transfer.json``, ``errors.csv``, ``stiffness.csv``, the model with its factors as ``model.json``, pictures and a manifest.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from calibrate.data.chosen_pictures import chosen
from calibrate.data.experiment import Experiment
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.models.extended_model import ExtendedModel
from studies.commandline.option_types import OutputFolder, Overwrite, Pictures, Positive, default_folder
from studies.commandline.outcome import Outcome
from studies.output import Manifest, open_output_folder
from studies.reports.alert_table import alert_lines
from studies.transfer import report
from studies.transfer.transferred import Transferred
from studies.transfer.transferred import transfer as transferred


@dataclass(frozen=True)
class TransferOutcome(Outcome):
    """A model on another specimen. folder: with ``model.json``."""

    found: Transferred
    folder: Path
    report: Path

    def lines(self) -> Iterable[str]:
        """The findings and the files."""
        yield from alert_lines(report.findings(self.found))
        yield f"model: {self.folder / 'model.json'}"
        yield f"report: {self.report}"


def transfer(
    model: Path,
    test: Path,
    /,
    *,
    hold_out: str = "every:3",
    spacing: Positive | None = None,
    pictures: Pictures = None,
    output: OutputFolder = None,
    overwrite: Overwrite = False,
) -> TransferOutcome:
    """Predict another specimen of a material, and locate where it differs.

    Effects of the material are carried over. One factor on the stiffness, and one on the relaxation where there is any, are fitted to the forces of the
    increments that are not held out. A map of stiffness is fitted to the virtual fields, and judged by fields that it does not know.

    Args:
        model: model file of `equigap discover`
        test: Experiment of another specimen (.npz)
        hold_out: every:N, after:SECONDS, last[:SHARE] or random[:SHARE]
        spacing: of the virtual fields, mm (default: from the noise)

    Raises:
        ModelFileError: what is no model file of `discover`.
        ConfigError: model, test and rule that do not go together.
        FitError: no force, or no factor that fits it.
        OutputFolderError: the folder holds another run.
    """
    rule = HoldOut.parse(hold_out)
    law, e = ExtendedModel.load(model), chosen(Experiment.load(test), pictures)
    settings = {"command": "transfer", "hold_out": hold_out, "spacing": spacing, "pictures": pictures}
    manifest = Manifest(settings=settings, inputs=[model, test])
    key = {**settings, "inputs": list(manifest.to_dict()["inputs"].values())}
    folder = open_output_folder(output or default_folder("transfer"), overwrite, key)
    found = transferred(e, law, rule, spacing)
    return TransferOutcome(found, folder, report.write(folder, found, manifest))
