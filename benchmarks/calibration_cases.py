"""One case of the calibration benchmark: data, reduction, and each way to fit it, timed.

In: a solved cross, a number of triangles. Out: rows (dictionaries) with times, evaluations, losses and the stress
error in the three homogeneous modes within the calibrated range, none of which was fitted.

Every time is CPU time of this process (s), which does not depend on what else runs on the machine; wall time is
beside it. Compilation is timed apart: each measured call is made a second time, or after a call that compiles.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.equations.basis import Basis, basis_for
from calibrate.equations.equilibrium import Equilibrium
from calibrate.equations.inputs import REFERENCE
from calibrate.equations.reduction import Quadratic
from calibrate.fitting import network_fit, paper_loss
from calibrate.fitting.calibrated_range import calibrated_range
from calibrate.fitting.calibration import Options, calibrate
from calibrate.models import pann
from calibrate.models.network_model import Model
from studies.accuracy import metrics

Array = NDArray[np.float64]
ITERATIONS = 300
EFFORT = network_fit.Effort(ITERATIONS, ITERATIONS)


@dataclass
class Clock:
    """CPU and wall seconds of a block."""

    cpu: float = 0.0
    wall: float = 0.0
    _begin: tuple[float, float] = field(default=(0.0, 0.0), repr=False)

    def __enter__(self) -> Clock:
        self._begin = time.process_time(), time.perf_counter()
        return self

    def __exit__(self, *_: object) -> None:
        self.cpu = time.process_time() - self._begin[0]
        self.wall = time.perf_counter() - self._begin[1]


class OutOfTimeError(Exception):
    """The CPU time allowed for a row is used up."""


class Counted:
    """Value and gradient with a count, the best point seen, and a limit on CPU time.

    A point asked for twice in a row (`paper_loss.slsqp` warms up at its start) is evaluated and counted once.
    """

    def __init__(self, function: Callable, lower: Array, seconds: float) -> None:
        self.function, self.lower = function, lower
        self.end = time.process_time() + seconds
        self.evaluations, self.best, self.loss = 0, np.array([]), np.inf
        self.last: tuple[Array, tuple[jax.Array, jax.Array]] | None = None

    def __call__(self, theta: jax.Array) -> tuple[jax.Array, jax.Array]:
        if self.last is not None and np.array_equal(self.last[0], theta):
            return self.last[1]
        if time.process_time() > self.end and self.evaluations:
            raise OutOfTimeError
        value, gradient = self.function(theta)
        self.last = np.asarray(theta), (value, gradient)
        self.evaluations += 1
        if float(value) < self.loss and (np.asarray(theta) >= self.lower - 1e-12).all():
            self.best, self.loss = np.asarray(theta), float(value)
        return value, gradient


@dataclass(frozen=True)
class Case:
    """One experiment and one set of inputs. limit: first invariant up to which models are compared with the truth."""

    experiment: Experiment
    inputs: str
    limit: float

    @cached_property
    def system(self) -> Equilibrium:
        """The paper's equations: one for each free node and component, one for each boundary and component."""
        return paper_loss.nodal_system(self.experiment)

    @cached_property
    def basis(self) -> Basis:
        return basis_for(self.inputs, self.system.deformation_gradients.reshape(-1, 2, 2))

    @cached_property
    def reduction(self) -> tuple[Quadratic, Array, Clock]:
        """The paper's loss with C_F frozen as a quadratic form, its convex spline, and the time both took."""
        with Clock() as clock:
            quadratic = paper_loss.reduced(self.system, self.basis)
            spline = network_fit.convex_spline(quadratic, self.inputs)
        return quadratic, spline, clock

    def reduced_loss(self, architecture: pann.Architecture) -> Callable[[jax.Array], tuple[jax.Array, jax.Array]]:
        """Value and gradient of the reduced loss: the same objective as the full one, to the spline's accuracy."""
        quadratic = self.reduction[0]
        J = np.nan_to_num(self.basis.site_inputs) + REFERENCE
        sites = jnp.asarray(np.stack([J[:, 0], J[:, 1] ** (2 / 3)], axis=1))
        chain = jnp.stack([jnp.ones(len(J)), 1 / (1.5 * jnp.sqrt(sites[:, 1]))], axis=1)
        interpolation = jnp.asarray(self.basis.interpolation)
        Q, q = jnp.asarray(quadratic.Q), jnp.asarray(quadratic.q)

        def loss(theta: jax.Array) -> jax.Array:
            psi = pann.energy_derivatives(architecture, theta, sites) * chain
            c = interpolation @ psi.ravel()
            return c @ Q @ c - 2 * q @ c + quadratic.constant

        return jax.jit(jax.value_and_grad(loss))

    def held_out(self, architecture: pann.Architecture, parameters: Array) -> dict[str, float]:
        """Largest over the three modes: |mean stress error|, 1 - r2 and maximum error, all relative."""
        found = metrics.agreement(Model(architecture, parameters), metrics.ArrudaBoyceTruth(), self.limit)
        return {
            "stress_bias": max(abs(a.bias) for a in found),
            "stress_1_minus_r2": max(1 - a.r2 for a in found),
            "stress_max_error": max(a.max_error for a in found),
        }


def reference_limit(experiment: Experiment) -> float:
    """99.9 % quantile of I1 of the clean data: the calibrated range."""
    return calibrated_range(paper_loss.nodal_system(experiment))["I1"][1]


def starting_points(architecture: pann.Architecture, n: int, seed: int) -> list[Array]:
    """The random starts of `network_fit.fit_network`, (n_parameters,) each."""
    keys = jax.random.split(jax.random.key(seed), n)
    return [np.asarray(architecture.random_start(key)) for key in keys]


def gauss_newton(
    case: Case, layers: tuple[int, ...], starts: int, seed: int
) -> tuple[dict[str, Any], pann.Architecture]:
    """Bounded Gauss-Newton on the reduction: distilled from the convex spline, then polished."""
    quadratic, spline, assembly = case.reduction
    with Clock() as first:
        network_fit.fit_network(quadratic, case.inputs, layers, spline, starts, seed, EFFORT)
    with Clock() as second:
        architecture, result = network_fit.fit_network(quadratic, case.inputs, layers, spline, starts, seed, EFFORT)
    row = {
        **times(second, first.cpu - second.cpu, assembly.cpu),
        "starts_done": starts,
        "evaluations": int(result.iterations.sum()),
        "loss": result.loss,
        "loss_reduced": float(case.reduced_loss(architecture)(jnp.asarray(result.parameters))[0]),
        "converged": result.reasons.count("converged"),
        **case.held_out(architecture, result.parameters),
    }
    return row, architecture


def slsqp(
    case: Case, architecture: pann.Architecture, full: bool, starts: int, seed: int, seconds: float
) -> dict[str, Any]:
    """SLSQP from the same starts, on the full data or on the reduction, for at most `seconds` of CPU time."""
    function = paper_loss.full_loss(case.system, architecture, "frozen") if full else case.reduced_loss(architecture)
    points = starting_points(architecture, starts, seed)
    with Clock() as compilation:
        jax.block_until_ready(function(jnp.asarray(points[0])))
    counted = Counted(function, np.where(architecture.nonnegative, 0.0, -np.inf), seconds)
    finished, converged = 0, 0
    with Clock() as clock:
        try:
            for point in points:
                result = paper_loss.slsqp(counted, architecture, point, ITERATIONS)
                finished, converged = finished + 1, converged + result.success
        except OutOfTimeError:
            pass
    theta = counted.best
    assembly = 0.0 if full else case.reduction[2].cpu
    return {
        **times(clock, compilation.cpu, assembly),
        "starts_done": finished,
        "evaluations": counted.evaluations,
        "loss": counted.loss,
        "loss_reduced": float(case.reduced_loss(architecture)(jnp.asarray(theta))[0]),
        "converged": converged,
        **case.held_out(architecture, theta),
    }


def weighted(case: Case, layers: tuple[int, ...], starts: int, seed: int) -> dict[str, Any]:
    """The default calibration as a user runs it, assembly included in its time."""
    options = Options(case.inputs, layers, starts=starts, seed=seed)
    with Clock() as first:
        calibrate(case.experiment, replace(options))
    with Clock() as second:
        result = calibrate(case.experiment, options)
    model = result.model
    return {
        **times(second, first.cpu - second.cpu, 0.0),
        "starts_done": starts,
        "evaluations": None,
        "loss": result.loss,
        "loss_reduced": float(case.reduced_loss(model.architecture)(jnp.asarray(model.parameters))[0]),
        "converged": None,
        **case.held_out(model.architecture, model.parameters),
    }


def times(clock: Clock, compilation: float, assembly: float) -> dict[str, float]:
    return {
        "cpu_seconds": clock.cpu,
        "wall_seconds": clock.wall,
        "compile_cpu_seconds": max(compilation, 0.0),
        "assembly_cpu_seconds": assembly,
    }
