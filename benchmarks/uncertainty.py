"""Pull test of the stated uncertainty, printed as a table and written beside its manifest.

In: a specimen solved with biquadratic quads, seen by a coarse camera mesh with `--seeds` noise seeds. Out, in a folder:
``pulls.csv`` and a manifest. Columns: see `studies.accuracy.pulls`; std and median of the pulls over seeds, against the
calibration of the clean data and against the material. Run: ``python benchmarks/uncertainty.py [--specimen cross]``.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path


def arguments(words: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("results/benchmark-uncertainty"))
    parser.add_argument("--overwrite", action="store_true", help="empty an earlier folder of this benchmark")
    parser.add_argument("--specimen", choices=("plate", "cross"), default="plate")
    parser.add_argument("--nodes", type=int, help="of the camera's triangulation (default 1000, cross 1150)")
    parser.add_argument("--increments", type=int, help="default 4, cross 5")
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--inputs", choices=("I1", "I1I2"), default="I1")
    parser.add_argument("--layers", default="4,4", help="neurons of each layer (default 4,4)")
    parser.add_argument("--starts", type=int, default=8, help="random starts of each fit (default 8)")
    return parser.parse_args(words)


def main(words: list[str] | None = None) -> int:
    args = arguments(words)
    from calibrate.fitting.calibration import Options
    from studies.accuracy import pulls
    from studies.output import Manifest, open_output_folder, write_csv
    from studies.synthetic import camera

    settings = {key: value for key, value in vars(args).items() if key not in ("output", "overwrite")}
    started = time.time()
    open_output_folder(args.output, args.overwrite, {"benchmark": "uncertainty", **settings})
    make = {"plate": pulls.clean_plate, "cross": pulls.clean_cross}[args.specimen]
    sizes = {"n_nodes": args.nodes, "n_increments": args.increments}
    clean = make(**{key: value for key, value in sizes.items() if value})
    device = {"plate": pulls.PLATE_CAMERA, "cross": camera.Camera(camera.GaussianField(resolution=512))}[args.specimen]
    options = Options(args.inputs, tuple(int(n) for n in args.layers.split(",")), starts=args.starts)
    result = pulls.pull_test(clean, device, options, range(args.seeds))
    columns, rows = result.table()
    write_csv(args.output / "pulls.csv", columns, rows, ["standard deviation and median of pulls over seeds"])
    chi_square = float(result.chi_square.mean())
    Manifest(0, settings, started=started).beside(args.output / "pulls.csv", mean_reduced_chi_square=chi_square)
    print(f"{clean.name}, {len(clean.points)} nodes, {args.seeds} seeds, {time.time() - started:.0f} s; ", end="")
    print(f"mean reduced chi-square {chi_square:.3f}")
    for i, name in enumerate(columns):
        print(f"{name:>18} ", " ".join(f"{row[i]:>8.8}" if i == 0 else f"{row[i]:8.3f}" for row in rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
