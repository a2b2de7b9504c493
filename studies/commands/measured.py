"""`equigap measured`: the loop closed on measured data; nothing but the data in, one report with its numbers out.

Out: ``report.html``, ``measured.json`` (every number), ``errors.csv``, ``effects.csv``, ``sections.csv``,
``homogeneous.csv``, ``control.csv``, a model file of every sheet learnt on (`equigap predict`), pictures and a manifest. Every step is kept in ``steps/`` and not made again.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from studies.commands.options import add_output, count, output_folder, positive, settings
from studies.sheets.measured_record import MANY, SHEETS, record
from studies.sheets.measured_results import (
    ControlResult,
    HomogeneousResult,
    MapResult,
    MeasuredResults,
    RecordResult,
    RivalResult,
)
from studies.sheets.sheet_results import NamedModel, SheetResult, StepResult, TransferResult

if TYPE_CHECKING:
    from calibrate.data.experiment import Experiment
    from studies.sheets.homogeneous.homogeneous_loops import Loop

DESCRIPTION = """\
What measured sheets and measured homogeneous tests do beyond a hyperelastic model of I1. Learns on Soft_Homo, transfers
that to Stiff2_Homo with one factor refitted, learns on Stiff2_Homo alone for comparison, locates what differs in
Stiff2_Hetero; runs the loops of Treloar, Kawabata and HNBR50; and looks for effects where there can be none. Takes about
three quarters of an hour on one core; a stopped run goes on where it was."""
FIRST, SECOND, HETERO = SHEETS
FINE, CELL = 5.0, 3.5  # mm: virtual fields and grid of the map of stiffness
LOCAL_FRAMES, COMPARED = 12, 14


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `equigap measured`."""
    parser.add_argument(
        "--until", type=positive, default=15.0, metavar="S", help="fitted up to then, scored after (15)"
    )
    parser.add_argument("--frames", type=count, default=24, help="of each sheet (default: %(default)s)")
    parser.add_argument(
        "--spacing", type=positive, default=12.0, metavar="MM", help="of the virtual fields on the sheets (12)"
    )
    parser.add_argument("--quick", action="store_true", help="the sheets alone, with 15 frames")
    add_output(parser, "measured")


def main(args: argparse.Namespace) -> int:
    """Run every step that is not there yet, write the report. Raises `DataNotFoundError` and errors of an Experiment."""
    from studies.commands.discover import Stages
    from studies.importers import measured_data
    from studies.output import Manifest, open_output_folder
    from studies.sheets.report import write

    started = time.time()
    sources = [measured_data.sheet(name) for name in SHEETS]  # before anything is made: are the data there?
    key = settings(args)
    folder = open_output_folder(output_folder(args, "measured"), args.overwrite, {"study": "measured", **key})
    manifest = Manifest(0, key, sources, started)
    with Stages() as say:
        results = Steps(folder, args, say).all()
        say("writing the report")
        report, answer = write(folder, results, manifest)
    print(f"{answer}\nreport: {report}")
    return 0


class Steps:
    """The steps of the study; each returns a `StepResult`, kept as JSON under ``steps/``."""

    def __init__(self, folder: Path, args: argparse.Namespace, say: Callable[[str], None]) -> None:
        self.folder, self.args, self.say = folder, args, say
        self.frames = 15 if args.quick else args.frames
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
        if self.args.quick:
            return []
        from studies.sheets.homogeneous.homogeneous_loops import loops

        return [self.step(f"loop_{loop.name}", HomogeneousResult, partial(self.homogeneous, loop)) for loop in loops()]

    def step[R: StepResult](self, name: str, kind: type[R], make: Callable[[], R]) -> R:
        """The result kept from an earlier run, or a new one."""
        import jax

        from studies.output.writing import write_json

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
        from studies.commands.import_data import Frames, import_experiment

        if name not in self._sheets:
            self._sheets[name] = import_experiment(name, frames=Frames(self.frames))
        return self._sheets[name]

    def record(self, name: str) -> RecordResult:
        """What the record of a sheet says, see `measured_record.record`."""
        from studies.commands.import_data import Frames, import_experiment

        return record(name, self.sheet(name), import_experiment(name, frames=Frames(MANY)))

    def learn(self, name: str) -> SheetResult:
        """What a sheet does beyond hyperelasticity, see `measured_loop.learn`."""
        from studies.sheets.measured_loop import learn

        return learn(self.sheet(name), self.args.until, self.args.spacing, self.say)

    def rivals(self, learnt: SheetResult) -> RivalResult:
        """Softening against relaxation on the first sheet, see `measured_loop.rivals`."""
        from studies.sheets.measured_loop import rivals

        return rivals(self.sheet(FIRST), learnt, self.args.until, self.args.spacing, self.say)

    def transfer(self, name: str, models: Sequence[NamedModel]) -> TransferResult:
        """Models of another sheet on this one, see `measured_transfer.transfer`."""
        from studies.sheets.measured_transfer import transfer

        return transfer(self.sheet(name), models, self.args.until, self.args.spacing)

    def locate(self, transferred: TransferResult) -> MapResult:
        """Where the heterogeneous sheet differs from what was transferred to it, see `measured_map.stiffness_map`."""
        from studies.commands.import_data import Frames, import_experiment
        from studies.sheets.measured_map import stiffness_map

        e = import_experiment(HETERO, frames=Frames(LOCAL_FRAMES))
        return stiffness_map(e, transferred.final.models, self.args.until, FINE, CELL)

    def control(self, name: str) -> ControlResult:
        """Negative control on a sheet, see `measured_control.split_half`."""
        from studies.sheets.measured_control import split_half

        return split_half(neighbouring_pictures(name, COMPARED), self.args.spacing)

    def homogeneous(self, loop: Loop) -> HomogeneousResult:
        """A loop on homogeneous tests, see `measured_homogeneous.close`."""
        from studies.sheets.homogeneous.measured_homogeneous import close

        return close(loop, self.say)


def neighbouring_pictures(name: str, count: int) -> Experiment:
    """A published sheet as groups of frames, with the noise from picture to picture."""
    import numpy as np

    from studies.commands.import_data import Frames, NoiseChoice, import_experiment
    from studies.sheets.measured_control import groups

    temporal = NoiseChoice("temporal")
    everything = import_experiment(name, frames=Frames(1000000), noise=temporal)  # every frame under load
    frames = np.array(everything.provenance["frames"])
    assert everything.time is not None
    chosen = tuple(int(frames[i]) for i in groups(everything.time, count))
    return import_experiment(name, frames=Frames(chosen), noise=temporal)
