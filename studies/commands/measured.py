"""`equigap measured`: `equigap discover` and `equigap transfer` on published measured data; nothing but the data in, one report out.

Out: ``report.html``, ``measured.json`` (every number), ``verdicts.csv``, ``errors.csv``, ``replays.csv``, ``transfers.csv``, ``homogeneous.csv``, ``control.csv``, pictures and a
manifest; what the two commands say of each sheet in a folder of its own. Every step is kept in ``steps/`` and not made again.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import jax
import numpy as np
from cyclopts import Parameter

from calibrate.data.experiment import Experiment
from studies.commandline.option_types import Count, OutputFolder, Overwrite, Positive, default_folder
from studies.commandline.outcome import Outcome
from studies.commands.discover import Diagnosis, discover
from studies.commands.import_data import Frames, NoiseChoice, import_experiment
from studies.commands.transfer import transfer
from studies.importers import measured_data
from studies.output import Manifest, open_output_folder
from studies.output.folder import CHECKPOINT
from studies.output.plain import StepResult
from studies.output.run_progress import RunProgress
from studies.output.writing import write_json
from studies.reports.discovery.replays.replayed_models import FEW_FILES
from studies.sheets import measured_control
from studies.sheets.homogeneous import measured_homogeneous
from studies.sheets.homogeneous.homogeneous_loops import Loop, loops
from studies.sheets.report import write
from studies.sheets.sheet_results import (
    ControlResult,
    HomogeneousResult,
    MeasuredResults,
    SheetResult,
    TransferResult,
)
from studies.transfer.report import findings

SHEETS = ("Soft_Homo", "Stiff2_Homo", "Stiff2_Hetero")
COMPARED, CONTROL_SPACING, QUICK_FRAMES = 14, 12.0, 15  # pictures; mm, of the virtual fields of the control


@Parameter(name="*", group="Sheets")
@dataclass(frozen=True)
class SheetStudy:
    """What is used of every sheet."""

    until: Positive = 15.0
    """fitted up to then, held out after, s"""
    frames: Count = 24
    """of each sheet; with --quick 15"""

    @property
    def hold_out(self) -> str:
        """As `equigap discover` takes it."""
        return f"after:{self.until:g}"


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

    Runs `discover` on three published sheets, `transfer` of the first one's model to the others, the loops of Treloar, Kawabata and HNBR50, and
    looks for effects where there can be none. Takes about an hour on one core; a stopped run goes on where it was.

    Args:
        quick: the sheets alone, with 15 frames and a quick diagnosis

    Raises:
        DataNotFoundError: a sheet is neither there nor to be fetched.
        EquigapError: an Experiment that cannot be.
    """
    started = time.time()
    sources = [measured_data.sheet(name) for name in SHEETS]  # before anything is made: are the data there?
    key = dict(sorted({"command": "measured", **asdict(sheets), "quick": quick}.items()))
    folder = open_output_folder(output or default_folder("measured", quick), overwrite, {"study": "measured", **key})
    manifest = Manifest(0, key, sources, started)
    with RunProgress() as say:
        results = Steps(folder, sheets, quick, say).all()
        say("writing the report")
        report, answer = write(folder, results, manifest)
    return Measured(answer, report)


class Steps:
    """The steps of the study; each returns a `StepResult`, kept as JSON under ``steps/``."""

    def __init__(self, folder: Path, options: SheetStudy, quick: bool, say: Callable[[str], None]) -> None:
        self.folder, self.options, self.quick, self.say = folder, options, quick, say
        self.frames = QUICK_FRAMES if quick else options.frames

    def all(self) -> MeasuredResults:
        """Every step's result."""
        sheets = {name: self.step(f"sheet_{name}", SheetResult, partial(self.discovered, name)) for name in SHEETS}
        transfers = {
            name: self.step(f"transfer_{name}", TransferResult, partial(self.transferred, name)) for name in SHEETS[1:]
        }
        controls = {name: self.step(f"control_{name}", ControlResult, partial(self.control, name)) for name in SHEETS}
        return MeasuredResults(sheets, transfers, controls, self.loops())

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

    def sheet(self, name: str) -> Path:
        """The file of a sheet with its increments."""
        path = self.folder / f"{name}.npz"
        if not path.exists():
            import_experiment(name, frames=Frames(self.frames)).save(path)
        return path

    def discovered(self, name: str) -> SheetResult:
        """What `equigap discover` says of a sheet."""
        diagnosis = Diagnosis(hold_out=(self.options.hold_out,))
        folder = self.folder / name
        begun = (folder / CHECKPOINT).exists()
        discover(self.sheet(name), diagnosis=diagnosis, quick=self.quick, output=folder, overwrite=not begun)
        return SheetResult.of(name, json.loads((folder / "discovery.json").read_text()))

    def transferred(self, name: str) -> TransferResult:
        """What `equigap transfer` says of a sheet with the first one's model: of few effects, where nothing explains it."""
        candidates = [self.folder / SHEETS[0] / file for file in (FEW_FILES[0], "model.json")]
        model = next(path for path in candidates if path.exists())
        output = self.folder / f"transfer_{name}"
        done = transfer(model, self.sheet(name), hold_out=self.options.hold_out, output=output, overwrite=True)
        return TransferResult.of(done.found, [one.text for one in findings(done.found)])

    def control(self, name: str) -> ControlResult:
        """Negative control on a sheet, see `measured_control.split_half`."""
        return measured_control.split_half(neighbouring_pictures(name, COMPARED), CONTROL_SPACING)

    def homogeneous(self, loop: Loop) -> HomogeneousResult:
        """A loop on homogeneous tests, see `measured_homogeneous.close`."""
        return measured_homogeneous.close(loop)


def neighbouring_pictures(name: str, count: int) -> Experiment:
    """A published sheet as groups of frames, with the noise from picture to picture."""
    temporal = NoiseChoice("temporal")
    everything = import_experiment(name, noise=temporal)
    frames = np.array(everything.provenance["frames"])
    assert everything.time is not None
    chosen = tuple(int(frames[i]) for i in measured_control.groups(everything.time, count))
    return import_experiment(name, frames=Frames(chosen), noise=temporal)
