"""The loss of the seed paper, kept as a reference: nodal imbalance and boundary forces, each scaled by a maximum.

In: an Experiment. Out: loss of a PANN on the full data (for SLSQP), or of spline coefficients (`reduced`).

    L = sum_(increments, free nodes) f.f / (C_F n_T) + sum_(increments, boundaries) |sum f - F|^2 / (C_L n_T),
    C_F = max over elements, nodes and increments of the squared element nodal force,
    C_L = max squared measured force,        n_T = number of increments.

The paper leaves open whether C_F follows the parameters. Both readings are here and neither is hidden:
``scaling="frozen"`` takes C_F once, at the neo-Hookean start; ``scaling="dependent"`` recomputes it with theta.
With correlated displacement noise the loss is ill-posed either way (docs/resolution.md has its errors): noise makes nodal forces
that grow with stiffness and mesh refinement, so that a softer material always has the lower loss, or, with the
dependent scaling, a larger C_F.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from calibrate import errors
from calibrate.data.experiment import Experiment
from calibrate.equations import kinematics
from calibrate.equations.basis import Basis
from calibrate.equations.equilibrium import Equilibrium, best_shear_modulus
from calibrate.equations.reduction import Quadratic
from calibrate.equations.virtual_fields import nodal_fields
from calibrate.models import pann

Array = NDArray[np.float64]
SCALINGS = ("frozen", "dependent")


def nodal_system(experiment: Experiment) -> Equilibrium:
    """The equations of the plain equilibrium gap: one row a free node and component, and the boundary sums."""
    return Equilibrium(experiment, nodal_fields(experiment), linear=True)


def force_scales(system: Equilibrium) -> tuple[float, float]:
    """C_F at the neo-Hookean start (whatever the inputs of the model) and C_L, both N^2."""
    psi = np.zeros((*system.deformation_gradients.shape[:2], 2))
    psi[..., 0] = 0.5 * best_shear_modulus(system)[0]
    return float(_element_force_max(system, psi)), _load_max(system.experiment)


def _load_max(experiment: Experiment) -> float:
    return max(float(np.nanmax(np.nansum(b.force**2, axis=1))) for b in experiment.loaded)


def _element_force_max(system: Equilibrium, psi: Array) -> float:
    F = system.deformation_gradients
    values, first = map(np.asarray, kinematics.invariants_and_derivatives(jnp.asarray(F)))
    slope = psi.reshape(*F.shape[:2], 2).copy()
    slope[..., 1] *= 1.5 * np.sqrt(values[..., 1])
    P = np.einsum("tmk,tmkij->tmij", slope, first)
    gradients, areas = kinematics.shape_gradients(system.experiment.points, system.experiment.triangles)
    forces = np.einsum("tmij,maj,m->tmai", P, gradients, areas * (system.experiment.thickness or 1.0))
    return (forces**2).sum(axis=-1).max()


def reduced(system: Equilibrium, basis: Basis) -> Quadratic:
    """The paper's loss with frozen C_F as a quadratic form in spline coefficients."""
    c_f, c_l = force_scales(system)
    n_t = system.experiment.n_increments
    weights = np.tile(np.where(system.fields.boundary >= 0, 1 / (c_l * n_t), 1 / (c_f * n_t)), 2)
    n = basis.n_functions
    Q, q, constant, rows = np.zeros((n, n)), np.zeros(n), 0.0, 0
    for F, load in zip(system.deformation_gradients, system.loads, strict=True):
        known = np.isfinite(load)
        G = system.matrix(basis, F)[known]
        w, load = weights[known], load[known]
        Q += G.T @ (w[:, None] * G)
        q += G.T @ (w * load)
        constant += float(load @ (w * load))
        rows += int(known.sum())
    return Quadratic(basis, Q, q, constant, rows)


@dataclass(frozen=True)
class FullFit:
    """Result of `slsqp`: parameters (n_parameters,), loss, evaluations, seconds (compilation excluded) and SciPy's
    message."""

    architecture: pann.Architecture
    parameters: Array
    loss: float
    evaluations: int
    seconds: float
    message: str
    success: bool


def full_loss(system: Equilibrium, architecture: pann.Architecture, scaling: str) -> Callable:
    """Value and gradient (theta) of the paper's loss on the full data, compiled by JAX.

    theta (n_parameters,). Raises `ConfigError` for an unknown `scaling`, `MissingForceError` where a component of a
    force was not measured.
    """
    if scaling not in SCALINGS:
        raise errors.ConfigError(f"scaling '{scaling}' unknown; choose one of {', '.join(SCALINGS)}")
    experiment = system.experiment
    if not all(np.isfinite(b.force).all() for b in experiment.loaded):
        raise errors.MissingForceError("the paper's loss needs both force components of every loaded boundary")
    values, first = kinematics.invariants_and_derivatives(jnp.asarray(system.deformation_gradients))
    gradients, areas = kinematics.shape_gradients(experiment.points, experiment.triangles)
    B = jnp.asarray(gradients * (areas * (experiment.thickness or 1.0))[:, None, None])
    triangles, n, n_t = jnp.asarray(experiment.triangles), len(experiment.points), experiment.n_increments
    loaded = np.concatenate([b.nodes for b in experiment.loaded])
    free = jnp.asarray(np.isin(np.arange(n), loaded, invert=True).astype(float))
    measured = jnp.asarray(np.stack([b.force for b in experiment.loaded], axis=1))
    frozen, c_l = force_scales(system)

    def element_forces(theta):
        slope = pann.energy_derivatives(architecture, theta, values)
        P = jnp.einsum("tmk,tmkij->tmij", slope, first)
        return jnp.einsum("tmij,maj->tmai", P, B)

    def loss(theta):
        forces = element_forces(theta)
        c_f = frozen if scaling == "frozen" else jnp.max(jnp.sum(forces**2, axis=-1))
        nodal = jnp.zeros((n_t, n, 2)).at[:, triangles].add(forces)
        sums = jnp.stack([nodal[:, b.nodes].sum(axis=1) for b in experiment.loaded], axis=1)
        imbalance = jnp.sum(nodal**2 * free[:, None]) / (c_f * n_t)
        return imbalance + jnp.sum((sums - measured) ** 2) / (c_l * n_t)

    return jax.jit(jax.value_and_grad(loss))


def slsqp(value_and_gradient: Callable, architecture: pann.Architecture, start: Array, limit: int = 300) -> FullFit:
    """Minimise a loss from `start` (n_parameters,) by SciPy's SLSQP with the bounds of the PANN."""
    bounds = [(0, None) if nonnegative else (None, None) for nonnegative in architecture.nonnegative]
    value_and_gradient(jnp.asarray(start))[0].block_until_ready()
    begin = time.perf_counter()
    result = minimize(
        lambda theta: tuple(map(np.asarray, value_and_gradient(jnp.asarray(theta)))),
        start,
        jac=True,
        method="SLSQP",
        bounds=bounds,
        options={"maxiter": limit, "ftol": 1e-12},
    )
    seconds = time.perf_counter() - begin
    theta = np.maximum(result.x, np.where(architecture.nonnegative, 0.0, -np.inf))
    return FullFit(
        architecture, theta, float(result.fun), int(result.nfev), seconds, str(result.message), bool(result.success)
    )
