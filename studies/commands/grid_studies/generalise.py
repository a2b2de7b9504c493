"""`equigap generalise`: which specimens, which invariants and how large a network make a model predict other tests?

In: command-line options. Out: a folder with every calibration of the study, figures, tables, report.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from studies.commandline.option_types import Count, OutputFolder, Overwrite
from studies.commandline.outcome import Outcome
from studies.errors import OptionError
from studies.grid import study
from studies.grid.generalise.generalise_study import GENERALISE
from studies.grid.generalise.generalise_study import measured as of_measured
from studies.grid.study import Execution
from studies.grid.study_options import ExecutionOptions, StudyReport, Target
from studies.importers import abbasi_sheets


@dataclass(frozen=True)
class PlannedJobs(Outcome):
    """What a dry run finds missing. jobs: their number by rule."""

    jobs: dict[str, int]

    def lines(self) -> Iterable[str]:
        """The number of jobs of every rule."""
        for rule, count in self.jobs.items():
            yield f"{rule:>10}  {count}"
        yield f"jobs to do  {sum(self.jobs.values())}"


def generalise(
    *,
    quick: bool = False,
    seeds: Count | None = None,
    starts: Count | None = None,
    measured: bool = False,
    dry_run: bool = False,
    execution: ExecutionOptions = Execution(),
    output: OutputFolder = None,
    overwrite: Overwrite = False,
) -> Outcome:
    """Study which specimens, invariants and sizes of network predict the reaction forces of other specimens.

    Eight sheets and a cross in plane stress, alone and combined, in two rubbers; three sets of invariants, five sizes.

    Args:
        quick: 4 sets of tests, one rubber, one noise seed: shows the path, proves nothing
        seeds: number of noise seeds (default: 5)
        starts: starts of each network (default: 5)
        measured: the measured sheets of EQUIGAP_DATA/abbasi2026 instead (docs/generalise.md)
        dry_run: only say how many jobs are missing; makes no file

    Raises:
        DataNotFoundError: measured sheets that are not there.
        OptionError: --seeds where nothing is simulated.
        WorkflowError: a job failed.
    """
    if measured and seeds is not None:
        raise OptionError("--seeds are of simulated noise, which --measured has not; leave --seeds out")
    target = Target("generalise-measured" if measured else "generalise", quick, output, overwrite, dry_run)
    settings = GENERALISE.quick if quick else GENERALISE.default
    if seeds is not None:
        settings = replace(settings, seeds=tuple(range(seeds)))
    if starts is not None:
        settings = replace(settings, starts=starts)
    if measured:
        settings = of_measured(settings, abbasi_sheets.names())
    if dry_run:
        return PlannedJobs(study.plan(GENERALISE, settings, target.folder, execution, overwrite))
    return StudyReport(study.run(GENERALISE, settings, target.folder, execution, overwrite))
