"""How strong each of two hidden effects is beside the other, by today's definition: `python -m benchmarks.evidence.pair_strengths docs/trials/foreign_92000.json`.

In: judged trials, as `equigap blind` keeps them, and a folder (-o) of their tests; a test that is not there is made again from its seed, which needs the forms that the
version of its day hid. Out: ``NAME.json``, a file a pair, kept, so that a stopped run goes on, then the judged trials once more, with the strengths in place of the
older ones. Nothing is diagnosed again.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from benchmarks.noise.kept_records import records
from studies.output.writing import write_json
from studies.trials.blind_case import FOREIGN, GLOBAL_LIMIT, Plan, beside
from studies.trials.blind_data import write
from studies.trials.judgement import JudgedTrial, read


@dataclass(frozen=True)
class Pair:
    """Two effects that were hidden in a trial."""

    name: str
    effects: tuple[str, ...]

    @property
    def plan(self) -> Plan:
        """That it was made by."""
        return Plan(int(self.name.rsplit("-", 1)[1]), self.effects, foreign=self.name.startswith(FOREIGN))


def strengths(tests: Path, pair: Pair, folder: Path) -> None:
    """Write the record of a pair, whose test is in `tests`, or is written there."""
    home = tests / pair.name
    if not (home / "experiment.npz").exists():
        write(pair.plan.trial(), home)
    write_json(folder / f"{pair.name}.json", {"trial": pair.name, "beside": beside(home)})


def with_strengths(trial: JudgedTrial, found: dict[str, float] | None) -> JudgedTrial:
    """A judged trial with other strengths of its two effects; the same where there are none."""
    if found is None:
        return trial
    return replace(trial, beside=found, strong=min(found.values()) > GLOBAL_LIMIT)


def main() -> None:
    """Strengths of all pairs, then the trials with them."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("judged", type=Path, help="trials.json of a blind run")
    parser.add_argument("-o", "--output", type=Path, default=Path("results/benchmark-pair-strengths"))
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    trials = read(args.judged)
    pairs = [Pair(one.trial, tuple(one.hidden)) for one in trials if len(one.hidden) > 1]
    kept = args.output / "strengths"
    made = records(partial(strengths, args.output / "tests"), kept, pairs, args.jobs, "strengths of pairs")
    found = {one["trial"]: one["beside"] for one in made}
    write_json(args.output / args.judged.name, [with_strengths(one, found.get(one.trial)).to_dict() for one in trials])


if __name__ == "__main__":
    main()
