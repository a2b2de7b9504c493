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
from scipy.optimize import least_squares, nnls

from calibrate import diagnosis, discovery, discrepancy, errors
from calibrate.basis import SingleBasis
from calibrate.chain import Addition, Additions, Chain
from calibrate.diagnosis import Fit, Problem
from calibrate.effects import CATALOGUE
from calibrate.effects.effect import Parameter
from calibrate.effects.viscosity import Viscosity
from calibrate.equilibrium import Equilibrium, equilibrium, neo_hooke
from calibrate.experiment import Experiment
from calibrate.virtual_fields import VirtualFields, bilinear_hats
from calibrate.whitening import covariances, whitening

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Say = Callable[[str], None]
KNOWN = ("force offset", "lag between force and image")  # the record says: no force at rest, pictures in time to 0.15 s
RELAXATION = (0.5, 2.0, 8.0, 32.0)  # s, times of the branches tried
FASTEST = 0.5  # s: a third of the time between increments; what relaxes faster is told by its product g tau alone


@dataclass(frozen=True)
class Relaxation(Viscosity):
    """A Prony branch that the increments can resolve."""

    shapes = (Parameter("tau", "s", lower=FASTEST),)

    def shape_values(self, data: Any) -> list[tuple[float, ...]]:
        return [(tau,) for tau in RELAXATION]


@dataclass(frozen=True)
class SecondRelaxation(Relaxation):
    """A second one, for a material that relaxes over more than a decade of time."""

    name = "second relaxation time"


EVERY = (*(Relaxation() if isinstance(e, Viscosity) else e for e in CATALOGUE), SecondRelaxation())
EFFECTS = tuple(effect for effect in EVERY if effect.name not in KNOWN)
AFTER = {SecondRelaxation.name: Viscosity.name}  # effects that mean nothing before another one is there
SPLINES = (1, 2, 3, 5, 8, 12)  # of the base model
FINER = 2  # bases that are tried in each round
MOST, ITERATIONS = 7, 4  # additions at most; steps of a fit that is tried
PAYS = 0.05  # share by which an addition must lower the error of what confirms
CONFIRMS = 1 / 3  # of the increments up to the limit: the last ones
SMOOTHING = (1e-3, 3e-3, 0.01, 0.03, 0.1, 0.3, 1.0)  # weights of the differences of neighbours in a map
FOLDS = 5  # of the virtual fields, drawn at random; each is left out once to choose the weight
REFITTED = ", relaxation refitted"
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

    def scaled(self, factor: float, strength: float = 1.0) -> Material:
        """Stiffer by a factor: amplitudes in MPa follow, those in 1/MPa go the other way; relaxation by its own `strength`."""
        power = {"MPa": 1, "1/MPa": -1}

        def amplitudes(a: Addition) -> tuple[float, ...]:
            own = strength if isinstance(a.effect, Viscosity) else 1.0
            pairs = zip(a.amplitudes, a.effect.amplitudes, strict=True)
            return tuple(own * v * factor ** power.get(p.unit, 0) for v, p in pairs)

        additions = tuple(replace(a, amplitudes=amplitudes(a)) for a in self.additions)
        return Material(self.basis, factor * self.c, additions)

    @property
    def relaxes(self) -> bool:
        return any(isinstance(a.effect, Viscosity) for a in self.additions)

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


def prepared(e: Experiment, split: Split, spacing: float, base: str, splines: int = 1) -> tuple[Problem, Fit]:
    """Problem whose held-out equations are those of the confirming increments alone, and its base fit."""
    problem, fit = diagnosis.prepare([e], [lambda system: _rows(system, split.fitted)], spacing, base=base)
    part = problem.parts[0]
    confirms = _rows(part.system, split.confirms) & diagnosis.all_rows(part.system)
    held = whitening(covariances(part.assembled, fit.c), confirms, _common(problem, fit))
    problem = with_splines(replace(problem, parts=(replace(part, held=held),)), base, splines)
    return problem, diagnosis.refit(problem, diagnosis.first_guess([part.assembled]), ())


def _common(problem: Problem, fit: Fit) -> Array | None:
    return discrepancy.sources(problem.parts[0].system, problem.basis, fit.c)


def _rows(system: Equilibrium, increments: Mask) -> Mask:
    return np.repeat(increments[:, None], system.loads.shape[1], axis=1)


def with_splines(problem: Problem, base: str, n: int) -> Problem:
    """The problem with a base energy of n functions of I1."""
    top = max(diagnosis.trained_top(part.system, part.train.rows) for part in problem.trained)
    start = diagnosis.first_guess([part.assembled for part in problem.trained])
    prior = diagnosis.smoothness(base, n) / (diagnosis.STIFFENING * float(start.max()))
    return replace(problem, cone=diagnosis.base_cone(problem.basis, base, top, n), prior=prior, parametric=True)


@dataclass(frozen=True, eq=False)
class Round:
    """A model, its errors on what was fitted and what confirms, the tests of what it leaves, and what was added."""

    problem: Problem
    fit: Fit
    train: discovery.Misfit | None
    held: discovery.Misfit | None
    scores: list[diagnosis.Score]
    confirmed: dict[str, float]
    added: str | None = None

    @property
    def splines(self) -> int:
        return self.problem.cone.shape[1]


def close_loop(problem: Problem, state: Fit, base: str, say: Say) -> list[Round]:
    """Add effects in the order of their evidence, where they lower the error of what confirms; until none does.

    The base starts as neo-Hooke and is made finer only when no effect helps: many splines take up whatever varies with the
    load, time among it, and extrapolate badly. Of effects with one signature the one that predicts best is taken. The order
    follows the score and not the gain in prediction, because an effect that is small but alone in what it does (relaxation)
    shows only when those that disturb everything (a sheet that was not flat) are in the model.
    """
    rounds: list[Round] = []
    while True:
        say(f"round {len(rounds) + 1}: testing effects")
        present = {a.effect.name for a in state.additions}
        scores = diagnosis.score(
            problem, state, [x for x in EFFECTS if AFTER.get(x.name, x.name) in {x.name, *present}]
        )
        errors_ = [discovery.misfit(problem, state.c, state.additions, held) for held in (False, True)]
        now = Round(problem, state, errors_[0], errors_[1], scores, {})
        found = _next(now, base, lambda text: say(f"round {len(rounds) + 1}: {text}")) if len(rounds) < MOST else None
        if found is None:
            return [*rounds, now]
        rounds.append(replace(now, added=found[0]))
        _, problem, state = found


def _next(now: Round, base: str, say: Say) -> tuple[str, Problem, Fit] | None:
    """What is added, with the problem and the fit that follow; errors of all that is tried go to `now.confirmed`."""
    assert now.held is not None
    limit = (1 - PAYS) * both(now.held)
    fits: dict[str, tuple[float, Problem, Fit]] = {}

    def tried(name: str, problem: Problem, *starts: Addition | None) -> float:
        if name not in fits:
            say(f"fit with {name}")
            found = [fit for start in starts if (fit := _refit(problem, now.fit, start)) is not None]
            fit = min(found, key=lambda fit: fit.loss, default=None)
            held = None if fit is None else discovery.misfit(problem, fit.c, fit.additions, True)
            fits[name] = (np.inf if held is None else both(held), problem, now.fit if fit is None else fit)
            if held is not None:
                now.confirmed[name] = both(held)
        return fits[name][0]

    tested = [one for one in now.scores if one.status == "tested"]
    like = diagnosis.likeness(tested)
    for i, one in enumerate(tested):
        if one.adjusted > discovery.ALPHA:
            continue
        group = [other for j, other in enumerate(tested) if j == i or like[i, j] > diagnosis.COLLINEAR]
        group = [other for other in group if other.adjusted < discovery.ALPHA]
        lowest = min(group, key=lambda other: tried(other.effect.name, now.problem, *_starts(now.problem, other)))
        if fits[lowest.effect.name][0] < limit:
            return lowest.effect.name, *fits[lowest.effect.name][1:]
    for n in [n for n in SPLINES if n > now.splines][:FINER]:
        name = f"base of {n} splines"
        if tried(name, with_splines(now.problem, base, n), None) < limit:
            return name, *fits[name][1:]
    return None


def _starts(problem: Problem, one: diagnosis.Score) -> list[Addition]:
    """Additions at the amplitude of the score test, or at the null value where that is not admissible; times at several."""
    null = tuple(p.null for p in one.effect.amplitudes)
    starts = [Addition(one.effect, one.amplitudes if one.admissible else null, one.shape)]
    if isinstance(one.effect, Viscosity):
        shapes = one.effect.shape_values(problem.parts[0].chain.data)
        starts += [Addition(one.effect, null, shape) for shape in shapes if shape != one.shape]
    return starts


def both(misfit: discovery.Misfit) -> float:
    """Error of force and of field in one number: a factor on either counts alike, however many equations it has."""
    return float(np.sqrt(misfit.force * misfit.field))


def _refit(problem: Problem, state: Fit, addition: Addition | None) -> Fit | None:
    """The fit with one more effect; None where it is not told from its null value, or its stresses are not finite."""
    additions = state.additions if addition is None else (*state.additions, addition)
    try:
        fit = diagnosis.refit(problem, state.c, additions, ITERATIONS)
    except ValueError:
        return None
    if not np.isfinite(fit.loss):
        return None
    if addition is None:
        return fit
    null = (p.null for p in addition.effect.amplitudes)
    changed = (abs(a - p) >= 2 * d for a, p, d in zip(fit.additions[-1].amplitudes, null, fit.errors[-1], strict=True))
    return fit if any(changed) else None


def base_name(splines: int) -> str:
    """'neo-Hooke' or how many splines."""
    return "neo-Hooke" if splines == 1 else f"{splines} splines"


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
    rounds = close_loop(problem, fit, base, lambda text: say(f"{e.name}: {text}"))
    whole, start = prepared(e, everything, spacing, base)
    result: dict[str, Any] = {
        "name": e.name,
        "spacing": spacing,
        "time": e.time,
        "split": {name: np.flatnonzero(mask).tolist() for name, mask in split.parts().items()},
        "verdict": verdict(rounds[-1].fit, rounds[-1].scores),
        "closest": [a.effect.name for a in rounds[-1].fit.additions],
        "models": [],
        "rounds": [],
    }
    for now in rounds:
        say(f"{e.name}: all of the first {until:g} s")
        whole = with_splines(whole, base, now.splines)
        try:
            final = diagnosis.refit(whole, start.c, now.fit.additions)
        except ValueError:  # not finite on the way: as it was found
            final = now.fit
        material = Material(whole.basis, final.c, final.additions)
        result["models"].append(
            {
                "name": " + ".join([base_name(now.splines), *(a.effect.name for a in final.additions)]),
                "reduced_chi_square": final.reduced_chi_square,
                "splines": now.splines,
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
                "error": None if now.held is None else both(now.held),
                "bases": {name: error for name, error in now.confirmed.items() if name.startswith("base of")},
                "candidates": [
                    {
                        "effect": one.effect.name,
                        "score": one.score,
                        "adjusted_p": one.adjusted,
                        "share": one.share,
                        "admissible": one.admissible,
                        "confirming_error": now.confirmed.get(one.effect.name),
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
    grips = grip_rows(system)
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
        result["errors"][name] = {
            **force_and_field(system, r, rows),
            "mean_force": float(np.sqrt(np.mean((sections[rows].mean(axis=1) / pull[rows] - 1) ** 2))),
            "section_scatter": float(np.sqrt(np.mean((sections[rows] / pull[rows, None] - 1) ** 2))),
            "lower_over_upper": float(np.mean(lower[rows] / upper[rows])),
        }
    result["force"] = pull.tolist()
    result["sections"] = (sections / pull[:, None]).tolist()
    return result


def grip_rows(system: Equilibrium) -> Mask:
    """Equations (2 v,) that hold a measured force."""
    return np.tile(system.fields.boundary >= 0, 2) & np.isfinite(system.loads).all(axis=0)


def force_and_field(system: Equilibrium, r: Array, increments: Mask) -> dict[str, float]:
    """Relative errors of residuals r (t, 2 v) in some increments, see the top of this module."""
    fields = np.tile(system.fields.boundary < 0, 2)
    grips = grip_rows(system)
    size = np.linalg.norm(system.loads[increments][:, grips])
    parts = (("force", grips), ("field", fields))
    return {name: float(np.linalg.norm(r[increments][:, rows]) / size) for name, rows in parts}


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


def carried(
    e: Experiment, material: Material, split: Split, spacing: float, strength: bool = False
) -> tuple[Material, dict[str, float]]:
    """The material with the factor on its stiffness, and on the `strength` of its relaxation, that fits the forces best.

    Fitted to the forces at the grips in the increments to be fitted; everything else stays as it was learnt.
    """
    system = equilibrium(e, spacing)
    rows = split.fitted | split.confirms
    grips = grip_rows(system)

    def residuals(logs: Array) -> Array:
        scaled = material.scaled(*np.exp(logs))
        return Chain(system, material.basis).with_additions(scaled.c, scaled.additions)[rows][:, grips].ravel()

    load = system.loads[rows][:, grips].ravel()
    guess = float(load @ load) / max(float(load @ (residuals(np.zeros(1)) + load)), 1e-3 * float(load @ load))
    start = np.log([guess, 1.0] if strength else [guess])
    best = least_squares(residuals, start, x_scale=0.1, diff_step=1e-2, xtol=1e-4, max_nfev=20)
    if not best.success:
        raise errors.FitError(f"{e.name}: the carried material cannot be scaled to its forces: {best.message}")
    factors = [float(f) for f in np.exp(best.x)]
    return material.scaled(*factors), dict(zip(("stiffness", "relaxation"), factors, strict=False))


def transfer(e: Experiment, models: Sequence[dict[str, Any]], until: float, spacing: float) -> dict[str, Any]:
    """Every model learnt on another sheet, on this one, with one factor refitted; the last also with its relaxation."""
    split = Split.of(e, until)
    result: dict[str, Any] = {"name": e.name, "time": e.time, "models": []}
    models = [model for model in models if not model["name"].endswith(REFITTED)]
    cases = [(model, False) for model in models]
    if Material.from_dict(models[-1]["material"]).relaxes:
        cases.append((models[-1], True))
    for model, strength in cases:
        material, factors = carried(e, Material.from_dict(model["material"]), split, spacing, strength)
        result["models"].append(
            {
                "name": model["name"] + (REFITTED if strength else ""),
                "factor": factors["stiffness"],
                "factors": factors,
                "material": material.to_dict(),
                **account(e, material, split, spacing),
            }
        )
    return result


def stiffness_map(e: Experiment, material: Material, until: float, spacing: float, cell: float) -> dict[str, Any]:
    """Stiffness of each place over that of the carried model: bilinear on a grid of `cell` mm, smooth, above zero.

    The factors k of nodes minimise |sum_q k_q w_q - F|^2 / |F|^2 + weight |gradient k|^2, w_q the virtual work of the model's
    stress times the hat of node q. The weight is the one that predicts best the virtual fields left out.
    """
    split = Split.of(e, until)
    system = equilibrium(e, spacing)
    chain = Chain(system, material.basis)
    stress_work, loads, hats = _work_by_place(e, chain, material, cell)
    rows = split.fitted | split.confirms
    scale = np.abs(force(e))[:, None]
    A, b = stress_work / scale[..., None], loads / scale

    def flat(array: Array, keep: Mask) -> Array:
        return array[rows][:, keep].reshape(-1, *array.shape[2:])

    D = _differences(hats)
    n = A.shape[1] // 2
    fold = np.tile(np.random.default_rng(0).integers(FOLDS, size=n), 2)
    inner, known = np.tile(system.fields.boundary < 0, 2), np.isfinite(system.loads).all(axis=0)
    parts = [inner & (fold == i) for i in range(FOLDS)]

    def left_out(weight: float | None) -> float:
        """|residual| of every field by a map that does not know it; None: by the same stiffness everywhere."""
        total = 0.0
        for part in parts:
            k = (
                np.ones(A.shape[2])
                if weight is None
                else _smooth_fit(flat(A, known & ~part), flat(b, known & ~part), weight * D)
            )
            total += float(((flat(A, part) @ k - flat(b, part)) ** 2).sum())
        return float(np.sqrt(total))

    scores = [left_out(weight) for weight in SMOOTHING]
    weight = SMOOTHING[int(np.argmin(scores))]
    k = _smooth_fit(flat(A, known), flat(b, known), weight * D)
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
        "left_out": {"before": left_out(None), "after": min(scores)},
        "errors": {},
    }
    for name, mask in split.parts().items():
        result["errors"][name] = {
            when: force_and_field(system, r, mask) for when, r in (("before", before), ("after", after))
        }
    return result


def _work_by_place(e: Experiment, chain: Chain, material: Material, cell: float) -> tuple[Array, Array, sp.csr_array]:
    """Work (t, 2 v, q) of the model's stress by hats on a grid, loads (t, 2 v), hats (n, q)."""
    hats = bilinear_hats(e.points, cell)
    share = (_centroid_mean(e) @ hats).toarray()
    P = chain.stress(material.c, material.additions)
    work = np.stack([chain.work(P * place[:, None, None]) for place in share.T], axis=-1)
    return work, np.nan_to_num(chain.external(material.additions)), hats


def _smooth_fit(A: Array, b: Array, D: Array) -> Array:
    """k >= 0 that minimises |A k - b|^2 + |D k|^2 (rows of D: differences of neighbours)."""
    n = A.shape[1]
    return nnls(np.concatenate([A, D]), np.concatenate([b, np.zeros(len(D))]), maxiter=50 * n)[0]


def _differences(hats: sp.csr_array) -> Array:
    """(pairs, q): differences of the values of neighbouring hats (n, q), those that overlap."""
    pairs = sp.triu(hats.T @ hats, k=1).tocoo()
    D = np.zeros((pairs.nnz, hats.shape[1]))
    D[np.arange(pairs.nnz), pairs.row], D[np.arange(pairs.nnz), pairs.col] = 1.0, -1.0
    return D


def _centroid_mean(e: Experiment) -> sp.csr_array:
    m = len(e.triangles)
    rows = np.repeat(np.arange(m), 3)
    return sp.csr_array((np.full(3 * m, 1 / 3), (rows, e.triangles.ravel())), shape=(m, len(e.points)))


def rivals(e: Experiment, material: Material, split: Split, spacing: float) -> list[dict[str, Any]]:
    """Softening with strain against relaxation with time: models with the same other effects, on the same increments.

    Strain: psi_1 >= 0 in straight lines or splines. Time: Prony branches of neo-Hooke with fixed times.
    """
    chain = Chain(equilibrium(e, spacing), material.basis)
    system = chain.system
    additions = tuple(a for a in material.additions if not isinstance(a.effect, Viscosity))
    rows, known = split.fitted | split.confirms, np.isfinite(system.loads).all(axis=0)
    scale = np.abs(force(e))[:, None]
    top = diagnosis.trained_top(system, _rows(system, rows))
    loads = np.nan_to_num(chain.external(additions))

    def columns(c: Array, tau: float | None = None) -> Array:
        branch = () if tau is None else (Addition(Viscosity(), (1.0,), (tau,)),)
        return chain.work(chain.stress(c, (*additions, *branch)))

    result = []
    for n, times in ((1, ()), (1, RELAXATION), (2, ()), (3, ()), (5, ()), (3, RELAXATION)):
        cone = diagnosis.base_cone(material.basis, "positive", top, n)
        soft = neo_hooke(material.basis)
        A = [columns(cone[:, j]) for j in range(cone.shape[1])]
        A += [columns(soft, tau) - columns(soft) for tau in times]
        work = np.stack(A, axis=-1)
        flat = (work / scale[..., None])[rows][:, known].reshape(-1, work.shape[-1])
        weights = nnls(flat, (loads / scale)[rows][:, known].ravel(), maxiter=1000)[0]
        r = work @ weights - loads
        line: dict[str, Any] = {
            "name": base_name(n) + (", relaxing" if times else ""),
            "branches": dict(zip(map(str, times), weights[cone.shape[1] :].tolist(), strict=True)),
            "errors": {},
        }
        for part, mask in split.parts().items():
            line["errors"][part] = force_and_field(system, r, mask)
        result.append(line)
    return result
