"""`equigap homogeneous`: a measured stress-stretch curve to an Experiment, by name or from a CSV; with a figure and a report."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from calibrate.data.experiment import Experiment
from calibrate.errors import ConfigError
from studies.commandline.option_types import OutputFolder, Overwrite, default_folder, nearest
from studies.commandline.outcome import Outcome
from studies.output import Manifest, open_output_folder
from studies.sheets.homogeneous.homogeneous_experiments import EXPERIMENTS, from_file
from studies.sheets.homogeneous.homogeneous_report import write_report

SOURCE = "a .csv with the columns stretch, stress (time) or lambda1, lambda2, P1_MPa, P2_MPa, or one of: " + ", ".join(
    EXPERIMENTS
)


@dataclass(frozen=True)
class HomogeneousTest(Outcome):
    """A homogeneous test that was read. path: of the Experiment."""

    experiment: Experiment
    path: Path
    report: Path

    def lines(self) -> Iterable[str]:
        """Files, and how many increments there are."""
        yield f"experiment: {self.path} ({self.experiment.n_increments} increments)"
        yield f"report: {self.report}"


def homogeneous(
    source: Annotated[str, Parameter(help=SOURCE)],
    /,
    *,
    mode: Literal["uniaxial", "equibiaxial", "pure_shear"] = "uniaxial",
    output: OutputFolder = None,
    overwrite: Overwrite = False,
) -> HomogeneousTest:
    """Write homogeneous tests (stress and stretch) as Experiments, for `equigap calibrate`.

    The sheet is 10 mm x 1 mm in cross-section. Noise is estimated from the scatter of the curve. The folder is
    results/homogeneous-NAME unless told.

    Args:
        mode: of a .csv

    Raises:
        ConfigError: unknown test.
        DataNotFoundError: its data are not there.
    """
    experiment = read(source, mode)
    key = {"command": "homogeneous", "source": source, "mode": mode}
    folder = open_output_folder(output or default_folder(f"homogeneous-{Path(source).stem}"), overwrite, key)
    manifest = Manifest(settings=key)
    path = folder / "experiment.npz"
    experiment.save(path)
    report = write_report(experiment, folder, manifest)
    manifest.beside(path, folder / "curve.png", increments=experiment.n_increments, **experiment.provenance)
    return HomogeneousTest(experiment, path, report)


def read(source: str, mode: str = "uniaxial") -> Experiment:
    """The Experiment of a named test or a .csv of `mode`. Raises `ConfigError`, `DataNotFoundError`."""
    if source in EXPERIMENTS:
        return EXPERIMENTS[source]()
    if source.endswith(".csv"):
        return from_file(source, mode)
    raise ConfigError(
        f"test '{source}' unknown{nearest(source, EXPERIMENTS)}; give a .csv or one of {', '.join(EXPERIMENTS)}"
    )
