"""Cost of a diagnosis with the whole catalogue, stage by stage, printed as a table and written beside its manifest.

In: the cross, solved with biquadratic quads, seen with noise by a camera of `--nodes` nodes. Out, in a folder:
``diagnosis.csv`` and a manifest. A row for each stage: CPU s of the first run, which compiles, and of the second; the
signatures once more by central differences, which take no compilation of derivatives but two evaluations for each number.
Run: ``python benchmarks/diagnosis.py``, with OMP_NUM_THREADS=1 on one core (``taskset -c 0``).
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any


def arguments(words: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("results/benchmark-diagnosis"))
    parser.add_argument("--overwrite", action="store_true", help="empty an earlier folder of this benchmark")
    parser.add_argument("--nodes", type=int, default=2600, help="of the camera's triangulation (default %(default)s)")
    parser.add_argument("--increments", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    return parser.parse_args(words)


def timed(times: dict[str, float], stage: str, function: Callable[[], Any]) -> Any:
    """Result of `function`; its CPU time is added to a stage."""
    start = time.process_time()
    result = function()
    times[stage] = times.get(stage, 0.0) + time.process_time() - start
    return result


def diagnose(experiment: Any) -> dict[str, float]:
    """CPU s of each stage of one diagnosis, and of signatures by differences."""
    import numpy as np

    from calibrate.diagnosis import base_fit, score_tests
    from calibrate.diagnosis.hold_out import HoldOut
    from calibrate.effects.chain import Addition

    times: dict[str, float] = {}
    problem, base = timed(times, "base model", lambda: base_fit.prepare([experiment], [HoldOut().training]))
    scores = timed(times, "tests of the catalogue", lambda: score_tests.score(problem, base))
    tested = [s.effect for s in scores if s.is_tested]

    def differences() -> None:
        for effect in tested:
            for shape in effect.shape_values(problem.trained[0].chain.data):
                null = np.array([p.null for p in effect.amplitudes])
                for i, p in enumerate(effect.amplitudes):
                    step = 1e-4 * p.typical * np.eye(len(null))[i]
                    for end in (null + step, null - step):
                        addition = Addition(effect, tuple(map(float, end)), tuple(shape))
                        problem.whiten([chain.residual(base.c, (addition,)) for chain in base.chains])

    timed(times, "signatures by central differences", differences)
    return times


def main(words: list[str] | None = None) -> int:
    args = arguments(words)
    from studies.accuracy import pulls
    from studies.output import Manifest, open_output_folder, write_csv
    from studies.synthetic import camera

    settings = {key: value for key, value in vars(args).items() if key not in ("output", "overwrite")}
    started = time.time()
    open_output_folder(args.output, args.overwrite, {"benchmark": "diagnosis", **settings})
    clean = pulls.clean_cross(n_nodes=args.nodes, n_increments=args.increments)
    clean = replace(clean, time=[float(i + 1) for i in range(clean.n_increments)])
    experiment = camera.record(clean, camera.Camera(camera.GaussianField(resolution=512)), args.seed)
    first, second = diagnose(experiment), diagnose(experiment)
    rows = [[stage, first[stage], second[stage]] for stage in first]
    whole = [sum(times[s] for s in ("base model", "tests of the catalogue")) for times in (first, second)]
    rows.insert(2, ["one diagnosis", *whole])
    columns = ["stage", "with compilation, s", "after compilation, s"]
    write_csv(args.output / "diagnosis.csv", columns, rows, ["CPU time of a diagnosis"])
    sizes = {"triangles": len(experiment.triangles), "increments": experiment.n_increments}
    Manifest(args.seed, settings, started=started).beside(args.output / "diagnosis.csv", **sizes)
    print(f"{sizes['triangles']} triangles, {sizes['increments']} increments")
    print(f"{columns[0]:>34} {columns[1]:>20} {columns[2]:>21}")
    for row in rows:
        print(f"{row[0]:>34} {row[1]:>20.1f} {row[2]:>21.1f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
