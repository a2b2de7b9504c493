"""Whether an inclusion is found, and where: `python -m benchmarks.inclusions FOLDER`.

In: a folder for the trials, which are gone on with; --first: seed. Out: `docs/results/inclusions.json`. Four kinds of a place of another stiffness, --each of every kind: a squircle with a sharp edge, which is
what the catalogue has; a rectangle, which it nearly has; a triangle, which it has not; and a smooth patch. Base, specimen, loading and noise are those of the foreign trials for the first
three (Gent's law, noise of two lengths, here stated as it is), of the blind trials for the patch.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.noise.kept_records import records
from calibrate.data.experiment import Experiment
from calibrate.diagnosis.discovery import discover
from calibrate.effects.inclusion import half_axes
from studies.output.writing import write_json
from studies.replay.replay_check import FiniteElementCheck
from studies.replay.twin_replay import twin_replay
from studies.trials.blind_case import described
from studies.trials.blind_data import draw
from studies.trials.blind_data import record as observed
from studies.trials.blind_solution import clean_experiment
from studies.trials.blind_trial import ForeignNoise, Trial
from studies.trials.foreign import INCLUSION, foreign

RESULTS = Path(__file__).parents[1] / "docs" / "results" / "inclusions.json"
SQUIRCLE, RECTANGLE, TRIANGLE, PATCH = "squircle", "rectangle", "triangle", "smooth patch"
KINDS = (SQUIRCLE, RECTANGLE, TRIANGLE, PATCH)
HEAD = ["hidden", "specimen", "true: a, place, half axes (extent), angle (degrees)", "verdict", "named", "dominant", "inclusion of the model", "reduced chi-square, before and after"]  # fmt: skip


@dataclass(frozen=True)
class Test:
    """One test to be made."""

    kind: str
    seed: int

    @property
    def name(self) -> str:
        """As its file is called."""
        return f"{self.kind.replace(' ', '-')}_{self.seed}"

    @property
    def trial(self) -> Trial:
        """Every number of it."""
        drawn = draw(self.seed, "inclusion" if self.kind in (SQUIRCLE, RECTANGLE) else "stiffness field")
        if self.kind == PATCH:
            return drawn
        other = replace(foreign(drawn), foreign=ForeignNoise(0.0, 1.0))
        return replace(other, effects=drawn.effects) if self.kind == SQUIRCLE else other


def make(test: Test, folder: Path) -> None:
    """Diagnose a test and write its file."""
    trial = test.trial
    data = observed(trial, clean_experiment(trial))
    began = time.process_time()
    found = discover([data], replay=twin_replay, check=FiniteElementCheck(), few_effects=False)
    record = {
        "kind": test.kind,
        "specimen": trial.specimen,
        "true": _true(trial, data),
        "seconds": time.process_time() - began,
    }
    write_json(folder / f"{test.name}.json", {**record, **described(found)})


def _true(trial: Trial, data: Experiment) -> dict[str, float]:
    """Of what is hidden, as the catalogue has it."""
    hidden = trial.effects[0]
    if hidden.shape:
        return {**hidden.amplitudes, **hidden.shape}
    more, low, high = hidden.more, data.points.min(axis=0), data.points.max(axis=0)
    size = float((high - low).max())
    x, y = (np.array([more["x"], more["y"]]) - (low + high) / 2) / size
    found = {"a": more["height"], "x": float(x), "y": float(y)}
    if "slender" not in more:
        return {**found, "radius": more["width"] / size, "e1": 0.0, "e2": 0.0}
    e = 0.5 * np.log(more["slender"])  # of the ellipse of as large a ratio and area
    shape = {"e1": float(e * np.cos(2 * more["tip"])), "e2": float(e * np.sin(2 * more["tip"]))}
    return {**found, "radius": INCLUSION * more["width"] / size, **shape}


def row(one: dict[str, Any]) -> list[str]:
    """Of the table."""
    inclusion = next((a for a in one["additions"] if a["effect"] == "inclusion"), None)
    fitted = "" if inclusion is None else _words({**inclusion["amplitudes"], **inclusion["shape"]})
    dominant = one["dominant"]["effect"] if one["dominant"] else ""
    chi = f"{one['rounds'][0]['chi_square']:.1f}, {one['rounds'][-1]['chi_square']:.2f}"
    return [one["kind"], one["specimen"], _words(one["true"]), one["verdict"], ", ".join(one["named"]), dominant, fitted, chi]  # fmt: skip


def _words(values: dict[str, float]) -> str:
    long, short, angle = half_axes(values["radius"], values["e1"], values["e2"])
    return f"{values['a']:+.3f} at ({values['x']:+.2f}, {values['y']:+.2f}), {long:.2f} x {short:.2f}, {np.degrees(angle):.0f}"


def main() -> None:
    """Make what is missing, then the numbers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=74100, help="seed (default %(default)s)")
    parser.add_argument("--each", type=int, default=4, help="tests of each kind (default %(default)s)")
    parser.add_argument("--jobs", type=int, default=1, help="tests side by side (default %(default)s)")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    todo = [Test(kind, options.first + len(KINDS) * i + k) for i in range(options.each) for k, kind in enumerate(KINDS)]
    found = records(make, options.folder, todo, options.jobs, "inclusions")
    found.sort(key=lambda one: KINDS.index(one["kind"]))
    content = {
        "command": f"python -m benchmarks.inclusions FOLDER --first {options.first} --each {options.each}",
        "made": datetime.now(UTC).date().isoformat(),
        "how": "seeds not looked at before, the diagnosis fixed before, every test that was finished",
        "numbers": {"first": options.first},
        "tables": {"tests": [HEAD, *map(row, found)]},
    }
    RESULTS.write_text(json.dumps(content, indent=1) + "\n")


if __name__ == "__main__":
    main()
