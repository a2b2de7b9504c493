"""How often the diagnosis finds something in simulated tests that hide nothing: `python -m benchmarks.noise.false_alarms -o results/alarms`.

In: --seeds tests from --first of every condition of `null_tests` (--only: of some), --jobs side by side. Out, in a folder: ``tests/``, one file a test,
``alarms.csv`` (condition, tests, alarms, with a name, rate, its 95 % interval after Clopper and Pearson 1934, errors, CPU seconds), ``tests.csv``,
``alarms.json``, a manifest. A run that was stopped goes on with the same command. The evidence is weighed only where there is an alarm, and all
effects at once are not fitted: neither changes whether there is one.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from benchmarks.noise.kept_records import records
from benchmarks.noise.null_tests import CONDITIONS, Condition, experiment
from calibrate.data.experiment import Experiment
from calibrate.diagnosis.base_fit import prepare
from calibrate.diagnosis.evidence.decision import decided
from calibrate.diagnosis.evidence.priors import read_priors
from calibrate.diagnosis.evidence.weighing import weigh
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.selection import Discovery, Verdict
from calibrate.diagnosis.selection.loop import close_loop
from calibrate.diagnosis.twin import with_twins
from calibrate.effects import CATALOGUE
from calibrate.effects.effect import distinct
from calibrate.errors import EquigapError
from calibrate.fitting.noise.noise_check import NoiseCheck, with_checked_noise
from studies.output.folder import open_output_folder
from studies.output.manifest import Manifest
from studies.output.writing import write_csv, write_json
from studies.replay.twin_replay import twin_replay
from studies.trials.blind_data import draw

FIRST = 987000
BLOCK = 24  # seeds of all conditions that are made before others, so that a run that is stopped has some of each
SHOWN = 3  # candidates in the record of a test


@dataclass(frozen=True)
class NullTest:
    """One test to be made."""

    condition: Condition
    seed: int

    @property
    def name(self) -> str:
        """As its file is called."""
        words = "".join(c if c.isalnum() or c == "." else "-" for c in self.condition.name)
        return f"{words}_{self.seed}"

    @property
    def size(self) -> tuple[int, str, int]:
        """Tests of one size share compiled code."""
        if self.condition.std:
            return self.seed // BLOCK, "coarse", 0
        trial = draw(self.seed, None)
        return self.seed // BLOCK, trial.specimen, len(trial.factors)


def make(test: NullTest, folder: Path) -> None:
    """Diagnose a test and write its file."""
    write_json(folder / f"{test.name}.json", record(test))


def record(test: NullTest) -> dict[str, Any]:
    """What the diagnosis says of a test; an error of the data or the fit is a result, too."""
    condition = test.condition
    known = {
        "condition": condition.name,
        "seed": test.seed,
        "kernel": condition.kernel(test.seed),
        "course": condition.course(test.seed),
    }
    data = experiment(condition, test.seed)
    began = time.process_time()
    try:
        found, check = diagnosed(data)
    except EquigapError as error:
        return {**known, "error": f"{type(error).__name__}: {error}"}
    return {**known, "seconds": time.process_time() - began, **described(found), "noise": noise_found(data, check)}


def diagnosed(data: Experiment) -> tuple[Discovery, NoiseCheck]:
    """The diagnosis of `calibrate.diagnosis.discovery` as far as it decides on an alarm and its names. Raises its errors."""
    checked, check = with_checked_noise(data)
    effects, priors = distinct(CATALOGUE), read_priors()
    problem, base = prepare([checked], [HoldOut.default(data.n_increments, False).training])
    problem, base, _ = with_twins(problem, base, twin_replay)
    found = close_loop(problem, base, effects)
    if found.verdict is not Verdict.NOTHING_SIGNIFICANT:
        found = decided(found, weigh(found, priors, effects), priors, effects)
    return found, check


def described(found: Discovery) -> dict[str, Any]:
    """Verdict, names, and what led there."""
    first = found.rounds[0]
    best = sorted((c.score for c in first.candidates if c.score.is_tested), key=lambda score: score.adjusted)[:SHOWN]
    tests = {
        "all": first.misfits.everything,
        "certain": first.misfits.certain,
        "smooth": first.misfits.smooth,
    }
    if first.predicted is not None:
        tests["predicted"] = first.predicted
    return {
        "verdict": found.verdict, "named": list(found.named), "closest": list(found.closest),
        "best": [[s.effect.name, s.score, s.degrees, s.adjusted] for s in best],
        "chi_square": {name: [*test, test.p_value] for name, test in tests.items()},
    }  # fmt: skip


def noise_found(data: Experiment, check: NoiseCheck) -> dict[str, Any]:
    """Stated and used."""
    return {
        name: None if noise is None else asdict(noise) for name, noise in (("stated", data.noise), ("used", check.used))
    }


COLUMNS = [
    "condition",
    "tests",
    "alarms",
    "named",
    "rate",
    "low",
    "high",
    "errors",
    "CPU seconds",
    "best where alarmed",
]


def row(condition: str, own: Sequence[dict[str, Any]]) -> list[Any]:
    """A line of the table: of the records of one condition."""
    made = [one for one in own if "error" not in one]
    alarms = [one for one in made if one["verdict"] != Verdict.NOTHING_SIGNIFICANT]
    named = sum(bool(one["named"]) for one in alarms)
    low, high = binomtest(len(alarms), len(made)).proportion_ci() if made else (0.0, 1.0)
    seconds = float(np.median([one["seconds"] for one in made])) if made else float("nan")
    best = Counter(one["best"][0][0] for one in alarms)
    words = ", ".join(f"{name} {n}" for name, n in best.most_common())
    rate = len(alarms) / max(len(made), 1)
    return [condition, len(made), len(alarms), named, rate, low, high, len(own) - len(made), seconds, words]


def write_tables(folder: Path, found: Sequence[dict[str, Any]], settings: dict[str, Any]) -> list[list[Any]]:
    """``alarms.csv``, ``alarms.json``, ``tests.csv`` with a manifest; also by kernel and course of the noise."""
    groups = {c.name: [r for r in found if r["condition"] == c.name] for c in CONDITIONS}
    rows = [row(name, own) for name, own in groups.items() if own]
    parts = [
        row(f"{name}, {kind}", some)
        for name, own in groups.items()
        for key in ("kernel", "course")
        for kind in sorted({r[key] for r in own})
        if (some := [r for r in own if r[key] == kind]) and len(some) < len(own)
    ]
    write_csv(folder / "alarms.csv", COLUMNS, [*rows, *parts])
    lines = [[r["condition"], r["seed"], r["kernel"], r["course"], r.get("verdict", r.get("error")), ", ".join(r.get("named", [])),
              *r["best"][0], r["seconds"]] for r in found if "best" in r]  # fmt: skip
    write_csv(
        folder / "tests.csv",
        [
            "condition",
            "seed",
            "kernel",
            "course",
            "verdict",
            "named",
            "best",
            "score",
            "degrees",
            "adjusted",
            "seconds",
        ],
        lines,
    )
    write_json(folder / "alarms.json", {"columns": COLUMNS, "rows": rows, "parts": parts})
    Manifest(settings=settings).beside(folder / "alarms.csv", folder / "tests.csv", folder / "alarms.json")
    return rows


def arguments(words: list[str] | None = None) -> argparse.Namespace:
    """The options."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("results/false-alarms"))
    parser.add_argument("--overwrite", action="store_true", help="empty an earlier folder of this benchmark")
    parser.add_argument("--first", type=int, default=FIRST, help="seed (default %(default)s)")
    parser.add_argument("--seeds", type=int, default=200, help="tests of each condition (default %(default)s)")
    parser.add_argument(
        "--only", nargs="+", choices=[c.name for c in CONDITIONS], metavar="CONDITION", help="some conditions alone"
    )
    parser.add_argument("--jobs", type=int, default=1, help="tests side by side (default %(default)s)")
    return parser.parse_args(words)


def main() -> None:
    """Make what is missing, then the tables."""
    options = arguments()
    settings = {"command": "false alarms", "first": options.first}
    folder = open_output_folder(options.output, options.overwrite, settings)
    chosen = [c for c in CONDITIONS if not options.only or c.name in options.only]
    todo = [NullTest(c, seed) for c, seed in product(chosen, range(options.first, options.first + options.seeds))]
    todo.sort(key=lambda test: test.size)

    found = records(make, folder / "tests", todo, options.jobs, "tests without an effect")
    for line in write_tables(folder, found, settings):
        print("{}: {} tests, {} alarms, {} named, {:.1%} ({:.1%} to {:.1%}), {} errors, {:.0f} s, {}".format(*line))


if __name__ == "__main__":
    main()
