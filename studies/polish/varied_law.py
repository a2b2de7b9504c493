"""A law whose parameters a polish varies: the network of a model file, or a classical law.

In: parameters. Out: the material of the forward model; its stress as a combination of columns, whose coefficients the parameters fix; and the
parameters that meet linear equations for these coefficients best.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from calibrate.equations.basis import Basis, SingleBasis, TensorBasis
from calibrate.equations.inputs import INPUT_SETS
from calibrate.equations.reduction import Quadratic
from calibrate.fitting.network_fit import refitted
from calibrate.fitting.uncertainty import coefficients_and_slopes
from calibrate.models.classical_laws import Law
from calibrate.models.network_model import Model
from forward.materials import ArrudaBoyce, Gent, Material, MooneyRivlin, NeoHooke, Pann, Yeoh

Array = NDArray[np.float64]


class VariedLaw(Protocol):
    """parameters (p,). material: as the forward model solves it. coefficients (k,): of the columns. inputs: numbers of the invariants it depends on, input_tops their
    largest values J_k less those at rest in the data."""

    @property
    def parameters(self) -> Array: ...

    @property
    def material(self) -> Material: ...

    @property
    def coefficients(self) -> Array: ...

    @property
    def inputs(self) -> tuple[int, ...]: ...

    @property
    def input_tops(self) -> tuple[float, float]: ...

    def columns(self, F: Array) -> sp.csr_array:
        """Derivative (4 q, k) of the stress (q, 2, 2), flattened, by the coefficients, at F (q, 2, 2)."""
        ...

    def fitted(self, G: Array, target: Array) -> Array:
        """Parameters (p,) whose coefficients c bring G c (N, k) nearest to the target (N,), of unit variance."""
        ...

    def at(self, parameters: Array) -> Self:
        """The law with other parameters (p,)."""
        ...


def stress_columns(basis: Basis, F: Array) -> sp.csr_array:
    """Stress (4 q, k) of the functions of a basis at F (q, 2, 2), flattened."""
    P, columns = basis.local(F)
    q, used = columns.shape
    values = P.reshape(q, used, 4).swapaxes(1, 2).ravel()
    indices = np.repeat(columns, 4, axis=0).ravel()
    return sp.csr_array((values, indices, np.arange(0, 4 * q * used + 1, used)), shape=(4 * q, basis.n_functions))


@dataclass(frozen=True, eq=False)
class NetworkLaw:
    """The network of a model; its stress in the functions of a basis, see `calibrate.equations.basis`."""

    model: Model
    basis: SingleBasis | TensorBasis

    @property
    def parameters(self) -> Array:
        """Weights and biases (n_parameters,)."""
        return self.model.parameters

    @property
    def material(self) -> Material:
        """As read from the model file."""
        return Pann.from_dict(self.model.to_dict())

    @property
    def coefficients(self) -> Array:
        """(n_functions,)."""
        return coefficients_and_slopes(self.model.architecture, self.basis, self.model.parameters)[0]

    @property
    def inputs(self) -> tuple[int, ...]:
        """Of the network."""
        return tuple(INPUT_SETS[self.model.architecture.inputs])

    @property
    def input_tops(self) -> tuple[float, float]:
        """Of the basis."""
        return self.basis.input_tops

    def columns(self, F: Array) -> sp.csr_array:
        """Of the basis."""
        return stress_columns(self.basis, F)

    def quadratic(self, G: Array, target: Array) -> Quadratic:
        """|G c - target|^2."""
        return Quadratic(self.basis, G.T @ G, G.T @ target, float(target @ target), len(target))

    def fitted(self, G: Array, target: Array) -> Array:
        """By bounded Levenberg-Marquardt steps from the present parameters, with the prior of a calibration."""
        return refitted(self.quadratic(G, target), self.model.architecture, self.model.parameters)

    def at(self, parameters: Array) -> NetworkLaw:
        """With other weights and biases."""
        return replace(self, model=replace(self.model, parameters=parameters))


MATERIALS: dict[str, type[Material]] = {
    "neo-Hooke": NeoHooke, "Mooney-Rivlin": MooneyRivlin, "Yeoh": Yeoh, "Arruda-Boyce": ArrudaBoyce, "Gent": Gent,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class FittedLaw:
    """A classical law with parameters as they are fitted (reciprocal limits), which are also its coefficients, linearised."""

    law: Law
    parameters: Array
    input_tops: tuple[float, float]
    inputs: tuple[int, ...] = (0, 1)

    @property
    def coefficients(self) -> Array:
        """The parameters."""
        return self.parameters

    @property
    def material(self) -> Material:
        """With parameters as they are reported."""
        values = [p.value(float(x)) for p, x in zip(self.law.parameters, self.coefficients, strict=True)]
        return MATERIALS[self.law.name](*values)

    def columns(self, F: Array) -> sp.csr_array:
        """dP / d parameters."""
        slopes = self.law.stress_and_sensitivity(F, self.coefficients)[1]
        return sp.csr_array(slopes.reshape(len(slopes), -1).T)

    def fitted(self, G: Array, target: Array) -> Array:
        """Linear least squares in the bounds."""
        size = np.linalg.norm(G, axis=0)
        found = lsq_linear(G / size, target, (self.law.lower * size, np.full(len(size), np.inf)), method="bvls")
        return np.asarray(found.x / size)

    def at(self, parameters: Array) -> FittedLaw:
        """With other parameters."""
        return replace(self, parameters=parameters)
