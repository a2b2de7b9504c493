"""One blind trial: write it, diagnose it, and never both with the label in hand.

In: a `Plan`. Out: ``experiment.npz`` and ``sealed/label.json``, then ``diagnosis.json``, for which the label is not opened. Of
two hidden effects ``sealed/beside.json`` says how strong each is beside the other. `judge` alone compares both.
"""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np

from calibrate.data.experiment import Experiment
from calibrate.data.triangulation import signed_areas
from calibrate.diagnosis import base_fit, model_weights, score_tests, selection, weighted_fit
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.selection import Discovery
from calibrate.diagnosis.selection.rounds import Round
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from studies.output.writing import write_json
from studies.reports.discovery.candidate_outcome import round_remarks
from studies.trials.blind_data import draw, write

NULL = "none"
GLOBAL_LIMIT = 10.0  # score above which an effect counts as strong; of two, each beside the other


@dataclass(frozen=True)
class Plan:
    """A trial: seed, effects to hide, and whether to diagnose it once more without the first of them."""

    seed: int
    effects: tuple[str, ...] = ()
    absent: bool = False

    @property
    def name(self) -> str:
        """Effects and seed, as the folder of the trial is called."""
        return "+".join(self.effects).replace(" ", "_") + f"-{self.seed}" if self.effects else f"{NULL}-{self.seed}"


def run(plan: Plan, folder: str | Path, cache: str | Path | None = None) -> str:
    """Write and diagnose a trial that is not there yet; return its name. Every file is written atomically."""
    if cache is not None:
        jax.config.update("jax_compilation_cache_dir", str(cache))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
    home = Path(folder) / plan.name
    if not (home / "experiment.npz").exists() or not (home / "sealed" / "label.json").exists():
        write(draw(plan.seed, *(plan.effects or (None,))), home)
    if len(plan.effects) > 1 and not (home / "sealed" / "beside.json").exists():
        write_json(home / "sealed" / "beside.json", beside(home))
    if not (home / "diagnosis.json").exists():
        write_json(home / "diagnosis.json", diagnose(home / "experiment.npz", plan.effects[:1] if plan.absent else ()))
    return plan.name


def beside(home: Path) -> dict[str, float]:
    """Score of every hidden effect in a model that has the other hidden ones, fitted from their true values.

    Tested against the base alone, an effect may get its score from another that it resembles.
    """

    known = {e.name: e for e in CATALOGUE}
    hidden = []
    for one in json.loads((home / "sealed" / "label.json").read_text())["effects"]:
        effect = known[one["name"]]
        amplitudes = tuple(one["amplitudes"][p.name] for p in effect.amplitudes)
        hidden.append(Addition(effect, amplitudes, tuple(one["shape"][p.name] for p in effect.shapes)))
    problem, base = base_fit.prepare([Experiment.load(home / "experiment.npz")], [HoldOut().training])
    result = {}
    for one in hidden:
        others = tuple(other for other in hidden if other is not one)
        _, fit = weighted_fit.fit_with_weights(problem, base.c, others)
        weighted, fit = weighted_fit.fit_with_weights(
            model_weights.reweighted(problem, fit.c, fit.additions), fit.c, fit.additions
        )
        result[one.effect.name] = score_tests.score(weighted, fit, (one.effect,))[0].score
    return result


def diagnose(path: Path, without: tuple[str, ...]) -> dict[str, Any]:
    """What the diagnosis says of an Experiment; `without`: once more with these effects taken out of the catalogue."""

    start = time.process_time()
    experiment = Experiment.load(path)
    problem, base = base_fit.prepare([experiment], [HoldOut().training])
    found = selection.close_loop(problem, base, whole_table=False)
    content = {"full": described(found), "seconds": time.process_time() - start}
    if without:
        rest = tuple(e for e in CATALOGUE if e.name not in without)
        content["without"] = list(without)
        content["absent"] = described(selection.close_loop(problem, base, rest, whole_table=False))
    return content


def described(found: Discovery) -> dict[str, Any]:
    """A `Discovery` as plain data."""
    additions = [
        {
            "effect": a.effect.name,
            "amplitudes": {p.name: v for p, v in zip(a.effect.amplitudes, a.amplitudes, strict=True)},
            "deviations": {p.name: v for p, v in zip(a.effect.amplitudes, d, strict=True)},
            "shape": {p.name: v for p, v in zip(a.effect.shapes, a.shape, strict=True)},
        }
        for a, d in zip(found.final.additions, found.final.errors, strict=True)
    ]
    return {
        "verdict": found.verdict,
        "named": list(found.named),
        "closest": list(found.closest),
        "groups": {k: list(v) for k, v in found.groups.items()},
        "additions": additions,
        "rounds": [_round(now) for now in found.rounds],
    }


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
        "p_value": now.fit.p_value,
        "misfits": [list(one) for one in now.fit.misfits],
        "predicted": None if now.predicted is None else [*now.predicted, now.predicted_p],
        "held": None if now.held is None else asdict(now.held),
        "scores": scores,
    }


def judge(home: Path) -> dict[str, Any]:
    """Compare a diagnosis with its label: the only place where both are open."""
    label = json.loads((home / "sealed" / "label.json").read_text())
    content = json.loads((home / "diagnosis.json").read_text())
    full = content["full"]
    hidden = label["effects"]
    names = [h["name"] for h in hidden]
    first = full["rounds"][0]
    scores = {n: first["scores"].get(n, {}).get("score", 0.0) for n in names}
    file = home / "sealed" / "beside.json"
    strength = json.loads(file.read_text()) if file.exists() else scores
    reach = {n: {n, *full["groups"].get(n, [])} for n in full["named"]}
    result = {
        "trial": home.name,
        "hidden": names,
        "verdict": full["verdict"],
        "named": full["named"],
        "closest": full["closest"],
        "scores": scores,
        **({"beside": strength} if file.exists() else {}),
        "strong": bool(names) and min(strength.values()) > GLOBAL_LIMIT,
        "hit": [any(n in group for group in reach.values()) for n in names],
        "exact": [n in full["named"] for n in names],
        "amplitudes": [_amplitude(h, full["additions"]) for h in hidden],
        "field": [_field(h, full["additions"], home) for h in hidden],
        "seconds": content["seconds"],
    }
    if "absent" in content:
        partners = {n for n, v in first["scores"].get(names[0], {}).get("like", {}).items() if v > 0.9}
        result["absent"] = {
            "verdict": content["absent"]["verdict"],
            "named": content["absent"]["named"],
            "closest": content["absent"]["closest"],
            "wrong": [n for n in content["absent"]["named"] if n not in partners],
            "partners": sorted(partners),
        }
    return result


def _field(hidden: dict[str, Any], additions: list[dict[str, Any]], home: Path) -> float | None:
    """Correlation of fitted and hidden stiffness over the specimen, by area; a patch has no coefficients of cosines."""

    fitted = next((a["amplitudes"] for a in additions if a["effect"] == hidden["name"]), None)
    if fitted is None or "height" not in hidden["more"]:
        return None
    e = Experiment.load(home / "experiment.npz")
    places, patch = e.points[e.triangles].mean(axis=1), hidden["more"]
    low, high = e.points.min(axis=0), e.points.max(axis=0)
    x = np.pi * (places - low) / (high - low)
    waves = [v * np.cos(int(k[1]) * x[:, 0]) * np.cos(int(k[2]) * x[:, 1]) for k, v in fitted.items()]
    distance = ((places - [patch["x"], patch["y"]]) ** 2).sum(axis=1)
    true = patch["height"] * np.exp(-distance / (2 * patch["width"] ** 2))
    spread = np.cov(np.sum(waves, axis=0), true, aweights=np.abs(signed_areas(e.points, e.triangles)))
    return float(spread[0, 1] / np.sqrt(spread[0, 0] * spread[1, 1]))


def _amplitude(hidden: dict[str, Any], additions: list[dict[str, Any]]) -> dict[str, Any] | None:
    """Pull (fitted - true) / deviation of each amplitude of an effect that is in the model, else None."""
    for addition in additions:
        if addition["effect"] == hidden["name"]:
            pulls = {
                name: (addition["amplitudes"][name] - true) / max(addition["deviations"][name], 1e-300)
                for name, true in hidden["amplitudes"].items()
                if name in addition["amplitudes"]
            }
            return {"true": hidden["amplitudes"], **addition, "pulls": pulls}
    return None
