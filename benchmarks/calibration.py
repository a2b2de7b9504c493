"""Calibration side by side: SLSQP on the full data, SLSQP and bounded Gauss-Newton on the reduction, one core.

In: the cross, solved with biquadratic quads (or `--solution`, a file of that solve). Out, in a folder:
``calibration.csv``, ``calibration.md`` and a manifest; ``rows/`` holds each row as it is done, so that a run that was
stopped goes on where it was.

The first three methods minimise one objective, the paper's loss with C_F frozen, on the same clean data from the
same random starts. `weighted` is the default calibration with its own loss, shown for its stress error. A row of
SLSQP ends when its CPU time is used up; it then says how many starts it finished, and its best point so far is
scored. Run: ``python benchmarks/calibration.py [--quick]``.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

SIZES = (5000, 20000, 100000)
LAYERS = ((1,), (4, 4), (16, 16))
INPUTS = ("I1", "I1I2")
CLEAN_METHODS = ("gauss-newton", "slsqp-reduced", "slsqp-full", "weighted")
NOISY_METHODS = ("gauss-newton", "weighted")
KEYS = ("triangles", "inputs", "layers", "data", "method")
COLUMNS = (
    *KEYS, "cpu_seconds", "wall_seconds", "compile_cpu_seconds", "assembly_cpu_seconds", "starts", "starts_done",
    "evaluations", "converged", "loss", "loss_reduced", "stress_bias", "stress_1_minus_r2", "stress_max_error",
)  # fmt: skip
NODES_PER_TRIANGLE = 0.52
KEY_CASE = (20000, "I1", (4, 4))


def one_core() -> None:
    """Keep this process, NumPy and XLA on one core; must come before JAX is imported."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def arguments(words: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("results/benchmark-calibration"))
    parser.add_argument("--overwrite", action="store_true", help="empty an earlier folder of this benchmark")
    parser.add_argument(
        "--quick", action="store_true", help="5k, I1, PANN (1) and (4,4); 4 starts, 10 s a row of SLSQP"
    )
    parser.add_argument("--sizes", type=int, nargs="+", help=f"triangles (default {SIZES})")
    parser.add_argument("--inputs", nargs="+", choices=INPUTS, help="input sets (default all)")
    parser.add_argument("--layers", nargs="+", type=layers_of, help="network sizes (default 1 4,4 16,16)")
    parser.add_argument("--starts", type=int, help="random starts (default 20)")
    parser.add_argument("--seconds", type=float, help="CPU time allowed for a row of SLSQP (default 60)")
    parser.add_argument("--increments", type=int, default=10)
    parser.add_argument("--forward-size", type=float, default=0.5, help="quads relative to the default mesh")
    parser.add_argument("--solution", type=Path, help="solution file of the whole cross, instead of solving")
    args = parser.parse_args(words)
    args.sizes = args.sizes or ([SIZES[0]] if args.quick else list(SIZES))
    args.inputs = args.inputs or (["I1"] if args.quick else list(INPUTS))
    args.layers = args.layers or list(LAYERS[:2] if args.quick else LAYERS)
    args.starts = args.starts or (4 if args.quick else 20)
    args.seconds = args.seconds or (10.0 if args.quick else 60.0)
    return args


def layers_of(text: str) -> tuple[int, ...]:
    """'4,4' to (4, 4)."""
    return tuple(int(n) for n in text.split(","))


def settings(args: argparse.Namespace) -> dict[str, Any]:
    """Whatever changes a row; which rows are done does not, so that a folder can be completed later."""
    return {
        "benchmark": "calibration",
        "starts": args.starts,
        "seconds": args.seconds,
        "increments": args.increments,
        "forward_size": args.forward_size,
        "solution": args.solution and str(args.solution.resolve()),
    }


def solution(args: argparse.Namespace) -> Any:
    """The solved cross, from `--solution`, from the folder, or solved now."""
    from forward.sheet.plane_stress import default_experiment
    from forward.solution import SurfaceSolution

    path = args.solution or args.output / "solution.npz"
    if not path.exists() and not args.solution:
        checkpoint = args.output / "solution_quarter.npz"
        default_experiment(
            size_factor=args.forward_size, n_increments=args.increments, progress=True, checkpoint=checkpoint
        ).save(path)
    return SurfaceSolution.load(path)


def experiments(args: argparse.Namespace, n_triangles: int) -> dict[str, Any]:
    """Clean and noisy Experiment on about `n_triangles` triangles."""
    from meshes import Cross, triangles
    from studies.synthetic import camera

    n_nodes = NODES_PER_TRIANGLE * n_triangles
    for _ in range(3):
        mesh = triangles(Cross(), n_nodes=round(n_nodes))
        n_nodes *= n_triangles / len(mesh.cells)
    clean = camera.observe(solution(args), mesh)
    return {"clean": clean, "noisy": camera.record(clean, camera.Camera(), 0)}


def plan(args: argparse.Namespace) -> list[tuple[int, str, str]]:
    """(triangles, inputs, data) of each case, smallest first."""
    return [(n, inputs, data) for n in sorted(args.sizes) for inputs in args.inputs for data in ("clean", "noisy")]


def run_case(args: argparse.Namespace, n: int, inputs: str, data: str) -> None:
    """Do the rows of one case that are not there yet."""
    methods = CLEAN_METHODS if data == "clean" else NOISY_METHODS
    missing = [
        (layers, m)
        for layers in args.layers
        for m in methods
        if not row_path(args, n, inputs, layers, data, m).exists()
    ]
    if not missing:
        return
    import calibration_cases as cases

    both = experiments(args, n)
    case = cases.Case(both[data], inputs, cases.reference_limit(both["clean"]))
    architectures: dict[tuple[int, ...], Any] = {}
    for layers, method in missing:
        print(f"{n} triangles, {inputs}, PANN{layers}, {data}: {method}", file=sys.stderr, flush=True)
        if method == "weighted":
            row = cases.weighted(case, layers, args.starts, 0)
        elif method == "gauss-newton":
            row, architectures[layers] = cases.gauss_newton(case, layers, args.starts, 0)
        else:
            if layers not in architectures:
                architectures[layers] = cases.gauss_newton(case, layers, args.starts, 0)[1]
            full = method == "slsqp-full"
            row = cases.slsqp(case, architectures[layers], full, args.starts, 0, args.seconds)
        save(args, row, n, inputs, layers, data, method, len(case.experiment.triangles))


def row_path(args: argparse.Namespace, n: int, inputs: str, layers: tuple[int, ...], data: str, method: str) -> Path:
    return args.output / "rows" / f"{n}_{inputs}_{'x'.join(map(str, layers))}_{data}_{method}.json"


def save(
    args: argparse.Namespace, row: dict, n: int, inputs: str, layers: tuple, data: str, method: str, m: int
) -> None:
    from studies.output import write_json

    key = {"size": n, "triangles": m, "inputs": inputs, "layers": list(layers), "data": data, "method": method}
    write_json(row_path(args, n, inputs, layers, data, method), {**key, "starts": args.starts, **row})


def rows(args: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Every row in the folder, in the order of the plan."""
    found = [json.loads(path.read_text()) for path in (args.output / "rows").glob("*.json")]
    order = {method: i for i, method in enumerate(("slsqp-full", "slsqp-reduced", "gauss-newton", "weighted"))}
    yield from sorted(found, key=lambda r: (r["size"], r["inputs"], r["layers"], r["data"], order[r["method"]]))


def cell(row: dict[str, Any], column: str) -> str:
    value = row[column]
    if isinstance(value, list):
        return "(" + ",".join(map(str, value)) + ")"
    if value is None:
        return ""
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def write(args: argparse.Namespace) -> str:
    """The tables and the manifest; returns the summary."""
    from studies.output import Manifest, write_csv, write_text

    done = list(rows(args))
    table = [[cell(row, c) if c == "layers" else row[c] for c in COLUMNS] for row in done]
    lines = ["| " + " | ".join(COLUMNS) + " |", "|" + " --- |" * len(COLUMNS)]
    lines += ["| " + " | ".join(cell(row, c) for c in COLUMNS) + " |" for row in done]
    note = (
        "CPU seconds of one core for all starts done; compilation and assembly apart, except `weighted`, whose time "
        f"includes assembly. SLSQP stops after {args.seconds:g} CPU seconds a row or 300 iterations a start. "
        "`evaluations`: of loss and gradient (SLSQP), steps of the polish over all starts (Gauss-Newton). "
        "`loss_reduced`: the paper's loss of every model. Stress errors: largest of uniaxial, equi-biaxial and "
        "pure-shear within the calibrated range, relative."
    )
    text = summary(done)
    csv, markdown = args.output / "calibration.csv", args.output / "calibration.md"
    write_csv(csv, COLUMNS, table)
    write_text(markdown, "\n".join(["# Calibration side by side", "", note, "", text, "", *lines, ""]))
    Manifest(seed=0, settings={**settings(args), "sizes": args.sizes, "core": sorted(os.sched_getaffinity(0))}).beside(
        csv, markdown
    )
    return text


def summary(done: list[dict[str, Any]]) -> str:
    """Gauss-Newton against SLSQP on the full data, at the key case and wherever both were run."""
    by_key = {(r["size"], r["inputs"], tuple(r["layers"]), r["method"]): r for r in done if r["data"] == "clean"}
    found = []
    for (size, inputs, layers, method), slow in by_key.items():
        fast = by_key.get((size, inputs, layers, "gauss-newton"))
        if method == "slsqp-full" and fast:
            found.append(comparison(fast, slow, (size, inputs, layers) == KEY_CASE))
    return "\n".join(found) or "no pair of rows to compare yet"


def comparison(fast: dict[str, Any], slow: dict[str, Any], is_key: bool) -> str:
    starts = fast["starts"]
    share = max(slow["starts_done"], 1) / starts
    estimate = slow["cpu_seconds"] / share
    if slow["starts_done"] == starts:
        how = f"{estimate:.3g} s"
    elif slow["starts_done"]:
        how = f"about {estimate:.3g} s, extrapolated from {slow['starts_done']} starts"
    else:
        how = f"more than {estimate:.3g} s, as not one start ended within {slow['cpu_seconds']:.3g} s"
    total = fast["cpu_seconds"] + fast["assembly_cpu_seconds"]
    return (
        f"- {'**key case** ' if is_key else ''}{fast['triangles']} triangles, PANN_{fast['inputs']}^{cell(fast, 'layers')}, "
        f"{starts} starts: reduction {fast['cpu_seconds']:.3g} s ({total:.3g} s with assembly), SLSQP on the full data "
        f"{how}: {estimate / fast['cpu_seconds']:.3g} times ({estimate / total:.3g} with assembly); largest stress "
        f"error {fast['stress_max_error']:.2g} against {slow['stress_max_error']:.2g}"
    )


def main(words: list[str] | None = None) -> int:
    args = arguments(words)
    one_core()
    from studies.output import open_output_folder

    open_output_folder(args.output, args.overwrite, settings(args))
    for n, inputs, data in plan(args):
        run_case(args, n, inputs, data)
        write(args)
    print(write(args))
    return 0


if __name__ == "__main__":
    sys.exit(main())
