"""How often the diagnosis finds something in simulated tests that hide nothing: `python benchmarks/false_alarms.py --seeds 100`.

In: options of `equigap simulate` behind --. Out: a line a test (verdict, best candidate, its score and adjusted p), then the rate.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import tempfile
from pathlib import Path

from calibrate.data.experiment import Experiment
from calibrate.diagnosis.selection import discover
from studies.cli import main as equigap


def verdict(seed: int, words: list[str], folder: Path) -> str:
    """The verdict on one test; prints its line."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        code = equigap(["simulate", *words, "--seed", str(seed), "-o", str(folder / str(seed))])
    if code:
        raise SystemExit(f"equigap simulate {' '.join(words)} failed; try it by itself")
    found = discover([Experiment.load(folder / str(seed) / "experiment.npz")], whole_table=False)
    best = min((r.score for r in found.rounds[0].candidates if r.score.is_tested), key=lambda score: score.adjusted)
    print(seed, found.verdict, *found.named, f"({best.effect.name}: {best.score:.1f}, {best.adjusted:.2g})", flush=True)
    return found.verdict


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("words", nargs="*", help="options of `equigap simulate`")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = [verdict(args.first + i, args.words, Path(folder)) for i in range(args.seeds)]
    alarms = sum(one != "nothing significant" for one in found)
    print(f"{alarms} of {len(found)} significant ({100 * alarms / len(found):.0f} %)")
