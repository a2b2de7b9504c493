"""Time and memory of the solid model beside other ways to solve it: the cross, 10 mm thick, one core.

In: sizes and methods. Out, in a folder: `forward3d.csv` and a manifest; with `--ranks`, `--million` and `--profile`
also `ranks.csv`, `million.csv`, `profile.csv`. Each case runs in a process of its own (`forward3d_cases.py`), after a
small one that compiles the forms. `rows/` holds each case as it is done, so that a run that was stopped goes on.

`default` is our model as it comes (PARDISO), `mumps` the same with MUMPS, `monolithic` displacement and pressure in
one matrix by DOLFINx's Newton method and MUMPS LU, `felupe` the same hexes in felupe with PARDISO. Compare CPU times:
other work on the machine (`load`: its mean number of processes when the case began) disturbs them less than wall
times. A case that would take more CPU time than `--timeout` is solved for two increments only, and its times are scaled by
the linear solves of the whole run; its note says so.
Run: `python benchmarks/forward3d.py`.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from studies.output import Manifest, open_output_folder, write_csv, write_json

# thousand unknowns of the displacement: (size factor of the plane mesh, layers in half the thickness)
SIZES = {36: (1.0, 2), 67: (0.84, 3), 150: (0.52, 4), 300: (0.38, 5), 600: (0.27, 6), 1000: (0.215, 7)}
METHODS = ("default", "mumps", "monolithic", "felupe")
VARIANTS = ("default", "mumps", "mumps-blr", "mumps-ooc")
DISPLACEMENT, INCREMENTS, FEW = 60.0, 10, 2
PATIENCE = 3  # wall time over CPU time that a case may take
GROWTH = 1.8  # of the time with the unknowns, to tell beforehand what would take too long
AIMS = {"felupe": 0.2, "monolithic": 0.25}  # of the default's time, from AIM_FROM unknowns
AIM_FROM, AIM_SOLVES, AGREEMENT = 60_000, 32, 1e-6
COLUMNS = (
    "unknowns", "method", "solves", "cpu_s", "wall_s", "peak_mb", "cpu_s_per_solve", "ratio_to_default",
    "force_difference", "load", "note",
)  # fmt: skip
RANK_COLUMNS = (
    "unknowns",
    "ranks",
    "solves",
    "cpu_s",
    "wall_s",
    "peak_mb",
    "largest_peak_mb",
    "speed_up",
    "load",
    "note",
)
MILLION_COLUMNS = (
    "unknowns", "variant", "first_step_s", "next_step_s", "peak_mb", "wall_s", "note",
)  # fmt: skip
PROFILE_COLUMNS = ("unknowns", "part", "calls", "cpu_s", "share")


def arguments(words: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("results/forward3d"))
    parser.add_argument("--overwrite", action="store_true", help="empty an earlier folder of this benchmark")
    parser.add_argument("--sizes", type=int, nargs="*", choices=SIZES, default=[36, 67, 150, 300])
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument("--timeout", type=float, default=1200.0, help="CPU time of one case, s (default 1200)")
    parser.add_argument("--memory", type=float, default=16.0, help="address space of one case, GB (default 16)")
    parser.add_argument("--ranks", type=int, nargs="?", const=67, choices=SIZES, help="MUMPS on 1 and 2 ranks")
    parser.add_argument("--million", type=int, nargs="*", choices=SIZES, help="memory of the solvers (300 600 1000)")
    parser.add_argument("--variants", nargs="+", choices=VARIANTS, default=list(VARIANTS), help="for --million")
    parser.add_argument("--profile", type=int, nargs="?", const=67, choices=SIZES, help="where the default's time goes")
    args = parser.parse_args(words)
    args.million = [300, 600, 1000] if args.million == [] else args.million or []
    return args


def run(args: argparse.Namespace, method: str, size: int, ranks: int = 1, **options: Any) -> dict[str, Any]:
    """One case, from its file if it is done; `failed` says what went wrong."""
    name = "_".join(map(str, (method, size, *options.values(), *([f"{ranks}ranks"] if ranks > 1 else []))))
    path = args.output / "rows" / f"{name}.json"
    if path.exists():
        return json.loads(path.read_text())
    increments = options.get("increments", INCREMENTS)
    case = {"method": method, "size_factor": SIZES[size][0], "layers": SIZES[size][1], **options}
    case |= {"displacement": DISPLACEMENT * increments / INCREMENTS, "increments": increments}
    case |= {"memory_gb": args.memory, "timeout": args.timeout}
    command = [sys.executable, str(Path(__file__).with_name("forward3d_cases.py")), json.dumps(case)]
    if ranks > 1:
        beside = shutil.which("mpiexec", path=str(Path(sys.executable).parent))
        command = [beside or "mpiexec", "-n", str(ranks), *command]
    print(f"forward3d: {name}", file=sys.stderr, flush=True)
    load = os.getloadavg()[0]
    row = {**case, "ranks": ranks, "load": load, **child(command, PATIENCE * args.timeout)}
    if "failed" not in row or row.get("too_long"):
        write_json(path, row)
    return row


def child(command: list[str], timeout: float) -> dict[str, Any]:
    """What a process printed, or how it failed; with it end the ranks that it started."""
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        out, err = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return {"failed": f"stopped after {timeout:g} s", "too_long": True}
    if process.returncode == 0:
        return json.loads(out.splitlines()[-1])
    if process.returncode == -signal.SIGXCPU:
        return {"failed": "stopped: too much CPU time", "too_long": True}
    return {"failed": (err.strip().splitlines() or [f"ended with {process.returncode}"])[-1][:200]}


def measure(args: argparse.Namespace, method: str, size: int, smaller: dict[str, Any] | None) -> dict[str, Any]:
    """A whole run, or two increments of it scaled up. smaller: the same method on the mesh before."""
    expected = 0.0
    if smaller and "failed" not in smaller:
        ratio = (SIZES[smaller["size"]][0] / SIZES[size][0]) ** 2 * SIZES[size][1] / SIZES[smaller["size"]][1]
        expected = smaller["cpu_s"] * ratio**GROWTH
    if expected <= args.timeout:
        row = run(args, method, size)
        if "failed" not in row or not row.get("too_long"):
            return {**row, "size": size, "note": row.get("failed", "")}
    row = run(args, method, size, increments=FEW)
    if "failed" in row:
        return {**row, "size": size, "note": row["failed"]}
    solves = smaller["solves"] if smaller and "solves" in smaller else row["solves"] * INCREMENTS / FEW
    factor = solves / row["solves"]
    note = f"extrapolated from {FEW} increments, {row['solves']} solves"
    scaled = {"cpu_s": factor * row["cpu_s"], "wall_s": factor * row["wall_s"], "solves": round(solves)}
    return {**row, **scaled, "size": size, "note": note}


def compare(args: argparse.Namespace) -> list[dict[str, Any]]:
    """Every method on every mesh, smallest first; the table grows with each."""
    rows: list[dict[str, Any]] = []
    for size in sorted(args.sizes):
        for method in sorted(args.methods, key=METHODS.index):
            before = [row for row in rows if row["method"] == method]
            rows.append(measure(args, method, size, before[-1] if before else None))
            relate(rows)
            write_csv(args.output / "forward3d.csv", COLUMNS, [[row.get(c) for c in COLUMNS] for row in rows])
    return rows


def relate(rows: list[dict[str, Any]]) -> None:
    """Add to each row what compares it with the default on the same mesh, at the load it reached."""
    defaults = {row["size"]: row for row in rows if row["method"] == "default" and "failed" not in row}
    for row in rows:
        if "failed" in row:
            continue
        row["cpu_s_per_solve"] = row["cpu_s"] / row["solves"]
        if default := defaults.get(row["size"]):
            row["ratio_to_default"] = row["cpu_s"] / default["cpu_s"]
            row["force_difference"] = row["forces"][-1] / default["forces"][row["increments"] - 1] - 1


def aims(rows: list[dict[str, Any]]) -> list[str]:
    """What was to be reached, and whether it was."""
    lines = []
    for row in rows:
        where = f"{row.get('unknowns', row['size'])} unknowns{' (extrapolated)' if row['note'] else ''}"
        if abs(row.get("force_difference", 0.0)) > AGREEMENT:
            lines.append(f"{where}: the force of {row['method']} DIFFERS by {row['force_difference']:.2g}")
        if row["method"] in AIMS and row.get("unknowns", 0) >= AIM_FROM and "ratio_to_default" in row:
            share, aim = 1 / row["ratio_to_default"], AIMS[row["method"]]
            word = "met" if share <= aim else "MISSED"
            lines.append(f"{where}: default takes {share:.3f} of the time of {row['method']}, aim {aim}: {word}")
        if row["method"] == "default" and not row["note"]:
            word = "met" if row["solves"] <= AIM_SOLVES else "MISSED"
            lines.append(f"{where}: default takes {row['solves']} linear solves, aim {AIM_SOLVES}: {word}")
    return lines


def scaling(args: argparse.Namespace) -> list[dict[str, Any]]:
    """MUMPS on one rank and on two."""
    rows = [run(args, "mumps", args.ranks, ranks) for ranks in (1, 2)]
    if not any("failed" in row for row in rows):
        rows[1]["speed_up"] = rows[0]["wall_s"] / rows[1]["wall_s"]
    return [{**row, "note": row.get("failed", "")} for row in rows]


def million(args: argparse.Namespace) -> list[dict[str, Any]]:
    """Two Newton steps of each linear solver on ever larger meshes."""
    rows = [run(args, "memory", n, variant=variant) for n in sorted(args.million) for variant in args.variants]
    return [{**row, "note": row.get("failed", "")} for row in rows]


def profile(args: argparse.Namespace) -> list[dict[str, Any]]:
    """Calls and CPU time of the default's parts."""
    row = run(args, "profile", args.profile)
    if "failed" in row:
        return [{"part": row["failed"]}]
    rest = row["cpu_s"] - sum(seconds for _, seconds in row["parts"].values())
    parts = {**row["parts"], "rest": (1, rest), "whole": (1, row["cpu_s"])}
    return [
        {"unknowns": row["unknowns"], "part": part, "calls": calls, "cpu_s": seconds, "share": seconds / row["cpu_s"]}
        for part, (calls, seconds) in parts.items()
    ]


def report(args: argparse.Namespace, name: str, columns: tuple[str, ...], rows: list[dict[str, Any]]) -> None:
    """Write a table with its manifest, and print it."""
    path = args.output / f"{name}.csv"
    write_csv(path, columns, [[row.get(c) for c in columns] for row in rows])
    lines = aims(rows) if name == "forward3d" else []
    settings = {"displacement": DISPLACEMENT, "increments": INCREMENTS, "timeout": args.timeout, "memory": args.memory}
    others = {name: metadata.version(name) for name in ("felupe", "mkl")}
    Manifest(settings={**settings, **others, "cpus": os.cpu_count()}).beside(path, aims=lines, rows=rows)
    print(f"\n| {' | '.join(columns)} |\n|{' --- |' * len(columns)}")
    for row in rows:
        cells = [f"{v:.4g}" if isinstance(v, float) else str(v) for v in (row.get(c, "") for c in columns)]
        print(f"| {' | '.join(cells)} |")
    print("\n".join(lines))


def main(words: list[str] | None = None) -> int:
    args = arguments(words)
    open_output_folder(
        args.output, args.overwrite, {"benchmark": "forward3d", "timeout": args.timeout, "memory": args.memory}
    )
    if args.sizes:
        report(args, "forward3d", COLUMNS, compare(args))
    if args.ranks:
        report(args, "ranks", RANK_COLUMNS, scaling(args))
    if args.million:
        report(args, "million", MILLION_COLUMNS, million(args))
    if args.profile:
        report(args, "profile", PROFILE_COLUMNS, profile(args))
    print(f"written to {args.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
