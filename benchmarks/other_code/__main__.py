"""Diagnosis of tests of another code: `python -m benchmarks.other_code FOLDER`.

In: `cases.CASES`. Each is solved by felupe, written as an export, imported and diagnosed by the commands of the README on defaults. Out, in FOLDER: exports, Experiments,
reports; and `docs/results/other_code.json`, a line a case. What is there already is not made again.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

from benchmarks.other_code.cases import CASES, Case, write

RESULTS = Path(__file__).parents[2] / "docs" / "results" / "other_code.json"
HEAD = ["hidden", "verdict", "named, or else dominant", "amplitudes", "force, held out", "field, held out, mm", "CPU s"]
FREE = "bottom,top,holes"


def command(*words: object) -> None:
    """A command of equigap. Raises `CalledProcessError`."""
    subprocess.run([sys.executable, "-m", "studies.cli", *map(str, words)], check=True, stdout=subprocess.DEVNULL)


def made(name: str, case: Case, seed: int, home: Path) -> Path:
    """discovery.json of a case."""
    folder = home / name.replace(",", "").replace(" ", "_")
    if not (folder / "imported" / "experiment.npz").exists():
        if not (folder / "export" / "machine.csv").exists():
            write(case, folder / "export", seed)
        record = folder / "export" / "machine.csv"
        command("import", folder / "export", "--thickness", 1, "--free", FREE, "--record", record, *case.stated, "-o", folder / "imported", "--overwrite")  # fmt: skip
    found, cost = folder / "found" / "discovery.json", folder / "cpu_s.txt"
    if not cost.exists():
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command("discover", folder / "imported" / "experiment.npz", "-o", folder / "found")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        cost.write_text(f"{after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime:.0f}")
    return found


def row(case: Case, path: Path) -> list[str]:
    """Of the table."""
    found = json.loads(path.read_text())
    additions = {
        one["effect"]: one for one in json.loads((path.parent / "model.json").read_text()).get("additions", ())
    }
    names = found["named"] or ([found["dominant"]["effect"]] if found.get("dominant") else found["closest"])
    values = [
        ", ".join(f"{p['name']} = {p['value']:.3g}" for kind in ("amplitudes", "shape") for p in additions[name][kind][:3])
        for name in names if name in additions
    ]  # fmt: skip
    replayed = ((found.get("replay") or {}).get("final") or {}).get("judged") or {}
    cpu = (path.parent.parent / "cpu_s.txt").read_text()
    return [
        case.truth, found["verdict"], " and ".join(names) or "-", "; ".join(values) or "-",
        _number(replayed.get("force"), "{:.2%}"), _number(replayed.get("field"), "{:.2g}"), cpu,
    ]  # fmt: skip


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else form.format(value)


def main() -> None:
    """Cases in their order, the results after each."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="*", default=list(CASES), help="names of cases")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    rows, right, nulls, wrong = [], 0, 0, 0
    for name in args.only:
        case = CASES[name]
        path = made(name, case, args.seed + list(CASES).index(name), args.folder)
        rows.append(row(case, path))
        content = json.loads(path.read_text())
        explained = content["verdict"] == "explained"
        right += bool(explained and case.right and set(content["named"]) <= set(case.right))
        nulls += bool(case.null and content["verdict"] == "nothing significant")
        wrong += bool(explained and not set(content["named"]) <= set(case.right))
        print(*rows[-1], sep=" | ", flush=True)
        numbers = {"tests": len(rows), "right": right, "of_catalogue": sum(bool(CASES[n].right) for n in args.only[: len(rows)]),
                   "quiet": nulls, "nulls": sum(CASES[n].null for n in args.only[: len(rows)]), "wrong": wrong}  # fmt: skip
        RESULTS.write_text(json.dumps({
            "command": "python -m benchmarks.other_code FOLDER", "made": datetime.now(UTC).date().isoformat(),
            "how": f"seed {args.seed}, noise estimated at import but where stated, all else by default",
            "numbers": numbers, "tables": {"cases": [HEAD, *rows]},
        }, indent=1) + "\n")  # fmt: skip


if __name__ == "__main__":
    main()
