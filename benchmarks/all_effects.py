"""All effects at once with and without a variance of their own for the equations without a load: errors of what was not fitted.

    equigap import Soft_Homo --until 15 --frames 12 -o soft
    python -m benchmarks.all_effects soft/experiment.npz ... [--output FOLDER]

In: Experiments. Every third increment is held out. Out: a table, and `all_effects_variance.json`. It takes some minutes an Experiment.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from calibrate.data.experiment import Experiment
from calibrate.diagnosis.base_fit import prepare
from calibrate.diagnosis.evidence.priors import read_priors
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.joint.everything import fit_everything
from calibrate.diagnosis.joint.shares import Everything
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.twin import with_twins
from calibrate.effects import CATALOGUE
from calibrate.effects.effect import distinct
from calibrate.fitting.noise.noise_check import with_checked_noise
from studies.output.writing import write_json
from studies.replay.twin_replay import twin_replay

COLUMNS = [
    "test",
    "variance of fields over noise",
    "model",
    "force error, held out",
    "field error, held out",
    "dispersion",
]


def problem_of(experiment: Experiment) -> Problem:
    """With the noise that its equations see, and its twin."""
    problem, fit = prepare([with_checked_noise(experiment)[0]], [HoldOut().training])
    return with_twins(problem, fit, twin_replay)[0]


def rows(name: str, found: Everything) -> list[list[Any]]:
    """Of neo-Hooke, all and plausible effects."""
    models = [("neo-Hooke", found.before[1], float("nan")), ("all effects", found.after[1], found.dispersion)]
    if found.plausible is not None:
        models.append(("plausible effects", found.plausible.after[1], found.plausible.dispersion))
    w = found.field_variance
    return [[name, w, model, one.force, one.field, left] for model, one, left in models if one is not None]


def main() -> None:
    """Print the table as it grows, and write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("experiments", nargs="+", type=Path)
    parser.add_argument("--output", type=Path, default=Path("results/benchmarks"))
    given = parser.parse_args()
    table: list[list[Any]] = []
    for path in given.experiments:
        experiment = Experiment.load(path)
        problem = problem_of(experiment)
        for variance in (1.0, None):
            found = fit_everything(problem, distinct(CATALOGUE), read_priors(), field_variance=variance)
            for row in rows(experiment.name, found):
                table.append(row)
                print(*row, sep="  ", flush=True)
            write_json(given.output / "all_effects_variance.json", {"columns": COLUMNS, "rows": table})


if __name__ == "__main__":
    main()
