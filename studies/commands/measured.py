"""`equigap measured`: the loop closed on measured data; nothing but the data in, one report with its numbers out.

Out: ``report.html``, ``measured.json`` (every number), ``errors.csv``, ``effects.csv``, ``sections.csv``,
``homogeneous.csv``, ``control.csv``, a model file of every sheet learnt on (`equigap predict`), pictures and a manifest. Every step is kept in ``steps/`` and not made again.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from studies.commands.options import add_output, count, output_folder, positive, settings
from studies.sheets.measured_record import MANY, SHEETS, record
from studies.sheets.model_errors import BASE, EVERY_EFFECT, MEAN, RETAINED, entry

if TYPE_CHECKING:
    from calibrate.data.experiment import Experiment

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


def shown(learnt: dict[str, Any]) -> list[dict[str, Any]]:
    """Of the models of a sheet the base, the one with every effect, the one retained by BIC, and the mean of the leave-one-out fits."""
    return [entry(learnt, name) for name in (BASE, EVERY_EFFECT, RETAINED, MEAN)]


class Steps:
    """The steps of the study; each returns plain numbers, kept as JSON under ``steps/``."""

    def __init__(self, folder: Path, args: argparse.Namespace, say: Callable[[str], None]) -> None:
        self.folder, self.args, self.say = folder, args, say
        self.frames = 15 if args.quick else args.frames
        self._sheets: dict[str, Experiment] = {}

    def all(self) -> dict[str, Any]:
        """Every step's result by name."""
        results: dict[str, Any] = {}
        for name in SHEETS:
            results[f"record_{name}"] = self.step(f"record_{name}", partial(self.record, name))
        results["first"] = self.step("first", lambda: self.learn(FIRST))
        results["rivals"] = self.step("rivals", lambda: self.rivals(results["first"]))
        results["second"] = self.step("second", lambda: self.transfer(SECOND, shown(results["first"])))
        results["own"] = self.step("own", lambda: self.learn(SECOND))
        results["hetero"] = self.step("hetero", lambda: self.transfer(HETERO, results["second"]["models"]))
        results["map"] = self.step("map", lambda: self.locate(results["hetero"]))
        for name in SHEETS:
            results[f"control_{name}"] = self.step(f"control_{name}", partial(self.control, name))
        if not self.args.quick:
            from studies.sheets.homogeneous.homogeneous_loops import loops

            for loop in loops():
                key = f"loop_{loop.name}"
                results[key] = self.step(key, partial(self.homogeneous, loop))
        return results

    def step(self, name: str, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """The result kept from an earlier run, or a new one."""
        import jax

        from studies.output.writing import plain, write_json

        path = self.folder / "steps" / f"{name}.json"
        if path.exists():
            return json.loads(path.read_text())
        self.say(name.replace("_", " "))
        began = time.monotonic()
        result = plain({**make(), "seconds": None})
        result["seconds"] = round(time.monotonic() - began, 1)
        write_json(path, result)
        jax.clear_caches()  # compiled code of all steps together takes more memory maps than a process may have
        return result

    def sheet(self, name: str) -> Experiment:
        """The sheet with its increments."""
        from studies.commands.import_data import Frames, import_experiment

        if name not in self._sheets:
            self._sheets[name] = import_experiment(name, frames=Frames(self.frames))
        return self._sheets[name]

    def record(self, name: str) -> dict[str, Any]:
        """What the record of a sheet says, see `measured_record.record`."""
        from studies.commands.import_data import Frames, import_experiment

        return record(name, self.sheet(name), import_experiment(name, frames=Frames(MANY)))

    def learn(self, name: str) -> dict[str, Any]:
        """What a sheet does beyond hyperelasticity, see `measured_loop.learn`."""
        from studies.sheets.measured_loop import learn

        return learn(self.sheet(name), self.args.until, self.args.spacing, self.say)

    def rivals(self, learnt: dict[str, Any]) -> dict[str, Any]:
        """Softening against relaxation on the first sheet, see `measured_loop.rivals`."""
        from studies.sheets.measured_loop import rivals

        return {"models": rivals(self.sheet(FIRST), learnt, self.args.until, self.args.spacing, self.say)}

    def transfer(self, name: str, models: list[dict[str, Any]]) -> dict[str, Any]:
        """Models of another sheet on this one, see `measured_transfer.transfer`."""
        from studies.sheets.measured_transfer import transfer

        return transfer(self.sheet(name), models, self.args.until, self.args.spacing)

    def locate(self, transferred: dict[str, Any]) -> dict[str, Any]:
        """Where the heterogeneous sheet differs from what was transferred to it, see `measured_map.stiffness_map`."""
        from studies.commands.import_data import Frames, import_experiment
        from studies.sheets.measured_map import stiffness_map
        from studies.sheets.model_errors import members

        e = import_experiment(HETERO, frames=Frames(LOCAL_FRAMES))
        return stiffness_map(e, members(transferred["models"][-1]), self.args.until, FINE, CELL)

    def control(self, name: str) -> dict[str, Any]:
        """Negative control on a sheet, see `measured_control.split_half`."""
        from studies.sheets.measured_control import split_half

        return split_half(neighbouring_pictures(name, COMPARED), self.args.spacing)

    def homogeneous(self, loop: Any) -> dict[str, Any]:
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
