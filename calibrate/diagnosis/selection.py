"""Close the loop: test the effects, add the best that data held out confirm, test what is left, until nothing is.

In: Experiments, what to hold out. Out: `Discovery` with a round for each model, and a verdict.

An effect is added if its adjusted p-value is small, its amplitude is physically admissible, and the error on equations
that were not used for fitting falls. Once nothing more is added, each effect is taken out again and the others compete
for its place. Effects are named only if what they leave is noise, or a small part of what they explain, both where they
were fitted and where they were not, and if those that explain more than another may leave are not more than two: a
catalogue that lacks the true effect imitates it with several. Otherwise they are the closest of the catalogue, and the
verdict says that the rest is not explained.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import minimize

from calibrate import errors
from calibrate.data.experiment import Experiment
from calibrate.diagnosis import effect_fit, effect_score, whitened
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.effect_score import Score
from calibrate.diagnosis.whitened import Problem
from calibrate.effects import CATALOGUE, Effect
from calibrate.effects.chain import Addition, Additions
from calibrate.equations.equilibrium import Equilibrium

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Model = tuple[Problem, Fit]  # a fit with the weights that belong to it
ALPHA = 0.03  # of the search for an effect
GLOBAL = 0.005  # of the misfit as a whole, once where it was fitted and once where it was not
REST = 0.03  # of what was explained, that may be left
MINOR = 0.005, 0.03  # of what an effect explains, that it may leave for others, and that a truncated formula may
NAMED = 2  # effects that together are called an explanation
CLOSE = 9.2  # difference of scores below which the likelihoods of two effects differ by less than 100 to 1
WORSE = 1.02  # a misfit larger by this factor is worse
SOFTEST = 0.1  # of the stiffness of the base, that an effect must leave it
MOST = 3  # effects in a model: one more than can be named
TRIES = 3
RIVAL = 0.8  # of the best score: effects so close are fitted before one is chosen, as scores are those of small effects
REFINED = 4  # significant effects whose shape is refined before they are compared
SHAPE_EVALUATIONS = 14  # the fit goes on from there


@dataclass(frozen=True)
class HoldOut:
    """Which equations of the experiments are held out: kind 'every' (each n-th increment), 'after' (s), 'half' or 'none'.

    value: n, time in s, or left, right, bottom, top.
    """

    kind: str = "every"
    value: Any = 3

    @classmethod
    def parse(cls, text: str) -> HoldOut:
        """'every:3', 'after:15', 'half:left' or 'none'. Raises `ConfigError`."""
        kind, _, value = text.partition(":")
        try:
            if kind == "every" and int(value) > 1:
                return cls(kind, int(value))
            if kind == "after" and np.isfinite(float(value)):
                return cls(kind, float(value))
        except ValueError:
            pass
        if kind == "half" and value in ("left", "right", "bottom", "top"):
            return cls(kind, value)
        if text == "none":
            return cls("none", None)
        raise errors.ConfigError(
            f"--hold-out {text}: give an experiment.npz, every:N (each N-th increment, N > 1), after:SECONDS, "
            "half:left|right|bottom|top, or none"
        )

    def __str__(self) -> str:
        return {
            "every": f"every {_ordinal(self.value)} increment",
            "after": f"increments after {self.value} s",
            "half": f"virtual fields in the {self.value} half",
            "none": "nothing",
        }[self.kind]

    def training(self, system: Equilibrium) -> Mask:
        """Equations (t, 2 v) that are used for fitting. Raises `ConfigError` when none or all are left."""
        e = system.experiment
        mask = np.ones(system.loads.shape, bool)
        if self.kind == "every":
            first, last = self.value - 2, len(mask) - 1
            if (last - first) % self.value == 0:  # the last one, often the largest, is used
                first = (first + 1) % self.value
            mask[first :: self.value] = False
        elif self.kind == "after":
            if e.time is None:
                raise errors.ConfigError(f"{e.name}: --hold-out after:SECONDS needs a time; use every:N")
            mask[e.time > self.value] = False
        elif self.kind == "half":
            axis = 0 if self.value in ("left", "right") else 1
            weight = system.fields.values / np.asarray(system.fields.values.sum(axis=0)).ravel()
            place = weight.T @ e.points[:, axis] - 0.5 * (e.points[:, axis].min() + e.points[:, axis].max())
            away = (place < 0) == (self.value in ("left", "bottom"))
            mask[:, np.tile(away & (system.fields.boundary < 0), 2)] = False
        if not mask.any():
            raise errors.ConfigError(f"{e.name}: holding out {self} leaves nothing to fit; use none, or another rule")
        if mask.all() and self.kind != "none":
            raise errors.ConfigError(
                f"{e.name}: holding out {self} holds out nothing; use none, or every:N with N no larger than the number of increments"
            )
        return mask


def _ordinal(n: int) -> str:
    return {2: "second", 3: "third"}.get(n, f"{n}th")


@dataclass(frozen=True)
class Misfit:
    """force: norm of force errors over norm of measured forces, NaN where no force is among the equations. field: norm of the virtual work that fields without a
    load leave, over the same. chi_square: whitened squared residual an equation; rows: equations. noise: what the squares
    of force and field are expected to be from noise alone. log_determinant: of the covariance behind chi_square, an equation."""

    force: float
    field: float
    chi_square: float
    rows: int
    noise: tuple[float, float] = (0.0, 0.0)
    log_determinant: float = 0.0

    @property
    def beyond_noise(self) -> tuple[float, float]:
        """Squares of force and field less those of noise."""
        return self.force**2 - self.noise[0], self.field**2 - self.noise[1]


@dataclass(frozen=True, eq=False)
class Row:
    """A line of the table: an effect's score, the fit with it (None where it was not made) and its errors.

    problem: the weights that the fit belongs to, where it was made to be compared.
    """

    score: Score
    fit: Fit | None = field(default=None, repr=False)
    problem: Problem | None = field(default=None, repr=False)
    train: Misfit | None = None
    held: Misfit | None = None
    like: tuple[tuple[str, float], ...] = ()

    @property
    def name(self) -> str:
        """Of the effect."""
        return self.score.effect.name

    @property
    def addition(self) -> Addition | None:
        """The effect as it was fitted; None where it was not."""
        return None if self.fit is None else self.fit.additions[-1]

    @property
    def deviations(self) -> tuple[float, ...]:
        """A standard deviation for each fitted amplitude, in its unit; none where it was not fitted."""
        return () if self.fit is None else self.fit.errors[-1]


@dataclass(frozen=True, eq=False)
class Round:
    """A model, its errors, the tests of what it leaves, and what was added (None: nothing). remarks: why not others.

    predicted: chi-square and degrees of freedom of what was held out, see `effect_fit.predictive`.
    """

    fit: Fit
    train: Misfit
    held: Misfit | None
    rows: tuple[Row, ...]
    predicted: tuple[float, int] | None = None
    added: str | None = None
    group: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def predicted_p(self) -> float:
        """Probability of a prediction as bad, if the model is right; 1 where nothing is held out."""
        return 1.0 if self.predicted is None else float(stats.chi2.sf(self.predicted[0], max(self.predicted[1], 1)))


@dataclass(frozen=True)
class Review:
    """Effects of a model, each taken out in turn. gains: by how much the misfit then rises. groups: others for its place."""

    gains: dict[str, float] = field(default_factory=dict)
    groups: dict[str, tuple[str, ...]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Discovery:
    """Result of `discover`. verdict: 'explained', 'nothing significant' or 'significant, not explained'.

    named: effects that what is left confirms; closest: those added that it does not. groups: for each added effect, the
    effects that these data cannot tell from it.
    """

    problem: Problem = field(repr=False)
    rounds: tuple[Round, ...]
    verdict: str
    named: tuple[str, ...]
    closest: tuple[str, ...]
    groups: dict[str, tuple[str, ...]]

    @property
    def base(self) -> Fit:
        """The fit without effects."""
        return self.rounds[0].fit

    @property
    def final(self) -> Fit:
        """The last fit: the base with the effects `named` and `closest`."""
        return self.rounds[-1].fit


def misfit(problem: Problem, c: Array, additions: Additions, held: bool) -> Misfit | None:
    """Errors of coefficients c (n,) and effects on the training equations, or on those held out (None where there are
    none)."""
    force = field_ = measured = chi = determinant = 0.0
    noise = np.zeros(2)
    n = forces = 0
    for part in problem.parts:
        weights = part.held if held else part.train
        if not weights.size:
            continue
        r, load = part.residual(c, part.carried(additions)), np.nan_to_num(part.system.loads)
        carries = np.broadcast_to(np.tile(part.system.fields.boundary >= 0, 2), r.shape)
        forces += int((weights.rows & carries).sum())
        force += float((r[weights.rows & carries] ** 2).sum())
        field_ += float((r[weights.rows & ~carries] ** 2).sum())
        noise += [weights.variance[carries].sum(), weights.variance[~carries].sum()]
        determinant += weights.log_determinant
        measured += float((load[weights.rows & carries] ** 2).sum())
        if not (weights.rows & carries).any():
            measured += float((load[np.isfinite(part.system.loads) & carries] ** 2).sum())
        chi += float((weights(r) ** 2).sum())
        n += weights.size
    if not n:
        return None
    size = max(measured, 1e-300)
    expected = float(noise[0] / size), float(noise[1] / size)
    of_force = float(np.sqrt(force / size)) if forces else float("nan")
    return Misfit(of_force, float(np.sqrt(field_ / size)), chi / n, n, expected, determinant / n)


def discover(
    experiments: Sequence[Experiment],
    hold_out: HoldOut | None = None,
    held: Sequence[Experiment] = (),
    effects: Sequence[Effect] = CATALOGUE,
    spacing: float | None = None,
    base: str = "positive",
    whole_table: bool = True,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Discovery:
    """Fit `experiments`, hold out equations of them and all of the experiments `held`, and find what is missing.

    hold_out: default every third increment, or nothing where there are experiments to be held out, or one has fewer
    than three increments. spacing: of the virtual fields, mm (None: from the noise). base: see `effect_fit.prepare`.
    whole_table: refit with every effect, not only with those that are tried. Raises `FitError` for a base that does not
    converge, `ConfigError`, and the errors of `calibrate.equations.equilibrium.equilibrium`.
    """
    say = progress or (lambda text: None)
    if hold_out is None:
        few = min(e.n_increments for e in experiments) < 3
        hold_out = HoldOut("none", None) if held or few else HoldOut()
    say("base model")
    train = [hold_out.training] * len(experiments) + [_nothing] * len(held)
    problem, state = effect_fit.prepare([*experiments, *held], train, spacing, base=base)
    return close_loop(problem, state, effects, whole_table, seed, say)


def close_loop(
    problem: Problem,
    state: Fit,
    effects: Sequence[Effect] = CATALOGUE,
    whole_table: bool = True,
    seed: int = 0,
    say: Callable[[str], None] = lambda text: None,
) -> Discovery:
    """Rounds of tests and additions from a base fit, see `discover`."""
    rounds: list[Round] = []
    reviews: dict[frozenset[str], Review] = {}  # of models with more than one effect, by their names
    while True:
        say(f"round {len(rounds) + 1}: testing effects")
        now = _round(problem, state, effects, whole_table, seed, say)
        added, names = None, frozenset(a.effect.name for a in state.additions)
        if len(names) > 1 and names not in reviews:
            now, reviews[names], added = _review(problem, now, effects, seed, say)
        enough = len(names) >= NAMED and _small(rounds[0], now)
        if added is None and len(names) < MOST and not enough:
            now, added = _extend(problem, now, say)
        rounds.append(now)
        if added is None:
            return _conclude(problem, tuple(rounds), reviews.get(names, Review()))
        problem, state = _without_idle(*added)


def _nothing(system: Equilibrium) -> Mask:
    return np.zeros(system.loads.shape, bool)


def _round(
    problem: Problem, state: Fit, effects: Sequence[Effect], whole: bool, seed: int, say: Callable[[str], None]
) -> Round:
    """Test every effect and make the table."""
    scores = effect_score.score(problem, state, effects, seed)
    tested = [s for s in scores if s.status == "tested"]
    like = effect_score.likeness(tested) if tested else np.zeros((0, 0))
    rows = []
    for i, one in enumerate(scores):
        if one.status != "tested":
            rows.append(Row(one))
            continue
        near = [(tested[j].effect.name, float(like[i, j])) for j in np.argsort(-like[i]) if j != i]
        row = Row(one, like=tuple((n, v) for n, v in near if v > 0.5))
        if whole:
            say(f"fit with {one.effect.name}")
            row = _fitted(problem, state, row)
        rows.append(row)
    return Round(
        state,
        misfit(problem, state.c, state.additions, False),  # type: ignore[arg-type]
        misfit(problem, state.c, state.additions, True),
        tuple(rows),
        effect_fit.predictive(problem, state),
    )


def _fitted(problem: Problem, state: Fit, row: Row, compared: bool = False) -> Row:
    """The row with a refit of base and effect and its errors, of few iterations for the table or of more to be compared.

    A fit to be compared has the weights that belong to it: those of a base that makes up for the effect are wrong.
    Amplitudes far beyond those that the score test is good for are not started from. Without a fit where none is better than
    the model without the effect, or where it runs away: it then did not converge.
    """
    addition = Addition(row.score.effect, row.score.amplitudes, row.score.shape)
    if not whitened.loss(problem, state.c, (*state.additions, addition)) < WORSE * state.loss + state.n_rows:
        null = tuple(p.null for p in row.score.effect.amplitudes)
        addition = replace(addition, amplitudes=null)
    additions, iterations = (*state.additions, addition), 6 if compared else 2
    try:
        if row.score.adjusted < ALPHA:
            problem, new = effect_fit.settled(problem, state.c, additions, iterations)
            if compared:
                problem, new = effect_fit.settled(effect_fit.reweighted(problem, new), new.c, new.additions, iterations)
        else:
            new = effect_fit.refit(problem, state.c, additions, iterations)
    except errors.FitError:
        return row
    if not new.free_loss < WORSE * state.free_loss + len(addition.amplitudes):
        return row
    return replace(
        row,
        fit=new,
        problem=problem if compared else None,
        train=misfit(problem, new.c, new.additions, False),
        held=misfit(problem, new.c, new.additions, True),
    )


def _extend(problem: Problem, now: Round, say: Callable[[str], None]) -> tuple[Round, Model | None]:
    """Add the best effect that is significant, admissible and confirmed by what was held out."""
    significant = [row for row in now.rows if row.score.status == "tested" and row.score.adjusted < ALPHA]
    refined = [replace(row, score=_best_shape(problem, now.fit, row.score)) for row in significant[:REFINED]]
    significant = sorted([*refined, *significant[REFINED:]], key=lambda row: -row.score.evidence)
    likes = _likes(significant)
    significant = [replace(row, like=likes[row.name]) for row in significant]
    now = replace(now, rows=tuple(replace(row, like=likes.get(row.name, row.like)) for row in now.rows))
    remarks: list[str] = []
    confirmed: list[Row] = []
    fitted: dict[str, Row] = {}
    tried = 0
    for row in significant:
        if not row.score.admissible:
            remarks.append(f"{row.name}: significant, but with an inadmissible amplitude")
            continue
        if tried == TRIES or (confirmed and row.score.score < RIVAL * confirmed[0].score.score):
            break
        tried += 1
        say(f"adding {row.name}")
        best = fitted[row.name] = _fitted(problem, now.fit, replace(row, fit=None), compared=True)
        why = _objection(now, best)
        if why:
            remarks.append(f"{row.name}: {why}")
        else:
            confirmed.append(best)
    now = replace(now, rows=tuple(fitted.get(row.name, row) for row in now.rows))
    if not confirmed:
        return replace(now, remarks=tuple(remarks)), None
    best = min(confirmed, key=lambda row: _price(row, now.fit))
    assert best.fit is not None
    equal = [row.name for row in confirmed if row is not best and _price(row, now.fit) < _price(best, now.fit) + CLOSE]
    group = dict.fromkeys((best.name, *_alike(best, significant), *equal))
    return replace(now, added=best.name, group=tuple(group), remarks=tuple(remarks)), _model(best)


def _objection(now: Round, row: Row) -> str:
    """Why a fitted effect is not added to the model of a round; empty where nothing speaks against it.

    The misfit that amplitudes are found and compared by lets the base have any energy, a negative one too; the errors here
    are those of a base that may be one.
    """
    if row.fit is None or row.addition is None or row.train is None:
        return "no fit with it is better than without it"
    if _idle(row.addition, row.deviations):
        return "no amplitude within its bounds differs from none when everything is refitted"
    if np.linalg.norm(row.fit.c) < SOFTEST * np.linalg.norm(now.fit.c):
        return "it would take the place of the material, which would have hardly any stiffness"
    if _grows(now, row.train, row.held):
        return "with the weights that belong to it, the errors are larger than without it"
    if now.held is not None and row.held is not None and not _better(now.held, row.held):
        return "the error on held-out data does not fall"
    return "" if _better(now.train, row.train) else "no error falls"


def _larger(before: Misfit, after: Misfit | None) -> bool:
    """Whether errors grow by more than noise may make them."""
    if after is None:
        return False
    return sum(after.beyond_noise) > WORSE**2 * max(sum(before.beyond_noise), 0.0) + sum(before.noise)


def _grows(now: Round, train: Misfit | None, held: Misfit | None) -> bool:
    """Whether a model has larger errors than that of a round, where they were fitted or where they were not."""
    return _larger(now.train, train) or (now.held is not None and _larger(now.held, held))


def _likes(rows: Sequence[Row]) -> dict[str, tuple[tuple[str, float], ...]]:
    """Cosines above 0.5 between effects at their best shapes, where these are more alike than at those of the grid.

    Two families of fibres that close up are one, which no shape of the grid shows.
    """
    cosines = effect_score.likeness([row.score for row in rows]) if rows else np.zeros((0, 0))
    result = {}
    for row, line in zip(rows, cosines, strict=True):
        like = dict(row.like)
        for other, cosine in zip(rows, line, strict=True):
            if other is not row and cosine > max(like.get(other.name, 0.0), 0.5):
                like[other.name] = float(cosine)
        result[row.name] = tuple(sorted(like.items(), key=lambda pair: -pair[1]))
    return result


def _price(row: Row, weights: Fit) -> float:
    """Misfit of a fit with an effect, and the price of its amplitudes and shapes (Schwarz 1978).

    Effects that amplify noise lower the weights, and with them a misfit that is none of noise: that part does not count.
    weights: a fit whose weights prices are compared by.
    """
    assert row.fit is not None
    lower = row.fit.log_determinant - weights.log_determinant
    amplified = max(row.fit.reduced_chi_square - 1, 0.0) * lower
    return row.fit.free_loss + amplified + (row.score.degrees + len(row.score.shape)) * float(np.log(row.fit.n_rows))


def _review(
    problem: Problem, now: Round, effects: Sequence[Effect], seed: int, say: Callable[[str], None]
) -> tuple[Round, Review, Model | None]:
    """Take each effect out and let all compete for its place; with another model if that is better."""
    state, best = now.fit, None
    gains: dict[str, float] = {}
    groups: dict[str, tuple[str, ...]] = {}
    exchanged: tuple[str, str] | tuple[()] = ()
    most = 1.0
    for one in state.additions:
        name = one.effect.name
        say(f"without {name}")
        others = tuple(a for a in state.additions if a is not one)
        weighted, without = effect_fit.settled(problem, state.c, others)
        gains[name] = without.free_loss - state.free_loss
        scores = [s for s in effect_score.score(weighted, without, effects, seed) if s.status == "tested"]
        scores = [_best_shape(weighted, without, s) for s in scores[:REFINED]]
        likely = [s for s in scores if s.admissible and s.effect.name != name and s.adjusted < ALPHA]
        own = next((s for s in scores if s.effect.name == name), None)
        height = own.score if own else 0.0
        rivals = [s for s in likely if s.score > min(height - CLOSE, RIVAL * height)][:TRIES]
        # the others as they were beside this one
        start = replace(state, additions=others, loss=without.loss, free_loss=without.free_loss)
        rows = [_fitted(problem, start, Row(s), compared=True) for s in rivals]
        rows = [row for row in rows if row.fit is not None and not _grows(now, row.train, row.held)]
        mine = _price(Row(own, state), state) if own else state.free_loss
        groups[name] = (name, *(row.name for row in rows if _price(row, state) < mine + CLOSE))
        for row in rows:
            assert row.fit is not None and row.addition is not None
            gain = mine - _price(row, state)
            if gain > most and not _idle(row.addition, row.deviations):
                most, best, exchanged = gain, _model(row), (name, row.name)
    if not exchanged:
        return now, Review(gains, groups), None
    remark = f"{exchanged[1]} takes the place of {exchanged[0]}: beside the other effects it explains more"
    return (
        replace(now, added=exchanged[1], group=(exchanged[1],), remarks=(*now.remarks, remark)),
        Review(gains, groups),
        best,
    )


def _alike(row: Row, significant: Sequence[Row]) -> list[str]:
    """Significant effects that the data cannot tell from one: signatures alike, or scores nearly as high."""
    cosines = dict(row.like)
    return [
        other.name
        for other in significant
        if other is not row
        and other.score.admissible
        and (cosines.get(other.name, 0.0) > effect_score.COLLINEAR or other.score.score > row.score.score - CLOSE)
    ]


def _better(before: Misfit, after: Misfit) -> bool:
    """Whether an error falls; beyond noise, as some effects amplify it, and not by lower weights (see `_price`)."""
    amplified = max(after.chi_square - 1, 0.0) * (after.log_determinant - before.log_determinant)
    falls = (a < b for a, b in zip(after.beyond_noise, before.beyond_noise, strict=True))
    return after.chi_square + amplified < before.chi_square and any(falls)


def _best_shape(problem: Problem, state: Fit, found: Score) -> Score:
    """The score at the best shape near the best one of the grid."""
    if not found.shape or not found.effect.shapes_vary:
        return found
    U = state.columns
    r = state.residual - U @ (U.T @ state.residual)
    null = tuple(p.null for p in found.effect.amplitudes)
    grid = np.array(found.effect.shape_values(problem.trained[0].chain.data))
    logarithmic = np.array([p.lower == 0 and np.all(grid[:, i] > 0) for i, p in enumerate(found.effect.shapes)])
    best = found

    def evaluate(x: Array) -> float:
        nonlocal best
        shape = tuple(float(v) for v in np.where(logarithmic, np.exp(x), x))
        if any(not p.lower <= v <= p.upper for p, v in zip(found.effect.shapes, shape, strict=True)):
            return 0.0
        one, _ = effect_score.examine_shape(problem, state, Addition(found.effect, null, shape), U, r)
        first[0] = first[0] or max(one.score, 1e-300)
        score = found.score * one.score / first[0]
        if one.status == "tested" and one.admissible >= best.admissible and score > best.score:
            best = replace(one, score=score, p_value=found.p_value, adjusted=found.adjusted)
        return -one.score

    first = [0.0]
    start = np.where(logarithmic, np.log(np.maximum(found.shape, 1e-12)), found.shape)
    step = np.where(logarithmic, 0.5, 0.13)
    simplex = np.concatenate([start[None], start + np.diag(step)])
    minimize(evaluate, start, method="Nelder-Mead",
             options={"maxfev": SHAPE_EVALUATIONS, "initial_simplex": simplex, "xatol": 1e-3, "fatol": 1e-2})  # fmt: skip
    return best


def _idle(addition: Addition, deviations: Sequence[float]) -> bool:
    """Whether no amplitude differs from its null value by two standard deviations."""
    return all(
        abs(a - p.null) < 2 * d or a == p.null
        for a, d, p in zip(addition.amplitudes, deviations, addition.effect.amplitudes, strict=True)
    )


def _model(row: Row) -> Model:
    assert row.problem is not None and row.fit is not None
    return row.problem, row.fit


def _without_idle(problem: Problem, state: Fit) -> Model:
    """The fit without effects that a later one has made superfluous."""
    kept = tuple(a for a, d in zip(state.additions, state.errors, strict=True) if not _idle(a, d))
    return (problem, state) if len(kept) == len(state.additions) else effect_fit.settled(problem, state.c, kept)


def _conclude(problem: Problem, rounds: tuple[Round, ...], review: Review) -> Discovery:
    """Verdict from the rounds."""
    first, last = rounds[0], rounds[-1]
    names = tuple(a.effect.name for a in last.fit.additions)
    groups = {r.added: r.group for r in rounds if r.added in names}
    groups.update({name: group for name, group in review.groups.items() if name in names})
    candidates = any(r.score.status == "tested" and r.score.adjusted < ALPHA for r in last.rows)
    noisy = not problem.noise_is_known or (last.fit.p_value > GLOBAL and last.predicted_p > GLOBAL)
    if not names:
        verdict = "significant, not explained" if candidates or not noisy else "nothing significant"
        return Discovery(problem, rounds, verdict, (), (), {})
    clean = noisy and not candidates
    gains = review.gains or dict.fromkeys(names, first.fit.free_loss - last.fit.free_loss)
    major = tuple(n for n in names if clean or n in worth_a_name(last.fit.additions, gains))
    explained = 0 < len(major) <= NAMED and (clean or _small(first, last))
    named = major if explained else ()
    verdict = "explained" if explained else "significant, not explained"
    return Discovery(problem, rounds, verdict, named, tuple(n for n in names if n not in named), groups)


def worth_a_name(additions: Additions, gains: dict[str, float]) -> tuple[str, ...]:
    """Effects that explain more than any other may leave. gains: rise of the misfit without each, where it was found."""
    left = max(MINOR[a.effect.truncated] * gains.get(a.effect.name, 0.0) for a in additions)
    return tuple(a.effect.name for a in additions if gains.get(a.effect.name, np.inf) >= left)


def _small(first: Round, last: Round) -> bool:
    """Whether what is left, fitted and held out, is a small part of what was explained.

    Each test of what is left is compared with the largest fall of any of them: some see little of an effect and yet all of what
    its formula leaves.
    """
    before, after = ([m for m in (*r.fit.misfits, r.predicted) if m is not None] for r in (first, last))
    explained = max(b[0] - a[0] for b, a in zip(before, after, strict=True))
    return all(a[0] - a[1] <= REST * max(explained, 0.0) or stats.chi2.sf(a[0], max(a[1], 1)) >= GLOBAL for a in after)
