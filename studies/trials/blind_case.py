"""One blind trial: write it, diagnose it, and never both with the label in hand.

In: a `Plan`. Out: ``experiment.npz`` and ``sealed/label.json``, then ``diagnosis.json``, for which the label is not opened. Of
two hidden effects ``sealed/beside.json`` says how strong each is beside the other. `judgement.judge` alone compares both.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from calibrate.data.experiment import Experiment
from calibrate.diagnosis import base_fit, discovery, score_tests, weighted_fit
from calibrate.diagnosis.evidence.explanations import Alternatives
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.replayed.checked_replay import replay_record
from calibrate.diagnosis.replayed.replay_verdict import stiffness_level
from calibrate.diagnosis.selection import Discovery
from calibrate.diagnosis.selection.rounds import Round
from calibrate.diagnosis.twin import with_own_twins, with_twins
from calibrate.effects import CATALOGUE, Effect
from calibrate.effects.chain import Addition
from studies.output.writing import write_json
from studies.replay.replay_check import FiniteElementCheck
from studies.replay.twin_replay import twin_replay
from studies.reports.discovery.candidate_outcome import round_remarks
from studies.trials.blind_data import draw, write
from studies.trials.blind_effects import ALSO
from studies.trials.blind_trial import Trial
from studies.trials.foreign import foreign

NULL, FOREIGN = "none", "foreign-"
GLOBAL_LIMIT = 10.0  # score above which an effect counts as strong; of two, each beside the other


@dataclass(frozen=True)
class Plan:
    """A trial: seed, effects to hide, whether to diagnose it once more without the first of them, and whether its forms are foreign."""

    seed: int
    effects: tuple[str, ...] = ()
    absent: bool = False
    foreign: bool = False

    @property
    def name(self) -> str:
        """Effects and seed, as the folder of the trial is called."""
        hidden = "+".join(self.effects).replace(" ", "_") or NULL
        return f"{FOREIGN if self.foreign else ''}{hidden}-{self.seed}"

    def trial(self) -> Trial:
        """Every number of it."""
        drawn = draw(self.seed, *(self.effects or (None,)))
        return foreign(drawn) if self.foreign else drawn


def run(plan: Plan, folder: str | Path) -> str:
    """Write and diagnose a trial that is not there yet; return its name. Every file is written atomically."""
    home = Path(folder) / plan.name
    if not (home / "experiment.npz").exists() or not (home / "sealed" / "label.json").exists():
        write(plan.trial(), home)
    if len(plan.effects) > 1 and not (home / "sealed" / "beside.json").exists():
        write_json(home / "sealed" / "beside.json", beside(home))
    if not (home / "diagnosis.json").exists():
        write_json(home / "diagnosis.json", diagnose(home / "experiment.npz", plan.effects[:1] if plan.absent else ()))
    return plan.name


def beside(home: Path) -> dict[str, float]:
    """Score of every hidden effect in a model that has the other hidden ones, fitted from their true values, with a twin as every diagnosis has.

    Tested against the base alone, an effect may get its score from another that it resembles.
    """

    known = {e.name: e for e in CATALOGUE}
    hidden = []
    for one in json.loads((home / "sealed" / "label.json").read_text())["effects"]:
        effect = known[one["name"]]
        amplitudes = tuple(one["amplitudes"][p.name] for p in effect.amplitudes)
        known_shapes = {
            **one["more"],
            **one["shape"],
        }  # a shape that the amplitude itself tells is not drawn, and matters not
        hidden.append(Addition(effect, amplitudes, tuple(known_shapes.get(p.name, 0.0) for p in effect.shapes)))
    problem, base = base_fit.prepare([Experiment.load(home / "experiment.npz")], [HoldOut().training])
    problem, base, _ = with_twins(problem, base, twin_replay)
    result = {}
    for one in hidden:
        others = tuple(other for other in hidden if other is not one)
        _, fit = weighted_fit.fit_with_weights(problem, base.c, others)
        weighted, fit = with_own_twins(*weighted_fit.refitted(problem, fit))
        result[one.effect.name] = score_tests.score(weighted, fit, (one.effect,))[0].score
    return result


def diagnose(path: Path, without: tuple[str, ...]) -> dict[str, Any]:
    """What the diagnosis says of an Experiment; `without`: once more with these effects, and those that contain them or are the same, taken out of the catalogue."""

    start = time.process_time()
    experiment = Experiment.load(path)
    found = discovery.discover(
        [experiment], replay=twin_replay, check=FiniteElementCheck(), few_effects=False
    )  # the verdict is what is judged
    content = {"full": described(found), "seconds": time.process_time() - start}
    if without:
        assert found.start is not None
        rest, content["without"] = catalogue_without(without)
        content["absent"] = described(
            discovery.diagnose(found.start, found.base, rest, check=FiniteElementCheck(), few_effects=False)
        )
    return content


def catalogue_without(names: Sequence[str]) -> tuple[tuple[Effect, ...], list[str]]:
    """The catalogue without effects, and what contains them as a special case or is the same; and the names of all that are out."""
    general = {e.nested_in for e in CATALOGUE if e.name in names} - {""}
    out = {*names, *general, *(also for name in names for also in ALSO.get(name, ()))}
    return tuple(e for e in CATALOGUE if e.name not in out), sorted(out)


def described(found: Discovery) -> dict[str, Any]:
    """A `Discovery` as plain data, with the amplitudes of its model file."""
    level = stiffness_level(found, found.final)
    additions = [
        {
            "effect": a.effect.name,
            "amplitudes": {p.name: v for p, v in zip(a.effect.amplitudes, a.stiffer(level).amplitudes, strict=True)},
            "deviations": {
                p.name: f * v for p, f, v in zip(a.effect.amplitudes, a.stiffness_factors(level), d, strict=True)
            },
            "shape": {p.name: v for p, v in zip(a.effect.shapes, a.shape, strict=True)},
        }
        for a, d in zip(found.final.additions, found.final.deviations, strict=True)
    ]
    return {
        "verdict": found.verdict,
        "named": list(found.named),
        "closest": list(found.closest),
        "dominant": None if found.dominant is None else asdict(found.dominant),
        "groups": {k: list(v) for k, v in found.groups.items()},
        "doubts": [] if found.confirmation is None else [str(doubt) for doubt in found.confirmation.doubts],
        "probabilities": {} if found.weighing is None else found.weighing.inclusion,
        "together": {} if found.weighing is None else _together(found.weighing.alternatives),
        "replaced": None if found.replaced is None else list(found.replaced),
        "additions": additions,
        "replay": replay_record(found.replay_check),
        "rounds": [_round(now) for now in found.rounds],
    }


def _together(found: Alternatives) -> dict[str, float]:
    """Probability of each effect, or one that counts under its name (`blind_effects.ALSO`)."""
    return {name: found.together((name, *also)) for name, also in ALSO.items()}


def _round(now: Round) -> dict[str, Any]:
    scores = {
        candidate.name: {
            "score": candidate.score.score,
            "adjusted": candidate.score.adjusted,
            "admissible": candidate.score.admissible,
            "amplitudes": list(candidate.score.amplitudes),
            "like": dict(candidate.like),
        }
        for candidate in now.candidates
        if candidate.score.is_tested
    }
    return {
        "added": now.added,
        "group": list(now.group),
        "remarks": round_remarks(now),
        "chi_square": now.fit.reduced_chi_square,
        "p_value": now.misfits.p_value,
        "misfits": [list(one) for one in now.misfits],
        "predicted": None if now.predicted is None else [*now.predicted, now.predicted_p],
        "held": None if now.held is None else asdict(now.held),
        "scores": scores,
    }
