"""The weighted problem of a diagnosis: residuals, loads and signatures of Experiments in rows of unit covariance.

In: the chain of every Experiment, the equations used for fitting, their weights. Out: `Problem`, and the whitened residual and its
derivatives for a base and effects. The covariance is that of noise and of errors that the discretised kinematics may make.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.effects import Effect
from calibrate.effects.chain import Additions, Chain
from calibrate.effects.support.effect_data import Data
from calibrate.equations import kinematics, reduction
from calibrate.equations.basis import PlaneStrainBasis, SingleBasis
from calibrate.equations.equilibrium import Equilibrium
from calibrate.equations.reduction import Assembled
from calibrate.equations.weights import Sources, Weights

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SHAPE_STEP = 1e-3  # of a radian, or of the size of a time, for derivatives by shapes
Rows = Callable[[Equilibrium], Mask]


def mean_of_noise(chain: Chain, assembled: Assembled, c: Array) -> Array:
    """Mean (t, 2 v), N, that noise brings into the residual of a base c (n,); none of a stand-in for a noise that nobody knows, which orders the equations alone."""
    if not assembled.noise_is_known:
        return np.zeros(chain.system.loads.shape)
    return chain.noise_shift(c, assembled.noise_axes, assembled.variances)


@dataclass(frozen=True, eq=False)
class OwnSignature:
    """An effect that a test has for itself beside others. deviation (p,): standard deviations of its amplitudes before the test.
    sources (t, 2 v, s), N: change of the residual by each amplitude, for every shape, those of a shape side by side; by a standard deviation where all shapes have an
    equal share of the variance."""

    effect: Effect
    deviation: Array
    sources: Array = field(repr=False)


@dataclass(frozen=True, eq=False)
class Unweighted:
    """The equations of one Experiment, and what their weights depend on.

    twin (t, 2 v), N: the discretisation error in the residual; None: unknown. own: effects that the weights allow for, see `evidence.own_effects`.
    denoised (t, n, 2), mm: displacements at which the weights know what noise does (None: those measured), see `model_weights.reweighted`.
    """

    chain: Chain
    assembled: Assembled = field(repr=False)
    twin: Array | None = field(default=None, repr=False)
    own: tuple[OwnSignature, ...] = field(default=(), repr=False)
    denoised: Array | None = field(default=None, repr=False)

    @property
    def experiment(self) -> Experiment:
        """The Experiment of the chain."""
        return self.chain.system.experiment

    @property
    def system(self) -> Equilibrium:
        """The virtual-work equations of the chain."""
        return self.chain.system


@dataclass(frozen=True, eq=False, kw_only=True)
class Part(Unweighted):
    """One Experiment in a diagnosis, with weights of the equations (t, 2 v) used for fitting and held out.

    shift (t, 2 v), N: see `Chain.noise_shift`. common: see `discretisation_error`. together: weights of both, where what is held out
    has noise in common with what is fitted; None: it is independent.
    """

    train: Weights
    held: Weights
    shift: Array = field(repr=False)
    common: Sources | None = field(repr=False)
    together: Callable[[], Weights] | None = field(default=None, repr=False)

    @property
    def inside(self) -> Mask:
        """(2 v,): equations of virtual fields without a load."""
        return np.tile(self.system.fields.boundary < 0, 2)

    @property
    def fitted_increments(self) -> Mask:
        """Increments (t,) with an equation that is fitted, beside one that fixes a nominal level."""
        return np.asarray((self.train.rows & ~self.system.level_equation).any(axis=1))

    @property
    def known(self) -> Array:
        """What is no misfit in the residual of the chain (t, 2 v), N: the mean that noise brings into it, and the discretisation error."""
        return self.shift if self.twin is None else self.shift + self.twin

    def residual(self, c: Array, additions: Additions = ()) -> Array:
        """Residual (t, 2 v), N, without what is known of it."""
        return self.chain.residual(c, additions) - self.known

    def own_residual(self, c: Array, additions: Additions = ()) -> Array:
        """Residual (t, 2 v), N, without the mean that noise brings into it in the base c (n,) itself, and without the discretisation error.

        What every stated error is of, and what a model file predicts (`ExtendedModel.predict`), which does not know the discretisation
        error, nor what a twin tells of edges (`twin_kinematics`). In a fit the mean is held at that of the weights.
        """
        return (
            self.chain.residual(c, additions)
            - mean_of_noise(self.chain, self.assembled, c)
            - (0.0 if self.twin is None else self.twin)
        )

    def beside_own_effects(self, r: Array) -> Array:
        """A residual (t, 2 v), N, without what the test has for itself: best linear prediction from the training equations (Robinson 1991)."""
        if not self.own:
            return r
        S = np.concatenate([one.sources for one in self.own], axis=-1)
        return r - S @ (self.train(np.moveaxis(S, -1, 0)) @ self.train(r))

    def valid(self, additions: Additions) -> Additions:
        """Those that hold for this experiment: of the material, and all where it took part in the fit."""
        return additions if self.train.size else tuple(a for a in additions if a.effect.of_material)


@dataclass(frozen=True, eq=False)
class Problem:
    """Experiments with weights. parts: all; those without training rows are held out.

    cone (n, k): the base models are non-negative sums of its columns. prior (m, n), 1 / MPa: see `base_functions.prior_rows`; as
    m more rows of the whitened equations, so that effects are tested and fitted beside a base that costs something. dispersion: see
    `residual_tests.rough_dispersion`, which those rows allow for. weights_c (n,), amplifying: coefficients whose noise weights the equations, see
    `reduction.coefficients_of_weights`, and effects that the weights know, see `amplified`. replay: see `twin.Replay`; None: no part has a twin. twin_has_effects: whether the twins
    were replayed with effects of the material.
    """

    parts: tuple[Part, ...]
    basis: SingleBasis | PlaneStrainBasis
    cone: Array
    prior: Array
    dispersion: float
    noise_is_known: bool
    with_discrepancy: bool
    weights_c: Array = field(repr=False)
    amplifying: Additions = ()
    replay: Callable[..., Any] | None = field(default=None, repr=False)
    twin_has_effects: bool = False

    @property
    def trained(self) -> tuple[Part, ...]:
        """The parts that have training rows."""
        return tuple(part for part in self.parts if part.train.size)

    @property
    def tests(self) -> tuple[Data, ...]:
        """What effects read of them."""
        return tuple(part.chain.data for part in self.trained)

    def shapes(self, effect: Effect) -> list[tuple[float, ...]]:
        """Shapes of an effect to be tried: those of the first test, then of every other what is beyond the range of those before, such as longer times."""
        found, *others = (np.array(effect.shape_values(data), float) for data in self.tests)
        for new in others:
            beyond = ((new < found.min(axis=0)) | (new > found.max(axis=0))).any(axis=1)
            found = np.concatenate([found, new[beyond]])
        return [tuple(shape) for shape in found.tolist()]

    @property
    def of_one_test(self) -> Problem:
        """The first of several tests alone."""
        return replace(self, parts=self.trained[:1])

    @property
    def level_is_nominal(self) -> bool:
        """Whether no force of the parts with training rows is that of its section."""
        return all(part.experiment.level_is_nominal for part in self.trained)

    def whiten(self, values: Sequence[Array]) -> Array:
        """Whitened training rows (..., N) of one array (..., t, 2 v) for each trained part; zeros in the rows of the prior, which come last."""
        rows = [part.train(v) for part, v in zip(self.trained, values, strict=True)]
        return np.concatenate([*rows, np.zeros((*rows[0].shape[:-1], len(self.prior)))], axis=-1)

    @property
    def bend(self) -> Array:
        """Rows of the prior (m, n) times the root of the dispersion: the data count by as much less."""
        return np.sqrt(self.dispersion) * self.prior

    @property
    def log_determinant(self) -> float:
        """Of the covariance of the noise in the training rows."""
        return sum(part.train.log_determinant for part in self.trained)

    def padded(self, rows: Array) -> Array:
        """(N, k) of rows of the equations alone, with zeros in those of the prior."""
        return np.pad(rows, ((0, len(self.prior)), (0, 0)))


def all_rows(system: Equilibrium) -> Mask:
    """Every equation with a known right-hand side (t, 2 v)."""
    return np.isfinite(system.loads)


def residual(problem: Problem, c: Array, additions: Additions) -> Array:
    """Whitened training residual (N,) of coefficients c (n,) and effects, and of the prior."""
    r = problem.whiten([part.residual(c, additions) for part in problem.trained])
    return _with_prior(problem, r, problem.bend @ c)


def _with_prior(problem: Problem, rows: Array, of_prior: Array) -> Array:
    """Whitened rows (N, ...) with those of the prior (m, ...) in place."""
    rows[len(rows) - len(problem.prior) :] = of_prior
    return rows


def dispersion(problem: Problem, r: Array) -> float:
    """Mean square of a whitened residual (N,) in the equations, at least 1."""
    r = r[: len(r) - len(problem.prior)]
    return max(1.0, float(r @ r) / len(r))


def loss(problem: Problem, c: Array, additions: Additions) -> float:
    """|whitened training residual|^2."""
    r = residual(problem, c, additions)
    return float(r @ r)


def loads(problem: Problem, additions: Additions = ()) -> Array:
    """Whitened right-hand side (N,)."""
    return problem.whiten([part.chain.external(additions) + part.known for part in problem.trained])


def stiffness_factor(problem: Problem, c: Array, additions: Additions) -> float:
    """Factor on the stiffness when the noise covariance follows it, see `reduction.stiffness_factor`, whose error it raises."""
    load = loads(problem, additions)
    internal = residual(problem, c, additions) + load
    return reduction.stiffness_factor(float(load @ load), float(load @ internal))


def level_factor(problem: Problem, c: Array, additions: Additions) -> float:
    """By which to multiply the stiffness so that the level is the nominal one, see `Equilibrium.share_carried`; 1 where it is measured. Of
    several tests that of the one that fixes it. Raises `FitError` where the sections pull against the record."""
    if not problem.level_is_nominal:
        return 1.0
    shares = [
        part.system.share_carried(part.own_residual(c, part.valid(additions)) + np.nan_to_num(part.system.loads))
        for part in problem.trained
        if part.system.level_equation.any()
    ]
    return 1 / float(np.mean(shares))


def base_columns(problem: Problem, chains: Sequence[Chain]) -> Array:
    """Whitened d residual / d coefficients (N, n), rows of the prior with them, of the base alone, also beside effects: the residual is exact, so that
    the amplitudes found are those at which it is orthogonal to these columns and to the signatures."""
    columns = []
    for chain in chains:
        F = kinematics.deformation_gradients(chain.system.gradient, np.asarray(chain.data.u))
        columns.append(np.moveaxis(np.array([chain.system.matrix(problem.basis, f) for f in F]), -1, 0))
    return _with_prior(problem, problem.whiten(columns).T, problem.bend)


def signature(problem: Problem, chains: Sequence[Chain], c: Array, additions: Additions) -> Array:
    """Whitened derivative (N, p) by the amplitudes of the last addition."""
    return problem.whiten([chain.derivative(c, additions) for chain in chains]).T


def signatures(problem: Problem, chains: Sequence[Chain], c: Array, additions: Additions) -> Array:
    """Whitened derivatives (N, k) by all amplitudes and shapes, in the order of `Variables`."""
    columns, chains = [], [chain.remembering() for chain in chains]
    for i, addition in enumerate(additions):
        others = additions[:i] + additions[i + 1 :]
        columns.append(signature(problem, chains, c, (*others, addition)))
        for j, value in enumerate(addition.shape):
            step = SHAPE_STEP * addition.effect.shapes[j].shape_size(value)
            ends = []
            for sign in (1, -1):
                shape = (*addition.shape[:j], value + sign * step, *addition.shape[j + 1 :])
                twin = (*additions[:i], replace(addition, shape=shape), *additions[i + 1 :])
                ends.append(problem.whiten([chain.residual(c, twin) for chain in chains]))
            columns.append(((ends[0] - ends[1]) / (2 * step))[:, None])
    return np.concatenate(columns, axis=1)
