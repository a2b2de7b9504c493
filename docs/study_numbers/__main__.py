"""Take the numbers of a page from the folders of finished runs.

    python docs/study_numbers resolution results/resolution
    python docs/study_numbers thickness results/thickness
    python docs/study_numbers generalise results/generalise
    python docs/study_numbers design results/design results/cross-pattern
    python docs/study_numbers replay results/replay results/calibrate
    python docs/study_numbers replay_sheet results/discover
    python docs/study_numbers sheets results/measured results/replay results/replay-neo-hooke
    python docs/study_numbers sheet_stability results/sheet-stability
    python docs/study_numbers several_tests results/several-tests
    python docs/study_numbers joint_sheets results/discover
    python docs/study_numbers every_third results/discover
    python docs/study_numbers few_effects results/measured results/discover      the second of all three sheets together
    python docs/study_numbers few_effects_trials results/few-effects
    python docs/study_numbers noise_grid results/false-alarms
    python docs/study_numbers noise_lengths BEFORE AFTER      of two revisions
    python docs/study_numbers pulls results/pulls
    python docs/study_numbers diagnosis_cost results/benchmark-diagnosis
    python docs/study_numbers blas_threads results/benchmark-blas-threads
    python docs/study_numbers skin FOLDER              in which the commands of docs/ugly_data.md were run

In: output folders of the commands of `docs/results`. Out: a file of `docs/results`; `make numbers` puts it into the pages.
The folder of design is made by `--validate`, the second by `equigap design docs/design/cross_pattern.toml`.
"""

from __future__ import annotations

import argparse
import json
from datetime import date
from pathlib import Path

import blas_threads
import design
import diagnosis_cost
import every_third
import few_effects
import few_effects_trials
import generalise
import joint_sheets
import noise_grid
import noise_lengths
import pulls
import replay
import replay_sheet
import resolution
import several_tests
import sheet_stability
import sheets
import skin
import thickness

RESULTS = Path(__file__).parents[1] / "results"
STUDIES = {
    "resolution": resolution,
    "thickness": thickness,
    "generalise": generalise,
    "design": design,
    "replay": replay,
    "replay_sheet": replay_sheet,
    "sheets": sheets,
    "sheet_stability": sheet_stability,
    "several_tests": several_tests,
    "joint_sheets": joint_sheets,
    "every_third": every_third,
    "few_effects": few_effects,
    "few_effects_trials": few_effects_trials,
    "skin": skin,
    "noise_grid": noise_grid,
    "noise_lengths": noise_lengths,
    "pulls": pulls,
    "diagnosis_cost": diagnosis_cost,
    "blas_threads": blas_threads,
}


def main(words: list[str] | None = None) -> None:
    """Write the file of one study; raises what a folder that is no finished run of it raises."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("study", choices=STUDIES)
    parser.add_argument("folders", type=Path, nargs="+")
    given = parser.parse_args(words)
    found = STUDIES[given.study].take(*given.folders)
    head = {"command": found.pop("command"), "made": date.today().isoformat(),
            "how": f"{found.pop('how')}; computed by docs/study_numbers from the folder of the run"}  # fmt: skip
    path = RESULTS / f"{given.study}.json"
    path.write_text(json.dumps({**head, **found}, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
