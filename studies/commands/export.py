"""`equigap export`: a model file or a classical law in, a file for another program out.

Every file states in its header which data and range the law comes from, and the largest error of energy, stress and tangent of the
written code against the model at random states inside that range.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from calibrate.models.model_file import load_model
from forward.materials import MATERIALS
from studies.commandline.option_types import Assignments, OutputFolder, Overwrite, Positive, default_folder
from studies.commandline.outcome import Outcome
from studies.commands.simulate import read_material
from studies.exporters import target_named, targets
from studies.exporters.certificate import Errors
from studies.exporters.material_law import law_of
from studies.output import Manifest, open_output_folder
from studies.output.findings import Finding
from studies.output.manifest import sha256_of
from studies.output.words import Words
from studies.output.writing import write_text
from studies.reports.alert_table import alert_lines
from studies.reports.model_remarks import remarks_of_file

WORDS = Words("export")


@dataclass(frozen=True)
class Exported(Outcome):
    """A written file. errors: of its code against the model, None where it could not be run here. defaults: parameters of a classical law that nobody gave."""

    file: Path
    left_out: tuple[str, ...]
    errors: Errors | None
    remarks: tuple[Finding, ...] = ()
    defaults: str = ""

    def lines(self) -> Iterable[str]:
        """What the model file says of itself, the error, what was left out, and the file."""
        yield from alert_lines(self.remarks)
        if self.defaults:
            yield f"not given, so the default: {self.defaults}"
        yield WORDS.accuracy(errors=self.errors)
        if self.left_out:
            yield WORDS.left_out(names=self.left_out)
        yield f"written: {self.file}"


def export(
    model: Annotated[
        str, Parameter(help=f"model file of `calibrate` or `discover`, or a classical law: {', '.join(MATERIALS)}")
    ],
    /,
    *,
    to: Annotated[str, Parameter(help="target: " + "; ".join(f"{t.name}: {t.summary}" for t in targets().values()))],
    parameter: Assignments = (),
    bulk_modulus: Positive | None = None,
    output: OutputFolder = None,
    overwrite: Overwrite = False,
) -> Exported:
    """Write a model as a law for another program.

    Effects of camera, load cell and specimen are left out, and the file says so.

    Args:
        parameter: of a classical law, such as mu=0.3; may be repeated
        bulk_modulus: MPa (N/mm) of nearly incompressible elements (default: 1000 shear moduli), where the test identified none

    Raises:
        ExportError: what the target cannot carry, by name.
        ModelFileError: what is no model file.
        OptionError: options that do not go together.
        OutputFolderError: the folder holds another run.
    """
    target, is_file = target_named(to), model.endswith(".json")
    found = load_model(model) if is_file and not parameter else read_material(model, dict(parameter))
    title = f"{Path(model).name}, SHA-256 {sha256_of(model)[:16]}" if is_file else model
    settings = {
        "command": "export",
        "to": to,
        "parameters": dict(parameter),
        "bulk_modulus": bulk_modulus,
        "model": title,
    }
    manifest = Manifest(settings=settings, inputs=[model] if is_file else [])
    law = law_of(found, title)
    written = target.export(law, bulk_modulus)
    folder = open_output_folder(output or default_folder("export"), overwrite, settings)
    file = folder / target.file_name
    write_text(file, written.text)
    manifest.beside(
        file, left_out=law.left_out, largest_stretches=law.valid, errors=written.errors and asdict(written.errors)
    )
    remarks = tuple(remarks_of_file(model)) if is_file and not parameter else ()
    defaults = "" if is_file else _defaults(found, dict(parameter))
    return Exported(file, law.left_out, written.errors, remarks, defaults)


def _defaults(material: Any, given: dict[str, float]) -> str:
    """'mu = 0.3' of parameters that were not given."""
    own = {key: value for key, value in material.to_dict().items() if key != "material" and key not in given}
    return ", ".join(f"{key} = {value:g}" for key, value in own.items() if isinstance(value, (int, float)))
