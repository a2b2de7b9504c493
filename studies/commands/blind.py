"""`equigap blind`: does the diagnosis find what is hidden, and nothing where nothing is?

In: numbers of trials. Out: a folder with every trial, its diagnosis and label, tables, confusion matrix, report. Trials are
independent; a killed run goes on with those that are not there yet, on another machine with ``--known trials.json`` of the first.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from cyclopts import Parameter

from studies.commandline.option_types import Count, Names, NonNegative, OutputFolder, Overwrite, Seed, default_folder
from studies.commandline.outcome import Outcome
from studies.errors import OptionError, StudyError
from studies.output.folder import open_output_folder
from studies.output.manifest import Manifest
from studies.trials.blind_case import Plan, run
from studies.trials.blind_plans import QUICK, Numbers, in_order_of_size, plans, read_known
from studies.trials.blind_report import write_report
from studies.trials.blind_workers import make_missing

MOST_FAILURES = 0.1  # share of the trials


@Parameter(name="*", group="Trials")
@dataclass(frozen=True)
class Trials:
    """How many are made, and of what."""

    trials: NonNegative | None = None
    """for each effect (default: 20; quick: 1)"""
    nulls: NonNegative | None = None
    """without an effect (default: 100; quick: 2)"""
    pairs: NonNegative | None = None
    """with two effects (default: 20; quick: 1)"""
    only: Names = ()
    """effects to hide, with commas between (default: all that can be found)"""
    seed: Seed = 20000
    """of the first trial"""
    foreign: bool = False
    """hide forms that the catalogue does not have (docs/discover_results.md), in noise that is not what is stated"""

    def numbers(self, quick: bool = False) -> Numbers:
        """Those given, and the usual ones for the others. Raises `ConfigError`."""
        given = {name: n for name in ("trials", "nulls", "pairs") if (n := getattr(self, name)) is not None}
        return replace(QUICK if quick else Numbers(), **given)

    def plans(self, quick: bool = False) -> list[Plan]:
        """All of them. Raises `ConfigError`."""
        return plans(self.numbers(quick), self.only, self.seed, self.foreign)


@dataclass(frozen=True)
class BlindTrials(Outcome):
    """Trials that are judged. finished: of `total`; answer: the rates in words; failures: {trial: error}."""

    total: int
    finished: int
    answer: str
    failures: Mapping[str, str]

    def lines(self) -> Iterable[str]:
        """How many are finished, unless all are, and the rates."""
        if self.finished < self.total:
            yield f"{self.finished} of {self.total} trials"
        yield self.answer

    def failure(self) -> StudyError | None:
        """Where more than a tenth of the trials failed."""
        if len(self.failures) <= MOST_FAILURES * self.total:
            return None
        first = next(iter(self.failures.items()))
        return StudyError(f"{len(self.failures)} of {self.total} trials failed, first: {first}")


def blind(
    *,
    trials: Trials = Trials(),
    quick: bool = False,
    jobs: Count = os.cpu_count() or 1,
    known: Path | None = None,
    report: bool = False,
    output: OutputFolder = None,
    overwrite: Overwrite = False,
) -> BlindTrials:
    """Blind trials of `equigap discover`.

    A seed draws specimen, base material, one hidden effect or none, amplitude and noise; the diagnosis sees the Experiment alone.
    Writes every trial and the confusion matrix.

    Args:
        quick: one trial an effect, two without, one with two effects, unless told otherwise: shows the path
        jobs: trials side by side
        known: trials.json of an earlier run, whose trials are not made again
        report: only write the report, of the trials that are there

    Raises:
        ConfigError: numbers or effects that cannot be.
        OptionError: --report with --overwrite.
        StudyError: --report finds no trial, workers are killed again and again, --known is no file of this run.
    """
    if report and overwrite:
        raise OptionError("--overwrite deletes the trials that --report is about; leave one of them out")
    todo = trials.plans(quick)
    settings = {
        **asdict(trials),
        **asdict(trials.numbers(quick)),
        "only": ",".join(trials.only) or None,
        "quick": quick,
    }
    key = {"study": "blind", **settings}
    folder = open_output_folder(output or default_folder("blind", quick), overwrite, key)
    manifest = Manifest(seed=trials.seed, settings=key, inputs=[known] if known else [])
    home = folder / "trials"
    home.mkdir(parents=True, exist_ok=True)
    earlier = read_known(known, todo)

    def missing() -> list[Plan]:
        left = [p for p in todo if p.name not in earlier and not (home / p.name / "diagnosis.json").exists()]
        return in_order_of_size(left)

    if report and len(missing()) == len(todo):
        raise StudyError(f"{folder}: no trial is there yet; run the same command without --report first")
    failures = {} if report else make_missing(run, home, jobs, len(todo), missing, "blind trials")
    homes = [home / plan.name for plan in todo if plan.name not in failures]
    answer = write_report(folder, homes, failures, manifest, earlier)
    return BlindTrials(len(todo), len(todo) - len(missing()), answer, failures)
