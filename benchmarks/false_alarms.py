"""How often the diagnosis finds something in simulated tests that hide nothing: `python benchmarks/false_alarms.py --seeds 100`.

In: options of `equigap simulate` behind --, or the blind trials that hide nothing (--trials); --stated: by which the stated noise of the
displacements is wrong, or none; --correlation: share of the variance of the noise that all pictures have in common, half of it with the
pattern, half with the reference; --independent: increments are taken for independent, as without the two; --without-twin: the discretisation
error is allowed for, not found by a replay. Out: a line a test (verdict, best candidate, its score and adjusted p), then the rate.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from calibrate.data.experiment import Experiment
from calibrate.diagnosis.discovery import discover
from calibrate.equations.noise_covariance import between_increments
from calibrate.fitting.noise_check import check_noise
from studies.cli import main as equigap
from studies.replay.twin_replay import twin_replay
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
    return replace(experiment, noise=noise.scaled(float(stated)))


def independent(experiment: Experiment) -> Experiment:
    """The same data; what is known of the noise, or found, is taken for new in every increment, with its mean variance."""
    noise = experiment.noise or check_noise(experiment).used
    assert noise is not None
    std = noise.displacement_std * np.sqrt(np.diag(between_increments(experiment, noise)).mean())
    return replace(experiment, noise=replace(noise, displacement_std=float(std), pattern_std=0.0, reference_std=0.0))


def camera_words(total: float, correlation: float) -> list[str]:
    """Options of `equigap simulate` for noise of which a share of the variance is common to all pictures."""
    common = total * np.sqrt(correlation / 2)
    own = ["--relative-noise", str(total * np.sqrt(1 - correlation))]
    return [*own, "--pattern-noise", str(common), "--reference-noise", str(common)]


def verdict(seed: int, experiment: Experiment, twin: bool = True) -> str:
    """The verdict on one test; prints its line."""
    began = time.process_time()
    found = discover([experiment], whole_table=False, replay=twin_replay if twin else None)
    best = min((r.score for r in found.rounds[0].candidates if r.score.is_tested), key=lambda score: score.adjusted)
    print(seed, found.verdict, *found.named, f"({best.effect.name}: {best.score:.1f}, {best.adjusted:.2g})",
          found.noise[0].used, f"{time.process_time() - began:.0f} s", flush=True)  # fmt: skip
    return found.verdict


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--trials", action="store_true", help="blind trials instead")
    parser.add_argument("--stated", default="1", help="factor on the stated noise, or none")
    parser.add_argument("--noise", type=float, default=5e-4, help="standard deviation of the displacements, of 200 mm")
    parser.add_argument(
        "--correlation", type=float, default=0.0, help="share of its variance that is common to all pictures"
    )
    parser.add_argument("--independent", action="store_true", help="take increments for independent")
    parser.add_argument("--without-twin", action="store_true", help="do not replay the tests")
    parser.add_argument("words", nargs="*", help="options of `equigap simulate`")
    args = parser.parse_args()
    words = [*camera_words(args.noise, args.correlation), *args.words]
    with tempfile.TemporaryDirectory() as folder:
        found = []
        for seed in range(args.first, args.first + args.seeds):
            exact = make(draw(seed, None))[0] if args.trials else simulated(seed, words, Path(folder))
            stated = with_stated_noise(exact, args.stated)
            found.append(verdict(seed, independent(stated) if args.independent else stated, not args.without_twin))
    alarms = sum(one != "nothing significant" for one in found)
    print(f"{alarms} of {len(found)} significant ({100 * alarms / len(found):.0f} %)")
