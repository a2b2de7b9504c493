"""Base and effects fitted together, with weights that follow both.

In: Experiments and the equations used for fitting. Out: `Problem` and `Fit`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy import stats

from calibrate import errors
from calibrate.data.experiment import Experiment
from calibrate.diagnosis import whitened
from calibrate.diagnosis.signature_noise import denoised, excess, hidden_noise
from calibrate.diagnosis.whitened import Problem, Rows
from calibrate.effects import Parameter
from calibrate.effects.chain import Additions, Chain
from calibrate.equations import reduction
from calibrate.equations.basis import PlaneStrainBasis, SingleBasis, basis_for, energy_basis
from calibrate.equations.equilibrium import equilibrium
from calibrate.equations.whitening import covariances, whitening
from calibrate.fitting.least_squares import CONDITION, beyond, bounded, less, orthonormal

Array = NDArray[np.float64]
PASSES = 12
FOLLOWED = 3  # iterations of a fit in which the estimate of the true displacements follows it
STIFFENING = 0.1  # prior: by how much psi_1 may grow from one spline to the next, over its value at rest
SETTLED = 0.05  # relative change of the base between the last two passes
# see `reduction.corrected`: with more noise in the change of volume, p-values in plane strain no longer hold
RELIABLE = 0.9
HALVINGS = 5  # of a step
RISE = 1.02  # factor by which a step may raise the misfit, as signatures are not its slope exactly
TURNS, NEAR = 2, 0.5  # updates of the weights by a fit; standard deviations between both that are near enough


@dataclass(frozen=True, eq=False)
class Fit:
    """Base and effects fitted together.

    c (n,): spline coefficients. loss: |whitened residual|^2 of `n_rows` training equations. free_loss: of the part that
    neither the base (all its splines) nor the amplitudes could change, with `degrees` of freedom. clear: the same, of
    the part that a discretisation error could not change either. smooth: of the part that varies slowly over specimen
    and increments, see `slow`. additions: effects; errors: a standard deviation for each amplitude. columns (N, k):
    orthonormal, what the fit can adjust. residual (N,): whitened. log_determinant: of the covariance that the weights
    come from. last_step: norm of what the last step changed, in standard deviations of an equation; above 1 the fit has
    not converged.
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
    last_step: float = 0.0

    @property
    def converged(self) -> bool:
        """Whether the last step changed no more than one standard deviation of an equation."""
        return self.last_step <= 1

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


@dataclass(frozen=True)
class Variables:
    """Amplitudes and shapes of additions as one vector of numbers of order 1, and its bounds."""

    additions: Additions

    @property
    def parameters(self) -> list[tuple[Parameter, float]]:
        """Every amplitude and shape with its value: of each addition its amplitudes, then its shapes."""
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
        """How many amplitudes and shapes each addition has."""
        return [len(a.amplitudes) + len(a.shape) for a in self.additions]

    @property
    def is_shape(self) -> NDArray[np.bool_]:
        """Which of `parameters` are shapes (k,)."""
        return np.array([k for a in self.additions for k in [False] * len(a.amplitudes) + [True] * len(a.shape)], bool)

    @property
    def scale(self) -> Array:
        """(k,): of amplitudes a typical one, of shapes their size (times) or a tenth of a radian (angles)."""
        sizes = []
        for (p, value), shape in zip(self.parameters, self.is_shape, strict=True):
            sizes.append((0.1 if p.unit == "rad" else max(abs(value), 1e-12)) if shape else p.typical)
        return np.array(sizes)

    @property
    def values(self) -> Array:
        """Values (k,) of `parameters`, each in its unit."""
        return np.array([value for _, value in self.parameters])

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper (k,); shapes move by no more than half their size, or a fifth of a radian, at a time."""
        lower, upper = (np.array([getattr(p, end) for p, _ in self.parameters]) for end in ("lower", "upper"))
        reach = np.where([p.unit == "rad" for p, _ in self.parameters], 2.0, 0.5) * self.scale
        lower = np.where(self.is_shape, np.maximum(lower, self.values - reach), lower)
        upper = np.where(self.is_shape, np.minimum(upper, self.values + reach), upper)
        return lower, np.maximum(upper, lower)

    def at(self, values: Array) -> Additions:
        """The additions with other values (k,)."""
        result = []
        for a, part in zip(self.additions, np.split(values, np.cumsum(self.sizes)[:-1]), strict=True):
            n = len(a.amplitudes)
            result.append(replace(a, amplitudes=tuple(map(float, part[:n])), shape=tuple(map(float, part[n:]))))
        return tuple(result)


def prepare(
    experiments: Sequence[Experiment],
    train: Sequence[Rows],
    spacing: float | None = None,
    with_discrepancy: bool = True,
    base: str = "positive",
) -> tuple[Problem, Fit]:
    """Problem and base fit. train: for each experiment, the equations to be used; the others are held out.

    base: 'positive' (psi_1 >= 0), 'convex' (psi_1 does not fall with I1 either, as in a PANN; rubber that softens
    before it stiffens then shows up in the errors of the base, not as an effect) or 'neo-Hooke' (psi_1 constant;
    effects are tested beside it alone, see `Problem`).

    spacing: of the virtual fields, mm (None: from the noise). Weights follow the base in `PASSES` passes. Raises
    `FitError` when it does not settle, or noise hides what it needs; `ConfigError` where nothing is left to fit, or
    tests in plane stress and in plane strain come together; and the errors of `calibrate.equations.equilibrium.equilibrium`.
    """
    systems = [equilibrium(e, spacing) for e in experiments]
    masks = [function(system) & whitened.all_rows(system) for function, system in zip(train, systems, strict=True)]
    used = [i for i, mask in enumerate(masks) if mask.any()]
    if not used:
        raise errors.ConfigError("every equation is held out; leave some to fit")
    planes = {e.plane for e in experiments}
    if len(planes) > 1:
        raise errors.ConfigError(
            "experiments in plane stress and in plane strain cannot be fitted together; fit one kind"
        )
    F = np.concatenate([s.deformation_gradients.reshape(-1, 2, 2) for s in systems])
    basis = basis_for("I1", F, plane=planes.pop())
    assert isinstance(basis, SingleBasis | PlaneStrainBasis)
    bulk = basis.n_functions - energy_basis(basis).n_functions
    assembled = [reduction.assemble(system, basis) for system in systems]
    c = whitened.first_guess([assembled[i] for i in used])
    chains = [Chain(system, basis) for system in systems]
    parametric = base == "neo-Hooke"
    cone = whitened.base_cone(
        basis,
        base,
        max(whitened.trained_top(systems[i], masks[i]) for i in used),
        1 if parametric else whitened.SPLINES,
    )
    previous = c
    stiffness = float(c[: basis.n_functions - bulk].max())
    prior, spread = whitened.smoothness(base, cone.shape[1] - bulk, bulk) / (STIFFENING * stiffness), 1.0
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
        c = reduction.corrected(
            quadratic, c, previous, [assembled[i] for i in used], [masks[i] for i in used], RELIABLE
        )
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
    known = [whitened.all_rows(system) for system in systems]
    parts = [
        whitened.weighted(chain, assembly, basis, c, mask, full & ~mask, with_discrepancy)
        for chain, assembly, mask, full in zip(chains, assembled, masks, known, strict=True)
    ]
    noise_is_known = all(a.noise_is_known for a in assembled)
    problem = Problem(tuple(parts), basis, cone, prior, noise_is_known, with_discrepancy, c, parametric)
    return problem, refit(problem, c, ())


def _finite(values: Array, additions: Additions, somewhere: bool = False) -> None:
    """Raises `FitError` where values are not finite, or, `somewhere`, all zero: nothing is left of the base."""
    if not np.isfinite(values).all() or (somewhere and not values.any()):
        names = " and ".join(a.effect.name for a in additions) or "no effect"
        raise errors.FitError(f"the fit with {names} ran away; check forces and their signs, and the largest strains")


def refit(problem: Problem, c: Array, additions: Additions, iterations: int = 6) -> Fit:
    """Base, amplitudes and shapes together, by Gauss-Newton on the exact residual; c (n,): where it starts.

    Amplitudes and shapes, in their bounds, are fitted beside all splines, so that they do not depend on what the base
    models can do; the base then follows in its cone. Steps that raise the misfit are halved. Raises `FitError` where a fit runs away.
    """
    cone, n = problem.cone, problem.cone.shape[1]
    w = np.maximum(np.linalg.lstsq(cone, c, rcond=None)[0], 0.0)
    r = whitened.residual(problem, cone @ w, additions)
    for k in range(iterations):
        c = cone @ w
        dispersion = max(1.0, float(r @ r) / len(r))
        if k < FOLLOWED or any(a.effect.rough for a in problem.amplifying):
            chains = denoised(problem, c, additions, r, dispersion)
            G = whitened.base_columns(problem, chains)
            A = G @ cone
            _finite(A, additions)
            span = A if problem.parametric else G
            base = orthonormal(span)
        S, change, variables = np.zeros((len(r), 0)), np.zeros(0), Variables(additions)
        left = S
        if additions:
            scale = variables.scale
            S = whitened.signatures(problem, chains, c, additions) * scale
            left = S - base @ (base.T @ S)
            _finite(left, additions, somewhere=True)
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
            r = whitened.residual(problem, cone @ moved, tried)
            if float(r @ r) <= RISE * before + len(change) + n:  # False for what is not finite
                break
        w, additions = moved, tried
        last_step = float(part * step / np.sqrt(dispersion))
        if step < 1e-2 * np.sqrt(dispersion):
            break
    c = cone @ w
    with np.errstate(divide="ignore", invalid="ignore"):  # nothing left
        c = (1 + (1 - 1 / dispersion) * (whitened.stiffness_factor(problem, c, additions) - 1)) * c
    _finite(c, additions)
    r = whitened.residual(problem, c, additions)
    U = orthonormal(np.concatenate([span, S], axis=1))
    free, degrees = beyond(r, U)
    clear = beyond(r, np.concatenate([U, whitened.doubtful([part.train for part in problem.trained])], axis=1))
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
        wrong = whitened.recovered(problem, c)
        shift = bounded(
            left, wrong - base @ (base.T @ wrong), np.full(len(scale), -np.inf), np.full(len(scale), np.inf)
        )
        spread = np.hypot(spread, shift * scale)
        for a, part in zip(additions, np.split(spread, np.cumsum(variables.sizes)[:-1]), strict=True):
            deviations.append(tuple(map(float, part[: len(a.amplitudes)])))
    generic = whitened.slow(problem)
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
        last_step,
    )


def bulk_modulus(problem: Problem, fit: Fit) -> tuple[float, float] | None:
    """Bulk modulus of a fit in plane strain and its standard deviation, MPa (N/mm without a thickness); None in plane stress."""
    if not isinstance(problem.basis, PlaneStrainBasis):
        return None
    G = whitened.base_columns(problem, fit.chains)
    S = whitened.signatures(problem, fit.chains, fit.c, fit.additions) if fit.additions else G[:, :0]
    others = orthonormal(np.concatenate([G[:, :-1], S], axis=1))
    left = G[:, -1] - others @ (others.T @ G[:, -1])
    return float(fit.c[-1]), float(np.sqrt(max(1.0, fit.reduced_chi_square)) / np.linalg.norm(left))


def settled(problem: Problem, c: Array, additions: Additions, iterations: int = 6) -> tuple[Problem, Fit]:
    """The fit with weights that know the noise of its second derivatives, see `whitened.amplified`; as `refit` where no effect
    takes any.

    Weights and amplitudes answer each other in turn: the next weights belong to the mean of both.
    """
    problem = whitened.amplified(problem, additions)
    fit = refit(problem, c, additions, iterations)
    for _ in range(TURNS):
        found = {a.effect.name: (a, d) for a, d in zip(fit.additions, fit.errors, strict=True)}
        far = [
            any(abs(x - y) > NEAR * d for x, y, d in zip(old.amplitudes, found[old.effect.name][0].amplitudes,
                                                         found[old.effect.name][1], strict=True))
            for old in problem.amplifying if old.effect.rough
        ]  # fmt: skip
        if not any(far):
            break
        before = {a.effect.name: a.amplitudes for a in problem.amplifying}
        middle = tuple(
            replace(a, amplitudes=tuple(0.5 * (x + y) for x, y in
                                        zip(before.get(a.effect.name, a.amplitudes), a.amplitudes, strict=True)))
            for a in fit.additions
        )  # fmt: skip
        problem = whitened.amplified(problem, middle)
        fit = refit(problem, fit.c, fit.additions, iterations)
    return problem, fit


def reweighted(problem: Problem, fit: Fit) -> Problem:
    """The same equations with the weights of a fit with effects: those of its base, as stiff as base and effects are."""
    load = whitened.loads(problem, fit.additions)
    whole = whitened.residual(problem, fit.c, fit.additions) + load
    base = whitened.residual(problem, fit.c, ()) + whitened.loads(problem)
    c = fit.c * float(load @ whole) / float(load @ base)
    known = whitened.amplifying(problem, fit.additions)
    parts = [
        whitened.weighted(
            p.chain, p.assembled, problem.basis, c, p.train.rows, p.held.rows, problem.with_discrepancy, known
        )
        for p in problem.parts
    ]
    return replace(problem, parts=tuple(parts), c=c, amplifying=known)


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
    doubt = whitened.doubtful([part.train for _, part in train]), whitened.doubtful([part.held for _, part in held])
    before, n_before = beyond(r, np.concatenate([A, doubt[0]], axis=1))
    both = np.concatenate([np.concatenate([A, B]), scipy.linalg.block_diag(*doubt)], axis=1)
    after, n_after = beyond(np.concatenate([r, s]), both)
    return max(after - before, 0.0), max(n_after - n_before, 0)
