"""Fitting on the reduction: a convex monotone spline first (global), then the network from it.

In: a `Quadratic`. Out: spline coefficients; PANN parameters with the reason why the optimiser stopped.

- `convex_spline`: psi as a sum of functions of single inputs, each convex and non-decreasing: non-negative least
  squares, hence one global solution.
- `fit_network`: several starts at once, bounded Levenberg-Marquardt; first on the energy derivatives of the
  spline (distillation), then on the loss itself. Random starts alone sit on a neo-Hookean plateau whose loss is
  within 0.2 % of the best while the material is missed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from calibrate import errors
from calibrate.equations.basis import Basis, PlaneStrainBasis, Spline, energy_basis
from calibrate.equations.inputs import INPUT_SETS
from calibrate.equations.reduction import Assembled, Quadratic, corrected
from calibrate.equations.weights import Weights
from calibrate.fitting.levenberg_marquardt import TOLERANCE, levenberg_marquardt
from calibrate.fitting.stopping import Stop
from calibrate.models import pann

Array = NDArray[np.float64]
# A weak normal prior on the weights of the (scaled) network, in units of the residuals' own standard deviation:
# without it a kink of any steepness fits just where the data end, and ruins the extrapolation.
PRIOR_STD = 5.0
DISTILLATION_DECAY = 1e-6
STRAIGHT = 1e-4  # relative change of the derivatives of an energy that is called a straight line
CLEARLY_LOWER, CLEAR_SHARE, RESTARTS = (
    10.0,
    0.02,
    2,
)  # loss of a convex spline, absolute and relative, that calls for new starts


def monotone_functions(basis, k: int, n: int = 24, reach: float = np.inf) -> Array:
    """Non-decreasing functions psi_k(J_k), sampled at the basis' sites: (n, n_sites, 2).

    The first is constant, the others are integrated cubic B-splines of s = sqrt((J - J(I)) / range), constant
    beyond the range of the data, and beyond `reach`, the J - J(I) of those that are fitted: a function that rises only there would act on the data by
    the ripples of its interpolant alone, and without end.
    """
    x = np.maximum(basis.site_inputs[:, k], 0.0)
    s = np.sqrt(np.minimum(x / min(x.max(), basis.input_tops[k], reach), 1.0))
    values = Spline(n).matrix(s)
    cumulative = np.cumsum(values[:, ::-1], axis=1)[:, ::-1]
    functions = np.zeros((n, len(x), 2))
    functions[:, :, k] = cumulative.T
    return functions


def convex_spline(quadratic: Quadratic, inputs: str, n: int = 24, reach: float = np.inf) -> Array:
    """Coefficients (n_functions,) of the best energy that is a sum of convex non-decreasing functions of J_k; reach: see `monotone_functions`.

    In plane strain with the best bulk modulus, not negative. Raises `FitError` when the loss has no information at all.
    """
    basis = quadratic.basis
    columns = np.concatenate([monotone_functions(basis, k, n, reach) for k in INPUT_SETS[inputs]])
    E = basis.interpolation @ columns.reshape(len(columns), -1).T
    if isinstance(basis, PlaneStrainBasis):
        E = np.column_stack([E, np.eye(basis.n_functions)[:, -1]])
    R, d = quadratic.factor()
    if R.shape[0] == 0:
        raise errors.FitError("the data do not constrain the material: forces or displacements are all noise")
    A = R @ E
    scale = np.linalg.norm(A, axis=0)
    scale[scale == 0] = 1.0
    weights, _ = nnls(A / scale, d, maxiter=50 * A.shape[1])
    return E @ (weights / scale)


@dataclass(frozen=True)
class NetworkFit:
    """Result of `fit_network`: best parameters (n_parameters,), their spline coefficients (n_functions,) and loss; of
    every start (n_starts,) its loss, its iterations, why it stopped, and its parameters (n_starts, n_parameters). dead: whether the energy is a straight line where a
    convex one that bends meets the data clearly better."""

    parameters: Array
    coefficients: Array
    loss: float
    losses: Array
    iterations: NDArray[np.int64]
    reasons: tuple[Stop, ...]
    all_parameters: Array
    dead: bool = False


@dataclass(frozen=True)
class Effort:
    """iterations of each start on the spline (distillation) and on the loss; tolerance: relative decrease of a small step there."""

    distillation: int = 300
    iterations: int = 300
    tolerance: float = TOLERANCE


@dataclass(frozen=True)
class NetworkResidual:
    """Residual functions of a network, hashable so that JAX compiles once for each architecture."""

    architecture: pann.Architecture
    distil: bool

    def __call__(self, theta, data):
        sites, weights, target, R, d, scales = data
        sampled = self.derivatives(theta, sites, scales)
        if self.distil:
            return ((sampled - target) * weights).ravel()
        return R @ sampled.ravel() - d

    def jacobian(self, theta, data):
        """(rows, n_parameters): site by site, backwards, which costs a large network much less than forwards through all rows."""
        sites, weights, _, R, _, scales = data
        slopes = jax.vmap(lambda site: jax.jacrev(lambda t: self._at(t, site, scales))(theta))(sites)
        if self.distil:
            return (slopes * weights[:, :, None]).reshape(-1, slopes.shape[-1])
        return R @ slopes.reshape(-1, slopes.shape[-1])

    def derivatives(self, theta, sites, scales):
        """psi_k at the sites (n, 2): derivative by J_k, zero for an input that is not used."""
        return jax.vmap(lambda site: self._at(theta, site, scales))(sites)

    def _at(self, theta, site, scales):
        index = jnp.array(INPUT_SETS[self.architecture.inputs])
        gradient = jax.grad(lambda y: pann._network(self.architecture, theta, y))((site * scales)[index])
        return jnp.zeros(2).at[index].set(gradient * scales[index])


@dataclass(frozen=True)
class WeightedSpline:
    """coefficients (n_functions,): of a convex spline. weights: of the equations it was fitted to, which belong to weights_c (n_functions,). loss: with them."""

    coefficients: Array
    weights: Weights
    weights_c: Array
    loss: Quadratic


def reweighted_spline(assembled: Assembled, inputs: str, passes: int) -> WeightedSpline:
    """Of the last pass: each has the weights that belong to the spline of the one before, the first those of neo-Hooke."""
    following = neo_hooke = assembled.first_guess()
    for _ in range(passes):
        c, weights = following, assembled.weights(following)
        quadratic = assembled.quadratic(weights)
        spline = convex_spline(quadratic, inputs)
        spline = corrected(quadratic, spline, c, [assembled])
        following = quadratic.coefficients_of_weights(spline, neo_hooke)
    return WeightedSpline(spline, weights, c, quadratic)


def fit_network(
    quadratic: Quadratic,
    inputs: str,
    layers: tuple[int, ...],
    spline: Array,
    n_starts: int = 20,
    seed: int = 0,
    effort: Effort = Effort(),
    reach: float = np.inf,
) -> tuple[pann.Architecture, NetworkFit]:
    """Fit PANN_inputs^layers to a reduced loss, starting from `spline` coefficients of `convex_spline`.

    n_starts random starts (JAX key `seed`) are distilled from the spline and polished on the loss; the one with
    the lowest loss is returned. In plane strain every network has the bulk modulus that suits it best, the last of its
    coefficients. Hidden weights that die leave a straight line; where a convex spline is clearly
    better, the network is started again from that. reach: see `monotone_functions`. Raises `FitError` when no start converged to a finite loss.
    """
    architecture, found = _fit_network(quadratic, inputs, layers, spline, n_starts, seed, effort)
    if not is_straight(quadratic.basis, found.coefficients):
        return architecture, found
    best = convex_spline(quadratic, inputs, reach=reach)
    allowed = found.loss - max(CLEARLY_LOWER, CLEAR_SHARE * found.loss)
    if quadratic.loss(best) >= allowed:
        return architecture, found
    for again in range(1, RESTARTS + 1):
        new_architecture, new = _fit_network(quadratic, inputs, layers, best, 2 * n_starts, seed + 1000 * again, effort)
        if new.loss < found.loss:
            architecture, found = new_architecture, new
        if not is_straight(quadratic.basis, found.coefficients):
            return architecture, found
    return architecture, replace(found, dead=True)


def is_straight(basis: Basis, coefficients: Array) -> bool:
    """Whether every derivative of an energy with coefficients (n_functions,) is constant: neo-Hooke, or Mooney-Rivlin."""
    sites = np.linalg.pinv(energy_basis(basis).interpolation) @ coefficients[: energy_basis(basis).n_functions]
    slopes = sites.reshape(-1, 2)
    return bool(np.ptp(slopes, axis=0).max() <= STRAIGHT * np.abs(slopes).max())


def _fit_network(
    quadratic: Quadratic, inputs: str, layers: tuple[int, ...], spline: Array, n_starts: int, seed: int, effort: Effort
) -> tuple[pann.Architecture, NetworkFit]:
    """One run of all starts."""
    whole, quadratic = quadratic, quadratic.of_energy()
    problem = _scaled_problem(quadratic, inputs, spline[: quadratic.basis.n_functions])
    unit = pann.Architecture(inputs, tuple(layers))
    lower = jnp.where(jnp.asarray(unit.nonnegative), 0.0, -jnp.inf)
    keys = jax.random.split(jax.random.key(seed), n_starts)
    starts = jnp.stack([unit.random_start(key) for key in keys])
    distilled = levenberg_marquardt(
        NetworkResidual(unit, True), problem.data, starts, lower, effort.distillation, DISTILLATION_DECAY
    ).parameters
    magnitude, offset = problem.magnitude, quadratic.constant - problem.magnitude**2
    floor = max(offset, 0.0) / magnitude**2
    decay = floor / max(quadratic.n_rows, 1) / PRIOR_STD**2 + 1e-14
    polish = NetworkResidual(unit, False)
    found = levenberg_marquardt(
        polish, problem.data, jnp.asarray(distilled), lower, effort.iterations, decay, floor, effort.tolerance
    )
    losses = found.objectives - decay * (found.parameters**2).sum(axis=1)
    if not np.isfinite(losses).any():
        raise errors.FitError("no start reached a finite loss; check the data for extreme deformations")
    best = int(np.nanargmin(losses))
    derivatives = polish.derivatives(found.parameters[best], problem.data[0], problem.data[-1])
    result = NetworkFit(
        parameters=found.parameters[best],
        coefficients=whole.with_bulk_modulus(
            problem.level * quadratic.basis.interpolation @ np.asarray(derivatives).ravel()
        ),
        loss=float(losses[best] * magnitude**2 + offset),
        losses=losses * magnitude**2 + offset,
        iterations=found.iterations,
        reasons=found.reasons,
        all_parameters=found.parameters,
    )
    return pann.Architecture(inputs, tuple(layers), problem.scales, problem.level), result


def refitted(quadratic: Quadratic, architecture: pann.Architecture, start: Array, effort: Effort = Effort()) -> Array:
    """Parameters (n_parameters,) of a network on a reduced loss, from `start` (n_parameters,); its scales and its level stay.

    With the prior of `fit_network`. Raises `FitError` where the loss is not finite.
    """
    R, d = quadratic.factor()
    magnitude = float(np.linalg.norm(d))
    floor = max(quadratic.constant - magnitude**2, 0.0) / magnitude**2
    missing = quadratic.basis.n_functions - len(d)
    R, d = np.pad(R, ((0, missing), (0, 0))) @ quadratic.basis.interpolation, np.pad(d, (0, missing))
    sites, scales = np.nan_to_num(quadratic.basis.site_inputs), np.asarray(architecture.scales)
    none = np.zeros_like(sites)
    data = tuple(
        map(jnp.asarray, (sites, none, none, R * architecture.energy_scale / magnitude, d / magnitude, scales))
    )
    unit = pann.Architecture(architecture.inputs, tuple(architecture.layers))
    lower = jnp.where(jnp.asarray(unit.nonnegative), 0.0, -jnp.inf)
    decay = floor / max(quadratic.n_rows, 1) / PRIOR_STD**2 + 1e-14
    found = levenberg_marquardt(
        NetworkResidual(unit, False), data, jnp.asarray(start)[None], lower, effort.iterations, decay, floor, effort.tolerance
    )  # fmt: skip
    if not np.isfinite(found.objectives).all():
        raise errors.FitError("the loss of the network is not finite; check the data for extreme deformations")
    return found.parameters[0]


@dataclass(frozen=True)
class _ScaledProblem:
    """What a network of unit size is fitted to. data: arguments of `NetworkResidual`; scales: 1 / range of (J1, J2); level:
    of the energy, MPa or N/mm; magnitude: of the loads."""

    data: tuple[jax.Array, ...]
    scales: tuple[float, float]
    level: float
    magnitude: float


def _scaled_problem(quadratic: Quadratic, inputs: str, spline: Array) -> _ScaledProblem:
    """The loss and the spline (n_functions,) in units of the data's range. Raises `FitError` where the spline is zero."""
    basis, index = quadratic.basis, list(INPUT_SETS[inputs])
    sites = np.nan_to_num(basis.site_inputs)
    scales = 1.0 / np.maximum(np.abs(sites).max(axis=0), 1e-300)
    target = (np.linalg.pinv(basis.interpolation) @ spline).reshape(len(sites), 2)
    level = max(float(np.abs(target[:, k]).max() / scales[k]) for k in index)
    if not level > 0:
        raise errors.FitError(
            "the convex spline fit is zero: stress does not grow with the stretch; check the signs of the forces, and that a stretch is 1 at rest"
        )
    R, d = quadratic.factor()
    # always n_functions rows: the rank varies with the data, and each new shape would be compiled again
    missing = basis.n_functions - len(d)
    R, d = np.pad(R, ((0, missing), (0, 0))) @ basis.interpolation, np.pad(d, (0, missing))
    weights = np.zeros_like(target)
    weights[:, index] = 1.0 / scales[index]
    magnitude = float(np.linalg.norm(d))
    data = tuple(map(jnp.asarray, (sites, weights, target / level, R * level / magnitude, d / magnitude, scales)))
    return _ScaledProblem(data, (float(scales[0]), float(scales[1])), level, magnitude)
