"""`equigap measured`: the loop closed on measured data; nothing but the data in, one report with its numbers out.

Out: ``report.html``, ``measured.json`` (every number), ``errors.csv``, ``effects.csv``, ``sections.csv``,
``homogeneous.csv``, ``control.csv``, a model file of every sheet learnt on (`equigap predict`), pictures and a manifest. Every step is kept in ``steps/`` and not made again.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import jax
import numpy as np
from cyclopts import Parameter

from calibrate.data.experiment import Experiment
from studies.commandline.option_types import Count, OutputFolder, Overwrite, Positive, default_folder
from studies.commandline.outcome import Outcome
from studies.commands.discover import Stages
from studies.commands.import_data import Frames, NoiseChoice, import_experiment
from studies.importers import measured_data
from studies.output import Manifest, open_output_folder
from studies.output.writing import write_json
from studies.sheets import measured_control, measured_loop
from studies.sheets.homogeneous import measured_homogeneous
from studies.sheets.homogeneous.homogeneous_loops import Loop, loops
from studies.sheets.measured_map import stiffness_map
from studies.sheets.measured_record import MANY, SHEETS, record
from studies.sheets.measured_results import (
    ControlResult,
    HomogeneousResult,
    MapResult,
    MeasuredResults,
    RecordResult,
    RivalResult,
)
from studies.sheets.measured_transfer import transfer
from studies.sheets.report import write
from studies.sheets.sheet_results import NamedModel, SheetResult, StepResult, TransferResult

FIRST, SECOND, HETERO = SHEETS
FINE, CELL = 5.0, 3.5  # mm: virtual fields and grid of the map of stiffness
LOCAL_FRAMES, COMPARED, QUICK_FRAMES = 12, 14, 15


@Parameter(name="*", group="Sheets")
@dataclass(frozen=True)
class SheetStudy:
    """What is used of every sheet."""

    until: Positive = 15.0
    """fitted up to then, scored after, s"""
    frames: Count = 24
    """of each sheet; with --quick 15"""
    spacing: Positive = 12.0
    """of the virtual fields, mm"""


@dataclass(frozen=True)
class Measured(Outcome):
    """A finished study. answer: its findings in words."""

    answer: str
    report: Path

    def lines(self) -> Iterable[str]:
        """The findings and the report."""
        yield self.answer
        yield f"report: {self.report}"


def measured(
    *,
    sheets: SheetStudy = SheetStudy(),
    quick: bool = False,
    output: OutputFolder = None,
    overwrite: Overwrite = False,
) -> Measured:
    """What measured sheets and measured homogeneous tests do beyond a hyperelastic model of I1.

    Learns on Soft_Homo, transfers that to Stiff2_Homo with one factor refitted, learns on Stiff2_Homo alone for comparison,
    locates what differs in Stiff2_Hetero; runs the loops of Treloar, Kawabata and HNBR50; and looks for effects where there can
    be none. Takes about three quarters of an hour on one core; a stopped run goes on where it was.

    Args:
        quick: the sheets alone, with 15 frames

    Raises:
        DataNotFoundError: a sheet is neither there nor to be fetched.
        EquigapError: an Experiment that cannot be.
    """
    started = time.time()
    sources = [measured_data.sheet(name) for name in SHEETS]  # before anything is made: are the data there?
    key = dict(sorted({"command": "measured", **asdict(sheets), "quick": quick}.items()))
    folder = open_output_folder(output or default_folder("measured", quick), overwrite, {"study": "measured", **key})
    manifest = Manifest(0, key, sources, started)
    with Stages() as say:
        results = Steps(folder, sheets, quick, say).all()
        say("writing the report")
        report, answer = write(folder, results, manifest)
    return Measured(answer, report)


class Steps:
    """The steps of the study; each returns a `StepResult`, kept as JSON under ``steps/``."""

    def __init__(self, folder: Path, options: SheetStudy, quick: bool, say: Callable[[str], None]) -> None:
        self.folder, self.options, self.quick, self.say = folder, options, quick, say
        self.frames = QUICK_FRAMES if quick else options.frames
        self._sheets: dict[str, Experiment] = {}

    def all(self) -> MeasuredResults:
        """Every step's result."""
        records = {name: self.step(f"record_{name}", RecordResult, partial(self.record, name)) for name in SHEETS}
        first = self.step("first", SheetResult, lambda: self.learn(FIRST))
        rivals = self.step("rivals", RivalResult, lambda: self.rivals(first))
        second = self.step("second", TransferResult, lambda: self.transfer(SECOND, first.named))
        own = self.step("own", SheetResult, lambda: self.learn(SECOND))
        hetero = self.step("hetero", TransferResult, lambda: self.transfer(HETERO, second.named))
        located = self.step("map", MapResult, lambda: self.locate(hetero))
        controls = {name: self.step(f"control_{name}", ControlResult, partial(self.control, name)) for name in SHEETS}
        return MeasuredResults(records, first, rivals, second, own, hetero, located, controls, self.loops())

    def loops(self) -> list[HomogeneousResult]:
        """Results of the homogeneous tests; none of a quick run."""
        if self.quick:
            return []
        return [self.step(f"loop_{loop.name}", HomogeneousResult, partial(self.homogeneous, loop)) for loop in loops()]

    def step[R: StepResult](self, name: str, kind: type[R], make: Callable[[], R]) -> R:
        """The result kept from an earlier run, or a new one."""
        path = self.folder / "steps" / f"{name}.json"
        if not path.exists():
            self.say(name.replace("_", " "))
            began = time.monotonic()
            result = make()
            write_json(path, replace(result, seconds=round(time.monotonic() - began, 1)).to_dict())
            jax.clear_caches()  # compiled code of all steps together takes more memory maps than a process may have
        return kind.from_dict(json.loads(path.read_text()))

    def sheet(self, name: str) -> Experiment:
        """The sheet with its increments."""
        if name not in self._sheets:
            self._sheets[name] = import_experiment(name, frames=Frames(self.frames))
        return self._sheets[name]

    def record(self, name: str) -> RecordResult:
        """What the record of a sheet says, see `measured_record.record`."""
        return record(name, self.sheet(name), import_experiment(name, frames=Frames(MANY)))

    def learn(self, name: str) -> SheetResult:
        """What a sheet does beyond hyperelasticity, see `measured_loop.learn`."""
        return measured_loop.learn(self.sheet(name), self.options.until, self.options.spacing, self.say)

    def rivals(self, learnt: SheetResult) -> RivalResult:
        """Softening against relaxation on the first sheet, see `measured_loop.rivals`."""
        return measured_loop.rivals(self.sheet(FIRST), learnt, self.options.until, self.options.spacing, self.say)

    def transfer(self, name: str, models: Sequence[NamedModel]) -> TransferResult:
        """Models of another sheet on this one, see `measured_transfer.transfer`."""
        return transfer(self.sheet(name), models, self.options.until, self.options.spacing)

    def locate(self, transferred: TransferResult) -> MapResult:
        """Where the heterogeneous sheet differs from what was transferred to it, see `measured_map.stiffness_map`."""
        e = import_experiment(HETERO, frames=Frames(LOCAL_FRAMES))
        return stiffness_map(e, transferred.final.models, self.options.until, FINE, CELL)

    def control(self, name: str) -> ControlResult:
        """Negative control on a sheet, see `measured_control.split_half`."""
        return measured_control.split_half(neighbouring_pictures(name, COMPARED), self.options.spacing)

    def homogeneous(self, loop: Loop) -> HomogeneousResult:
        """A loop on homogeneous tests, see `measured_homogeneous.close`."""
        return measured_homogeneous.close(loop, self.say)


def neighbouring_pictures(name: str, count: int) -> Experiment:
    """A published sheet as groups of frames, with the noise from picture to picture."""
    temporal = NoiseChoice("temporal")
    everything = import_experiment(name, frames=Frames(1000000), noise=temporal)  # every frame under load
    frames = np.array(everything.provenance["frames"])
    assert everything.time is not None
    chosen = tuple(int(frames[i]) for i in measured_control.groups(everything.time, count))
    return import_experiment(name, frames=Frames(chosen), noise=temporal)
