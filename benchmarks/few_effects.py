"""How often few effects by the fields of replays are right, beside something that is not among them: `python -m benchmarks.few_effects --first 999000`.

In: seed of the first test. Each test hides one effect of the catalogue, or none, beside a stiffness field or a warp of the specimen, which have too many amplitudes to be candidates: the discrepancy.
Specimens, materials, loads and noise are those of the blind trials; materials may stiffen, so that an upturn counts as part of the base.

Out, in a folder: a JSON file a test, kept, so that a stopped run goes on; ``few_effects.json`` with a table and every test. Named: a probability above 95 %.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

from benchmarks.noise.kept_records import records
from calibrate.diagnosis import base_fit
from calibrate.diagnosis.evidence.explanations import CERTAIN
from calibrate.diagnosis.evidence.priors import read_priors
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.effects import CATALOGUE
from calibrate.effects.effect import distinct
from calibrate.fitting.noise.noise_check import with_checked_noise
from studies.output.folder import open_output_folder
from studies.output.manifest import Manifest
from studies.output.writing import write_json
from studies.replay.few_effects_replay import FewEffectsReplays
from studies.trials import blind_data
from studies.trials.blind_effects import ALSO
from studies.trials.blind_trial import Trial

HIDDEN = ("stiffness gradient", "compressibility", "second invariant", "one fibre family", "camera tilt", "lens distortion", "image rotation", "out-of-plane motion", "inclusion", "")  # fmt: skip
BESIDE = {
    "stiffness field": {"stiffness gradient", "inclusion"},
    "initial warp": set[str](),
}  # and what is nearly a part of it
ROUNDS = 3
OF_THE_BASE = "upturn"


@dataclass(frozen=True)
class Test:
    """effect: that is hidden, '' for none; beside: what the candidates do not have."""

    seed: int
    effect: str
    beside: str

    @property
    def name(self) -> str:
        """What is hidden, and the seed."""
        return f"{self.effect or 'none'}+{self.beside}-{self.seed}".replace(" ", "_")

    def trial(self) -> Trial:
        """Every number of it."""
        return blind_data.draw(self.seed, *((self.effect,) if self.effect else ()), self.beside)


def tests(first: int) -> Iterator[Test]:
    """All, mixed so that a run that is stopped has some of each kind."""
    seeds = count(first)
    for turn in range(ROUNDS):
        for k, effect in enumerate(HIDDEN):
            yield Test(next(seeds), effect, list(BESIDE)[(k + turn) % len(BESIDE)])


def ranked(one: Test, folder: Path) -> None:
    """Write NAME.json of a test: what is hidden, and what is probable."""
    began = time.process_time()
    trial = one.trial()
    experiment = with_checked_noise(blind_data.make(trial)[0])[0]
    problem, base = base_fit.prepare([experiment], [HoldOut().training], base="neo-Hooke")
    found = FewEffectsReplays(problem, base.c, distinct(CATALOGUE), read_priors()).by_fields()
    right = {one.effect, *ALSO.get(one.effect, ())}
    named = [name for name, p in found.inclusion.items() if p > CERTAIN and name != OF_THE_BASE]
    write_json(folder / f"{one.name}.json", {
        "name": one.name, "effect": one.effect, "beside": one.beside, "label": blind_data.label(trial), "inclusion": found.inclusion,
        "named_right": [name for name in named if name in right], "named_wrong": [name for name in named if name not in right | BESIDE[one.beside]],
        "named_part": [name for name in named if name in BESIDE[one.beside] - right],
        "left_mm": [found.base.field, None if found.best is None else found.best.errors.field], "seconds": time.process_time() - began,
    })  # fmt: skip


def table(found: list[dict[str, Any]]) -> list[list[str]]:
    """Of every effect."""
    rows = [
        [
            "hidden, beside a field or a warp",
            "tests",
            "named right",
            "named wrong",
            "a gradient or an inclusion for a field",
            "probability of the right one",
        ]
    ]
    for effect in HIDDEN:
        own = [one for one in found if one["effect"] == effect]
        if not own:
            continue
        right, wrong, part = (sum(bool(one[f"named_{key}"]) for one in own) for key in ("right", "wrong", "part"))
        shares = ", ".join(f"{one['inclusion'].get(effect, 0.0):.2f}" for one in own) if effect else ""
        rows.append([effect or "nothing", str(len(own)), str(right) if effect else "", str(wrong), str(part), shares])
    return rows


def main() -> None:
    """Make what is missing, and the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=999000)
    parser.add_argument("--most", type=int, help="so many tests at most; 0: only the table of those that are there")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path, default=Path("results/few-effects"))
    parser.add_argument("--overwrite", action="store_true")
    options = parser.parse_args()
    started = time.time()
    open_output_folder(options.output, options.overwrite, {"benchmark": "few effects", "first": options.first})
    folder = options.output / "tests"
    folder.mkdir(exist_ok=True)
    found = records(ranked, folder, list(tests(options.first))[: options.most], options.jobs, "tests")
    numbers = {"tests": len(found), "right": sum(bool(one["named_right"]) for one in found), "wrong": sum(bool(one["named_wrong"]) for one in found)}  # fmt: skip
    write_json(options.output / "few_effects.json", {"numbers": numbers, "tables": {"kinds": table(found)}, "tests": found})  # fmt: skip
    Manifest(0, {"first": options.first}, started=started).beside(options.output / "few_effects.json")


if __name__ == "__main__":
    main()
