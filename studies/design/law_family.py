r"""What is not known of the law before the test, and how the stress depends on it.

In: the expected law and how far it may be off. Out: `LawFamily`: k parameters theta with a normal prior, the values at knots by which
d psi / dI1 and d psi / dI2 differ from the expected law's (`forward.materials.tabulated`), and the nominal stress of the homogeneous
modes as a linear function of them. The prior is a Gaussian process for each of the two (Rasmussen and Williams 2006, section 2.2),

    cov f_k(I) f_k(I') = (deviation mu / 2)^2 exp(-(x - x')^2 / (2 l^2)),    x = sqrt((I - 3) / range),

mu the shear modulus at rest. What no specimen determines keeps the standard deviation of the prior. With closer knots nothing changes but
the cost; with independent values at a few knots one curve of states, such as uniaxial tension, would seem to tell both functions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.equations.deformation_modes import mode_invariants, nominal_stress, stretches_to_gradient
from calibrate.equations.kinematics import invariants_and_derivatives
from forward.materials import Material
from forward.materials.tabulated import Tabulated
from studies.accuracy.metrics import MaterialDerivatives

Array = NDArray[np.float64]
POINTS = 40  # stretches of a mode
JITTER = 1e-6  # of the prior's variance


@dataclass(frozen=True)
class LawFamily:
    """base: the expected law. stretches: {mode: up to where the stress is predicted}. largest_stretch: in any test, so that no test profits
    from deviations that are constant beyond the last knot. deviation, correlation_length l: see above. knots: of each invariant."""

    base: Material
    stretches: Mapping[str, float]
    largest_stretch: float = 3.5
    deviation: float = 0.5
    correlation_length: float = 0.3
    knots: int = 14

    @cached_property
    def tops(self) -> tuple[float, float]:
        """I1 - 3 and I2 - 3 at the last knots: largest of the predicted modes, and of pure shear at the largest stretch."""
        modes = [*self.stretches.items(), ("pure_shear", self.largest_stretch)]
        ends = np.concatenate([mode_invariants(mode, np.array([x])) for mode, x in modes])
        return float(ends[:, 0].max() - 3), float(ends[:, 1].max() - 3)

    @cached_property
    def places(self) -> tuple[Array, Array]:
        """Knots in I1 - 3 and I2 - 3, (knots,) each, quadratically spaced: in small strain these grow with the square of the strain."""
        share = np.linspace(0, 1, self.knots) ** 2
        return self.tops[0] * share, self.tops[1] * share

    @property
    def varied(self) -> Tabulated:
        """The deviations as a law, of which the forward sensitivities are taken; its own slopes play no part."""
        first, second = (tuple(places.tolist()) for places in self.places)
        ones = (1.0,) * self.knots
        return Tabulated(first, ones, second, ones)

    @property
    def size(self) -> int:
        """Number k of parameters: the values at the knots of I1, then of I2."""
        return 2 * self.knots

    @cached_property
    def prior(self) -> Array:
        """Factor L (k, k), MPa, of the prior's covariance L L^T."""
        x = np.linspace(0, 1, self.knots)
        one = np.exp(-((x[:, None] - x) ** 2) / (2 * self.correlation_length**2)) + JITTER * np.eye(self.knots)
        size = self.deviation * self.base.shear_modulus / 2
        return np.kron(np.eye(2), size * np.linalg.cholesky(one)).astype(np.float64)

    def hats(self, invariants: Array) -> Array:
        """d psi / d(I1, I2) per parameter, (..., 2, k), at invariants (..., 2)."""
        result = np.zeros((*invariants.shape, self.size))
        for i, places in enumerate(self.places):
            for j, unit in enumerate(np.eye(self.knots)):
                result[..., i, i * self.knots + j] = np.interp(invariants[..., i] - 3, places, unit)
        return result

    def stretch(self, mode: str) -> Array:
        """Stretches (p,) above 1 at which a mode is judged."""
        return np.linspace(1, self.stretches[mode], POINTS + 1)[1:]

    def stress(self, mode: str) -> Array:
        """Nominal stress (p,) of the expected law along the pull, MPa."""
        return nominal_stress(MaterialDerivatives(self.base), mode, self.stretch(mode))

    def stress_sensitivity(self, mode: str) -> Array:
        """Derivatives (p, k) of the nominal stress along the pull to the parameters."""
        stretch = self.stretch(mode)
        values, first = map(np.asarray, invariants_and_derivatives(jnp.asarray(stretches_to_gradient(mode, stretch))))
        return np.einsum("pik,pi->pk", self.hats(values), first[:, :, 0, 0])
