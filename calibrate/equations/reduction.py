"""Reduction of the weighted equilibrium-gap loss to a small quadratic form in spline coefficients.

In: an Experiment and a basis. Out: `Quadratic`, loss(c) = c^T Q c - 2 q^T c + constant, with which any model is
fitted in milliseconds, whatever the mesh. The weights derive from the noise: residuals are divided by the
Cholesky factor of their covariance K Sigma_u K^T + Sigma_force, with K the tangent at the current estimate. With
the true K the fit is one Gauss-Newton step of FEMU, and at the true material the loss is chi-square distributed
with one degree of freedom an equation.

The covariance is held while the loss is minimised and updated between passes; that it is proportional to the
square of the stiffness is taken into account afterwards, in closed form (`Quadratic.stiffness_factor`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate import errors
from calibrate.data.experiment import Noise
from calibrate.data.load_path import samples
from calibrate.equations import kinematics, noise_covariance
from calibrate.equations.basis import Basis, PlaneStrainBasis
from calibrate.equations.equilibrium import Equilibrium, best_neo_hooke
from calibrate.equations.noise_covariance import EquationNoise, cholesky_factor
from calibrate.equations.weights import Weights, weights_of

Array = NDArray[np.float64]
SAMPLES = 100  # of noise, for what it adds to squares on average: to sqrt(2 / (100 N)) of N equations
DENSE = 4000  # nodes up to which a covariance between them is formed
RELIABLE = 0.5  # share of a combination of both parts of the stress that must be no noise, in plane strain
Progress = Callable[[int, int], None]


def stiffness_factor(loads: float, product: float) -> float:
    """Factor on the best stiffness when the covariance follows it, as it does: Sigma = s^2 Sigma(c), c -> s c.

    loads: squares of the whitened loads b^T b; product: with the internal forces of the fit, b^T A c. Minimising (s^2 |A c|^2 - 2 s b^T A c + b^T b) / s^2 over s gives
    s = b^T b / b^T A c. With a fixed covariance, equations without a measured force are met best by no stiffness at all, which attenuates it by
    about loss / b^T b: 0.3 % on noisy synthetic data, tens of percent where the model leaves much unexplained. Raises `FitError` where the fit pulls against the loads.
    """
    if not product > 0.0:
        raise errors.FitError(
            "a fit has no stiffness left, or pulls against the measured forces; check their signs and units"
        )
    return loads / product


@dataclass(frozen=True)
class Quadratic:
    """loss(c) = c^T Q c - 2 q^T c + constant; dimensionless, from `n_rows` equations; Q (n, n), q (n,)."""

    basis: Basis
    Q: Array
    q: Array
    constant: float
    n_rows: int

    def loss(self, c: Array) -> float:
        """The loss of spline coefficients c (n_functions,)."""
        return float(c @ self.Q @ c - 2 * self.q @ c + self.constant)

    def factor(self) -> tuple[Array, Array]:
        """R (r, n), d (r,) with loss = |R c - d|^2 + constant - |d|^2; directions without information dropped."""
        if not self.Q.any():
            return np.zeros((0, len(self.q))), np.zeros(0)
        scale = np.sqrt(np.maximum(np.diag(self.Q), 1e-14 * np.diag(self.Q).max()))
        values, vectors = np.linalg.eigh(self.Q / np.outer(scale, scale))
        keep = values > 1e-12 * values.max()
        root = np.sqrt(values[keep])
        return (vectors[:, keep] * root).T * scale, (vectors[:, keep].T @ (self.q / scale)) / root

    def stiffness_factor(self, c: Array) -> float:
        """Factor on the best c when the covariance follows the stiffness, see the function of that name."""
        return stiffness_factor(self.constant, float(self.q @ c))

    def coefficients_of_weights(self, c: Array, neo_hooke: Array) -> Array:
        """Those for the next weights of a fit c (n_functions,), see `coefficients_of_weights`; neo_hooke: of any stiffness."""
        level = float(self.q @ c) / float(self.q @ neo_hooke)
        return coefficients_of_weights(self.basis, c, level * neo_hooke, self.loss(c) / self.n_rows)

    def of_energy(self) -> Quadratic:
        """The least loss over all bulk moduli, as a function of the other coefficients; itself where there is none."""
        if not isinstance(self.basis, PlaneStrainBasis):
            return self
        Q, q, column = self.Q[:-1, :-1], self.q, self.Q[:-1, -1]
        weight = max(float(self.Q[-1, -1]), 1e-300)
        return Quadratic(
            self.basis.energy,
            Q - np.outer(column, column) / weight,
            q[:-1] - column * q[-1] / weight,
            self.constant - float(q[-1]) ** 2 / weight,
            self.n_rows,
        )

    def with_bulk_modulus(self, c: Array) -> Array:
        """Coefficients of the energy with the bulk modulus of least loss; c itself where there is none."""
        if not isinstance(self.basis, PlaneStrainBasis):
            return c
        return np.append(c, (self.q[-1] - self.Q[:-1, -1] @ c) / self.Q[-1, -1])

    def __add__(self, other: Quadratic) -> Quadratic:
        """The loss of two experiments together; both must have been assembled with the same basis."""
        if self.basis != other.basis:
            raise ValueError("two losses can be added only on the same basis: assemble both with one `basis`")
        return Quadratic(
            self.basis, self.Q + other.Q, self.q + other.q, self.constant + other.constant, self.n_rows + other.n_rows
        )


@dataclass(frozen=True)
class Assembled:
    """What does not depend on the weights: assembled once, weighted many times.

    noise_factor, between: see `noise_covariance.noise_factor` and `between_increments`. progress: called with (done, total) while `matrices` are made.
    """

    system: Equilibrium
    basis: Basis
    noise: Noise
    noise_is_known: bool
    noise_factor: sp.csr_array = field(repr=False)
    between: Array = field(repr=False)
    progress: Progress | None = field(default=None, repr=False)

    @cached_property
    def matrices(self) -> list[Array]:
        """G (rows, n_functions) of every increment."""
        found = []
        for i, F in enumerate(self.system.deformation_gradients):
            found.append(self.system.matrix(self.basis, F))
            if self.progress:
                self.progress(i + 1, self.system.experiment.n_increments)
        return found

    @property
    def variances(self) -> Array:
        """Variance (t,) of the noise of a displacement in each increment, over that of what is new in it."""
        return np.diag(self.between)

    @cached_property
    def fewest_sources(self) -> sp.csr_array | Array:
        """noise_factor, or where it has more sources than there are nodes, as for noise correlated over little more than their distance, the Cholesky
        factor of the same covariance."""
        n, s = self.noise_factor.shape
        if s <= n or n > DENSE:
            return self.noise_factor
        return cholesky_factor((self.noise_factor @ self.noise_factor.T).toarray())

    @cached_property
    def noise_axes(self) -> Array:
        """Of the noise of gradients (m, 2, 2), see `kinematics.gradient_axes`."""
        return kinematics.gradient_axes(self.system.gradient, self.noise_factor)

    @cached_property
    def linear_change(self) -> Array:
        """By how much G (t, 2 v, n_functions) changes when the triangles are taken for linear again, see `Equilibrium.linear`."""
        linear = replace(self.system, linear=True)
        each = zip(linear.deformation_gradients, self.matrices, strict=True)
        return np.array([linear.matrix(self.basis, F) - G for F, G in each])

    def weights(self, c: Array) -> Weights:
        """Of all equations that are measured, by what noise does to them at coefficients c (n_functions,)."""
        return weights_of(self.noise_at(c), np.isfinite(self.system.loads))

    def quadratic(self, weights: Weights) -> Quadratic:
        """The noise-weighted loss."""
        G, load = self.weighted_equations(weights)
        return Quadratic(self.basis, G.T @ G, G.T @ load, float(load @ load), len(load))

    def weighted_equations(self, weights: Weights) -> tuple[Array, Array]:
        """G (N, n_functions) and load (N,) of the weighted equations, with residuals of unit covariance."""
        return weights(np.moveaxis(np.array(self.matrices), -1, 0)).T, weights(np.nan_to_num(self.system.loads))

    def noise_at(self, c: Array, u: Array | None = None) -> EquationNoise:
        """What noise does to the residuals at coefficients c (n_functions,), at displacements u (t, n, 2), mm (None: those measured)."""
        return EquationNoise.of(self.system, self.noise, self._spreads(c, u), self.samples[1])

    @cached_property
    def samples(self) -> tuple[NDArray[np.int64], Array]:
        """Increments (k,) from which what noise does is known in all, and their shares (t, k), see `load_path.samples`."""
        return samples(self.system.experiment.displacements)

    def _spreads(self, c: Array, u: Array | None = None) -> Array:
        chosen = self.samples[0]
        if u is None:
            some = self.system.deformation_gradients[chosen]
        else:
            some = kinematics.deformation_gradients(self.system.gradient, u[chosen])
        each = (noise_covariance.spread(self.system, self.basis, c, F, self.fewest_sources) for F in some)
        return stacked(each, len(some))

    def noise_of_parts(self, c: Array, rows: NDArray[np.bool_] | None = None) -> Array:
        """(2, 2): what noise adds, on average of `SAMPLES`, to the squares and product of the isochoric and the volumetric part of the
        weighted G c in plane strain; weights at coefficients c (n_functions,), as in `quadratic`. rows (t, 2 v): those used."""
        parts = [self._spreads(part) for part in _parts(c).T]
        noise = EquationNoise.of(self.system, self.noise, parts[0] + parts[1], self.samples[1])
        weights = weights_of(noise, np.isfinite(self.system.loads) if rows is None else rows)
        rng, root = np.random.default_rng(0), noise_covariance.root(self.between)
        numbers = [root @ rng.standard_normal((len(root), parts[0].shape[2])) for _ in range(SAMPLES)]
        each = np.array([[weights(noise.residuals(one, part)) for part in parts] for one in numbers])
        return np.asarray(np.einsum("nir,njr->ij", each, each) / SAMPLES)

    def first_guess(self, used: NDArray[np.bool_] | None = None) -> Array:
        """Coefficients (n_functions,) of neo-Hooke with the modulus that fits the forces: start of the weighting. used (t, 2 v): the equations fitted, None for all."""
        return best_neo_hooke(self.system, self.basis, used)


def stacked(spreads: Iterable[Array], k: int) -> Array:
    """Spreads (k, r, s) of samples, of k of them (r, s), as they come: they are never held twice."""
    found: Array | None = None
    for i, one in enumerate(spreads):
        found = np.empty((k, *one.shape)) if found is None else found
        found[i] = one
    assert found is not None
    return found


def _parts(c: Array) -> Array:
    """(n_functions, 2): coefficients of the isochoric part alone, and of the volumetric part alone."""
    return np.column_stack([np.append(c[:-1], 0.0), np.append(np.zeros(len(c) - 1), c[-1])])


def corrected(
    quadratic: Quadratic,
    c: Array,
    weights: Array,
    tests: Sequence[Assembled],
    rows: Sequence[NDArray[np.bool_] | None] | None = None,
    reliable: float = RELIABLE,
) -> Array:
    """The best c (n_functions,) with the stiffness that noise attenuates put right; weights: those that the loss belongs to.

    In plane stress by `Quadratic.stiffness_factor`. In plane strain noise in the measured change of volume, times a large bulk
    modulus, adds to the squares of the volumetric stress, so that least squares take the bulk modulus for too small (errors in
    variables; Fuller 1987): isochoric and volumetric part have a factor each, and what noise adds to their squares on average is
    taken off. Where the noise is unknown, one factor for both. Raises `FitError` where of a combination of them less than the share
    `reliable` is no noise.
    """
    if not isinstance(quadratic.basis, PlaneStrainBasis) or not all(test.noise_is_known for test in tests):
        return quadratic.stiffness_factor(c) * c
    noise = np.zeros((2, 2))
    for test, used in zip(tests, rows or [None] * len(tests), strict=True):
        noise += test.noise_of_parts(weights, used)
    parts, old = _parts(c), _parts(weights)
    squares = parts.T @ quadratic.Q @ parts
    size = np.sqrt(np.diag(squares) / np.maximum(np.diag(old.T @ quadratic.Q @ old), 1e-300))
    true = squares - noise * np.outer(size, size)
    try:
        share = float(scipy.linalg.eigh(true, squares, eigvals_only=True)[0])
    except np.linalg.LinAlgError:
        raise errors.FitError(
            "these data cannot tell the bulk modulus from the shear modulus: in plane strain the volume must change by other shares "
            "in other places or increments; calibrate on a specimen with holes"
        ) from None
    if not share > reliable:
        raise errors.FitError(
            f"noise hides the change of volume: of what it tells of the stress in plane strain, {1 - share:.0%} is noise, at most "
            f"{1 - reliable:.0%} may be; a body of so large a bulk modulus needs a test with less noise"
        )
    return parts @ np.linalg.solve(true, parts.T @ quadratic.q)


def coefficients_of_weights(basis: Basis, c: Array, neo_hooke: Array, dispersion: float) -> Array:
    """Coefficients (n_functions,) whose noise weights the equations of a material c: its own where it leaves noise alone (dispersion 1), and the more it leaves, the more those
    of neo-Hooke, as stiff as c.

    What a material misses does not scale with its stiffness as noise does. Weights that followed it would take the equations where it is soft for
    exact ones, and the next fit would be softer still there, down to no modulus at rest. In plane strain they are its own: what noise adds to the change of
    volume looks like what a model misses, and is taken off with its weights, see `corrected`.
    """
    if isinstance(basis, PlaneStrainBasis):
        return c
    return neo_hooke + (c - neo_hooke) / max(dispersion, 1.0)


def assemble(system: Equilibrium, basis: Basis, progress: Progress | None = None) -> Assembled:
    """The equations of a basis and their noise. progress: see `Assembled`.

    Where the noise is unknown, `noise_covariance.default_noise` weights the equations and the loss is no chi-square.
    """
    experiment = system.experiment
    noise = experiment.noise
    noise_is_known = noise is not None and noise.displacement_std > 0
    if noise is None or not noise_is_known:
        noise = noise_covariance.default_noise(experiment, system.fields.spacing)
    factor = noise_covariance.noise_factor(experiment, noise)
    between = noise_covariance.between_increments(experiment, noise)
    return Assembled(system, basis, noise, noise_is_known, factor, between, progress)
