"""Options that the commands resolution, thickness and sweep share, and the outcome of such a command."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from calibrate.errors import ConfigError
from studies.commandline.option_types import Count, Integers, Seed, default_folder
from studies.commandline.outcome import Outcome
from studies.grid import study
from studies.grid.axes import LEAST_NODES, Settings
from studies.grid.study import Execution, Preset

ExecutionOptions = Annotated[Execution, Parameter(name="*", group="Where and how it runs")]


@Parameter(name="*", group="Data and network")
@dataclass(frozen=True)
class StudyOptions:
    """What a preset leaves to choose; None and () stand for the preset's own."""

    seeds: Count | None = None
    """number of noise seeds (default: 10)"""
    nodes: Count | None = None
    """nodes of the finest triangulation (default: 9500; thickness: 5000)"""
    inputs: Literal["I1", "I2", "I1I2"] | None = None
    """invariants of the network (default: I1)"""
    layers: Integers = ()
    """neurons of each layer (default: 4,4)"""
    normalisation: Literal["unit-variance", "unit-maximum"] | None = None
    """of the random field (default: unit-variance)"""

    def chosen(self) -> dict[str, Any]:
        """Fields of `Settings` that are given."""
        seeds = None if self.seeds is None else tuple(range(self.seeds))
        values = {"seeds": seeds, "nodes": self.nodes, "inputs": self.inputs, "layers": tuple(self.layers) or None,
                  "normalisation": self.normalisation}  # fmt: skip
        return {name: value for name, value in values.items() if value is not None}

    def settings(self, preset: Preset[Settings], quick: bool = False) -> Settings:
        """Settings of a preset, or of its quick form, with what is given. Raises `ConfigError`."""
        settings = replace(preset.quick if quick else preset.default, **self.chosen())
        if settings.nodes < LEAST_NODES or min(settings.layers) < 1:
            raise ConfigError(f"at least {LEAST_NODES} nodes and one neuron a layer are needed")
        return settings


@Parameter(name="*", group="Data and network")
@dataclass(frozen=True)
class LossOptions(StudyOptions):
    """Those of a study that fits the losses of the paper too."""

    dependent_seeds: Seed | None = None
    """noise seeds that are also fitted with the paper's loss in its dependent scaling by SLSQP on the full data (default: 2;
    thickness: 0)"""

    def chosen(self) -> dict[str, Any]:
        """Fields of `Settings` that are given."""
        own = {} if self.dependent_seeds is None else {"dependent_seeds": self.dependent_seeds}
        return {**super().chosen(), **own}


@dataclass(frozen=True)
class StudyReport(Outcome):
    """A study that is finished. report: its page."""

    report: Path

    def lines(self) -> Iterable[str]:
        """The page."""
        yield f"report: {self.report}"


@dataclass(frozen=True)
class StudyPlan(Outcome):
    """What a dry run finds missing. jobs: their number by rule."""

    settings: Settings
    jobs: dict[str, int]

    def lines(self) -> Iterable[str]:
        """The number of cases, and of jobs of every rule."""
        names = ("specimens", "thicknesses", "resolutions", "noises", "seeds")
        axes = " x ".join(f"{len(getattr(self.settings, name))} {name}" for name in names)
        yield f"{len(self.settings.cases)} cases: {axes} (clean data have no seed)"
        for rule, count in self.jobs.items():
            yield f"{rule:>10}  {count}"
        yield f"{'jobs to do':>10}  {sum(self.jobs.values())}"


@dataclass(frozen=True)
class Target:
    """Where the results of a study go, and whether it is only planned."""

    name: str
    quick: bool = False
    output: Path | None = None
    overwrite: bool = False
    dry_run: bool = False

    @property
    def folder(self) -> Path:
        """As given, or results/NAME."""
        return self.output or default_folder(self.name, self.quick)


def run_study(preset: Preset[Settings], settings: Settings, execution: Execution, target: Target) -> Outcome:
    """Run or resume a study, or count the jobs that are missing. Raises `ConfigError` and what `study.run` raises."""
    if target.dry_run:
        return StudyPlan(settings, study.plan(preset, settings, target.folder, execution, target.overwrite))
    return StudyReport(study.run(preset, settings, target.folder, execution, target.overwrite))
