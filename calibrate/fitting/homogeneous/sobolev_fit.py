"""Supervised (Sobolev) fit of a PANN: the derivative of the energy is fitted to measured stresses.

In: {mode: (stretch, nominal stress)} of homogeneous incompressible tests. Out: a Model.

Loss = sum over modes of mean((P_model - P)^2) / max(P)^2, so that each mode counts the same. It starts from the
convex spline and its distilled network (`calibrate.fitting.network_fit`), together with random starts, and is minimised on the
exact stresses by bounded Levenberg-Marquardt; the energy itself is never seen. A small ridge, 1e-6 times the sum of the
squared weights, keeps steps out of the gaps between data points: with inputs scaled to 1, a softplus may bend
within some 5 % of their range, not within 0.1 %.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.equations.basis import basis_for, polyconvex
from calibrate.equations.deformation_modes import MODES, stretches_to_gradient
from calibrate.equations.inputs import INPUT_SETS
from calibrate.equations.reduction import Quadratic
from calibrate.fitting import network_fit
from calibrate.fitting.calibrated_range import curve_ranges
from calibrate.fitting.levenberg_marquardt import levenberg_marquardt
from calibrate.fitting.stopping import Stop
from calibrate.models import pann
from calibrate.models.network_model import Model

Array = NDArray[np.float64]
Curves = Mapping[str, tuple[Array, Array]]
RIDGE = 1e-6


@dataclass(frozen=True)
class SupervisedFit:
    """model, its loss, the losses (n,) of all starts, and why the best one stopped. effective_parameters: trace of the projection of the
    stresses on what the parameters change, damped by the ridge."""

    model: Model
    loss: float
    losses: Array
    reason: Stop
    effective_parameters: float


def check_curves(curves: Curves) -> None:
    """Check {mode: (stretch (k,), nominal stress (k,) MPa)}.

    Raises `ExperimentError` or `UnitsError` for data that no homogeneous test gives, `ConfigError` for an unknown mode.
    """
    if not curves:
        raise errors.ExperimentError(f"no stress-stretch data; give at least one of {', '.join(MODES)}")
    for mode, (stretch, stress) in curves.items():
        if mode not in MODES:
            raise errors.ConfigError(f"mode '{mode}' unknown; choose one of {', '.join(MODES)}")
        if stretch.shape != stress.shape or stretch.ndim != 1 or stretch.size < 2:
            raise errors.ExperimentError(f"{mode}: stretch {stretch.shape} and stress {stress.shape} do not match")
        if not (np.isfinite(stretch).all() and np.isfinite(stress).all()):
            raise errors.ExperimentError(f"{mode}: values are not finite; leave such rows out")
        if not (stretch > 0).all() or stretch.max() > 20:
            raise errors.UnitsError(
                f"{mode}: stretches from {stretch.min():g} to {stretch.max():g}; give ratios, not %"
            )
        if not np.abs(stress).max() > 0:
            raise errors.ExperimentError(f"{mode}: every stress is zero")


def gradients(curves: Curves) -> tuple[Array, Array, Array]:
    """F (m, 2, 2), nominal stress (m,) MPa and weight (m,) 1/MPa of all points of all modes."""
    F = np.concatenate([stretches_to_gradient(mode, stretch) for mode, (stretch, _) in curves.items()])
    stress = np.concatenate([stress for _, stress in curves.values()])
    weight = np.concatenate([np.full(s.size, 1 / (np.abs(s).max() * np.sqrt(s.size))) for _, s in curves.values()])
    return F, stress, weight


def quadratic(curves: Curves, inputs: str) -> Quadratic:
    """The loss as a quadratic form in spline coefficients, like that of an Experiment."""
    F, stress, weight = gradients(curves)
    basis = basis_for(inputs, F)
    P, columns = basis.local(F)
    A = np.zeros((len(F), basis.n_functions))
    np.put_along_axis(A, columns, weight[:, None] * P[:, :, 0, 0], axis=1)
    d = weight * stress
    return Quadratic(basis, A.T @ A, A.T @ d, float(d @ d), len(F))


@dataclass(frozen=True)
class _StressResidual:
    """Weighted stress errors of a network and its ridge; hashable, so that JAX compiles once for each architecture."""

    architecture: pann.Architecture
    ridge: float

    def __call__(self, theta, data):
        sites, slopes, stress, weight, scales = data
        psi = network_fit.NetworkResidual(self.architecture, True).derivatives(theta, sites, scales)
        misfit = weight * (jnp.sum(psi * slopes, axis=-1) - stress)
        weights = theta[np.flatnonzero(self.architecture.nonnegative)]
        return jnp.concatenate([misfit, jnp.sqrt(self.ridge) * weights])


def fit_supervised(
    curves: Curves,
    inputs: str = "I1",
    layers: tuple[int, ...] = (1,),
    n_starts: int = 10,
    seed: int = 0,
    limit: int = 1000,
    ridge: float = RIDGE,
) -> SupervisedFit:
    """Fit PANN_inputs^layers to {mode: (stretch (k,), nominal stress (k,) MPa)}.

    n_starts random starts (JAX key `seed`) besides the distilled one; limit: iterations.
    ridge: see the module.
    Raises `ExperimentError`, `UnitsError`, `ConfigError`, `FitError`.
    """
    check_curves(curves)
    reduced = quadratic(curves, inputs)
    spline = network_fit.convex_spline(reduced, inputs)
    architecture, first = network_fit.fit_network(reduced, inputs, tuple(layers), spline, n_starts, seed)
    F, stress, weight = gradients(curves)
    sites, derivatives = polyconvex(F)
    slopes = architecture.energy_scale * derivatives[:, :, 0, 0]
    data = tuple(map(jnp.asarray, (sites, slopes, stress, weight, np.array(architecture.scales))))
    keys = jax.random.split(jax.random.key(seed), n_starts)
    starts = [jnp.asarray(first.parameters), *(architecture.random_start(key) for key in keys)]
    if len(INPUT_SETS[inputs]) > 1:
        # a network of one input is one of both: without this start the fit may end worse than that
        single = fit_supervised(curves, "I1", layers, n_starts, seed, limit, ridge).model
        embedded = _embedded(single, architecture)
        starts += [jnp.asarray(embedded), *_perturbed(embedded, architecture, keys)]
    unit = pann.Architecture(inputs, tuple(layers))
    lower = jnp.where(jnp.asarray(architecture.nonnegative), 0.0, -jnp.inf)
    found = levenberg_marquardt(_StressResidual(unit, ridge), data, jnp.stack(starts), lower, limit)
    losses = found.objectives
    if not np.isfinite(losses).any():
        raise errors.FitError("no start reached a finite loss; check the data for extreme stretches")
    best = int(np.nanargmin(losses))
    model = Model(
        architecture,
        found.parameters[best],
        "MPa",
        curve_ranges(F),
        {"loss": float(losses[best]), "kind": "supervised", "seed": seed, "starts": n_starts},
        {"modes": sorted(curves)},
    )
    residual = _StressResidual(unit, ridge)
    J = np.asarray(jax.jacobian(lambda theta: residual(theta, data))(jnp.asarray(found.parameters[best])))[: len(F)]
    squares = np.linalg.svd(J, compute_uv=False) ** 2
    effective = float((squares / (squares + ridge)).sum())
    return SupervisedFit(model, float(losses[best]), losses, found.reasons[best], effective)


def _embedded(single: Model, architecture: pann.Architecture) -> Array:
    """Parameters of a network of I1 alone as those of a network of both inputs."""
    old = single.architecture
    hidden, output, skip = old.unpack(np.asarray(single.parameters))
    ratio = old.scales[0] / architecture.scales[0]
    level = old.energy_scale / architecture.energy_scale
    parts = []
    for k, (W, b) in enumerate(hidden):
        parts += [np.column_stack([W * ratio, np.zeros(len(W))]) if k == 0 else W, b]
    parts += [output * level, np.array([skip[0] * ratio * level, 0.0])]
    return np.concatenate([np.ravel(part) for part in parts])


def _perturbed(parameters: Array, architecture: pann.Architecture, keys: jax.Array) -> list[jax.Array]:
    """Parameters moved a tenth of the way to random ones, one vector a key: the second input begins to act."""
    return [0.9 * jnp.asarray(parameters) + 0.1 * architecture.random_start(key) for key in keys]
