r"""Many calibrations of the same tests: several experiments together, several sets of invariants, several sizes of network.

In: equilibrium systems. Out: `JointFit`, a network with its loss, why every start stopped and how the starts agree. What is costly is done
once:

- `weighted_test`: the noise covariance of every equation of a test, at the convex function of I1 that suits this test alone best, so that
  losses of all inputs and sizes are comparable and a test weighs by its noise wherever it is used;
- `reduce`: the loss of several tests together as one small quadratic form, for one set of invariants, and its convex spline;
- `fit`: one size of network, from many starts at once.

What increments have in common of the noise (`Noise`) counts as new in each. Losses of independent tests add: their noise is independent, and each is weighted by its own (`calibrate.equations.reduction`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.data.experiment import Noise
from calibrate.equations import noise_covariance
from calibrate.equations.basis import Basis, basis_for
from calibrate.equations.equilibrium import Equilibrium, best_neo_hooke
from calibrate.equations.reduction import Quadratic, stiffness_factor
from calibrate.equations.unseen_strip import WindowEquilibrium
from calibrate.fitting import network_fit
from calibrate.fitting.stopping import Stop
from calibrate.models import pann

Array = NDArray[np.float64]
FIRST = slice(None, None, -3)  # increments that tell the law at which all are weighted
# A small step: some tenths of the loss, where noise leaves `LIKELY` undecided.
EFFORT = network_fit.Effort(distillation=40, iterations=150, tolerance=2e-5)
LIKELY = 9.0  # rise of the loss, in units of its mean over the equations, up to which a start counts as good as the best: three deviations


@dataclass(frozen=True)
class WeightedTest:
    """A test and the Cholesky factors (r, r), N, of the noise of its equations, those with a measured load, by increment."""

    system: Equilibrium
    lowers: Mapping[int, Array]

    def quadratic(self, basis: Basis) -> Quadratic:
        """The noise-weighted loss in a basis that covers the test."""
        n = basis.n_functions
        loss = Quadratic(basis, np.zeros((n, n)), np.zeros(n), 0.0, 0)
        for i, lower in self.lowers.items():
            F, load = self.system.deformation_gradients[i], self.system.loads[i]
            known = np.isfinite(load)
            both = np.column_stack([self.system.matrix(basis, F)[known], load[known]])
            G, d = np.split(scipy.linalg.solve_triangular(lower, both, lower=True), [-1], axis=1)
            loss += Quadratic(basis, G.T @ G, G.T @ d[:, 0], float((d**2).sum()), len(d))
        return loss


def weighted_test(system: Equilibrium) -> WeightedTest:
    """The equations of a test with their weights. Raises `FitError`, see `calibrate.fitting.network_fit.convex_spline`."""
    experiment = system.experiment
    noise = experiment.noise
    if noise is None or not noise.displacement_std > 0:
        noise = noise_covariance.default_noise(experiment, system.fields.spacing)
    basis = basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2), plane=experiment.plane)
    factor = noise_covariance.noise_factor(experiment, noise)
    of_points = sp.csr_array(factor @ factor.T)
    variances = np.diag(noise_covariance.between_increments(experiment, noise))
    c = best_neo_hooke(system, basis)
    for increments in (range(experiment.n_increments)[FIRST], range(experiment.n_increments)):
        lowers = {}
        for i in increments:
            covariance = residual_covariance(system, basis, c, i, of_points * variances[i], noise)
            measured = np.isfinite(system.loads[i])
            lowers[i] = noise_covariance.cholesky_factor(covariance[np.ix_(measured, measured)])
        test = WeightedTest(system, lowers)
        if increments != range(experiment.n_increments):
            loss = test.quadratic(basis)
            c = network_fit.convex_spline(loss, "I1")
            c = loss.stiffness_factor(c) * c
    return test


def residual_covariance(
    system: Equilibrium, basis: Basis, c: Array, increment: int, of_points: sp.csr_array, noise: Noise
) -> Array:
    """Covariance (2 n_fields, 2 n_fields), N^2, of the residuals of an increment: camera, load cell and, where there is one, the strip.

    of_points (n_nodes, n_nodes), mm^2: covariance of a displacement, sparse because it dies out within some correlation lengths.
    """
    F, load = system.deformation_gradients[increment], system.loads[increment]
    blocks = system.tangent(basis, F, c)
    spread = [[block @ of_points for block in row] for row in blocks]
    camera = np.block([
        [sum((s @ b.T).toarray() for s, b in zip(one, other, strict=True)) for other in blocks] for one in spread
    ])  # fmt: skip
    nothing = np.zeros((len(load), 0))
    error = system.strip_error(basis, c, increment) if isinstance(system, WindowEquilibrium) else nothing
    return camera + error @ error.T + noise_covariance.covariance_of(system, nothing, load, noise)


@dataclass(frozen=True)
class Reduced:
    """The loss of several tests together for one set of invariants. spline: coefficients (n_functions,) of its convex spline."""

    inputs: str
    quadratic: Quadratic
    spline: Array = field(repr=False)


def reduce(tests: Sequence[WeightedTest], inputs: str) -> Reduced:
    """Raises `FitError` where the data do not constrain the material, `ConfigError` for unknown inputs or no test."""
    gradients = np.concatenate([test.system.deformation_gradients.reshape(-1, 2, 2) for test in tests])
    basis = basis_for(inputs, gradients, plane=tests[0].system.experiment.plane)
    total = tests[0].quadratic(basis)
    for test in tests[1:]:
        total += test.quadratic(basis)
    spline = network_fit.convex_spline(total, inputs)
    return Reduced(inputs, total, spline)


@dataclass(frozen=True)
class JointFit:
    """A network fitted to several tests. losses, reasons, parameters (s, p): of every start; best: the number of the one of least loss.

    loss_per_equation: of the best, about 1 where the model is right and the noise known.
    """

    architecture: pann.Architecture
    parameters: Array
    losses: Array
    reasons: tuple[Stop, ...]
    best: int
    loss_per_equation: float

    @property
    def likely(self) -> NDArray[np.int64]:
        """Starts whose loss is as good as the best one's, as far as noise allows it to be told."""
        return np.flatnonzero(self.losses <= self.losses[self.best] + LIKELY * max(1.0, self.loss_per_equation))

    @property
    def agreement(self) -> float:
        """Share of the starts that are likely."""
        return len(self.likely) / len(self.losses)


def fit(reduced: Reduced, layers: tuple[int, ...], starts: int = 20, seed: int = 0) -> JointFit:
    """Fit one size of network. Raises `FitError` when no start reached a finite loss, or the best leaves no stiffness.

    The stiffness is put right by `stiffness_factor`: at the best scale of c, q^T c is what the loss falls by.
    """
    quadratic = reduced.quadratic
    architecture, found = network_fit.fit_network(
        quadratic, reduced.inputs, layers, reduced.spline, starts, seed, EFFORT
    )
    best = int(np.nanargmin(found.losses))
    factor = stiffness_factor(quadratic.constant, quadratic.constant - found.loss)
    architecture = replace(architecture, energy_scale=factor * architecture.energy_scale)
    per_equation = found.loss / quadratic.n_rows
    return JointFit(architecture, found.all_parameters, found.losses, found.reasons, best, per_equation)
