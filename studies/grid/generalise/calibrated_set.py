"""One calibration of the study: tests that are fitted together, invariants, size of the network; in typed form, to a file and back.

Of each: loss, why its starts stopped and how they agree, r2_F on every specimen, nominal stresses in the homogeneous modes with the band over
its likely starts. Stresses in MPa, stretches of `stretches`.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any, Self

import jax
import numpy as np
from numpy.typing import NDArray

from calibrate.equations.deformation_modes import MODES, largest_stretch, mode_invariants, nominal_stress
from calibrate.equations.inputs import REFERENCE
from calibrate.fitting.joint_calibration import JointFit
from calibrate.fitting.network_fit import NetworkResidual
from calibrate.models import pann

Array = NDArray[np.float64]
POINTS = 41  # of a predicted curve


@dataclass(frozen=True)
class Prediction:
    """Nominal stress (k,) of the best start, and the lowest and highest of the likely ones."""

    stress: list[float]
    low: list[float]
    high: list[float]


@dataclass(frozen=True)
class CalibratedSet:
    """See above. scores: r2_F by specimen, of the best start; reasons: number of starts by why they stopped."""

    tests: str
    inputs: str
    layers: tuple[int, ...]
    loss_per_equation: float
    losses: list[float]
    agreement: float
    reasons: dict[str, int]
    seconds: float
    scores: dict[str, float]
    predictions: dict[str, Prediction]

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Self:
        """Of what `asdict` gave."""
        values = {field.name: content[field.name] for field in fields(cls)}
        values["layers"] = tuple(values["layers"])
        values["predictions"] = {mode: Prediction(**one) for mode, one in values["predictions"].items()}
        return cls(**values)


def stretches(mode: str, end_I1: float) -> Array:
    """(k,) from 1 to where a mode reaches `end_I1`."""
    return np.linspace(1.0, largest_stretch(mode, end_I1), POINTS)


def predictions(fit: JointFit, end_I1: float) -> dict[str, Prediction]:
    """Nominal stress in every homogeneous mode."""
    found = {}
    for mode in MODES:
        stretch = stretches(mode, end_I1)
        values = mode_invariants(mode, stretch)
        sites = np.stack([values[:, 0], values[:, 1] ** 1.5], axis=1) - REFERENCE
        slopes = slopes_of(fit.architecture, fit.parameters, sites)
        slopes = slopes * np.stack([np.ones(len(values)), 1.5 * np.sqrt(values[:, 1])], axis=1)  # by I1 and I2
        stress = np.array([nominal_stress(_Known(one), mode, stretch) for one in slopes])
        likely = stress[fit.likely]
        found[mode] = Prediction(stress[fit.best].tolist(), likely.min(axis=0).tolist(), likely.max(axis=0).tolist())
    return found


@dataclass(frozen=True)
class _Known:
    """d psi / d(I1, I2) (k, 2), MPa, at invariants that were chosen before."""

    slopes: Array

    def __call__(self, invariants: Array) -> Array:
        return self.slopes


def slopes_of(architecture: pann.Architecture, parameters: Array, sites: Array) -> Array:
    """d psi / d(J1, J2) (s, k, 2), MPa, of networks with parameters (s, p) at (J1, J2) - rest (k, 2); compiled once for each size."""
    unit = pann.Architecture(architecture.inputs, architecture.layers)
    return architecture.energy_scale * np.asarray(_unit_slopes(unit, parameters, sites, np.array(architecture.scales)))


@partial(jax.jit, static_argnums=0)
def _unit_slopes(unit: pann.Architecture, parameters: Any, sites: Any, scales: Any) -> Any:
    network = NetworkResidual(unit, distil=False)
    return jax.vmap(lambda theta: network.derivatives(theta, sites, scales))(parameters)


def calibrated_set(
    tests: str, inputs: str, fit: JointFit, scores: dict[str, float], end_I1: float, seconds: float
) -> CalibratedSet:
    """What is kept of a fit."""
    return CalibratedSet(
        tests,
        inputs,
        fit.architecture.layers,
        fit.loss_per_equation,
        fit.losses.tolist(),
        fit.agreement,
        dict(Counter(str(reason) for reason in fit.reasons)),
        seconds,
        scores,
        predictions(fit, end_I1),
    )


def to_file(content: Sequence[CalibratedSet]) -> dict[str, Any]:
    """For `studies.output.write_json`."""
    return {"calibrations": [asdict(one) for one in content]}


def load(path: Path) -> list[CalibratedSet]:
    """Calibrations of a file. Raises `ValueError`, `KeyError`, `OSError`."""
    return [CalibratedSet.from_dict(one) for one in json.loads(path.read_text())["calibrations"]]
