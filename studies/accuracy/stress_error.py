"""How wrong are stress and energy of a calibrated model, state by state: a Model and deformation states in, % out.

The states are those of the 2D reference at its Gauss points in all increments, weighted by area; only those within the
calibrated range of I1 are judged. With P the in-plane first Piola-Kirchhoff stress in plane stress and |P| its
Frobenius norm, the error of a component is

    100 (P_model - P_true)_ij sign(P_true)_ij / |P_true|,

positive where the model is too stiff, whichever way the stress points (shear has both signs in equal share in the whole
specimen). Along the stress, 100 (P_model - P_true) : P_true / |P_true|^2 is the error of the stiffness as a whole.
The energy error is 100 (psi_model - psi_true) / psi_true.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.equations.kinematics import invariants_and_derivatives
from calibrate.models.network_model import Model
from forward.solution import SurfaceSolution
from studies.accuracy.epsilon import weighted_quantile
from studies.accuracy.metrics import ArrudaBoyceTruth, Derivatives
from studies.output import write_npz

Array = NDArray[np.float64]
COMPONENTS = {"P11": (0, 0), "P22": (1, 1), "P12": (0, 1)}
SHARES = {"median": 0.5, "p05": 0.05, "p25": 0.25, "p75": 0.75, "p95": 0.95}
AT_REST = 1e-9  # I1 - 3 below which a relative error means nothing


@dataclass(frozen=True, eq=False)
class States:
    """Deformation states: in-plane F (s, 2, 2), weights (s,), invariants (s, 2)."""

    F: Array
    weights: Array
    invariants: Array

    @classmethod
    def of(cls, solution: SurfaceSolution) -> Self:
        """Every Gauss point in every increment of a plane-stress solution; weights: area, mm^2."""
        _, weights, F = solution.gauss()
        F = F.reshape(-1, 2, 2)
        return cls(
            F, np.tile(weights, len(F) // len(weights)), np.asarray(invariants_and_derivatives(jnp.asarray(F))[0])
        )

    def save(self, path: str | Path) -> None:
        """Write a .npz with one array a field, atomically."""
        write_npz(path, F=self.F, weights=self.weights, invariants=self.invariants)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote."""
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as content:
            return cls(content["F"], content["weights"], content["invariants"])

    def within(self, limit: float) -> Self:
        """The states that are deformed at all, with I1 up to `limit`."""
        I1 = self.invariants[:, 0]
        chosen = (I1 > 3 + AT_REST) & (limit >= I1)
        return type(self)(self.F[chosen], self.weights[chosen], self.invariants[chosen])


@dataclass(frozen=True, eq=False)
class Reference:
    """The truth at states: stress (s, 2, 2) and energy (s,), MPa. Made once, it serves every model."""

    states: States
    stress: Array
    energy: Array

    @classmethod
    def at(cls, states: States, truth: Derivatives = ArrudaBoyceTruth()) -> Self:
        """truth: d psi / d(I1, I2), a polynomial of degree up to 7 for the energy to be exact."""
        values, slopes = map(np.asarray, invariants_and_derivatives(jnp.asarray(states.F)))
        return cls(states, np.einsum("sk,skij->sij", truth(values), slopes), energy_of(truth, states.invariants))


def energy_of(truth: Derivatives, invariants: Array) -> Array:
    """psi (s,) at invariants (s, 2) by Gauss integration of d psi along the straight line from rest."""
    x, w = np.polynomial.legendre.leggauss(4)
    change = invariants - 3.0
    slopes = np.array([truth(3.0 + t * change) for t in (x + 1) / 2])
    return np.einsum("q,qsk,sk->s", w / 2, slopes, change)


def stress_errors(model: Model, reference: Reference) -> Array:
    """Signed error (s, 3) of P11, P22, P12, %, at the states of the reference."""
    true = reference.stress
    off = (model.nominal_stress(reference.states.F) - true) * np.sign(true)
    norm = np.linalg.norm(true, axis=(1, 2))
    return 100 * np.stack([off[:, i, j] / norm for i, j in COMPONENTS.values()], axis=1)


def stiffness_errors(model: Model, reference: Reference) -> Array:
    """Signed error (s,) along the stress, %."""
    true = reference.stress
    off = model.nominal_stress(reference.states.F) - true
    return 100 * (off * true).sum(axis=(1, 2)) / (true**2).sum(axis=(1, 2))


def energy_errors(model: Model, invariants: Array, truth: Array) -> Array:
    """Signed error (s,) of the energy, %, at invariants (s, 2); truth (s,): MPa."""
    found = np.asarray(jax.vmap(model.energy)(jnp.asarray(invariants)))
    return 100 * (found / truth - 1)


@dataclass(frozen=True)
class Quantiles:
    """Area-weighted statistics of a signed error, %."""

    median: float
    p05: float
    p25: float
    p75: float
    p95: float
    mean: float

    @classmethod
    def of(cls, errors: Array, weights: Array) -> Self:
        """Of errors (s,) with weights (s,)."""
        found = {name: weighted_quantile(errors, weights, share) for name, share in SHARES.items()}
        return cls(**found, mean=float(np.average(errors, weights=weights)))


@dataclass(frozen=True)
class EnergyErrors:
    """Area-weighted statistics of the energy error, %: of its size, and its mean with sign."""

    median_abs: float
    p95_abs: float
    mean: float


@dataclass(frozen=True)
class StateErrors:
    """Errors of a model at the states of a reference, %. stress: by component; stiffness: along the stress."""

    KEYS: ClassVar[tuple[str, ...]] = ("stress_error", "stiffness_error", "energy_error")  # in a file

    stress: dict[str, Quantiles]
    stiffness: Quantiles
    energy: EnergyErrors

    @classmethod
    def of(cls, model: Model, reference: Reference) -> Self:
        """Judge a model at the states of a reference."""
        weights = reference.states.weights
        errors = stress_errors(model, reference)
        energy = energy_errors(model, reference.states.invariants, reference.energy)
        median, high = (weighted_quantile(np.abs(energy), weights, share) for share in (0.5, 0.95))
        return cls(
            {name: Quantiles.of(errors[:, i], weights) for i, name in enumerate(COMPONENTS)},
            Quantiles.of(stiffness_errors(model, reference), weights),
            EnergyErrors(median, high, float(np.average(energy, weights=weights))),
        )

    def to_dict(self) -> dict[str, Any]:
        """By `KEYS`."""
        return dict(zip(self.KEYS, asdict(self).values(), strict=True))

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Self:
        """Of what `to_dict` gave, other keys ignored."""
        stress, stiffness, energy = (content[key] for key in cls.KEYS)
        parts = {name: Quantiles(**part) for name, part in stress.items()}
        return cls(parts, Quantiles(**stiffness), EnergyErrors(**energy))
