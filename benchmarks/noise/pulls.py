"""Errors of fitted amplitudes over their stated deviations, each effect by itself: `python -m benchmarks.noise.pulls -o results/pulls`.

In: --trials blind trials of every effect that is hidden alone, seeds from --first, noise stated as it is (--only: some effects), --jobs side by side.
Each is diagnosed as `discover` does, with the hidden effect for a catalogue. Out, in a folder:
``trials/``, one file a trial, ``pulls.csv`` (effect, trials, strong ones, amplitudes, rms and mean pull, its size at the median over that of a normal
number, share within 95 %), ``trials.csv``, ``pulls.json``, a manifest. A run that was stopped goes on with the same command. Strong: a score above 10;
others are not counted. Amplitudes of a warp or a stiffness field are those of the series closest to the bend or patch.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.noise.kept_records import records
from calibrate.diagnosis.discovery import discover
from calibrate.effects import CATALOGUE
from calibrate.errors import EquigapError
from studies.output.folder import open_output_folder
from studies.output.manifest import Manifest
from studies.output.writing import write_csv, write_json
from studies.replay.twin_replay import twin_replay
from studies.trials.blind_case import GLOBAL_LIMIT, described
from studies.trials.blind_data import draw
from studies.trials.blind_data import make as blind
from studies.trials.blind_effects import FREQUENT
from studies.trials.judgement import judged_amplitude

FIRST, STRIDE = 988000, 100  # seed; between effects: no two share a test
NORMAL = 0.6745  # median of |y| of normal numbers
COLUMNS = [
    "effect",
    "trials",
    "strong",
    "not fitted",
    "amplitudes",
    "rms pull",
    "mean pull",
    "median size",
    "within 95 %",
]
LINE = ["effect", "seed", "score", "amplitude", "true", "fitted", "deviation", "pull", "seconds"]


@dataclass(frozen=True)
class Trial:
    """One trial to be made."""

    effect: str
    seed: int

    @property
    def name(self) -> str:
        """As its file is called."""
        return f"{self.effect.replace(' ', '_')}-{self.seed}"

    @property
    def size(self) -> tuple[str, int, str]:
        """Trials of one size share compiled code."""
        drawn = draw(self.seed, self.effect)
        return drawn.specimen, len(drawn.factors), self.effect


def make(trial: Trial, folder: Path) -> None:
    """Fit a trial and write its file."""
    write_json(folder / f"{trial.name}.json", record(trial))


def record(trial: Trial) -> dict[str, Any]:
    """Score, amplitudes and pulls of the hidden effect; an error of the data or the fit is a result, too."""
    data, label = blind(draw(trial.seed, trial.effect))
    known = {"effect": trial.effect, "seed": trial.seed}
    effect = next(e for e in CATALOGUE if e.name == trial.effect)
    began = time.process_time()
    try:
        found = discover([data], effects=(effect,), replay=twin_replay, few_effects=False)
        content = described(found)
    except EquigapError as error:
        return {**known, "error": f"{type(error).__name__}: {error}"}
    seconds = time.process_time() - began
    score = content["rounds"][0]["scores"].get(trial.effect, {}).get("score", 0.0)
    return {**known, "score": score, "seconds": seconds, "amplitudes": _amplitudes(content, label["effects"][0])}


def _amplitudes(found: dict[str, Any], hidden: dict[str, Any]) -> dict[str, Any]:
    """{name: true, fitted, deviation, pull}; none where the effect was not added."""
    one = judged_amplitude(hidden, found["additions"])
    if one is None:
        return {}
    return {
        name: {"true": one.true[name], "fitted": one.amplitudes[name], "deviation": one.deviations[name], "pull": pull}
        for name, pull in one.pulls.items()
    }


def row(effect: str, own: Sequence[dict[str, Any]]) -> list[Any]:
    """A line of the table."""
    strong = [one for one in own if one.get("score", 0.0) > GLOBAL_LIMIT]
    pulls = np.array([a["pull"] for one in strong for a in one["amplitudes"].values()])
    failed = sum("error" in one for one in own) + sum(not one["amplitudes"] for one in strong)
    if not len(pulls):
        return [effect, len(own), len(strong), failed, 0, None, None, None, None]
    size = float(np.median(np.abs(pulls)) / NORMAL)
    rms, within = float(np.sqrt((pulls**2).mean())), float((np.abs(pulls) < 1.96).mean())
    return [effect, len(own), len(strong), failed, len(pulls), rms, float(pulls.mean()), size, within]


def write_tables(folder: Path, found: Sequence[dict[str, Any]], settings: dict[str, Any]) -> list[list[Any]]:
    """``pulls.csv``, ``pulls.json``, ``trials.csv`` with a manifest."""
    rows = [row(name, own) for name in FREQUENT if (own := [one for one in found if one["effect"] == name])]
    lines = [[one["effect"], one["seed"], one["score"], name, a["true"], a["fitted"], a["deviation"], a["pull"], one["seconds"]]
             for one in found for name, a in one.get("amplitudes", {}).items()]  # fmt: skip
    write_csv(folder / "pulls.csv", COLUMNS, rows)
    write_csv(folder / "trials.csv", LINE, lines)
    write_json(folder / "pulls.json", {"columns": COLUMNS, "rows": rows})
    Manifest(settings=settings).beside(folder / "pulls.csv", folder / "trials.csv", folder / "pulls.json")
    return rows


def arguments(words: list[str] | None = None) -> argparse.Namespace:
    """The options."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("results/pulls"))
    parser.add_argument("--overwrite", action="store_true", help="empty an earlier folder of this benchmark")
    parser.add_argument("--first", type=int, default=FIRST, help="seed (default %(default)s)")
    parser.add_argument("--trials", type=int, default=20, help="of each effect (default %(default)s)")
    parser.add_argument("--only", nargs="+", choices=FREQUENT, metavar="EFFECT", help="some effects alone")
    parser.add_argument("--jobs", type=int, default=1, help="trials side by side (default %(default)s)")
    return parser.parse_args(words)


def main() -> None:
    """Make what is missing, then the tables."""
    options = arguments()
    settings = {"command": "pulls", "first": options.first}
    folder = open_output_folder(options.output, options.overwrite, settings)
    seeds = {name: options.first + STRIDE * i for i, name in enumerate(FREQUENT)}
    chosen = [name for name in FREQUENT if not options.only or name in options.only]
    todo = [Trial(name, seeds[name] + k) for name in chosen for k in range(options.trials)]
    todo.sort(key=lambda trial: trial.size)
    found = records(make, folder / "trials", todo, options.jobs, "trials")
    for line in write_tables(folder, found, settings):
        print(*(f"{value:.2f}" if isinstance(value, float) else value for value in line))


if __name__ == "__main__":
    main()
