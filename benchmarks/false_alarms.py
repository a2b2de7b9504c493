"""How often the diagnosis finds something in simulated tests that hide nothing: `python benchmarks/false_alarms.py --seeds 100`.

In: options of `equigap simulate` behind --, or the blind trials that hide nothing (--trials); --stated: by which the stated noise of the
displacements is wrong, or none. Out: a line a test (verdict, best candidate, its score and adjusted p), then the rate.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import tempfile
from dataclasses import replace
from pathlib import Path

from calibrate.data.experiment import Experiment
from calibrate.diagnosis.selection import discover
from studies.cli import main as equigap
from studies.trials.blind_data import draw, make


def simulated(seed: int, words: list[str], folder: Path) -> Experiment:
    """A test of `equigap simulate`."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        code = equigap(["simulate", *words, "--seed", str(seed), "-o", str(folder / str(seed))])
    if code:
        raise SystemExit(f"equigap simulate {' '.join(words)} failed; try it by itself")
    return Experiment.load(folder / str(seed) / "experiment.npz")


def with_stated_noise(experiment: Experiment, stated: str) -> Experiment:
    """The same data with another statement on their noise: a factor on its standard deviation, or 'none'."""
    noise = experiment.noise
    if stated == "none" or noise is None:
        return replace(experiment, noise=None)
    return replace(experiment, noise=replace(noise, displacement_std=float(stated) * noise.displacement_std))


def verdict(seed: int, experiment: Experiment) -> str:
    """The verdict on one test; prints its line."""
    found = discover([experiment], whole_table=False)
    best = min((r.score for r in found.rounds[0].candidates if r.score.is_tested), key=lambda score: score.adjusted)
    print(seed, found.verdict, *found.named, f"({best.effect.name}: {best.score:.1f}, {best.adjusted:.2g})", flush=True)
    return found.verdict


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--trials", action="store_true", help="blind trials instead")
    parser.add_argument("--stated", default="1", help="factor on the stated noise, or none")
    parser.add_argument("words", nargs="*", help="options of `equigap simulate`")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = []
        for seed in range(args.first, args.first + args.seeds):
            exact = make(draw(seed, None))[0] if args.trials else simulated(seed, args.words, Path(folder))
            found.append(verdict(seed, with_stated_noise(exact, args.stated)))
    alarms = sum(one != "nothing significant" for one in found)
    print(f"{alarms} of {len(found)} significant ({100 * alarms / len(found):.0f} %)")
