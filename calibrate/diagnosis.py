"""What a model leaves unexplained, and which effect it looks like: fit, score tests, groups.

In: Experiments and the equations used for fitting. Out: `Fit` (base and effects in it), `Score` of every effect.

With whitened residuals r, base columns B (splines of the energy and effects in the model) and the signature S of an
effect, all of unit covariance, the score test (Rao 1948) projects both on the complement of B,

    T = g^T M^-1 g,   g = S'^T r,   M = S'^T S',   amplitude = -M^-1 g,

T is chi-square distributed with as many degrees of freedom as the effect has amplitudes if the effect is absent, and
tells by how much the loss would fall. Shapes are tried on a grid (Davies 1977); the p-value of the whole search comes
from the simulated distribution of its smallest p-value (Westfall and Young 1993).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import lsq_linear

from calibrate import discrepancy, errors, kinematics, noise_model, reduction
from calibrate.basis import DEGREE, SingleBasis, Spline, basis_for, polyconvex
from calibrate.chain import Addition, Additions, Chain
from calibrate.effects import CATALOGUE, Effect, Parameter
from calibrate.equilibrium import Equilibrium, equilibrium
from calibrate.experiment import Experiment
from calibrate.reduction import Assembled
from calibrate.whitening import Whitening, covariances, whitening

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
COLLINEAR = 0.9  # |cos| of signatures that cannot be told apart
ABSORBED = 1e-3  # share of a signature that must be left by the base
DRAWS = 2000  # of the simulated search
PASSES = 12
FOLLOWED = 3  # iterations of a fit in which the estimate of the true displacements follows it
STIFFENING = 0.1  # prior: by how much psi_1 may grow from one spline to the next, over its value at rest
SETTLED = 0.05  # relative change of the base between the last two passes
CONDITION = 1e-8
SPLINES = 24  # of the base
SHAPE_STEP = 1e-3  # of a radian, or of the size of a time, for derivatives by shapes
LEAST = 0.2  # of the information on an amplitude, that noise in its signature leaves
SAMPLES = 2  # of noise, for its part in a signature
HALVINGS = 5  # of a step
RISE = 1.02  # factor by which a step may raise the misfit, as signatures are not its slope exactly
TURNS, NEAR = 2, 0.5  # updates of the weights by a fit; standard deviations between both that are near enough
UNSEEN = 1e-4  # size of a column, relative to the largest, that is not fitted
SLOW_PLACES, SLOW_TIMES = 3, 4  # cosines over each side of a specimen, over its increments
DOUBTFUL = 0.1  # variance of a discrepancy over that of noise, from which a direction says nothing of noise


@dataclass(frozen=True, eq=False)
class Part:
    """One Experiment in a diagnosis: its chain, weights, and the equations (t, 2 v) used for fitting and held out.

    shift (t, 2 v), N: see `Chain.noise_shift`. common: see `discrepancy.sources`.
    """

    chain: Chain
    assembled: Assembled = field(repr=False)
    train: Whitening
    held: Whitening
    shift: Array = field(repr=False)
    common: Array | None = field(repr=False)

    def residual(self, c: Array, additions: Additions = ()) -> Array:
        """Residual (t, 2 v), N, without the mean that noise brings into it."""
        return self.chain.with_additions(c, additions) - self.shift

    def carried(self, additions: Additions) -> Additions:
        """Those that hold for this experiment: of the material, and all where it took part in the fit."""
        return additions if self.train.size else tuple(a for a in additions if a.effect.of_material)

    @property
    def experiment(self) -> Experiment:
        return self.chain.system.experiment

    @property
    def system(self) -> Equilibrium:
        return self.chain.system

    @cached_property
    def linear(self) -> Equilibrium:
        """The same equations with linear triangles."""
        return Equilibrium(self.experiment, self.system.fields, linear=True)


@dataclass(frozen=True, eq=False)
class Problem:
    """Experiments with weights. parts: all; those without training rows are held out.

    cone (n, k): the base models are non-negative sums of its columns. prior (r, k), 1 / MPa: a weak normal prior on the
    changes of psi_1, without which the last splines take up whatever is wrong and ruin the extrapolation. parametric: effects
    are tested and fitted beside the functions of the cone alone (a neo-Hookean base, for one), not beside all splines. An
    effect that any energy of I1 could imitate is found only so, and only if the base is right. c (n,), rough: the base
    and the effects of second derivatives that the weights belong to, see `roughened`.
    """

    parts: tuple[Part, ...]
    basis: SingleBasis
    cone: Array
    prior: Array
    noise_is_known: bool
    with_discrepancy: bool
    c: Array = field(repr=False)
    parametric: bool = False
    rough: Additions = ()

    @property
    def trained(self) -> tuple[Part, ...]:
        return tuple(part for part in self.parts if part.train.size)

    def white(self, values: Sequence[Array]) -> Array:
        """Whitened training rows (..., N) of one array (..., t, 2 v) for each trained part."""
        return np.concatenate([part.train(v) for part, v in zip(self.trained, values, strict=True)], axis=-1)


@dataclass(frozen=True, eq=False)
class Fit:
    """Base and effects fitted together.

    c (n,): spline coefficients. loss: |whitened residual|^2 of `n_rows` training equations. free_loss: of the part that
    neither the base (all its splines) nor the amplitudes could change, with `degrees` of freedom. clear: the same, of the
    part that a discretisation error could not change either. smooth: of the part that varies slowly over specimen and
    increments, see `slow`. additions: effects; errors: a standard deviation for each amplitude. columns (N, k): orthonormal,
    what the fit can adjust. log_determinant: of the covariance that the weights come from.
    """

    c: Array
    additions: Additions
    loss: float
    free_loss: float
    degrees: int
    clear: tuple[float, int]
    smooth: tuple[float, int]
    n_rows: int
    columns: Array = field(repr=False)
    residual: Array = field(repr=False)
    chains: tuple[Chain, ...] = field(repr=False)
    log_determinant: float
    errors: tuple[tuple[float, ...], ...] = ()

    @property
    def reduced_chi_square(self) -> float:
        """Of what no I1 energy, convex or not, can absorb."""
        return self.free_loss / max(self.degrees, 1)

    @property
    def p_value(self) -> float:
        """Probability of a misfit as large, if there is nothing but noise, from all three (Bonferroni).

        The weights allow for discretisation errors of a size that they seldom have, so that `free_loss` alone is too
        forgiving; an effect that acts as these errors do is not seen in `clear`; a small one that acts everywhere alike
        is lost in the noise of many equations, but not in `smooth`.
        """
        return min(1.0, 3 * min(float(stats.chi2.sf(loss, max(n, 1))) for loss, n in self.misfits))

    @property
    def misfits(self) -> tuple[tuple[float, int], ...]:
        """Chi-square and degrees of freedom of the three tests of `p_value`."""
        return (self.free_loss, self.degrees), self.clear, self.smooth


@dataclass(frozen=True, eq=False)
class Score:
    """One effect's test. status: 'tested', 'gauge', 'not testable' or 'absorbed'; why: in words, where not tested.

    score: T over the dispersion, with `degrees`; p_value: of the effect; adjusted: of the whole search. share: of the
    misfit that it would explain. absorbed: share of the signature that the base takes. amplitudes, errors: with null
    value 0 of the difference. admissible: within bounds. direction (N,): unit vector of the fitted change.
    """

    effect: Effect
    status: str
    why: str = ""
    score: float = 0.0
    degrees: int = 0
    p_value: float = 1.0
    adjusted: float = 1.0
    share: float = 0.0
    absorbed: float = 1.0
    amplitudes: tuple[float, ...] = ()
    errors: tuple[float, ...] = ()
    shape: tuple[float, ...] = ()
    admissible: bool = True
    direction: Array | None = field(default=None, repr=False)

    @property
    def evidence(self) -> float:
        """Improvement minus the price of its amplitudes and shapes (Schwarz 1978), for ranking."""
        n = 1000 if self.direction is None else len(self.direction)
        price = (self.degrees + len(self.shape)) * float(np.log(n))
        return self.score - price if self.status == "tested" else -np.inf


Rows = Callable[[Equilibrium], Mask]


def all_rows(system: Equilibrium) -> Mask:
    """Every equation with a known right-hand side (t, 2 v)."""
    return np.isfinite(system.loads)


def prepare(
    experiments: Sequence[Experiment],
    train: Sequence[Rows],
    spacing: float | None = None,
    with_discrepancy: bool = True,
    base: str = "positive",
) -> tuple[Problem, Fit]:
    """Problem and base fit. train: for each experiment, the equations to be used; the others are held out.

    base: 'positive' (psi_1 >= 0), 'convex' (psi_1 does not fall with I1 either, as in a PANN; rubber that softens before
    it stiffens then shows up in the errors of the base, not as an effect) or 'neo-Hooke' (psi_1 constant; effects are tested
    beside it alone, see `Problem`).

    Weights follow the base in `PASSES` passes. Raises `FitError` when it does not settle.
    """
    systems = [equilibrium(e, spacing) for e in experiments]
    masks = [function(system) & all_rows(system) for function, system in zip(train, systems, strict=True)]
    used = [i for i, mask in enumerate(masks) if mask.any()]
    if not used:
        raise errors.ConfigError("every equation is held out; leave some to fit")
    basis = basis_for("I1", np.concatenate([s.deformation_gradients.reshape(-1, 2, 2) for s in systems]))
    assert isinstance(basis, SingleBasis)
    assembled = [reduction.assemble(system, basis) for system in systems]
    c = first_guess([assembled[i] for i in used])
    chains = [Chain(system, basis) for system in systems]
    parametric = base == "neo-Hooke"
    cone = base_cone(basis, base, max(trained_top(systems[i], masks[i]) for i in used), 1 if parametric else SPLINES)
    previous = c
    prior, spread = smoothness(base, cone.shape[1]) / (STIFFENING * float(c.max())), 1.0
    for count in range(PASSES):
        whites = [whitening(covariances(assembled[i], c), masks[i]) for i in used]
        A = np.concatenate([w(np.moveaxis(np.array(assembled[i].matrices), -1, 0)).T
                            for w, i in zip(whites, used, strict=True)])  # fmt: skip
        shifts = [chains[i].noise_shift(c, assembled[i].noise_factor) for i in used]
        d = np.concatenate([w(np.nan_to_num(systems[i].loads) + shift)
                            for w, i, shift in zip(whites, used, shifts, strict=True)])  # fmt: skip
        quadratic = reduction.Quadratic(basis, A.T @ A, A.T @ d, float(d @ d), len(d))
        weights = bounded(A @ cone, d, np.zeros(cone.shape[1]), np.full(cone.shape[1], np.inf), prior * np.sqrt(spread))
        previous, c = c, cone @ weights
        spread = max(1.0, quadratic.loss(c) / len(d))
        if not c.any():
            raise errors.FitError("the data do not constrain the material: forces or displacements are all noise")
        c = quadratic.stiffness_factor(c) * c
        if count > 1:  # weights and fit may answer each other in turn
            c = 0.5 * (previous + c)
        change = float(np.linalg.norm(A @ (c - previous)) / np.linalg.norm(A @ c))
        if change < 0.2 * SETTLED:
            break
    if not change < SETTLED:
        raise errors.FitError(
            f"the base model has not converged (its forces still change by {change:.1%} when the weights are updated); "
            "a diagnosis of it would be one of the fit: check forces, units and free edges, or give a larger --spacing"
        )
    known = [all_rows(system) for system in systems]
    parts = [
        weighted(chain, assembly, basis, c, mask, full & ~mask, with_discrepancy)
        for chain, assembly, mask, full in zip(chains, assembled, masks, known, strict=True)
    ]
    noise_is_known = all(a.noise_is_known for a in assembled)
    problem = Problem(tuple(parts), basis, cone, prior, noise_is_known, with_discrepancy, c, parametric)
    return problem, refit(problem, c, ())


def weighted(
    chain: Chain,
    assembled: Assembled,
    basis: SingleBasis,
    c: Array,
    train: Mask,
    held: Mask,
    with_discrepancy: bool,
) -> Part:
    """One Experiment with the weights that belong to the material with coefficients c (n,)."""
    common = discrepancy.sources(chain.system, basis, c) if with_discrepancy else None
    noise = covariances(assembled, c)
    shift = chain.noise_shift(c, assembled.noise_factor)
    return Part(chain, assembled, whitening(noise, train, common), whitening(noise, held, common), shift, common)


def _reweighted(part: Part, c: Array, rough: Additions) -> Part:
    """The same with the noise that effects `rough` amplify."""
    if rough and part.train.size:
        spreads = part.chain.spread_of_noise(c, rough, part.assembled.noise_factor)
        pairs = zip(spreads, part.system.loads, strict=True)
        noise = [noise_model.covariance_of(part.system, spread, load, part.assembled.noise) for spread, load in pairs]
    else:
        noise = covariances(part.assembled, c)
    train, held = (whitening(noise, w.rows, part.common) for w in (part.train, part.held))
    return replace(part, train=train, held=held)


def reweighted(problem: Problem, fit: Fit) -> Problem:
    """The same equations with the weights of a fit with effects: those of its base, as stiff as base and effects are."""
    load = loads(problem, fit.additions)
    whole = residual(problem, fit.c, fit.additions) + load
    base = residual(problem, fit.c, ()) + loads(problem)
    c = fit.c * float(load @ whole) / float(load @ base)
    parts = [
        weighted(p.chain, p.assembled, problem.basis, c, p.train.rows, p.held.rows, problem.with_discrepancy)
        for p in problem.parts
    ]
    return roughened(replace(problem, parts=tuple(parts), c=c, rough=()), fit.additions)


def roughened(problem: Problem, additions: Additions) -> Problem:
    """The same equations and base with the weights of a model with these effects.

    Those that take second derivatives of the displacements amplify their noise: with weights that do not know it, the
    misfit of the true model is larger than that of none.
    """
    rough = _rough(problem, additions)
    if rough == problem.rough:
        return problem
    return replace(problem, parts=tuple(_reweighted(p, problem.c, rough) for p in problem.parts), rough=rough)


def _rough(problem: Problem, additions: Additions) -> Additions:
    if not problem.noise_is_known:
        return ()
    return tuple(
        a
        for a in additions
        if a.effect.rough and any(v != p.null for v, p in zip(a.amplitudes, a.effect.amplitudes, strict=True))
    )


def first_guess(assembled: Sequence[Assembled]) -> Array:
    """Neo-Hooke with the mean of the moduli that fit each experiment's forces."""
    return np.mean([a.first_guess() for a in assembled], axis=0)


def trained_top(system: Equilibrium, mask: Mask) -> float:
    """Largest I1 - 3 in the increments used for fitting."""
    F = system.deformation_gradients[mask.any(axis=1)]
    return float(polyconvex(F)[0][..., 0].max())


def base_cone(basis: SingleBasis, base: str, top: float, n: int = SPLINES) -> Array:
    """(n_functions, n): psi_1 of which the base models are non-negative sums; constant beyond I1 - 3 = top.

    Cubic splines in sqrt(I1 - 3); fewer than four functions are straight lines between n points, and one is neo-Hooke.
    """
    x = basis.site_inputs[:, basis.k]
    along = np.sqrt(np.minimum(x / top, 1.0))
    values = Spline(n).matrix(along) if n > DEGREE else _hats(along, n)
    if base == "convex":
        values = np.cumsum(values[:, ::-1], axis=1)[:, ::-1]
    sites = np.zeros((n, len(x), 2))
    sites[:, :, basis.k] = values.T
    return basis.interpolation @ sites.reshape(n, -1).T


def _hats(x: Array, n: int) -> Array:
    """(m, n): straight lines between n even points of [0, 1]; 1 everywhere where there is but one."""
    if n == 1:
        return np.ones((len(x), 1))
    return np.stack([np.interp(x, np.linspace(0, 1, n), row) for row in np.eye(n)], axis=1)


def smoothness(base: str, n: int) -> Array:
    """(n - 1, n): weights to the changes of psi_1 from one spline to the next."""
    return np.eye(n)[1:] if base == "convex" else np.eye(n)[1:] - np.eye(n)[:-1]


def denoised(problem: Problem, c: Array, additions: Additions, r: Array, dispersion: float) -> list[Chain]:
    """The trained chains at displacements without the noise that shows in the whitened residual r (N,).

    Signatures and residuals of noisy displacements hold the same noise, which biases their product. The maximum of the
    likelihood, whose covariance C follows the parameters, has no such bias; its derivative by a parameter is S^T C^-1 r
    with the signature S taken at u - Sigma K^T C^-1 r, the best linear estimate of the true displacements (K: tangent,
    Sigma: covariance of the noise). dispersion: only this part of the squared residual is taken for noise.
    """
    pairs = zip(problem.trained, visible_noise(problem, c, additions, r), strict=True)
    return [part.chain.disturbed(-noise / dispersion) for part, noise in pairs]


def visible_noise(problem: Problem, c: Array, additions: Additions, r: Array) -> list[Array]:
    """Sigma K^T C^-1 r (t, n, 2), mm, of each trained part; K knows of effects only those of second derivatives."""
    found, start = [], 0
    for part in problem.trained:
        forces = part.train.adjoint(r[start : start + part.train.size])
        start += part.train.size
        factor = part.assembled.noise_factor
        noise = np.moveaxis(part.chain.pulled_back(c, _rough(problem, additions), forces), 1, 0)
        flat = factor @ (factor.T @ noise.reshape(len(noise), -1))
        found.append(np.moveaxis(flat.reshape(noise.shape), 0, 1))
    return found


def hidden_noise(problem: Problem, chains: Sequence[Chain], c: Array, additions: Additions) -> list[list[Array]]:
    """Samples of noise (t, n, 2), mm, of each trained part, without what would show in the residual."""
    rough, samples = _rough(problem, additions), []
    rng = np.random.default_rng(0)
    for _ in range(SAMPLES):
        noise = [
            np.asarray(noise_model.sample(part.assembled.noise_factor, rng, part.experiment.n_increments))
            for part in problem.trained
        ]
        moved = [chain.disturbed(z) for chain, z in zip(chains, noise, strict=True)]
        change = [m.with_additions(c, rough) - k.with_additions(c, rough) for m, k in zip(moved, chains, strict=True)]
        seen = visible_noise(problem, c, rough, problem.white(change))
        samples.append([z - s for z, s in zip(noise, seen, strict=True)])
    return samples


def excess(
    problem: Problem,
    chains: Sequence[Chain],
    c: Array,
    additions: Additions,
    U: Array,
    scale: Array,
    S: Array,
    hidden: list[list[Array]],
) -> Array:
    """(p, p): what `hidden_noise` adds to M, by the signature S (N, p), times scale (p,), of the last addition beside U.

    The noise that shows in the residual has been taken out, that which does not is independent of it: the score has the
    variance M, but its slope is M less this, so that the amplitude is -(M - excess)^-1 g.
    """
    total = np.zeros((len(scale), len(scale)))
    for sample in hidden:
        moved = [chain.disturbed(z) for chain, z in zip(chains, sample, strict=True)]
        change = signature(problem, moved, c, additions) * scale - S
        change = change - U @ (U.T @ change)
        total += change.T @ change / len(hidden)
    return total


def less(M: Array, N: Array) -> Array:
    """M - N (p, p), no direction of M being left less than `LEAST` of itself."""
    values, vectors = np.linalg.eigh(M)
    keep = values > CONDITION * values.max()
    root = vectors[:, keep] * np.sqrt(values[keep])
    inverse = vectors[:, keep] / np.sqrt(values[keep])
    shares, turn = np.linalg.eigh(inverse.T @ N @ inverse)
    left = root @ turn
    return M - (left * np.minimum(shares, 1 - LEAST)) @ left.T


def base_columns(problem: Problem, chains: Sequence[Chain]) -> Array:
    """Whitened d residual / d coefficients (N, n) of the base alone, also beside effects: the residual is exact, so that
    the amplitudes found are those at which it is orthogonal to these columns and to the signatures."""
    columns = []
    for chain in chains:
        F = kinematics.deformation_gradients(chain.system.gradient, np.asarray(chain.data.u))
        columns.append(np.moveaxis(np.array([chain.system.matrix(problem.basis, f) for f in F]), -1, 0))
    return problem.white(columns).T


def signature(problem: Problem, chains: Sequence[Chain], c: Array, additions: Additions) -> Array:
    """Whitened derivative (N, p) by the amplitudes of the last addition."""
    return problem.white([chain.derivative(c, additions) for chain in chains]).T


def residual(problem: Problem, c: Array, additions: Additions) -> Array:
    """Whitened training residual (N,)."""
    return problem.white([part.residual(c, additions) for part in problem.trained])


def loss(problem: Problem, c: Array, additions: Additions) -> float:
    """|whitened training residual|^2."""
    r = residual(problem, c, additions)
    return float(r @ r)


def orthonormal(columns: Array) -> Array:
    """Orthonormal basis of the span of columns (N, k), directions without information dropped."""
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 1e-9 * size.max()] / size[size > 1e-9 * size.max()]
    U, R = np.linalg.qr(columns)
    left, s, _ = np.linalg.svd(R)
    return U @ left[:, s > 1e-5 * s[0]]


@dataclass(frozen=True)
class Variables:
    """Amplitudes and shapes of additions as one vector of numbers of order 1, and its bounds."""

    additions: Additions

    @property
    def parameters(self) -> list[tuple[Parameter, float]]:
        return [
            pair
            for a in self.additions
            for pair in (
                *zip(a.effect.amplitudes, a.amplitudes, strict=True),
                *zip(a.effect.shapes, a.shape, strict=True),
            )
        ]

    @property
    def sizes(self) -> list[int]:
        return [len(a.amplitudes) + len(a.shape) for a in self.additions]

    @property
    def is_shape(self) -> NDArray[np.bool_]:
        return np.array([k for a in self.additions for k in [False] * len(a.amplitudes) + [True] * len(a.shape)], bool)

    @property
    def scale(self) -> Array:
        """Of amplitudes a typical one, of shapes their size (times) or a tenth of a radian (angles)."""
        sizes = []
        for (p, value), shape in zip(self.parameters, self.is_shape, strict=True):
            sizes.append((0.1 if p.unit == "rad" else max(abs(value), 1e-12)) if shape else p.typical)
        return np.array(sizes)

    @property
    def values(self) -> Array:
        return np.array([value for _, value in self.parameters])

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper; shapes move by no more than half their size, or a fifth of a radian, at a time."""
        lower, upper = (np.array([getattr(p, end) for p, _ in self.parameters]) for end in ("lower", "upper"))
        reach = np.where([p.unit == "rad" for p, _ in self.parameters], 2.0, 0.5) * self.scale
        lower = np.where(self.is_shape, np.maximum(lower, self.values - reach), lower)
        upper = np.where(self.is_shape, np.minimum(upper, self.values + reach), upper)
        return lower, np.maximum(upper, lower)

    def at(self, values: Array) -> Additions:
        """The additions with other values."""
        result = []
        for a, part in zip(self.additions, np.split(values, np.cumsum(self.sizes)[:-1]), strict=True):
            n = len(a.amplitudes)
            result.append(replace(a, amplitudes=tuple(map(float, part[:n])), shape=tuple(map(float, part[n:]))))
        return tuple(result)


def refit(problem: Problem, c: Array, additions: Additions, iterations: int = 6) -> Fit:
    """Base, amplitudes and shapes together, by Gauss-Newton on the exact residual.

    Amplitudes and shapes, in their bounds, are fitted beside all splines, so that they do not depend on what the base
    models can do; the base then follows in its cone. Steps that raise the misfit are halved.
    """
    cone, n = problem.cone, problem.cone.shape[1]
    w = np.maximum(np.linalg.lstsq(cone, c, rcond=None)[0], 0.0)
    r = residual(problem, cone @ w, additions)
    for k in range(iterations):
        c = cone @ w
        dispersion = max(1.0, float(r @ r) / len(r))
        if k < FOLLOWED or problem.rough:
            chains = denoised(problem, c, additions, r, dispersion)
            G = base_columns(problem, chains)
            A = G @ cone
            span = A if problem.parametric else G
            base = orthonormal(span)
        S, change, variables = np.zeros((len(r), 0)), np.zeros(0), Variables(additions)
        left = S
        if additions:
            scale = variables.scale
            S = signatures(problem, chains, c, additions) * scale
            left = S - base @ (base.T @ S)
            lower, upper = (end / scale for end in variables.bounds)
            x = np.clip(variables.values / scale, lower, upper)
            change = bounded(left, left @ x - (r - base @ (base.T @ r)), lower, upper) - x
            change[~S.any(axis=0)] = 0.0  # shapes that mean something at the null value only
        new = bounded(A, A @ w - r - S @ change, np.zeros(n), np.full(n, np.inf), problem.prior * np.sqrt(dispersion))
        step = np.linalg.norm(A @ (new - w)) + np.linalg.norm(S @ change)
        before = float(r @ r)
        for halving in range(HALVINGS):
            part = 0.5**halving
            tried = variables.at((x + part * change) * scale) if additions else ()
            moved = w + part * (new - w)
            r = residual(problem, cone @ moved, tried)
            if float(r @ r) <= RISE * before + len(change) + n:  # False for what is not finite
                break
        w, additions = moved, tried
        if step < 1e-2 * np.sqrt(dispersion):
            break
    c = cone @ w
    c = (1 + (1 - 1 / dispersion) * (stiffness_factor(problem, c, additions) - 1)) * c
    r = residual(problem, c, additions)
    U = orthonormal(np.concatenate([span, S], axis=1))
    free, degrees = beyond(r, U)
    clear = beyond(r, np.concatenate([U, doubtful([part.train for part in problem.trained])], axis=1))
    deviations: list[tuple[float, ...]] = []
    if additions:
        M, start = left.T @ left, 0
        N = np.zeros_like(M)
        for one, size in zip(additions, variables.sizes, strict=True):
            own = slice(start, start + len(one.amplitudes))
            if one.effect.rough and problem.noise_is_known:
                others = tuple(a for a in additions if a is not one)
                hidden = hidden_noise(problem, chains, c, additions)
                N[own, own] = excess(problem, chains, c, (*others, one), base, scale[own], S[:, own], hidden)
            start += size
        values, vectors = np.linalg.eigh(less(M, N))
        inverse = (vectors / np.maximum(values, CONDITION * values.max())) @ vectors.T
        spread = np.sqrt(np.diag(inverse @ M @ inverse)) * scale
        spread = spread * np.sqrt(max(1.0, free / max(degrees, 1)))
        wrong = recovered(problem, c)
        shift = bounded(
            left, wrong - base @ (base.T @ wrong), np.full(len(scale), -np.inf), np.full(len(scale), np.inf)
        )
        spread = np.hypot(spread, shift * scale)
        for a, part in zip(additions, np.split(spread, np.cumsum(variables.sizes)[:-1]), strict=True):
            deviations.append(tuple(map(float, part[: len(a.amplitudes)])))
    generic = slow(problem)
    generic = orthonormal(generic - U @ (U.T @ generic))
    smooth = float(((generic.T @ r) ** 2).sum()), generic.shape[1]
    determinant = sum(part.train.log_determinant for part in problem.trained)
    return Fit(
        c,
        additions,
        float(r @ r),
        free,
        degrees,
        clear,
        smooth,
        len(r),
        U,
        r,
        tuple(chains),
        determinant,
        tuple(deviations),
    )


def settled(problem: Problem, c: Array, additions: Additions, iterations: int = 6) -> tuple[Problem, Fit]:
    """The fit with weights that know the noise of its second derivatives; as `refit` where no effect takes any.

    Weights and amplitudes answer each other in turn: the next weights belong to the mean of both.
    """
    problem = roughened(problem, additions)
    fit = refit(problem, c, additions, iterations)
    for _ in range(TURNS):
        found = {a.effect.name: (a, d) for a, d in zip(fit.additions, fit.errors, strict=True)}
        far = [
            any(abs(x - y) > NEAR * d for x, y, d in zip(old.amplitudes, found[old.effect.name][0].amplitudes,
                                                         found[old.effect.name][1], strict=True))
            for old in problem.rough
        ]  # fmt: skip
        if not any(far):
            break
        before = {a.effect.name: a.amplitudes for a in problem.rough}
        middle = tuple(
            replace(a, amplitudes=tuple(0.5 * (x + y) for x, y in
                                        zip(before.get(a.effect.name, a.amplitudes), a.amplitudes, strict=True)))
            for a in fit.additions
        )  # fmt: skip
        problem = roughened(problem, middle)
        fit = refit(problem, fit.c, fit.additions, iterations)
    return problem, fit


def recovered(problem: Problem, c: Array) -> Array:
    """Whitened change (N,) of the residual when the triangles are taken for linear again.

    A standard deviation of what the recovered kinematics still miss. Its effect on an amplitude is added to that of
    noise, because errors of neighbouring edges are less independent than the weights assume.
    """
    changes = []
    for part in problem.trained:
        work = [
            np.array([system.matrix(problem.basis, F) @ c for F in system.deformation_gradients])
            for system in (part.linear, part.system)
        ]
        changes.append(work[0] - work[1])
    return problem.white(changes)


def slow(problem: Problem) -> Array:
    """Whitened disturbances (N, k) of no particular kind that vary slowly over a specimen and its increments.

    Forces on every loaded boundary, and body forces as cosines over the specimen; both as cosines over the increments.
    """
    blocks = []
    for part in problem.trained:
        system, points = part.system, part.experiment.points
        nodal = np.bincount(part.experiment.triangles.ravel(), np.repeat(system.areas / 3, 3), len(points))
        size = np.asarray(system.fields.values.T @ nodal).ravel()
        total = np.asarray(system.fields.values.sum(axis=0)).ravel()
        x = (np.asarray(system.fields.values.T @ points) / total[:, None] - points.min(axis=0)) / np.ptp(points, axis=0)
        k = np.arange(SLOW_PLACES)
        cosines = [np.cos(np.pi * np.multiply.outer(x[:, i], k)) for i in range(2)]
        places = np.einsum("v,vk,vl->klv", size, *cosines).reshape(-1, len(size))
        loaded = np.array([system.fields.boundary == b for b in range(len(part.experiment.loaded))], float)
        places = np.concatenate([places, loaded])
        t = (np.arange(len(system.loads)) + 0.5) / len(system.loads)
        times = np.cos(np.pi * np.multiply.outer(np.arange(min(SLOW_TIMES, len(t))), t))
        values = np.einsum("st,ij,pv->psijtv", times, np.eye(2), places)
        values = np.moveaxis(values, -2, -3).reshape(-1, len(t), 2 * len(size))
        blocks.append(part.train(values).T)
    return scipy.linalg.block_diag(*blocks)


def doubtful(weights: Sequence[Whitening]) -> Array:
    """Directions (N, k) in which a discretisation error may be as large as noise, for rows of several parts."""
    blocks = [w.U[:, w.shrink < 1 / np.sqrt(1 + DOUBTFUL) - 1] for w in weights]
    return scipy.linalg.block_diag(*blocks)


def beyond(r: Array, columns: Array) -> tuple[float, int]:
    """|r|^2 of the part of r (N,) that no combination of columns (N, k) changes, and its degrees of freedom."""
    Q = orthonormal(columns) if columns.size else columns
    free = r - Q @ (Q.T @ r)
    return float(free @ free), len(r) - Q.shape[1]


def predictive(problem: Problem, fit: Fit) -> tuple[float, int] | None:
    """How much |r|^2 rises beyond the noise when the equations held out are fitted too, and for how many of them.

    Chi-square distributed with as many degrees of freedom if the model predicts them within noise, the uncertainty of
    its parameters included (Chow 1960). Coefficients that only the equations held out see are free. None: nothing is
    held out.
    """
    used = [part for part in problem.parts if part.held.size]
    if not used:
        return None
    parts = [*problem.trained, *(part for part in used if not part.train.size)]
    columns, errors_ = [], []
    for part in parts:
        own = fit.additions if part.train.size else tuple(a for a in fit.additions if a.effect.of_material)
        F = part.system.deformation_gradients
        G = np.moveaxis(np.array([part.system.matrix(problem.basis, f) for f in F]), -1, 0)
        S = [np.zeros((0, *G.shape[1:]))]
        for addition in fit.additions:
            n = len(addition.amplitudes)
            if addition in own:
                S.append(part.chain.derivative(fit.c, (*(a for a in own if a is not addition), addition)))
            else:
                S.append(np.zeros((n, *G.shape[1:])))
        columns.append(np.concatenate([G, *S]))
        errors_.append(part.residual(fit.c, own))
    train = [(k, part) for k, part in enumerate(parts) if part.train.size]
    held = [(k, part) for k, part in enumerate(parts) if part.held.size]
    A = np.concatenate([part.train(columns[k]).T for k, part in train])
    B = np.concatenate([part.held(columns[k]).T for k, part in held])
    r = np.concatenate([part.train(errors_[k]) for k, part in train])
    s = np.concatenate([part.held(errors_[k]) for k, part in held])
    doubt = doubtful([part.train for _, part in train]), doubtful([part.held for _, part in held])
    before, n_before = beyond(r, np.concatenate([A, doubt[0]], axis=1))
    both = np.concatenate([np.concatenate([A, B]), scipy.linalg.block_diag(*doubt)], axis=1)
    after, n_after = beyond(np.concatenate([r, s]), both)
    return max(after - before, 0.0), max(n_after - n_before, 0)


def signatures(problem: Problem, chains: Sequence[Chain], c: Array, additions: Additions) -> Array:
    """Whitened derivatives (N, k) by all amplitudes and shapes, in the order of `Variables`."""
    columns = []
    for i, addition in enumerate(additions):
        others = additions[:i] + additions[i + 1 :]
        columns.append(signature(problem, chains, c, (*others, addition)))
        for j, value in enumerate(addition.shape):
            step = SHAPE_STEP * (1.0 if addition.effect.shapes[j].unit == "rad" else max(abs(value), 1e-12))
            ends = []
            for sign in (1, -1):
                shape = (*addition.shape[:j], value + sign * step, *addition.shape[j + 1 :])
                twin = (*additions[:i], replace(addition, shape=shape), *additions[i + 1 :])
                ends.append(problem.white([chain.with_additions(c, twin) for chain in chains]))
            columns.append(((ends[0] - ends[1]) / (2 * step))[:, None])
    return np.concatenate(columns, axis=1)


def loads(problem: Problem, additions: Additions = ()) -> Array:
    """Whitened right-hand side (N,)."""
    return problem.white([part.chain.external(additions) + part.shift for part in problem.trained])


def stiffness_factor(problem: Problem, c: Array, additions: Additions) -> float:
    """Factor on the stiffness when the noise covariance follows it, see `Quadratic.stiffness_factor`."""
    load = loads(problem, additions)
    internal = residual(problem, c, additions) + load
    return float(load @ load / (load @ internal))


def bounded(A: Array, target: Array, lower: Array, upper: Array, prior: Array | None = None) -> Array:
    """argmin |A x - target|^2 + |prior x|^2 in bounds; columns scaled, reduced to their own number of rows."""
    if prior is not None:
        A, target = np.concatenate([A, prior]), np.concatenate([target, np.zeros(len(prior))])
    scale = np.linalg.norm(A, axis=0)
    seen = scale > UNSEEN * scale.max()  # what the data hardly see stays at its bound, or at zero
    if not seen.all():
        result = np.clip(np.zeros(len(scale)), lower, upper)
        result[seen] = bounded(A[:, seen], target, lower[seen], upper[seen])
        return result
    Q, R = np.linalg.qr(A / scale)
    ridge = 1e-9 * np.linalg.norm(R) * np.eye(R.shape[1])
    found = lsq_linear(
        np.concatenate([R, ridge]),
        np.concatenate([Q.T @ target, np.zeros(R.shape[1])]),
        (lower * scale, upper * scale),
        method="bvls",
        max_iter=400,
    )
    return np.clip(found.x / scale, lower, upper)


def score(problem: Problem, state: Fit, effects: Sequence[Effect] = CATALOGUE, seed: int = 0) -> list[Score]:
    """Test every effect that is not in the model yet; best first, those that could not be tested last."""
    present = {a.effect.name for a in state.additions}
    U, r = state.columns, state.residual
    r = r - U @ (U.T @ r)
    found: list[tuple[Score, Array]] = []
    skipped = []
    hidden = hidden_noise(problem, state.chains, state.c, state.additions) if problem.noise_is_known else []
    for effect in effects:
        if effect.name in present:
            continue
        why = untestable(problem, effect)
        if why:
            skipped.append(why)
            continue
        result = examine(problem, state, effect, U, r, hidden)
        if result[0].status == "tested":
            found.append(result)
        else:
            skipped.append(result[0])
    if not found:
        return skipped
    everything = np.concatenate([Q for _, Q in found], axis=1)
    both = orthonormal(everything)
    rest = r - both @ (both.T @ r)
    dispersion = max(1.0, float(rest @ rest) / max(len(r) - U.shape[1] - both.shape[1], 1))
    tested = adjust([one for one, _ in found], [Q for _, Q in found], dispersion, seed)
    tested.sort(key=lambda s: -s.evidence)
    return tested + skipped


def untestable(problem: Problem, effect: Effect) -> Score | None:
    """Why an effect cannot be tested with these data, or None."""
    if effect.gauge:
        return Score(effect, "gauge", f"cannot be told from {effect.gauge}")
    lacking = {effect.missing(part.chain.data) for part in problem.trained} - {None}
    if lacking:
        return Score(effect, "not testable", "needs " + " and ".join(sorted(map(str, lacking))))
    if len(problem.trained) > 1 and not effect.of_material:
        return Score(effect, "not testable", "belongs to one test, not to the material; needs a run on one experiment")
    return None


def examine(
    problem: Problem, state: Fit, effect: Effect, U: Array, r: Array, hidden: list[list[Array]] | None = None
) -> tuple[Score, Array]:
    """Score of one effect over its shapes, and orthonormal signatures (N, k) of all shapes for the simulation.

    hidden: see `hidden_noise`; found here where it is not given.
    """
    null = tuple(p.null for p in effect.amplitudes)
    best: Score | None = None
    blocks, absorbed_most = [], 1.0
    shapes = effect.shape_values(problem.trained[0].chain.data)
    single = len(shapes) == 1
    for shape in shapes:
        one, Q = examine_shape(problem, state, Addition(effect, null, tuple(shape)), U, r, hidden, correct=single)
        absorbed_most = min(absorbed_most, one.absorbed)
        if one.status != "tested":
            continue
        blocks.append(Q)
        if best is None or (one.admissible, one.score) > (best.admissible, best.score):
            best = one
    if best is None:
        return Score(effect, "absorbed", "the base model can do the same", absorbed=absorbed_most), np.zeros(
            (len(r), 0)
        )
    if not single and effect.rough and problem.noise_is_known:
        best = examine_shape(problem, state, Addition(effect, null, best.shape), U, r, hidden)[0]
    p = min(1.0, len(blocks) * float(stats.chi2.sf(best.score, best.degrees)))
    return replace(best, p_value=p), np.concatenate(blocks, axis=1)


def examine_shape(
    problem: Problem,
    state: Fit,
    addition: Addition,
    U: Array,
    r: Array,
    hidden: list[list[Array]] | None = None,
    correct: bool = True,
) -> tuple[Score, Array]:
    """Score of one effect with one shape, and its orthonormal signature (N, p).

    correct: the amplitude of a rough effect for the noise in its signature, which its score does not depend on.
    """
    effect = addition.effect
    typical = np.array([p.typical for p in effect.amplitudes])
    additions = (*state.additions, addition)
    S = signature(problem, state.chains, state.c, additions) * typical
    left = S - U @ (U.T @ S)
    size = np.linalg.norm(S)
    absorbed = 1.0 - np.linalg.norm(left) / max(size, 1e-300)
    if absorbed > 1 - ABSORBED:
        return Score(effect, "absorbed", "the base model can do the same", absorbed=absorbed), left
    g, M = left.T @ r, left.T @ left
    values, vectors = np.linalg.eigh(M)
    keep = values > CONDITION * values.max()
    Q = (left @ vectors[:, keep]) / np.sqrt(values[keep])
    T = float(((vectors[:, keep].T @ g) ** 2 / values[keep]).sum())
    inverse = (vectors[:, keep] / values[keep]) @ vectors[:, keep].T
    if correct and effect.rough and problem.noise_is_known:
        hidden = hidden_noise(problem, state.chains, state.c, state.additions) if hidden is None else hidden
        inverse = np.linalg.inv(less(M, excess(problem, state.chains, state.c, additions, U, typical, S, hidden)))
    a = -inverse @ g
    spread = np.sqrt(np.diag(inverse @ M @ inverse))
    null = np.array([p.null for p in effect.amplitudes])
    amplitudes = null + a * typical
    admissible = all(p.lower <= v <= p.upper for p, v in zip(effect.amplitudes, amplitudes, strict=True))
    if not admissible and len(a) > 1:  # the best within the bounds; its score is less, its price is not
        lower, upper = (np.array([getattr(p, end) for p in effect.amplitudes]) for end in ("lower", "upper"))
        a = bounded(left, -r, (lower - null) / typical, (upper - null) / typical)
        amplitudes, admissible = null + a * typical, True
        T = max(float(-2 * (g @ a) - a @ M @ a), 0.0)
    change = left @ a
    direction = change / max(np.linalg.norm(change), 1e-300)
    return (
        Score(effect, "tested", "", T, int(keep.sum()), 1.0, 1.0, T / max(float(r @ r), 1e-300), absorbed,
              tuple(map(float, amplitudes)), tuple(map(float, spread * typical)), addition.shape, admissible, direction),
        Q,
    )  # fmt: skip


def adjust(scores: list[Score], blocks: list[Array], dispersion: float, seed: int) -> list[Score]:
    """Scores over the dispersion, with p-values of the whole search from simulated noise."""
    Q = np.concatenate(blocks, axis=1)
    values, vectors = np.linalg.eigh(Q.T @ Q)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    draws = np.random.default_rng(seed).standard_normal((DRAWS, root.shape[1])) @ root.T
    smallest = np.ones(DRAWS)
    start = 0
    for one, block in zip(scores, blocks, strict=True):
        size, n_shapes = one.degrees, block.shape[1] // one.degrees
        T = (draws[:, start : start + block.shape[1]].reshape(DRAWS, n_shapes, size) ** 2).sum(axis=2).max(axis=1)
        smallest = np.minimum(smallest, np.minimum(1.0, n_shapes * stats.chi2.sf(T, size)))
        start += block.shape[1]
    result = []
    for one, block in zip(scores, blocks, strict=True):
        n_shapes = block.shape[1] // one.degrees
        score = one.score / dispersion
        p = min(1.0, n_shapes * float(stats.chi2.sf(score, one.degrees)))
        exceeded = int((smallest <= p).sum())
        adjusted = exceeded / DRAWS if exceeded >= 10 else min(len(scores) * p, 10 / DRAWS)
        deviations = tuple(float(e * np.sqrt(dispersion)) for e in one.errors)
        result.append(replace(one, score=score, p_value=p, adjusted=adjusted, errors=deviations))
    return result


def likeness(scores: Sequence[Score]) -> Array:
    """|cos| (k, k) of the fitted changes of tested effects."""
    directions = np.array([s.direction for s in scores])
    return np.abs(directions @ directions.T)
