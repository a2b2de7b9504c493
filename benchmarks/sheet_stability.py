"""Whether few effects of the measured sheets stay the same under small changes of what is given: `python -m benchmarks.sheet_stability`.

In: the published sheets (`EQUIGAP_DATA`). Each change is made by itself: pictures, how long is fitted, the noise that is stated, the spacing of the virtual fields. Out, in a folder: a JSON file a
case, kept, so that a stopped run goes on; ``sheet_stability.json`` with a table. Nothing that is held out is used or told.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.noise.kept_records import records
from calibrate.diagnosis import base_fit
from calibrate.diagnosis.evidence.priors import read_priors
from calibrate.diagnosis.hold_out import HoldOut, Kind
from calibrate.diagnosis.replayed.few_effects import FewEffects
from calibrate.diagnosis.replayed.updating import Updated
from calibrate.effects import CATALOGUE
from calibrate.effects.effect import distinct
from calibrate.equations.virtual_fields import default_spacing
from calibrate.fitting.noise.noise_check import with_checked_noise
from calibrate.models.parameter_covariance import Z95
from studies.commands.import_data import Frames, import_experiment
from studies.commands.measured import SHEETS
from studies.output.folder import open_output_folder
from studies.output.manifest import Manifest
from studies.output.writing import write_json
from studies.replay.few_effects_replay import FewEffectsReplays

PAIR = ("stiffness gradient", "compressibility")


@dataclass(frozen=True)
class Change:
    """pictures of the whole test; until: fitted up to then, s; noise: stated standard deviation over the estimated one; spacing: of the virtual fields over the default."""

    words: str
    pictures: int = 24
    until: float = 15.0
    noise: float = 1.0
    spacing: float = 1.0


CHANGES = (
    Change("none"),
    Change("12 pictures", pictures=12),
    Change("36 pictures", pictures=36),
    Change("fitted until 10 s", until=10.0),
    Change("fitted until 25 s", until=25.0),
    Change("twice the noise", noise=2.0),
    Change("spacing x 1.5", spacing=1.5),
)


@dataclass(frozen=True)
class Case:
    """A sheet and a change."""

    sheet: str
    change: Change

    @property
    def name(self) -> str:
        """Of its file."""
        return f"{self.sheet}-{self.change.words}".replace(" ", "_")


def cases() -> Iterator[Case]:
    """All, every sheet as it is first. Noise and spacing have a part in the forces alone, so that one sheet shows it."""
    for change in CHANGES:
        of_forces = change.noise != 1 or change.spacing != 1
        for sheet in SHEETS[:1] if of_forces else SHEETS:
            yield Case(sheet, change)


def found_of(case: Case) -> tuple[FewEffects, Updated]:
    """Few effects by the fields, and with the forces."""
    change = case.change
    experiment = import_experiment(case.sheet, frames=Frames(change.pictures))
    experiment = with_checked_noise(experiment)[0]
    if experiment.noise is not None:
        experiment = replace(experiment, noise=experiment.noise.scaled(change.noise))
    spacing = None if change.spacing == 1 else change.spacing * default_spacing(experiment)
    fitted = HoldOut(Kind.AFTER, change.until).training
    problem, base = base_fit.prepare([experiment], [fitted], spacing, base="neo-Hooke")
    effects, priors = distinct(CATALOGUE), read_priors()
    replays = FewEffectsReplays(problem, base.c, effects, priors)
    few = replays.by_fields()
    return few, replays.with_forces(few, few.best)


def told(case: Case, folder: Path) -> None:
    """Write NAME.json."""
    began = time.process_time()
    few, new = found_of(case)
    best = few.best
    amplitudes = {} if best is None else {name: [list(map(float, part)) for part in one] for name, one in best.priors.items()}  # fmt: skip
    memory = {a.effect.name: [*map(float, a.amplitudes), *map(float, a.shape)] for a in new.present[0] if a.effect.remembers}  # fmt: skip
    write_json(folder / f"{case.name}.json", {
        "name": case.name, "sheet": case.sheet, "change": case.change.words, "inclusion": few.inclusion, "sets": few.sets,
        "best": [] if best is None else list(best.effects), "amplitudes": amplitudes, "memory": memory,
        "fitted": [new.after.force, new.after.field], "seconds": time.process_time() - began,
    })  # fmt: skip


def table(found: list[dict[str, Any]]) -> list[list[str]]:
    """A line a case, in the order of the changes."""
    head = ["sheet", "change", "most probable set", "its probability", *PAIR, "gy, 1/extent", "g, tau (s)"]
    rows = []
    for case in sorted(cases(), key=lambda one: SHEETS.index(one.sheet)):
        one = next((one for one in found if one["name"] == case.name), None)
        if one is None:
            continue
        names, probability = one["sets"][0]
        gradient = one["amplitudes"].get(PAIR[0])
        gy = "" if gradient is None else f"{gradient[0][1]:.3f} +- {Z95 * gradient[1][1]:.3f}"
        relaxation = one["memory"].get("viscoelasticity")
        shares = [f"{100 * one['inclusion'].get(name, 0.0):.0f} %" for name in PAIR]
        rows.append([case.sheet, case.change.words, ", ".join(names) or "none", f"{100 * probability:.0f} %", *shares, gy,
                     "" if relaxation is None else f"{relaxation[0]:.2f}, {relaxation[1]:.1f}"])  # fmt: skip
    return [head, *rows]


def main() -> None:
    """Make what is missing, and the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--most", type=int, help="so many cases at most; 0: only the table of those that are there")
    parser.add_argument("-o", "--output", type=Path, default=Path("results/sheet-stability"))
    parser.add_argument("--overwrite", action="store_true")
    options = parser.parse_args()
    started = time.time()
    open_output_folder(options.output, options.overwrite, {"benchmark": "sheet stability"})
    folder = options.output / "cases"
    folder.mkdir(exist_ok=True)
    found = records(told, folder, list(cases())[: options.most], options.jobs, "cases")
    best = [one for one in found if set(one["best"]) == set(PAIR)]
    likely = [min(one["inclusion"].get(name, 0.0) for name in PAIR) for one in found]
    numbers = {"cases": len(found), "same_set": len(best), "least_of_pair": float(np.min(likely, initial=1.0))}
    write_json(options.output / "sheet_stability.json", {"numbers": numbers, "tables": {"cases": table(found)}, "cases": found})  # fmt: skip
    Manifest(0, {}, started=started).beside(options.output / "sheet_stability.json")


if __name__ == "__main__":
    main()
