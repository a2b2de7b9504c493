"""What the measured sheets say: learn on one, carry to the next, locate what differs; dictionaries of plain numbers out.

A sheet's increments are split three ways. Of those up to `until` the first two thirds are fitted and the last third confirms
what is added, so that an effect must pay where the deformation is larger than any that was fitted. The models chosen are
then fitted to all up to `until`. Those after `until` are scored once, at the end. Errors: of force, the norm of what the two grips disagree over the norm of
the measured forces; of the field, the norm of the virtual work that fields without a load leave, over the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar, nnls
from scipy.spatial import cKDTree

from calibrate import diagnosis, discovery, discrepancy, errors
from calibrate.basis import SingleBasis
from calibrate.chain import Addition, Additions, Chain
from calibrate.diagnosis import Fit, Problem
from calibrate.effects import CATALOGUE
from calibrate.effects.viscosity import Viscosity
from calibrate.effects.warp import InitialWarp
from calibrate.equilibrium import Equilibrium, equilibrium, neo_hooke
from calibrate.experiment import Experiment
from calibrate.virtual_fields import VirtualFields, _hats
from calibrate.whitening import covariances, whitening

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Say = Callable[[str], None]
KNOWN = ("force offset", "lag between force and image")  # the record says: no force at rest, pictures in time to 0.15 s
EVERY = CATALOGUE if "initial warp" in {e.name for e in CATALOGUE} else (*CATALOGUE, InitialWarp())
EFFECTS = tuple(effect for effect in EVERY if effect.name not in KNOWN)
SPLINES = (5, 8, 12, 24)  # of the base model
MOST, ITERATIONS = 3, 3  # effects that are added at most; steps of a fit that is tried
CONFIRMS = 1 / 3  # of the increments up to the limit: the last ones
RELAXATION = (0.5, 2.0, 8.0, 32.0)  # s, times of the branches tried
SECTIONS = 9  # bands along the pull in which the section force is found


@dataclass(frozen=True)
class Split:
    """Increments (t,) that are fitted, that confirm, and that are scored."""

    fitted: Mask
    confirms: Mask
    scored: Mask

    @classmethod
    def of(cls, e: Experiment, until: float) -> Split:
        """By time. Raises `ConfigError` where one of the three would be empty."""
        if e.time is None:
            raise errors.ConfigError(f"{e.name}: has no time, so that no first part can be fitted")
        early = np.flatnonzero(e.time <= until)
        fitted, confirms = (np.zeros(e.n_increments, bool) for _ in range(2))
        fitted[early] = True
        confirms[early[early.size - round(CONFIRMS * early.size) :]] = True
        fitted &= ~confirms
        scored = e.time > until
        if fitted.sum() < 3 or not confirms.any() or not scored.any():
            raise errors.ConfigError(
                f"{e.name}: {early.size} of {e.n_increments} increments are before {until:g} s; give more --frames or "
                "another --until"
            )
        return cls(fitted, confirms, scored)

    def parts(self) -> dict[str, Mask]:
        """What was fitted in the end, and what was scored."""
        return {"fitted": self.fitted | self.confirms, "scored": self.scored}


@dataclass(frozen=True, eq=False)
class Material:
    """A model that can be carried to another sheet: base energy and effects."""

    basis: SingleBasis
    c: Array
    additions: Additions

    def scaled(self, factor: float) -> Material:
        """Stiffer by a factor: amplitudes in MPa follow, those in 1/MPa go the other way."""
        power = {"MPa": 1, "1/MPa": -1}
        additions = tuple(
            replace(
                a,
                amplitudes=tuple(
                    v * factor ** power.get(p.unit, 0) for v, p in zip(a.amplitudes, a.effect.amplitudes, strict=True)
                ),
            )
            for a in self.additions
        )
        return Material(self.basis, factor * self.c, additions)

    def base_only(self) -> Material:
        return replace(self, additions=())

    def to_dict(self) -> dict[str, Any]:
        return {
            "top": float(self.basis.top),
            "splines": int(self.basis.n),
            "c": self.c.tolist(),
            "effects": [
                {"name": a.effect.name, "amplitudes": list(a.amplitudes), "shape": list(a.shape)}
                for a in self.additions
            ],
        }

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Material:
        known = {effect.name: effect for effect in EVERY}
        additions = tuple(
            Addition(known[e["name"]], tuple(e["amplitudes"]), tuple(e["shape"])) for e in content["effects"]
        )
        return cls(SingleBasis(0, content["top"], content["splines"]), np.array(content["c"]), additions)


def prepared(e: Experiment, split: Split, spacing: float, base: str, splines: int | None = None) -> tuple[Problem, Fit]:
    """Problem whose held-out equations are those of the confirming increments alone, and its base fit.

    splines: of the base; None: see `simplest_base`.
    """
    problem, fit = diagnosis.prepare([e], [lambda system: _rows(system, split.fitted)], spacing, base=base)
    part = problem.parts[0]
    confirms = _rows(part.system, split.confirms) & diagnosis.all_rows(part.system)
    held = whitening(covariances(part.assembled, fit.c), confirms, _common(problem, fit))
    problem = replace(problem, parts=(replace(part, held=held),))
    return simplest_base(problem, base, SPLINES if splines is None else (splines,))


def _common(problem: Problem, fit: Fit) -> Array | None:
    return discrepancy.sources(problem.parts[0].system, problem.basis, fit.c)


def _rows(system: Equilibrium, increments: Mask) -> Mask:
    return np.repeat(increments[:, None], system.loads.shape[1], axis=1)


def simplest_base(problem: Problem, base: str, splines: Sequence[int] = SPLINES) -> tuple[Problem, Fit]:
    """The problem with as many splines as predict best what confirms, and its base fit.

    A fine base takes up whatever varies with the load, and then extrapolates badly; a coarse one cannot follow.
    """
    tops = [diagnosis.trained_top(part.system, part.train.rows) for part in problem.trained]
    start = diagnosis.first_guess([part.assembled for part in problem.trained])
    fits = []
    for n in splines:
        prior = diagnosis.smoothness(base, n) / (diagnosis.STIFFENING * float(start.max()))
        coarse = replace(problem, cone=diagnosis.base_cone(problem.basis, base, max(tops), n), prior=prior)
        fit = diagnosis.refit(coarse, start, ())
        predicted = discovery.misfit(coarse, fit.c, (), True)
        fits.append((fit.loss if predicted is None else predicted.chi_square, coarse, fit))
    _, coarse, fit = min(fits, key=lambda line: line[0])
    return coarse, fit


@dataclass(frozen=True, eq=False)
class Round:
    """A model, its errors on what was fitted and what confirms, the tests of what it leaves, and what was added."""

    fit: Fit
    train: discovery.Misfit | None
    held: discovery.Misfit | None
    scores: list[diagnosis.Score]
    confirmed: dict[str, float]
    added: str | None = None


def close_loop(problem: Problem, state: Fit, say: Say) -> list[Round]:
    """Add, of all effects that are significant, the one that predicts best what confirms; until none predicts better.

    `calibrate.discovery` tries them in the order of their scores, which here are those of several effects at once.
    """
    rounds: list[Round] = []
    while True:
        say(f"round {len(rounds) + 1}: testing effects")
        scores = diagnosis.score(problem, state, EFFECTS)
        errors_ = [discovery.misfit(problem, state.c, state.additions, held) for held in (False, True)]
        now = Round(state, errors_[0], errors_[1], scores, {})
        best = state
        lowest = np.inf if now.held is None else now.held.chi_square
        for one in scores if len(rounds) < MOST else []:
            if one.status != "tested" or one.adjusted > discovery.ALPHA:
                continue
            say(f"round {len(rounds) + 1}: fit with {one.effect.name}")
            null = tuple(p.null for p in one.effect.amplitudes)
            addition = Addition(one.effect, one.amplitudes if one.admissible else null, one.shape)
            fit = _refit(problem, state, addition)
            if fit is None:
                continue
            held = discovery.misfit(problem, fit.c, fit.additions, True)
            idle = all(
                abs(a - p) < 2 * d for a, p, d in zip(fit.additions[-1].amplitudes, null, fit.errors[-1], strict=True)
            )
            if held is None or idle:
                continue
            now.confirmed[one.effect.name] = held.chi_square
            if held.chi_square < lowest:
                best, lowest = fit, held.chi_square
        if best is state:
            return [*rounds, now]
        rounds.append(replace(now, added=best.additions[-1].effect.name))
        state = best


def _refit(problem: Problem, state: Fit, addition: Addition) -> Fit | None:
    """The fit with one more effect; None where its stresses do not stay finite on the way."""
    try:
        fit = diagnosis.refit(problem, state.c, (*state.additions, addition), ITERATIONS)
    except ValueError:
        return None
    return fit if np.isfinite(fit.loss) else None


def verdict(last: Fit, scores: Sequence[diagnosis.Score]) -> str:
    """'explained' only if what the last model leaves is noise."""
    if last.p_value > discovery.GLOBAL and not any(
        s.status == "tested" and s.adjusted < discovery.ALPHA for s in scores
    ):
        return "explained" if last.additions else "nothing significant"
    return "significant, not explained"


def learn(e: Experiment, until: float, spacing: float, base: str, say: Say) -> dict[str, Any]:
    """Close the loop on a sheet: what is added, with errors before and after; everything that the report shows."""
    split = Split.of(e, until)
    say(f"{e.name}: base model")
    problem, fit = prepared(e, split, spacing, base)
    everything = replace(split, fitted=split.fitted | split.confirms)
    whole, start = prepared(e, everything, spacing, base, problem.cone.shape[1])
    rounds = close_loop(problem, fit, lambda text: say(f"{e.name}: {text}"))
    result: dict[str, Any] = {
        "name": e.name,
        "spacing": spacing,
        "time": _plain(e.time),
        "split": {name: np.flatnonzero(mask).tolist() for name, mask in split.parts().items()},
        "verdict": verdict(rounds[-1].fit, rounds[-1].scores),
        "closest": [a.effect.name for a in rounds[-1].fit.additions],
        "models": [],
        "rounds": [],
    }
    for now in rounds:
        say(f"{e.name}: all of the first {until:g} s")
        try:
            final = diagnosis.refit(whole, start.c, now.fit.additions) if now.fit.additions else start
        except ValueError:  # not finite on the way: as it was found
            final = now.fit
        material = Material(whole.basis, final.c, final.additions)
        result["models"].append(
            {
                "name": " + ".join(["base", *(a.effect.name for a in final.additions)]),
                "reduced_chi_square": final.reduced_chi_square,
                "splines": whole.cone.shape[1],
                "selection": {
                    "reduced_chi_square": now.fit.reduced_chi_square,
                    "fitted": _errors(now.train),
                    "confirming": _errors(now.held),
                },
                "amplitudes": [
                    {"effect": a.effect.name, "name": p.name, "unit": p.unit, "value": v, "deviation": d}
                    for a, deviations in zip(final.additions, final.errors, strict=True)
                    for p, v, d in zip(a.effect.amplitudes, a.amplitudes, deviations, strict=True)
                ],
                "material": material.to_dict(),
                **account(e, material, split, spacing),
            }
        )
        tested = [s for s in now.scores if s.status == "tested"]
        like = diagnosis.likeness(tested)
        result["rounds"].append(
            {
                "added": now.added,
                "candidates": [
                    {
                        "effect": one.effect.name,
                        "score": one.score,
                        "adjusted_p": one.adjusted,
                        "share": one.share,
                        "admissible": one.admissible,
                        "confirming_chi_square": now.confirmed.get(one.effect.name),
                        "like": [
                            tested[j].effect.name
                            for j in range(len(tested))
                            if j != i and like[i, j] > diagnosis.COLLINEAR
                        ],
                        "decided_by": one.effect.decided_by,
                    }
                    for i, one in enumerate(tested)
                ],
            }
        )
    return result


def _errors(misfit: discovery.Misfit | None) -> dict[str, float] | None:
    if misfit is None:
        return None
    return {"force": misfit.force, "field": misfit.field, "chi_square": misfit.chi_square}


def account(e: Experiment, material: Material, split: Split, spacing: float) -> dict[str, Any]:
    """Errors of a model on a sheet, the grips' forces, and the section forces over the measured force."""
    chain = Chain(equilibrium(e, spacing), material.basis)
    r, system = chain.with_additions(material.c, material.additions), chain.system
    grips = np.tile(system.fields.boundary >= 0, 2) & np.isfinite(system.loads).all(axis=0)
    fields = np.tile(system.fields.boundary < 0, 2)
    measured = system.loads[:, grips]
    sections = section_forces(e, material)
    pull = force(e)
    thirds = sections.shape[1] // 3
    lower, upper = sections[:, :thirds].mean(axis=1), sections[:, -thirds:].mean(axis=1)
    result: dict[str, Any] = {
        "errors": {},
        "grip_error": (r[:, grips] / np.linalg.norm(measured, axis=1)[:, None]).tolist(),
    }
    for name, rows in split.parts().items():
        size = np.linalg.norm(measured[rows])
        result["errors"][name] = {
            "force": float(np.linalg.norm(r[rows][:, grips]) / size),
            "field": float(np.linalg.norm(r[rows][:, fields]) / size),
            "section_scatter": float(np.sqrt(np.mean((sections[rows] / pull[rows, None] - 1) ** 2))),
            "lower_over_upper": float(np.mean(lower[rows] / upper[rows])),
        }
    result["force"] = pull.tolist()
    result["sections"] = (sections / pull[:, None]).tolist()
    return result


def force(e: Experiment) -> Array:
    """Pull (t,), N: the mean size of the forces along y of the two grips."""
    return np.mean([np.abs(b.force[:, 1]) for b in e.loaded], axis=0)


def section_forces(e: Experiment, material: Material, n: int = SECTIONS) -> Array:
    """Force along y through the sheet (t, n), N, as the model has it, mean over each of n bands, bottom band first."""
    y = e.points[:, 1]
    edges = np.linspace(y.min(), y.max(), n + 1)
    values = np.stack([np.clip((y - a) / (b - a), 0, 1) for a, b in pairwise(edges)], axis=1)
    fields = VirtualFields(sp.csr_array(values), np.full(n, -1), float(edges[1] - edges[0]))
    return Chain(Equilibrium(e, fields), material.basis).with_additions(material.c, _without_loads(material))[:, n:]


def _without_loads(material: Material) -> Additions:
    return tuple(a for a in material.additions if a.effect.stage != "load")


def carried(e: Experiment, material: Material, split: Split, spacing: float) -> tuple[Material, float]:
    """The material with the one factor on its stiffness that fits the forces of the increments to be fitted."""
    system = equilibrium(e, spacing)
    rows = split.fitted | split.confirms
    grips = np.tile(system.fields.boundary >= 0, 2) & np.isfinite(system.loads).all(axis=0)

    def misfit(log_factor: float) -> float:
        scaled = material.scaled(float(np.exp(log_factor)))
        r = Chain(system, material.basis).with_additions(scaled.c, scaled.additions)
        return float((r[rows][:, grips] ** 2).sum())

    r = Chain(system, material.basis).with_additions(material.c, material.additions)[rows][:, grips]
    load = system.loads[rows][:, grips]
    guess = float(np.log(max(float((load * load).sum() / (load * (r + load)).sum()), 1e-3)))
    best = minimize_scalar(misfit, bounds=(guess - 0.5, guess + 0.5), method="bounded", options={"xatol": 1e-3})
    factor = float(np.exp(best.x))
    return material.scaled(factor), factor


def transfer(e: Experiment, models: Sequence[dict[str, Any]], until: float, spacing: float) -> dict[str, Any]:
    """Every model learnt on another sheet, on this one, with one factor refitted."""
    split = Split.of(e, until)
    result: dict[str, Any] = {"name": e.name, "time": _plain(e.time), "models": []}
    for model in models:
        material, factor = carried(e, Material.from_dict(model["material"]), split, spacing)
        result["models"].append(
            {
                "name": model["name"],
                "factor": factor,
                "material": material.to_dict(),
                **account(e, material, split, spacing),
            }
        )
    return result


def stiffness_map(e: Experiment, material: Material, until: float, spacing: float, cell: float) -> dict[str, Any]:
    """Stiffness of each place over that of the carried model: bilinear on a grid of `cell` mm, smooth, above zero.

    The factors k of nodes minimise |sum_q k_q w_q - F|^2 / |F|^2 + weight |gradient k|^2, w_q the virtual work of the model's
    stress times the hat of node q. The weight is the one that predicts best a third of the virtual fields left out.
    """
    split = Split.of(e, until)
    system = equilibrium(e, spacing)
    chain = Chain(system, material.basis)
    stress_work, loads, middle, hats = _work_by_place(e, chain, material, cell)
    rows = split.fitted | split.confirms
    scale = np.abs(force(e))[:, None]
    weights = [0.003, 0.01, 0.03, 0.1, 0.3, 1.0]
    A, b = stress_work / scale[..., None], loads / scale
    flat = lambda array, keep: array[rows][:, keep].reshape(-1, *array.shape[2:])  # noqa: E731
    D = _differences(hats.shape[1], middle)
    n = A.shape[1] // 2
    left_out = np.tile(np.arange(n) % 3 == 1, 2) & np.tile(system.fields.boundary < 0, 2)
    scores = []
    for weight in weights:
        k = _smooth_fit(flat(A, ~left_out), flat(b, ~left_out), weight * D)
        scores.append(float(np.linalg.norm(flat(A, left_out) @ k - flat(b, left_out))))
    weight = weights[int(np.argmin(scores))]
    k = _smooth_fit(flat(A, np.ones(2 * n, bool)), flat(b, np.ones(2 * n, bool)), weight * D)
    grips = np.tile(system.fields.boundary >= 0, 2)
    after = np.einsum("trk,k->tr", stress_work, k) - loads
    before = stress_work.sum(axis=2) - loads
    result: dict[str, Any] = {
        "name": e.name,
        "cell": cell,
        "spacing": spacing,
        "weight": weight,
        "map": (hats @ k).tolist(),
        "points": e.points.tolist(),
        "triangles": e.triangles.tolist(),
        "left_out": {
            "before": float(np.linalg.norm(flat(A, left_out).sum(axis=1) - flat(b, left_out))),
            "after": min(scores),
        },
        "errors": {},
    }
    for name, mask in split.parts().items():
        size = np.linalg.norm(loads[mask][:, grips])
        result["errors"][name] = {
            when: {
                "force": float(np.linalg.norm(r[mask][:, grips]) / size),
                "field": float(np.linalg.norm(r[mask][:, ~grips]) / size),
            }
            for when, r in (("before", before), ("after", after))
        }
    return result


def _work_by_place(
    e: Experiment, chain: Chain, material: Material, cell: float
) -> tuple[Array, Array, Array, sp.csr_array]:
    """Work (t, 2 v, q) of the model's stress by hats on a grid, loads (t, 2 v), nodes' places (q, 2), hats (n, q)."""
    hats = _hats(e.points, cell)
    share = (_centroid_mean(e) @ hats).toarray()
    middle = np.asarray(hats.T @ e.points) / np.asarray(hats.sum(axis=0)).reshape(-1, 1)
    P = chain.stress(material.c, material.additions)
    work = np.stack([chain.work(P * place[:, None, None]) for place in share.T], axis=-1)
    return work, np.nan_to_num(chain.external(material.additions)), middle, hats


def _smooth_fit(A: Array, b: Array, D: Array) -> Array:
    """k >= 0 that minimises |A k - b|^2 + |D k|^2 (rows of D: differences of neighbours)."""
    n = A.shape[1]
    return nnls(np.concatenate([A, D]), np.concatenate([b, np.zeros(len(D))]), maxiter=50 * n)[0]


def _differences(n: int, places: Array) -> Array:
    """(pairs, n): differences of neighbouring nodes, at `places` (n, 2)."""
    pitch = float(np.median(cKDTree(places).query(places, k=2)[0][:, 1]))
    pairs = cKDTree(places).query_pairs(1.2 * pitch, output_type="ndarray")
    D = np.zeros((len(pairs), n))
    D[np.arange(len(pairs)), pairs[:, 0]], D[np.arange(len(pairs)), pairs[:, 1]] = 1.0, -1.0
    return D


def _centroid_mean(e: Experiment) -> sp.csr_array:
    m = len(e.triangles)
    rows = np.repeat(np.arange(m), 3)
    return sp.csr_array((np.full(3 * m, 1 / 3), (rows, e.triangles.ravel())), shape=(m, len(e.points)))


def _plain(values: Array | None) -> list[float] | None:
    return None if values is None else values.tolist()


def rivals(e: Experiment, material: Material, split: Split, spacing: float) -> list[dict[str, Any]]:
    """Softening with strain against relaxation with time: two models with the same effects, on the same increments.

    Strain: psi_1 >= 0 of any shape. Time: psi_1 that does not fall, and Prony branches of neo-Hooke with fixed times.
    """
    chain = Chain(equilibrium(e, spacing), material.basis)
    system, additions = chain.system, material.additions
    rows, grips = split.fitted | split.confirms, np.tile(system.fields.boundary >= 0, 2)
    scale = np.abs(force(e))[:, None]
    top = diagnosis.trained_top(system, _rows(system, rows))
    loads = np.nan_to_num(chain.external(additions))

    def columns(c: Array, tau: float | None = None) -> Array:
        branch = () if tau is None else (Addition(Viscosity(), (1.0,), (tau,)),)
        return chain.work(chain.stress(c, (*additions, *branch)))

    result = []
    for name, base, times in (
        ("softer with strain", "positive", ()),
        ("relaxing in time", "convex", RELAXATION),
        ("both", "positive", RELAXATION),
        ("neither", "convex", ()),
    ):
        cone = diagnosis.base_cone(material.basis, base, top, SPLINES[1])
        soft = neo_hooke(material.basis)
        A = [columns(cone[:, j]) for j in range(cone.shape[1])]
        A += [columns(soft, tau) - columns(soft) for tau in times]
        work = np.stack(A, axis=-1)
        flat = (work / scale[..., None])[rows].reshape(-1, work.shape[-1])
        weights = nnls(flat, (loads / scale)[rows].ravel(), maxiter=1000)[0]
        r = work @ weights - loads
        line: dict[str, Any] = {
            "name": name,
            "branches": dict(zip(map(str, times), weights[cone.shape[1] :].tolist(), strict=True)),
            "errors": {},
        }
        for part, mask in split.parts().items():
            size = np.linalg.norm(loads[mask][:, grips])
            line["errors"][part] = {
                "force": float(np.linalg.norm(r[mask][:, grips]) / size),
                "field": float(np.linalg.norm(r[mask][:, ~grips]) / size),
            }
        result.append(line)
    return result
