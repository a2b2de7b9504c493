"""Experiments with their weights: residuals, loads and signatures in rows of unit covariance.

In: the chain of every Experiment, the equations used for fitting, a base model. Out: `Problem`, and what any model leaves of
it: rows of unit covariance, of noise and of what the kinematics may miss.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.effects.chain import Additions, Chain
from calibrate.equations import discretisation_error, kinematics, noise_covariance
from calibrate.equations.basis import DEGREE, PlaneStrainBasis, SingleBasis, Spline, energy_basis, polyconvex
from calibrate.equations.equilibrium import Equilibrium
from calibrate.equations.reduction import Assembled
from calibrate.equations.whitening import Whitening, covariances, whitening

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SPLINES = 24  # of the base
SHAPE_STEP = 1e-3  # of a radian, or of the size of a time, for derivatives by shapes
SLOW_PLACES, SLOW_TIMES = 3, 4  # cosines over each side of a specimen, over its increments
DOUBTFUL = 0.1  # variance of a discrepancy over that of noise, from which a direction says nothing of noise
Rows = Callable[[Equilibrium], Mask]


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
        return self.chain.residual(c, additions) - self.shift

    def carried(self, additions: Additions) -> Additions:
        """Those that hold for this experiment: of the material, and all where it took part in the fit."""
        return additions if self.train.size else tuple(a for a in additions if a.effect.of_material)

    @property
    def experiment(self) -> Experiment:
        """The Experiment of the chain."""
        return self.chain.system.experiment

    @property
    def system(self) -> Equilibrium:
        """The virtual-work equations of the chain."""
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
    effect that any energy of I1 could imitate is found only so, and only if the base is right. c (n,), amplifying: the base
    and the effects that the weights belong to, see `amplified`.
    """

    parts: tuple[Part, ...]
    basis: SingleBasis | PlaneStrainBasis
    cone: Array
    prior: Array
    noise_is_known: bool
    with_discrepancy: bool
    c: Array = field(repr=False)
    parametric: bool = False
    amplifying: Additions = ()

    @property
    def trained(self) -> tuple[Part, ...]:
        """The parts that have training rows."""
        return tuple(part for part in self.parts if part.train.size)

    def white(self, values: Sequence[Array]) -> Array:
        """Whitened training rows (..., N) of one array (..., t, 2 v) for each trained part."""
        return np.concatenate([part.train(v) for part, v in zip(self.trained, values, strict=True)], axis=-1)


def all_rows(system: Equilibrium) -> Mask:
    """Every equation with a known right-hand side (t, 2 v)."""
    return np.isfinite(system.loads)


def weighted(
    chain: Chain,
    assembled: Assembled,
    basis: SingleBasis | PlaneStrainBasis,
    c: Array,
    train: Mask,
    held: Mask,
    with_discrepancy: bool,
    additions: Additions = (),
) -> Part:
    """One Experiment with the weights that belong to the material with coefficients c (n,) and effects; c as stiff as both."""
    common = discretisation_error.sources(chain.system, basis, c) if with_discrepancy else None
    noise = _covariances(chain, assembled, c, additions if train.any() else ())
    shift = chain.noise_shift(c, assembled.noise_factor)
    return Part(chain, assembled, whitening(noise, train, common), whitening(noise, held, common), shift, common)


def amplified(problem: Problem, additions: Additions) -> Problem:
    """The same equations and base with the weights of a model with these effects.

    Effects that take second derivatives of the displacements amplify their noise. Those in the material change what stress
    a noise makes, above all where they remember or stiffen; the weights know them as they were when `reweighted`, as long
    as they are in the model. With weights that do not know it, the misfit of the true model may be larger than that of none.
    """
    names = {a.effect.name for a in additions}
    known = tuple(a for a in problem.amplifying if not a.effect.rough and a.effect.name in names)
    found = (*known, *(a for a in amplifying(problem, additions) if a.effect.rough))
    if found == problem.amplifying:
        return problem
    parts = []
    for part in problem.parts:
        noise = _covariances(part.chain, part.assembled, problem.c, found if part.train.size else ())
        train, held = (whitening(noise, w.rows, part.common) for w in (part.train, part.held))
        parts.append(replace(part, train=train, held=held))
    return replace(problem, parts=tuple(parts), amplifying=found)


def _covariances(chain: Chain, assembled: Assembled, c: Array, additions: Additions) -> list[Array]:
    """Noise covariance (2 v, 2 v), N^2, of every increment, of a material as stiff as with coefficients c (n,)."""
    if not additions:
        return covariances(assembled, c)
    c = c / _stiffening(chain, c, tuple(a for a in additions if a.effect.in_material))
    spreads = chain.spread_of_noise(c, additions, assembled.noise_factor)
    pairs = zip(spreads, chain.system.loads, strict=True)
    return [noise_covariance.covariance_of(chain.system, spread, load, assembled.noise) for spread, load in pairs]


def _stiffening(chain: Chain, c: Array, additions: Additions) -> float:
    """Factor by which effects raise the work of the measured loads."""
    load = chain.external()
    works = [float((load * (chain.residual(c, some) + load)).sum()) for some in ((), additions)]
    return works[1] / works[0]


def amplifying(problem: Problem, additions: Additions) -> Additions:
    """Effects that change what noise does, where it is known."""
    if not problem.noise_is_known:
        return ()
    return tuple(
        a
        for a in additions
        if (a.effect.rough or a.effect.in_material)
        and any(v != p.null for v, p in zip(a.amplitudes, a.effect.amplitudes, strict=True))
    )


def first_guess(assembled: Sequence[Assembled]) -> Array:
    """Coefficients (n_functions,) of neo-Hooke with the mean of the moduli that fit each experiment's forces."""
    return np.mean([a.first_guess() for a in assembled], axis=0)


def trained_top(system: Equilibrium, mask: Mask) -> float:
    """Largest I1 - 3 in the increments used for fitting."""
    F = system.isochoric_gradients[mask.any(axis=1)]
    return float(polyconvex(F)[0][..., 0].max())


def base_cone(basis: SingleBasis | PlaneStrainBasis, base: str, top: float, n: int = SPLINES) -> Array:
    """(n_functions, n): psi_1 of which the base models are non-negative sums; constant beyond I1 - 3 = top.

    Cubic splines in sqrt(I1 - 3); fewer than four functions are straight lines between n points, and one is neo-Hooke. In plane
    strain one more column, the bulk modulus.
    """
    if isinstance(basis, PlaneStrainBasis):
        energy = energy_basis(basis)
        assert isinstance(energy, SingleBasis)
        return scipy.linalg.block_diag(base_cone(energy, base, top, n), np.eye(1))
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


def smoothness(base: str, n: int, bulk: int = 0) -> Array:
    """(n - 1, n + bulk): weights to the changes of psi_1 from one spline to the next, and to no bulk modulus."""
    if bulk:
        return np.pad(smoothness(base, n), ((0, 0), (0, bulk)))
    return np.eye(n)[1:] if base == "convex" else np.eye(n)[1:] - np.eye(n)[:-1]


def residual(problem: Problem, c: Array, additions: Additions) -> Array:
    """Whitened training residual (N,) of coefficients c (n,) and effects."""
    return problem.white([part.residual(c, additions) for part in problem.trained])


def loss(problem: Problem, c: Array, additions: Additions) -> float:
    """|whitened training residual|^2."""
    r = residual(problem, c, additions)
    return float(r @ r)


def loads(problem: Problem, additions: Additions = ()) -> Array:
    """Whitened right-hand side (N,)."""
    return problem.white([part.chain.external(additions) + part.shift for part in problem.trained])


def stiffness_factor(problem: Problem, c: Array, additions: Additions) -> float:
    """Factor on the stiffness when the noise covariance follows it, see `Quadratic.stiffness_factor`."""
    load = loads(problem, additions)
    internal = residual(problem, c, additions) + load
    return float(load @ load / (load @ internal))


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
                ends.append(problem.white([chain.residual(c, twin) for chain in chains]))
            columns.append(((ends[0] - ends[1]) / (2 * step))[:, None])
    return np.concatenate(columns, axis=1)


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
