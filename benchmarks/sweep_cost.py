"""What a sweep costs: CPU time, memory and disk of a few of its jobs, measured; of the whole of it, extrapolated.

In: the settings of `equigap sweep` (`--quick`: those of its --quick). Out, in a folder: ``sweep_cost.csv`` and ``.md`` with a
row for each measured job and the sum over all jobs, and a manifest. `rows/` holds each measurement as it is done, so
that a run that was stopped goes on.

Each job is the one that the workflow would start, in a process of its own on one core; the operating system says what
it took. CPU times are compared, as other work on the machine disturbs them less than wall times. The first calibration
compiles what the others find compiled: it is measured apart (`first case`). A sweep is taken to cost the mean of what was
measured of each kind of job, times their number.
Run: ``python benchmarks/sweep_cost.py [--quick]``.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from studies.grid import workflow
from studies.grid.axes import PLANE, Case, Settings
from studies.grid.presets.sweep_study import SWEEP
from studies.grid.study import open_study
from studies.output import Manifest, write_csv, write_json, write_text

COLUMNS = ("kind", "job", "cpu_s", "wall_s", "peak_mb", "output_kb")
CORES = (2, 100)
Job = tuple[str, list[str], list[str]]  # kind, words after the folder, files that it leaves


def jobs(settings: Settings) -> Iterator[Job]:
    """Those that are measured, each after what it needs: thin and thickest, finest and coarsest, and some in between."""
    thick = settings.thicknesses[-1]
    for specimen in settings.specimens:
        chosen = settings.thicknesses if specimen == settings.specimens[0] else (PLANE, thick)
        for thickness in chosen:
            kind = "forward 2D" if thickness == PLANE else "forward 3D"
            yield kind, ["forward", specimen, thickness], [f"forward/{specimen}_{thickness}.npz"]
        for resolution in settings.resolutions:
            yield "mesh", ["mesh", specimen, resolution], [f"meshes/{specimen}_{resolution}.npz"]
        for thickness in (PLANE, thick):
            files = [f"clean/{specimen}_{thickness}.{suffix}" for suffix in ("npz", "json")]
            yield "observe", ["observe", specimen, thickness], files
    finest, coarsest, noise, specimen = (
        settings.resolutions[0],
        settings.resolutions[-1],
        settings.noises[-1],
        settings.specimens[0],
    )
    yield calibration("first case", Case(specimen, PLANE, finest, noise, "0"))
    for resolution in settings.resolutions:
        yield calibration("case", Case(specimen, PLANE, resolution, noise, "1"))
    yield calibration("case", Case(specimen, thick, finest, noise, "1"))
    for resolution in (finest, coarsest):
        yield calibration("case", Case(settings.specimens[-1], thick, resolution, noise, "1"))


def calibration(kind: str, case: Case) -> Job:
    return kind, ["fit", case.specimen, case.thickness, case.resolution, case.record], [str(case.path(Path()))]


def counts(settings: Settings) -> dict[str, int]:
    """Number of jobs of each kind in the whole sweep."""
    specimens, solids = len(settings.specimens), sum(h != PLANE for h in settings.thicknesses)
    plane = len(settings.thicknesses) - solids
    return {
        "forward 2D": specimens * plane, "forward 3D": specimens * solids, "mesh": specimens * len(settings.resolutions),
        "observe": specimens * len(settings.thicknesses), "first case": 1, "case": len(settings.cases) - 1,
    }  # fmt: skip


def measure(folder: Path, job: Job) -> dict[str, Any]:
    """One job's row, from its file if it is done."""
    kind, (step, *keys), files = job
    path = folder / "rows" / f"{'_'.join([step, *keys])}.json"
    if not path.exists():
        print("sweep_cost:", step, *keys, file=sys.stderr, flush=True)
        command = [sys.executable, "-m", "studies.grid.steps", step, str(folder), *keys]
        begin = time.perf_counter()
        process = subprocess.Popen(command, env=workflow.environment(folder / "workflow"))
        _, status, used = os.wait4(process.pid, 0)
        if status:
            raise SystemExit(f"{' '.join(command)}: failed, see above")
        sizes = sum((folder / name).stat().st_size for name in files)
        write_json(path, {
            "kind": kind, "job": " ".join([step, *keys]), "cpu_s": used.ru_utime + used.ru_stime,
            "wall_s": time.perf_counter() - begin, "peak_mb": used.ru_maxrss / 1e3, "output_kb": sizes / 1e3,
        })  # fmt: skip
    return json.loads(path.read_text())


def extrapolate(rows: Sequence[dict[str, Any]], number: dict[str, int]) -> list[dict[str, Any]]:
    """One row a kind: jobs, CPU seconds of one (lowest, mean, highest), of all; the last row is the sum."""
    result = []
    for kind, count in number.items():
        found = [row for row in rows if row["kind"] == kind]
        if not found or not count:
            continue
        seconds = [row["cpu_s"] for row in found]
        mean = sum(seconds) / len(seconds)
        disk = count * sum(row["output_kb"] for row in found) / len(found)
        result.append({
            "kind": kind, "measured": len(found), "jobs": count, "lowest_s": min(seconds), "mean_s": mean,
            "highest_s": max(seconds), "core_h": count * mean / 3600, "core_h_lowest": count * min(seconds) / 3600,
            "core_h_highest": count * max(seconds) / 3600, "disk_mb": disk / 1e3, "peak_mb": max(row["peak_mb"] for row in found),
        })  # fmt: skip
    total: dict[str, Any] = dict.fromkeys(result[0])
    total |= {
        key: sum(row[key] for row in result)
        for key in result[0]
        if key in ("jobs", "measured", "disk_mb") or "core_h" in key
    }
    return [*result, {**total, "kind": "all", "peak_mb": max(row["peak_mb"] for row in result)}]


def sentences(rows: Sequence[dict[str, Any]], total: dict[str, Any]) -> list[str]:
    """The sweep on so many cores: work over cores, but no less than its longest chain of jobs."""

    def longest(word: str) -> float:
        return max(row["cpu_s"] for row in rows if word in row["kind"])

    chain = longest("forward") + longest("observe") + longest("case")
    texts = []
    for cores in CORES:
        low, mean, high = (
            max(3600 * total[key] / cores, chain) / 60 for key in ("core_h_lowest", "core_h", "core_h_highest")
        )
        memory = cores * total["peak_mb"] / 1e3
        texts.append(f"{cores} cores: {mean:.3g} minutes ({low:.3g} to {high:.3g}), at most {memory:.3g} GB of memory")
    return [*texts, f"longest chain (a solution, its observation, a case): {chain:.0f} s"]


def markdown(columns: Sequence[str], rows: Sequence[dict[str, Any]]) -> str:
    cells = [
        [f"{v:.3g}" if isinstance(v, float) else "" if v is None else str(v) for v in map(row.get, columns)]
        for row in rows
    ]
    lines = [list(columns), ["---"] * len(columns), *cells]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("results/sweep-cost"))
    parser.add_argument("--overwrite", action="store_true", help="empty an earlier folder of this benchmark")
    parser.add_argument("--quick", action="store_true", help="the settings of `equigap sweep --quick`")
    args = parser.parse_args(words)
    settings = SWEEP.quick if args.quick else SWEEP.default
    folder = open_study(args.output, settings, args.overwrite)
    once = {tuple(job[1]): job for job in jobs(settings)}
    rows = [measure(folder, job) for job in once.values()]
    summary = extrapolate(rows, counts(settings))
    texts = sentences(rows, summary[-1])
    table = folder / "sweep_cost.csv"
    write_csv(table, COLUMNS, [[row[c] for c in COLUMNS] for row in rows])
    text = "\n\n".join([markdown(COLUMNS, rows), markdown(list(summary[0]), summary), *texts])
    write_text(folder / "sweep_cost.md", text + "\n")
    Manifest(settings=asdict(settings)).beside(table, folder / "sweep_cost.md", extrapolated=summary)
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
