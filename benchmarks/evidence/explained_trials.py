"""What the evidence of all explanations makes of blind trials: `python benchmarks/evidence/explained_trials.py --first 941000`.

In: one trial of every effect that is hidden alone, one of every pair, and --nulls that hide nothing, seeds from --first on (--only: some of these
seeds); --stereo: the heights of a flat sheet are measured, too; --linear: without fits. Out: a line a trial (hidden, verdict of the
rounds alone and as the evidence decides, best explanation and probabilities), counts of `Judgement` of both verdicts and of `Outcome`, and
with --output a JSON file of both. A trial that is in the file is not made again.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from calibrate.data.experiment import Experiment
from calibrate.diagnosis.discovery import discover
from calibrate.diagnosis.evidence.decision import decided
from calibrate.diagnosis.evidence.explanations import CERTAIN, TIE, UNKNOWN, Alternatives
from calibrate.diagnosis.evidence.priors import read_priors
from calibrate.diagnosis.evidence.weighing import weigh
from calibrate.diagnosis.selection import Discovery, Verdict
from calibrate.effects import CATALOGUE
from studies.output import write_json
from studies.trials.blind_data import draw, make
from studies.trials.blind_effects import FREQUENT
from studies.trials.blind_plans import PAIRS


class Outcome(StrEnum):
    """Of a trial, by the first that holds. wrong: an effect that is not hidden is included with more than 95 %; unexplained: something in no
    catalogue has more than half; first: the best explanation is what is hidden; tie: what is hidden has more than 5 %; part: the best
    explanation is some of what is hidden."""

    WRONG = "wrong"
    UNEXPLAINED = "unexplained"
    FIRST = "first"
    TIE = "tie"
    PART = "part"
    OTHER = "other"


def outcome(hidden: set[str], found: Alternatives) -> Outcome:
    """See `Outcome`."""
    best = set(found.explanations[0].names)
    whole = sum(one.probability for one in found.explanations if set(one.names) == hidden and not one.discrepancy)
    holds = {
        Outcome.WRONG: any(p > CERTAIN and name not in hidden for name, p in found.inclusion.items()),
        Outcome.UNEXPLAINED: found.unexplained > UNKNOWN,
        Outcome.FIRST: best == hidden,
        Outcome.TIE: whole > TIE,
        Outcome.PART: best < hidden,
        Outcome.OTHER: True,
    }
    return next(one for one, true in holds.items() if true)


class Judgement(StrEnum):
    """Of a verdict, by the first that holds. quiet: nothing significant; open: not explained; wrong: a name in whose group nothing hidden
    is; right: what is hidden is named; group: it is in the groups of what is named; part: some of it."""

    QUIET = "quiet"
    OPEN = "open"
    WRONG = "wrong"
    RIGHT = "right"
    GROUP = "group"
    PART = "part"


WORDS = {"none": "nothing hidden", "single": "one effect", "pair": "two effects"}
MEANING = {
    Judgement.QUIET: "nothing significant",
    Judgement.OPEN: "significant, not explained",
    Judgement.WRONG: "explained, with a name in whose group nothing hidden is",
    Judgement.RIGHT: "explained by what is hidden",
    Judgement.GROUP: "explained, what is hidden in the groups of what is named",
    Judgement.PART: "explained by some of what is hidden",
}


def judged(hidden: set[str], found: Discovery) -> Judgement:
    """See `Judgement`."""
    groups = {name: {name, *found.groups.get(name, ())} for name in found.named}
    holds = {
        Judgement.QUIET: found.verdict is Verdict.NOTHING_SIGNIFICANT,
        Judgement.OPEN: found.verdict is Verdict.NOT_EXPLAINED,
        Judgement.WRONG: any(not group & hidden for group in groups.values()),
        Judgement.RIGHT: set(groups) == hidden,
        Judgement.GROUP: hidden <= set().union(*groups.values()),
        Judgement.PART: True,
    }
    return next(one for one, true in holds.items() if true)


def said(found: Discovery) -> str:
    """Verdict and names."""
    names = [" or ".join((name, *found.groups.get(name, ())[1:])) for name in found.named]
    return f"{found.verdict}: {'; '.join(names or found.closest)}"


def diagnosed(seed: int, names: tuple[str, ...], stereo: bool, linear: bool) -> dict[str, Any]:
    """One trial."""
    experiment, _ = make(draw(seed, *(names or (None,))))
    if stereo:
        experiment = flat(experiment)
    rounds = discover([experiment], fitted=False)
    weighing = weigh(rounds, read_priors(), fitted=not linear)
    found = decided(rounds, weighing, read_priors(), CATALOGUE)
    shown, hidden = weighing.alternatives, set(names)
    return {
        "seed": seed, "hidden": list(names), "of_rounds": said(rounds), "decided": said(found),
        "judged_rounds": str(judged(hidden, rounds)), "judged": str(judged(hidden, found)), "replaced": found.replaced,
        "outcome": str(outcome(set(names), shown)), "best": list(shown.explanations[0].names),
        "probability": shown.explanations[0].probability, "in_no_catalogue": shown.unexplained,
        "inclusion": {name: p for name, p in shown.inclusion.items() if p > TIE},
    }  # fmt: skip


def flat(experiment: Experiment) -> Experiment:
    """The same with measured heights of 0 mm."""
    return replace(experiment, heights=np.zeros((experiment.n_increments + 1, len(experiment.points))))


def plans(first: int, nulls: int) -> list[tuple[int, tuple[str, ...]]]:
    """Seeds and what they hide."""
    hidden: list[tuple[str, ...]] = [*((name,) for name in FREQUENT), *PAIRS, *([()] * nulls)]
    return list(enumerate(hidden, first))


def main() -> None:
    """Run the trials and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=941000)
    parser.add_argument("--nulls", type=int, default=4)
    parser.add_argument("--only", type=int, nargs="*")
    parser.add_argument("--stereo", action="store_true")
    parser.add_argument("--linear", action="store_true")
    parser.add_argument("--output", type=Path)
    options = parser.parse_args()
    known = json.loads(options.output.read_text())["trials"] if options.output and options.output.exists() else []
    rows = {row["seed"]: row for row in known}
    for seed, names in plans(options.first, options.nulls):
        if seed in rows or (options.only and seed not in options.only):
            continue
        rows[seed] = diagnosed(seed, names, options.stereo, options.linear)
        print({key: value for key, value in rows[seed].items() if key != "inclusion"}, flush=True)
        if options.output:
            write_json(options.output, summary(list(rows.values())))
    print(summary(list(rows.values()))["numbers"])


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """As the file holds it."""
    kinds = tuple(WORDS)
    numbers: dict[str, int] = {}
    table = [
        ["verdict", *(f"{kind}, {what}" for kind in WORDS.values() for what in ("rounds alone", "with the evidence"))]
    ]
    for judgement in Judgement:
        columns = [[row for row in rows if len(row["hidden"]) == n] for n in range(len(kinds))]
        counts = [
            sum(row[what] == judgement for row in column) for column in columns for what in ("judged_rounds", "judged")
        ]
        table.append([MEANING[judgement], *(str(count) for count in counts)])
    for n, kind in enumerate(kinds):
        for what in ("judged_rounds", "judged", "outcome"):
            count = Counter(row[what] for row in rows if len(row["hidden"]) == n)
            numbers |= {f"{kind}_{what}_{key}": value for key, value in count.items()}
    return {
        "numbers": {"trials": len(rows), **numbers},
        "tables": {"verdicts": table},
        "trials": sorted(rows, key=lambda r: r["seed"]),
    }


if __name__ == "__main__":
    main()
