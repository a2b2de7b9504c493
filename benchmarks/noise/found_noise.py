"""Noise that an import estimates from the fields alone beside that found from the equations: `python -m benchmarks.noise.found_noise`.

In: --seeds tests from --first that hide nothing, with little noise on 1,350 to 1,460 points: of one correlation length, and of two. Out: `docs/results/found_noise.json`, a line a test. What
coarse virtual fields feel (5.6 distances of the points, about those of a diagnosis) is the standard deviation of their residuals by the noise in question over that by the true noise: of the
import's estimate, brought to the size that fine fields see as a stated noise is, and of the noise found anew.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from calibrate.data.experiment import Experiment, Noise
from calibrate.fitting.noise.fine_fields import FineFields
from calibrate.fitting.noise.noise_check import check_noise, material, unit_of
from studies.importers.recording.noise_estimate import displacement_noise
from studies.trials.blind_data import draw, record
from studies.trials.blind_solution import clean_experiment
from studies.trials.blind_trial import ForeignNoise, Trial
from studies.trials.foreign import LONG, SHARE, SHORT, foreign

RESULTS = Path(__file__).parents[2] / "docs" / "results" / "found_noise.json"
COARSE = 5.6  # distances of the points
HEAD = ["specimen", "noise", "import: std over true", "length over true", "felt by coarse fields, import", "found anew: std over true", "felt by coarse fields, found anew"]  # fmt: skip


def test_of(seed: int) -> tuple[Trial, Experiment, Noise]:
    """A trial, its Experiment without a stated noise, and the true noise of 1 mm."""
    drawn = draw(seed, None)
    length = drawn.correlation_length
    two = bool(seed % 2)
    trial = replace(foreign(drawn), foreign=ForeignNoise(0.0, None)) if two else drawn
    short = Noise(1.0, SHORT * length, second_length=LONG * length, second_share=1 - SHARE)
    return trial, replace(record(trial, clean_experiment(trial)), noise=None), short if two else Noise(1.0, length)


def row(seed: int) -> list[str]:
    """Of the table."""
    trial, e, true = test_of(seed)
    estimated = displacement_noise(e.points, e.displacements).total
    stated = Noise(estimated.std, estimated.correlation_length)
    fields = FineFields.of(e, COARSE, *material(e))
    assert fields is not None
    real = trial.displacement_std**2 * fields.variances(true)

    def felt(noise: Noise | None) -> str:
        assert noise is not None
        return f"{np.median(np.sqrt(noise.total_std**2 * fields.variances(unit_of(noise)) / real)):.2f}"

    rescaled, anew = check_noise(replace(e, noise=stated)).used, check_noise(e)
    return [
        trial.specimen, "two lengths" if true.second_share else "one length", f"{estimated.std / trial.displacement_std:.1f}",
        f"{estimated.correlation_length / true.mean_length:.1f}", felt(rescaled), f"{anew.found / trial.displacement_std:.2f}", felt(anew.used),
    ]  # fmt: skip


def main() -> None:
    """Every test, then the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=73000, help="seed (default %(default)s)")
    parser.add_argument("--seeds", type=int, default=8, help="tests (default %(default)s)")
    options = parser.parse_args()
    rows = []
    for seed in range(options.first, options.first + options.seeds):
        rows.append(row(seed))
        print(seed, *rows[-1], flush=True)
    estimated, rescaled, anew = ([float(one[i]) for one in rows] for i in (2, 4, 6))
    content = {
        "command": f"python -m benchmarks.noise.found_noise --first {options.first} --seeds {options.seeds}",
        "made": datetime.now(UTC).date().isoformat(),
        "how": "seeds not looked at before",
        "numbers": {
            "tests": len(rows), "largest": f"{max(estimated):.0f}",
            "rescaled": f"{min(rescaled):.2f} to {max(rescaled):.1f}", "anew": f"{min(anew):.2f} to {max(anew):.2f}", "most": f"{max(anew):.1f}",
        },
        "tables": {"tests": [HEAD, *rows]},
    }  # fmt: skip
    RESULTS.write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()
