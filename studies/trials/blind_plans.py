"""Which blind trials are made, and in which order. In: how many of each kind. Out: a list of `Plan`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import batched, count
from pathlib import Path

from calibrate.errors import ConfigError
from studies.errors import StudyError
from studies.synthetic.camera import stream
from studies.trials.blind_case import Plan
from studies.trials.blind_effects import FREQUENT, LATER, MATERIAL, RECORDING, UNPAIRED
from studies.trials.judgement import JudgedTrial, read

PAIRS = (
    ("second invariant", "force offset"),
    ("viscoelasticity", "stiffness gradient"),
    ("one fibre family", "unmeasured strip"),
    ("compressibility", "image rotation"),
    ("Mullins softening", "second invariant"),
)
ABSENT = 3  # of so many trials of an effect, one is diagnosed once more without the effect in the catalogue
PAIRED = 4  # random stream, beside those of the trials
WINDOW = 72  # trials that are put in an order of their own


@dataclass(frozen=True)
class Numbers:
    """Trials of each effect, without an effect, and with two."""

    trials: int = 20
    nulls: int = 100
    pairs: int = 20

    def __post_init__(self) -> None:
        counts = (self.trials, self.nulls, self.pairs)
        if min(counts) < 0 or sum(counts) == 0:
            raise ConfigError("--trials, --nulls and --pairs count trials; give numbers that are not negative")


QUICK = Numbers(1, 2, 1)


def plans(numbers: Numbers, only: Sequence[str] = (), seed: int = 20000, foreign: bool = False) -> list[Plan]:
    """All trials, mixed so that a run that is stopped has some of each. only: effects to hide, () for all that can be found.

    seed: of the first trial. foreign: forms and noise that are not those of the catalogue, in random pairs. Raises `ConfigError` for an effect that cannot be found.
    """
    for name in only:
        if name not in FREQUENT:
            raise ConfigError(f"--only {name}: choose from {', '.join(FREQUENT)}")
    effects = list(only or FREQUENT)
    seeds = count(seed)  # every trial its own: effects of one seed would share material, specimen and noise

    def hiding(names: Sequence[str]) -> list[Plan]:
        return [Plan(next(seeds), (name,), k % ABSENT == 0) for k in range(numbers.trials) for name in names]

    single = hiding([name for name in effects if name not in LATER])
    none = [Plan(next(seeds)) for _ in range(numbers.nulls)]
    both = [_pair(next(seeds), None if foreign else PAIRS[i % len(PAIRS)]) for i in range(numbers.pairs)]
    later = [plan for name in LATER if name in effects for plan in hiding([name])]
    ranked = [(k / max(len(group), 1), plan) for group in (single, none, both, later) for k, plan in enumerate(group)]
    return [replace(plan, foreign=foreign) for _, plan in sorted(ranked, key=lambda pair: pair[0])]


def _pair(seed: int, names: tuple[str, str] | None) -> Plan:
    """These two effects, or a random one of the material with one of the recording."""
    rng = stream(seed, PAIRED)
    of_material, of_recording = (sorted(set(kind) & set(FREQUENT) - set(UNPAIRED)) for kind in (MATERIAL, RECORDING))
    return Plan(seed, names or (str(rng.choice(of_material)), str(rng.choice(of_recording))))


def in_order_of_size(todo: Sequence[Plan]) -> list[Plan]:
    """Trials of one specimen and number of increments in a row, within a `WINDOW`: they share compiled code."""

    def size(plan: Plan) -> tuple[str, int]:
        trial = plan.trial()
        return trial.specimen, len(trial.factors)

    return [plan for window in batched(todo, WINDOW) for plan in sorted(window, key=size)]


def read_known(path: Path | None, todo: Sequence[Plan]) -> dict[str, JudgedTrial]:
    """Judged trials of an earlier run by name, those of this plan. Raises `StudyError`."""
    if path is None:
        return {}
    try:
        known = {one.trial: one for one in read(path)}
    except (OSError, ValueError) as error:
        raise StudyError(
            f"--known {path}: give the trials.json of a blind run ({str(error).splitlines()[0]})"
        ) from None
    found = {plan.name: known[plan.name] for plan in todo if plan.name in known}
    if not found:
        raise StudyError(f"--known {path}: none of its trials is one of this run; give the same --seed and numbers")
    return found
