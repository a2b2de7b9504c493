"""Three tests of one material at once, whose specimens or rig have something: `python -m benchmarks.several_tests --first 998000`.

In: seed of the first test; three seeds a set. Each set hides an effect of the material in all three tests, or none, and one of a specimen (stiffness gradient,
stiffness field, inclusion, unmeasured strip, warp) in none, in one of them, in all of them alike; every third material is diagnosed without its effect in the catalogue.
Specimens, loads, times and noise are those of the blind trials. Sizes are the largest of three draws, as a weak effect says nothing about a joint fit.

Out, in a folder: a JSON file a set, kept, so that a stopped run goes on; ``several_tests.json`` with tables and every set.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.noise.kept_records import records
from calibrate.diagnosis.discovery import discover
from calibrate.diagnosis.evidence.own_effects import OwnEffect
from calibrate.diagnosis.selection import Discovery, Verdict
from calibrate.effects import CATALOGUE
from studies.output.folder import open_output_folder
from studies.output.manifest import Manifest
from studies.output.writing import write_json
from studies.replay.replay_check import FiniteElementCheck
from studies.replay.twin_replay import twin_replay
from studies.synthetic.camera import stream
from studies.trials import blind_data
from studies.trials.blind_case import catalogue_without
from studies.trials.blind_effects import ALSO, EFFECTS, Hidden
from studies.trials.blind_trial import SPECIMENS, Trial

TESTS, DRAWS = 3, 3  # a set; of a size
HIDING, PLACE = 11, 12  # random streams, beside those of the trials
OWN = ("stiffness gradient", "stiffness field", "inclusion", "unmeasured strip", "initial warp")
ALIKE = ("stiffness gradient", "initial warp")  # that a rig, or the way specimens are made, gives all of them
MATERIALS = ("second invariant", "viscoelasticity", "compressibility", "one fibre family", "Payne softening")
ROUNDS = 3  # of sets, each with one of every kind


@dataclass(frozen=True)
class Set:
    """Three tests. material: an effect that all have, or none; own: of a specimen, or none; alike: all have it, else one; removed: the material's is not in the catalogue."""

    seed: int
    material: str = ""
    own: str = ""
    alike: bool = False
    removed: bool = False

    @property
    def name(self) -> str:
        """What is hidden, and the seed."""
        where = "_in_all" if self.alike else "_in_one"
        parts = [self.material + ("_removed" if self.removed else ""), self.own + (where if self.own else "")]
        return ("+".join(part for part in parts if part) or "none").replace(" ", "_") + f"-{self.seed}"

    @property
    def where(self) -> tuple[int, ...]:
        """Numbers of the tests that have the effect of a specimen."""
        if not self.own:
            return ()
        return tuple(range(TESTS)) if self.alike else (int(stream(self.seed, PLACE).integers(TESTS)),)

    def trials(self) -> list[Trial]:
        """Every number of the three."""
        rng, common = stream(self.seed, HIDING), (self.material or None,)
        drawn = [blind_data.draw(self.seed + k, *common) for k in range(TESTS)]
        first = drawn[0]
        shared = (_largest(self.material, rng, first),) if self.material else ()
        own = (_largest(self.own, rng, drawn[self.where[0]]),) if self.own else ()
        return [
            replace(
                one,
                material=first.material,
                thickness=first.thickness,
                effects=shared + (own if k in self.where else ()),
            )
            for k, one in enumerate(drawn)
        ]


def _largest(name: str, rng: np.random.Generator, trial: Trial) -> Hidden:
    """Of some draws."""
    specimen, interval = SPECIMENS[trial.specimen], float(np.diff(trial.times).min())
    about = blind_data.situation(specimen, trial.material, trial.thickness, trial.stretch, trial.times[-1], interval)
    draws = [Hidden(name, *EFFECTS[name](rng, about)) for _ in range(DRAWS)]

    def size(one: Hidden) -> float:
        sizes = list(one.amplitudes.values()) or [one.more[key] for key in ("height", "slope") if key in one.more]
        return float(np.linalg.norm(sizes))

    return max(draws, key=size)


def sets(first: int) -> list[Set]:
    """All, mixed so that a run that is stopped has some of each kind."""
    return list(_sets(count(first, TESTS)))


def _sets(seeds: Iterator[int]) -> Iterator[Set]:
    for turn in range(ROUNDS):
        for k, own in enumerate(OWN):
            material = MATERIALS[(k + turn) % len(MATERIALS)]
            yield Set(next(seeds), own=own)
            yield Set(next(seeds), material, own)
            if k % 2 == 0:
                yield Set(next(seeds))
            else:
                yield Set(next(seeds), material, removed=True)
        for own in ALIKE:
            yield Set(next(seeds), own=own, alike=True)


def diagnosed(one: Set, folder: Path) -> None:
    """Write NAME.json of a set: what is hidden, and what a joint diagnosis says."""
    began = time.process_time()
    trials = one.trials()
    tests = [replace(blind_data.make(trial)[0], name=f"test {k}") for k, trial in enumerate(trials)]
    effects = catalogue_without([one.material])[0] if one.removed else CATALOGUE
    found = discover(tests, effects=effects, replay=twin_replay, check=FiniteElementCheck(), few_effects=False)
    write_json(folder / f"{one.name}.json", {**_judged(one, found), "labels": [blind_data.label(t) for t in trials],
                                             "seconds": time.process_time() - began})  # fmt: skip


def _judged(one: Set, found: Discovery) -> dict[str, Any]:
    groups = {name: sorted({name, *found.groups.get(name, ())}) for name in found.named}
    own = [_own(effect) for effect in found.own if effect.is_there]
    alike = {one.own, *ALSO.get(one.own, ())}
    right = [told for told in own if told["effect"] in alike]
    seen = {test for told in right for test in told["seen_in"]}
    return {
        "name": one.name, "material": one.material, "own": one.own, "alike": one.alike, "removed": one.removed,
        "where": [f"test {k}" for k in one.where], "verdict": str(found.verdict), "named": groups,
        "closest": list(found.closest), "dominant": found.dominant.effect if found.dominant else "",
        "doubts": [] if found.confirmation is None else [str(doubt) for doubt in found.confirmation.doubts],
        "material_right": one.material in groups or any(one.material in group for group in groups.values()),
        "material_wrong": sorted(name for name, group in groups.items() if one.material not in group),
        "told": own, "right_tests": any(told["alike"] for told in right) if one.alike else seen == {f"test {k}" for k in one.where},
        "wrong_tests": sorted({test for told in own for test in told["seen_in"]} - {f"test {k}" for k in one.where}),
        "wrong_own": sorted({told["effect"] for told in own} - alike),
        "additions": [{"effect": a.effect.name, "amplitudes": list(a.amplitudes), "deviations": list(d), "shape": list(a.shape)}
                      for a, d in zip(found.final.additions, found.final.deviations, strict=True)],
    }  # fmt: skip


def _own(told: OwnEffect) -> dict[str, Any]:
    return {"effect": told.effect.name, "own": told.own, "common": told.common, "alike": told.is_common,
            "seen_in": list(told.seen_in), "values": told.values, "deviations": told.deviations}  # fmt: skip


def kind(record: dict[str, Any]) -> str:
    """What a set is made for."""
    if record["removed"]:
        return "effect of the material removed from the catalogue"
    if record["alike"]:
        return "effect that all specimens have alike"
    if record["own"]:
        return "effect of one specimen" + (", beside one of the material" if record["material"] else "")
    return "nothing hidden"


def summary(found: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Numbers and tables: sets of each kind, verdicts, and whether material and specimens were told right."""
    table = [["hidden", "sets", *map(str, Verdict), "material named right", "material named wrong",
              "effect told of the right tests", "of a test that has none", "another effect told"]]  # fmt: skip
    for name in dict.fromkeys(kind(one) for one in found):
        of_kind = [one for one in found if kind(one) == name]
        verdicts = [sum(one["verdict"] == verdict for one in of_kind) for verdict in Verdict]
        named = sum(one["material_right"] for one in of_kind) if any(one["material"] for one in of_kind) else ""
        right = sum(one["right_tests"] for one in of_kind) if any(one["own"] for one in of_kind) else ""
        wrong = (sum(bool(one[key]) for one in of_kind) for key in ("material_wrong", "wrong_tests", "wrong_own"))
        bad, tests, other = wrong
        table.append([str(cell) for cell in (name, len(of_kind), *verdicts, named, bad, right, tests, other)])
    seconds = float(np.median([one["seconds"] for one in found]))
    return {"numbers": {"sets": len(found), "seconds": seconds}, "tables": {"kinds": table}, "sets": list(found)}


def main() -> None:
    """Make what is missing, and write the summary."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=998000, help="seed of the first test")
    parser.add_argument(
        "--most", type=int, help="so many sets (default: all; 0: only the summary of those that are there)"
    )
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path, default=Path("results/several-tests"))
    parser.add_argument("--overwrite", action="store_true")
    options = parser.parse_args()
    started, settings = time.time(), {"first": options.first}
    open_output_folder(options.output, options.overwrite, {"benchmark": "several tests", **settings})
    kept = options.output / "sets"
    kept.mkdir(exist_ok=True)
    found = records(diagnosed, kept, sets(options.first)[: options.most], options.jobs, "sets of three tests")
    write_json(options.output / "several_tests.json", summary(found))
    Manifest(options.first, settings, started=started).beside(options.output / "several_tests.json")
    print(json.dumps(summary(found)["tables"]["kinds"], indent=0))


if __name__ == "__main__":
    main()
