"""equigap beside NN-EUCLID and classical laws on NN-EUCLID's data, and a linear elastic plate: the numbers of docs/peers.md.

NN-EUCLID runs by its own code with its own settings in an interpreter that has torch (and pandas below 3), from a clone of
github.com/EUCLID-code/EUCLID-hyperelasticity-NN; neither is part of this project. It takes about half an hour of one core a member and is
trained in pieces: call again with more ``--epochs`` and it goes on. Everything else is kept case by case and not computed twice.

    python benchmarks/peers.py --nn-euclid CLONE --python PYTHON --output results/peers [--minutes 12 --epochs 500] [--results docs/results/peers.json]

Times are CPU seconds of one process with one thread, which other work on the machine disturbs little.
"""
# ruff: noqa: E402  (the number of threads must be set before anything numerical is imported)

from __future__ import annotations

import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parent)]

from beside import elastic_plate, fibre_search, peer_figures, peer_tables
from beside.peer_process import Member
from beside.side_by_side import compare

from calibrate.fitting.calibration import Options, calibrate
from studies.commands.import_data import import_experiment
from studies.output import Manifest, write_figure, write_json

CASES = ("Ogden-high", "Ogden-low", "Holzapfel-high")
GROWTH = ("Ogden", "high")


def arguments(words: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else "")
    parser.add_argument("--nn-euclid", type=Path, required=True, metavar="CLONE", help="a clone of NN-EUCLID")
    parser.add_argument("--python", type=Path, required=True, help="an interpreter with torch and pandas below 3")
    parser.add_argument("--output", type=Path, default=Path("results/peers"))
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES), help="material and noise")
    parser.add_argument("--epochs", type=int, default=500, help="of each member, in all")
    parser.add_argument("--minutes", type=float, default=1e6, help="of training a member in this call; 0: none")
    parser.add_argument("--growth", type=int, nargs="*", default=[2, 4, 6], metavar="STEPS", help="load steps to time")
    parser.add_argument("--seeds", type=int, default=1, help="of the starts of equigap's network")
    parser.add_argument("--plate-seeds", type=int, default=5, help="of the noise on the elastic plate")
    parser.add_argument("--results", type=Path, help="where the numbers of the page go")
    return parser.parse_args(words)


def kept(path: Path, make: Callable[[], Any], fresh: bool = False) -> Any:
    """What a file holds, made and written if it does not exist."""
    if fresh or not path.exists():
        write_json(path, make())
    return json.loads(path.read_text())


def case(args: argparse.Namespace, material: str, noise: str) -> dict[str, Any]:
    """One material and noise; evaluated again where its member has learnt more."""
    folder = args.output / "members" / f"{material}-{noise}-0"
    member = Member(args.nn_euclid, args.python, material, noise, 0, folder.resolve())
    member.train(args.minutes, args.epochs)
    path = args.output / f"{material}-{noise}.json"
    epochs = len(member.history())
    known = json.loads(path.read_text()) if path.exists() else None
    if known is None or known["epochs"] != epochs:
        known = {**compare(member, args.seeds, known), "epochs": epochs}
        write_json(path, known)
    return known


def growth(args: argparse.Namespace, steps: int) -> dict[str, Any]:
    """CPU time with some load steps: one calibration in a process that has compiled, one epoch."""
    member = Member(args.nn_euclid, args.python, *GROWTH, 0, args.output)
    test, options = import_experiment(member.data).select(list(range(steps))), Options(inputs="I1I2")
    calibrate(test, options)
    start = time.process_time()
    calibrate(test, options)
    ours = time.process_time() - start
    return {"steps": steps, "equigap": ours, "epoch": member.seconds_an_epoch(steps)}


def main(words: list[str] | None = None) -> int:
    """Run what is missing, and write figures, tables and numbers."""
    args = arguments(words)
    args.output.mkdir(parents=True, exist_ok=True)
    cases = [case(args, *name.split("-")) for name in args.cases]
    plate = kept(args.output / "plate.json", lambda: elastic_plate.study((1.0, 0.6), args.plate_seeds))
    fibrous = args.nn_euclid / "fem-data" / "noise=high" / "Holzapfel"
    fibres = kept(args.output / "fibres.json", lambda: fibre_search.search(import_experiment(fibrous)))
    times = [kept(args.output / f"growth-{n}.json", lambda n=n: growth(args, n)) for n in args.growth]
    member = Member(args.nn_euclid, args.python, *GROWTH, 0, args.output)
    settings = {"nn_euclid": member.versions(), "cpu": platform.processor() or platform.machine()}
    manifest = Manifest(settings=settings)
    pictures = {"peers-loss": peer_figures.loss_over_time(cases)}
    pictures |= {f"peers-paths-{c['material']}-{c['noise']}": peer_figures.paths(c) for c in cases}
    for name, figure in pictures.items():
        path = args.output / f"{name}.png"
        write_figure(path, figure, dpi=130)
        manifest.beside(path)
    numbers, tables = peer_tables.summary(cases, plate, times, settings)
    numbers |= peer_tables.fibre_numbers(fibres)
    command = "python benchmarks/peers.py --nn-euclid CLONE --python PYTHON"
    how = "CPU seconds of one thread; one realisation of noise a case, as published; members trained in pieces"
    target = args.results or args.output / "summary.json"
    write_json(target, {"command": command, "how": how, **settings, "numbers": numbers, "tables": tables})
    for title, rows in tables.items():
        print(f"\n{title}")
        print("\n".join(" | ".join(map(str, row)) for row in rows))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
