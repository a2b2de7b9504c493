"""`equigap figures`: every figure and table of all studies, made from nothing, in one folder.

In: a scale. Out: a folder a study, ``index.html`` with small copies of all pictures, ``figures.json`` that lists every figure and table with the
record beside it. Each study runs as a command of its own; those that are finished are not made again.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from calibrate.errors import DataNotFoundError
from studies.commandline.option_types import Count, Names, OutputFolder, Overwrite, default_folder, nearest
from studies.commandline.outcome import Outcome
from studies.errors import OptionError, StudyError
from studies.importers import measured_data
from studies.output import open_output_folder, write_json, write_text
from studies.output.manifest import revision, versions
from studies.output.report import page, thumbnail

SCALES = ("quick", "default", "full")
RECORDS = "finished"  # folder of what is finished
PATIENCE = 10  # s for a command to end by itself when all is interrupted
THUMBNAIL = (640, 512)  # pixels of a small copy at most


@dataclass(frozen=True)
class Step:
    """A command of `equigap`. words: after its name; FOLDER stands for the folder of all results. of_scale: words that a scale
    adds; a scale that is not among them leaves the step out. parallel: takes --jobs. data: needs measured data."""

    name: str
    of_scale: dict[str, tuple[str, ...]]
    words: tuple[str, ...] = ()
    command: str = ""
    parallel: bool = False
    data: bool = False

    def line(self, scale: str, folder: Path, jobs: int) -> list[str]:
        """The words of the command line after `equigap`."""
        words = [word.replace("FOLDER", str(folder)) for word in (*self.words, *self.of_scale[scale])]
        more = ["--jobs", str(jobs)] if self.parallel else []
        return [self.command or self.name, *words, *more, "--output", str(folder / self.name)]


QUICK, PLAIN = ("--quick",), ()
USUAL: dict[str, tuple[str, ...]] = {"quick": QUICK, "default": PLAIN, "full": PLAIN}
EXPERIMENT = "FOLDER/simulate/experiment.npz"
FEW_CASES = "--specimens cross --thicknesses 2D,10,40 --resolutions 100,25 --noises 0,0.1 --seeds 3"  # of the sweep: 24
STEPS = (
    Step("specimens", USUAL),
    Step("simulate", USUAL),
    Step("calibrate", USUAL, (EXPERIMENT,)),
    Step("predict", dict.fromkeys(SCALES, PLAIN), ("FOLDER/calibrate/model.json", "--against", "arruda_boyce")),
    Step("discover", USUAL, (EXPERIMENT,)),
    Step("supervised", USUAL, ("--data", "arruda-boyce")),
    Step("design", {"quick": QUICK, "default": PLAIN, "full": ("--validate",)}),
    Step("resolution", USUAL, parallel=True),
    Step("thickness", {"quick": QUICK, "default": PLAIN, "full": ("--fine",)}, parallel=True),
    Step(
        "sweep",
        {
            "quick": QUICK,
            "default": tuple(FEW_CASES.split()),
            "full": PLAIN,
        },
        parallel=True,
    ),
    Step(
        "blind",
        {
            "quick": ("--quick", "--only", "second invariant,lens distortion"),
            "default": ("--trials", "1", "--nulls", "5", "--pairs", "5"),
            "full": PLAIN,
        },
        parallel=True,
    ),
    Step("measured", USUAL, data=True),
)


@dataclass(frozen=True)
class AllFigures(Outcome):
    """A run. absent: {study: why it was left out}; failed: {study: its log}; page: that shows everything."""

    steps: tuple[Step, ...]
    folder: Path
    absent: dict[str, str]
    failed: dict[str, Path]
    page: Path

    def lines(self) -> Iterable[str]:
        """Times, what was left out, and the page."""
        yield from costs(self.folder, self.steps)
        for name, why in self.absent.items():
            yield f"- {name}: left out, {why}"
        yield f"figures: {self.page}"

    def failure(self) -> StudyError | None:
        """Studies that failed."""
        if not self.failed:
            return None
        logs = ", ".join(map(str, self.failed.values()))
        return StudyError(f"{', '.join(self.failed)} failed, see {logs}; the same command goes on with what is missing")


def figures(
    *,
    scale: Literal["quick", "default", "full"] = "default",
    only: Annotated[Names, Parameter(help="of " + ", ".join(step.name for step in STEPS))] = (),
    jobs: Count = os.cpu_count() or 1,
    output: Annotated[OutputFolder, Parameter(help="folder (default: results/figures-SCALE)")] = None,
    overwrite: Overwrite = False,
) -> AllFigures:
    """Make every figure and table of all studies in one folder, with a page that shows them all.

    Scale quick takes some minutes, default some hours, full a day. A run that was stopped goes on where it was; studies that need
    data which are not there are named and left out.

    Args:
        scale: how much
        jobs: cases side by side

    Raises:
        OptionError: unknown study.
    """
    steps = chosen(only)
    folder = (output or default_folder(f"figures-{scale}")).resolve()
    open_output_folder(folder, overwrite, {"study": "figures", "scale": scale})
    absent = missing_data(steps)
    names = run_all([s for s in steps if s.name not in absent], scale, folder, jobs)
    failed = {name: folder / RECORDS / f"{name}.log" for name in names}
    return AllFigures(tuple(steps), folder, absent, failed, write_page(folder, scale, absent, names))


def chosen(only: Sequence[str]) -> list[Step]:
    """Steps by name, or all. Raises `OptionError`."""
    names = [step.name for step in STEPS]
    for name in only:
        if name not in names:
            raise OptionError(f"--only {name}: no such study{nearest(name, names)}; choose from {', '.join(names)}")
    return [step for step in STEPS if step.name in (only or names)]


def missing_data(steps: Iterable[Step]) -> dict[str, str]:
    """Studies whose data are neither there nor to be fetched, and why."""
    absent = {}
    for step in steps:
        if step.data:
            try:
                for name in measured_data.SHEETS:
                    measured_data.sheet(name)
            except DataNotFoundError as error:
                absent[step.name] = str(error)
    return absent


def run_all(
    steps: Sequence[Step],
    scale: str,
    folder: Path,
    jobs: int,
    run: Callable[[list[str], Path], tuple[int, float]] | None = None,
) -> list[str]:
    """Run the steps that are not finished, in order; the names of those that failed."""
    failed = []
    for i, step in enumerate(steps, start=1):
        line, record = step.line(scale, folder, jobs), folder / RECORDS / f"{step.name}.json"
        head = f"figures: {i}/{len(steps)} {step.name}"
        if _finished(record, line) and (folder / step.name).is_dir():
            print(f"{head}: finished", file=sys.stderr, flush=True)
            continue
        print(head, file=sys.stderr, flush=True)
        record.parent.mkdir(parents=True, exist_ok=True)
        began = time.monotonic()
        code, peak = (run or _run)(line, record.with_suffix(".log"))
        if code in (130, -2):
            raise KeyboardInterrupt
        if code:
            failed.append(step.name)
            print(f"{head}: FAILED, exit code {code}", file=sys.stderr, flush=True)
            continue
        seconds = round(time.monotonic() - began, 1)
        made_by = {"revision": revision(), "versions": versions()}
        about = {"command": _without_jobs(line), **made_by, "seconds": seconds, "peak_MB": round(peak)}
        write_json(record, about)
    return failed


def _run(line: list[str], log: Path) -> tuple[int, float]:
    """The command in a process of its own, its progress on the terminal, its words in a log: exit code, and the memory, MB, that
    the largest of all its processes took."""
    with log.open("w") as file:
        process = subprocess.Popen([sys.executable, "-m", "studies.cli", *line], stdout=file)
        try:
            _, status, usage = os.wait4(process.pid, 0)
        except KeyboardInterrupt:  # from a terminal it reaches the command as well
            try:
                process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                process.terminate()
                process.wait()
            raise
        process.returncode = os.waitstatus_to_exitcode(status)
    return process.returncode, usage.ru_maxrss / 1024


def costs(folder: Path, steps: Iterable[Step]) -> list[str]:
    """A line a finished study: time, and memory of its largest process."""
    return [
        f"{name:12} {one['seconds']:8.0f} s {one['peak_MB']:6.0f} MB"
        for name, one in finished(folder, steps).items()
        if "peak_MB" in one
    ]


def finished(folder: Path, steps: Iterable[Step]) -> dict[str, dict[str, Any]]:
    """{study: what was recorded as it came to its end: command, revision, versions, seconds, peak_MB}; without those that did not."""
    found = {}
    for step in steps:
        with suppress(OSError, ValueError):
            found[step.name] = json.loads((folder / RECORDS / f"{step.name}.json").read_text())
    return found


def _without_jobs(line: list[str]) -> list[str]:
    place = line.index("--jobs") if "--jobs" in line else len(line)
    return [*line[:place], *line[place + 2 :]]


def _finished(record: Path, line: list[str]) -> bool:
    try:
        return json.loads(record.read_text())["command"] == _without_jobs(line)
    except (OSError, ValueError, KeyError):
        return False


def collected(folder: Path) -> list[dict[str, Any]]:
    """Every file that a manifest in `folder` names, with its study, hash and the manifest."""
    found = []
    for path in sorted(folder.glob("*/**/*.json")):
        try:
            record = json.loads(path.read_text())
        except (OSError, ValueError):
            continue
        if isinstance(record, dict) and record.get("format") == "equigap-manifest":
            for name, digest in record.get("outputs", {}).items():
                file = path.parent / name
                found.append(
                    {
                        "study": path.relative_to(folder).parts[0],
                        "file": str(file.relative_to(folder)),
                        "manifest": str(path.relative_to(folder)),
                        "sha256": digest,
                    }
                )
    return found


def write_page(folder: Path, scale: str, absent: dict[str, str], failed: Sequence[str]) -> Path:
    """``figures.json`` and ``index.html``: reports to open, and every picture."""
    files = collected(folder)
    content = {
        "format": "equigap-figures",
        "version": 2,
        "scale": scale,
        "finished": finished(folder, STEPS),
        "left_out": absent,
        "failed": list(failed),
        "files": files,
    }
    write_json(folder / "figures.json", content)
    studies: dict[str, dict[str, list[Any]]] = {}
    for step in STEPS:
        reports = sorted(str(p.relative_to(folder)) for p in (folder / step.name).glob("**/report.html"))
        pictures = [_small(folder, path) for path in sorted((folder / step.name).glob("**/*.png"))]
        if reports or pictures:
            studies[step.name] = {"reports": reports, "pictures": pictures}
    write_text(folder / "index.html", page("figures.html", scale=scale, studies=studies, absent=absent, failed=failed))
    return folder / "index.html"


def _small(folder: Path, path: Path) -> dict[str, str]:
    """A picture as the page shows it: its path, a small copy and words for who cannot see it."""
    place = path.relative_to(folder)
    alt = f"{place.parts[0]}: {path.stem.replace('_', ' ')}"
    return {"path": str(place), "source": thumbnail(path, THUMBNAIL), "alt": alt}
