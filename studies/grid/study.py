"""A study from its settings to its report: a `Preset` and a folder in, the path of ``report.html`` out.

The cases are jobs of the workflow `grid.smk`; a killed run resumes where it was.
"""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

from studies.commandline.option_types import Count
from studies.errors import OptionError
from studies.grid import report, workflow
from studies.grid.report import Page
from studies.grid.results import Results
from studies.output import open_output_folder

SNAKEFILE = Path(__file__).with_name("grid.smk")


class StudySettings(Protocol):
    """What a workflow asks of its settings, a dataclass. study: its name."""

    @property
    def study(self) -> str: ...

    @property
    def seeds(self) -> tuple[int, ...]: ...

    def targets(self, folder: Path) -> list[Path]:
        """Every file that the report needs."""
        ...


@dataclass(frozen=True)
class Preset[S: StudySettings]:
    """A study. default, quick: settings; quick shows the path and proves nothing. page: what its report shows.

    results: of a folder and its settings, which the page takes; snakefile: the workflow that makes them.
    """

    default: S
    quick: S
    page: Callable[[Any], Page]
    results: Callable[[Path, Any], Any] = Results
    snakefile: Path = SNAKEFILE

    @property
    def name(self) -> str:
        """As in `equigap NAME`."""
        return self.default.study


@dataclass(frozen=True)
class Execution:
    """Where and how many jobs run; it changes no result."""

    jobs: Count | None = None
    """jobs at a time (default: number of cores, or what the profile says)"""
    profile: Path | None = None
    """folder of a Snakemake profile that submits the jobs, e.g. to SLURM: docs/cluster.md"""
    ranks: Count = 1
    """MPI ranks of each 3D solution"""
    container: str | None = None
    """run every job by Apptainer in this image, such as equigap.sif: docker/README.md"""

    def config(self, folder: Path) -> tuple[list[str], list[str]]:
        """'key=value' for the snakefile and options of Snakemake. Raises `ConfigError`, `OptionError`."""
        workflow.check(self.jobs, self.profile)
        own = [f"ranks={self.ranks}"]
        image = self.container
        if image is None:
            return own, []
        if not shutil.which("apptainer") and not shutil.which("singularity"):
            raise OptionError(f"--container {image}: needs the program apptainer; install it, or leave --container out")
        if "://" not in image:
            if not Path(image).is_file():
                raise OptionError(f"--container {image}: no such file; docker/README.md says how the image is built")
            image = str(Path(image).resolve())
        bind = f"--bind {shlex.quote(str(folder.resolve()))}"
        return [*own, f"container={image}"], ["--software-deployment-method", "apptainer", "--apptainer-args", bind]


def open_study(folder: Path, settings: Any, overwrite: bool = False) -> Path:
    """The output folder of a study, new or resumed. Raises `OutputFolderError`."""
    return open_output_folder(folder, overwrite, asdict(settings))


def run[S: StudySettings](
    preset: Preset[S], settings: S, folder: Path, execution: Execution = Execution(), overwrite: bool = False
) -> Path:
    """Run or resume a study and write its report; returns the path of that. Raises `WorkflowError`, `OutputFolderError`."""
    config, words = execution.config(folder)
    folder = open_study(folder, settings, overwrite)
    name, targets = f"{settings.study} study", settings.targets(folder)
    workflow.run_workflow(name, preset.snakefile, folder, targets, execution.jobs, execution.profile, config, words)
    results = preset.results(folder, settings)
    return report.write(results, preset.page(results))


def plan[S: StudySettings](
    preset: Preset[S], settings: S, folder: Path, execution: Execution = Execution(), overwrite: bool = False
) -> dict[str, int]:
    """Jobs of each kind that are missing in `folder`, which is left as it is: one to be begun is planned elsewhere."""
    config, words = execution.config(folder)
    begun = folder.exists() and (not folder.is_dir() or any(folder.iterdir())) and not overwrite
    with TemporaryDirectory() as elsewhere:
        place = open_study(folder if begun else Path(elsewhere), settings)
        return workflow.plan(preset.snakefile, place, execution.jobs, execution.profile, config, words)
