"""What a polish does to the coarsest camera of the resolution study: bias, chi-square, held-out increments, time.

In: the cross of the study, its noise seeds and their number of camera points. Out, in a folder: ``polish.csv``, a seed a row, and a manifest with medians. Bias: mean stress
error within the calibrated range, worst of three modes, before and after. Held-out: every third increment, `--held-out` seeds. Run:
``python benchmarks/polish.py [--resolution 12.5]``.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

COLUMNS = (
    "seed",
    "bias before, %",
    "bias after, %",
    "kept",
    "chi-square before",
    "chi-square after",
    "CPU s",
    "seconds",
)
HELD = ("seed", "kept", "chi-square before", "after", "force error before, %", "after, %", "field error before, mm", "after, mm")  # fmt: skip


def arguments(words: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("results/benchmark-polish"))
    parser.add_argument("--overwrite", action="store_true", help="empty an earlier folder of this benchmark")
    parser.add_argument("--resolution", default="12.5", help="percent of the camera's points (default 12.5: 1152)")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--held-out", type=int, default=3, help="seeds that are also judged on held-out increments")
    parser.add_argument("--clean", action="store_true", help="also data without noise, weighted as if they had it")
    return parser.parse_args(words)


def experiments(folder: Path, resolution: str, seeds: int) -> tuple[float, list[Any]]:
    """Calibrated I1 and Experiments of the study: without noise, but with that of the others stated; then every seed."""
    from calibrate.data.experiment import Experiment
    from meshes import Mesh
    from studies.grid import steps
    from studies.grid.axes import CLEAN, PLANE, Case
    from studies.grid.presets.resolution_study import DEFAULT
    from studies.synthetic.coarsening import coarsening

    settings = replace(DEFAULT, resolutions=("100", resolution), keep_all=False)
    steps.forward(folder, settings, "cross", PLANE)
    for level in settings.resolutions:
        steps.mesh(folder, settings, "cross", level)
    steps.observe(folder, settings, "cross", PLANE)
    clean = Experiment.load(folder / "clean" / f"cross_{PLANE}.npz")
    limit = json.loads((folder / "clean" / f"cross_{PLANE}.json").read_text())["calibrated_I1"]
    camera = coarsening(clean.points, clean.triangles, Mesh.load(folder / "meshes" / f"cross_{resolution}.npz"))
    cases = [Case("cross", PLANE, resolution, "0.1", str(k)) for k in range(seeds)]
    found = [camera.apply(steps.record(clean, settings, one)) for one in cases]
    exact = camera.apply(steps.record(clean, settings, Case("cross", PLANE, resolution, "0", CLEAN)))
    return limit, [replace(exact, noise=found[0].noise), *found]


def bias(model: Any, limit: float) -> float:
    """%, worst of the modes."""
    from studies.accuracy.metrics import ArrudaBoyceTruth, agreement

    return max((100 * score.bias for score in agreement(model, ArrudaBoyceTruth(), limit)), key=abs)


def row_of(seed: str, experiment: Any, limit: float) -> list[Any]:
    """See `COLUMNS`."""
    from calibrate.fitting.calibration import calibrate
    from studies.polish.polished_calibration import polished

    before = calibrate(experiment)
    cpu, clock = time.process_time(), time.perf_counter()
    after, record = polished(before)
    spent = time.process_time() - cpu, time.perf_counter() - clock
    assert record.before is not None and record.after is not None
    per_row = [e.chi_square / e.equations for e in (record.before, record.after)]
    return [seed, bias(before.model, limit), bias(after.model, limit), str(record.kept), *per_row, *spent]


def held_row(seed: int, experiment: Any) -> list[Any]:
    """See `HELD`."""
    from calibrate.diagnosis.hold_out import HoldOut
    from calibrate.fitting.calibration import calibrate
    from studies.polish.polished_calibration import polished

    fitted = HoldOut.parse("every:3", 0).increments(experiment)
    part, held = (experiment.select(np.flatnonzero(mask)) for mask in (fitted, ~fitted))
    _, record = polished(calibrate(part), held)
    pair = record.held_before, record.held_after
    assert pair[0] is not None and pair[1] is not None
    errors = [f(e) for f in (lambda e: e.chi_square / e.equations, lambda e: 100 * e.force_error, lambda e: e.field_error)
              for e in pair]  # fmt: skip
    return [seed, str(record.kept), *errors]


def main(words: list[str] | None = None) -> int:
    args = arguments(words)
    from studies.output import Manifest, open_output_folder, write_csv

    settings = {key: value for key, value in vars(args).items() if key not in ("output", "overwrite")}
    started = time.time()
    folder = open_output_folder(args.output, args.overwrite, {"benchmark": "polish", **settings})
    limit, tests = experiments(folder, args.resolution, args.seeds)
    rows = []
    for seed, test in enumerate(tests, start=-1):
        if seed >= 0 or args.clean:
            rows.append(row_of("clean" if seed < 0 else str(seed), test, limit))
            print(rows[-1], flush=True)
    held = [held_row(seed, tests[seed + 1]) for seed in range(args.held_out)]
    write_csv(folder / "polish.csv", COLUMNS, rows, ["chi-square: of the replay, per equation"])
    write_csv(
        folder / "held_out.csv", HELD, held, ["replays with the motion of the grips as measured; every third increment"]
    )
    noisy = np.array([row[1:3] for row in rows if row[0] != "clean"])
    medians = dict(zip(("before", "after"), np.median(noisy, axis=0).tolist(), strict=True))
    Manifest(0, settings, started=started).beside(folder / "polish.csv", folder / "held_out.csv", median_bias=medians)
    print(
        f"{len(tests[0].points)} points; median bias {medians['before']:.3f} % before, {medians['after']:.3f} % after"
    )
    for row in held:
        print(row)
    return 0


if __name__ == "__main__":
    sys.exit(main())
