"""Model file: a calibrated PANN as one documented JSON that `forward` and `predict` read.

Keys: ``format`` = "equigap-model", ``version`` = 1, ``kind`` = "pann"; ``inputs`` ("I1" | "I2" | "I1I2");
``layers`` [N...]; ``scales`` [s_1, s_2]; ``energy_scale``; ``hidden`` [{"weights": [[...]], "biases": [...]}];
``output`` [...] (w); ``skip`` [...] (v); ``unit`` ("MPa", or "N/mm" where the thickness was unknown);
``calibrated_range`` {"I1": [min, max], "I2": [min, max]}, and of I1 near each mode (`calibrate.fitting.calibrated_range.near`); ``fit`` and ``provenance`` (free JSON).
Optional: ``level`` "nominal" where only ratios of stiffness are known, of a window in a larger body; ``fitness`` (`calibrate.models.fitness`);
``bulk_modulus`` {"value", "standard_deviation" (or null)} of a calibration in plane strain, where the
invariants are those of the isochoric part (`calibrate.equations.isochoric`); ``uncertainty`` {"factor": [[...]] (rows: parameters; covariance =
factor factor^T), "effective_parameters", "reduced_chi_square", "noise_is_known"}; parameters in the order weights (row by row) and biases of each layer, output, skip.
The formula is in `calibrate.models.pann`, that of the uncertainty in `calibrate.fitting.uncertainty`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.equations import isochoric as plane_strain
from calibrate.equations import kinematics
from calibrate.equations.deformation_modes import (
    LARGEST_STRETCH,
    MODES,
    largest_stretch,
    mode_invariants,
    stretches_to_gradient,
)
from calibrate.equations.inputs import INPUT_SETS
from calibrate.models import pann
from calibrate.models.fitness import Fitness
from calibrate.models.json_file import (
    MEASURED,
    NOMINAL,
    Format,
    check_level,
    check_range,
    check_unit,
    read_model,
    write_model,
)
from calibrate.models.parameter_covariance import Uncertainty

FORMAT, VERSION = "equigap-model", 1
MISTAKEN = (
    "equigap-extended-model",
    "an extended model of `equigap discover`, whose effects no network holds; predict a test with "
    "`equigap predict MODEL.json --test EXPERIMENT.npz` or calibrate.models.extended_model.ExtendedModel, or save its "
    "'network' (the base alone) as a file of its own",
)
STRETCH_STEP = 1e-3
LARGEST_INPUT, LARGEST_MODULUS = 1e3, 1e9  # scaled invariant; MPa
Array = NDArray[np.float64]


@partial(jax.jit, static_argnums=(0, 1))
def _derivatives(inputs, layers, scales, energy_scale, parameters, invariants):
    """Compiled once for each size of network, whatever its scales."""
    architecture = pann.Architecture(inputs, layers, (scales[0], scales[1]), energy_scale)
    return pann.energy_derivatives(architecture, parameters, invariants)


@dataclass(frozen=True)
class Model:
    """A calibrated PANN. parameters (n_parameters,); calibrated_range: (min, max) of I1 and I2 in the data.

    uncertainty: None where the loss was not weighted by noise, and in files written before it was stored.
    bulk_modulus: None where it was calibrated in plane stress, which takes rubber for incompressible. level_is_nominal: whether only ratios
    of its stresses are known. fitness: the verdict of the calibration, None in files written before it was stored.
    """

    architecture: pann.Architecture
    parameters: Array
    unit: str = "MPa"
    calibrated_range: dict[str, tuple[float, float]] = field(default_factory=dict)
    fit: dict[str, Any] = field(default_factory=dict)
    provenance: dict[str, Any] = field(default_factory=dict)
    uncertainty: Uncertainty | None = field(default=None, repr=False)
    bulk_modulus: float | None = None
    bulk_modulus_deviation: float | None = None
    level_is_nominal: bool = False
    fitness: Fitness | None = None

    def energy(self, invariants: jax.Array) -> jax.Array:
        """Strain energy at one (I1, I2) (2,), MPa (or N/mm)."""
        return pann.energy(self.architecture, jnp.asarray(self.parameters), invariants)

    def derivatives(self, invariants: Array) -> Array:
        """d psi / d(I1, I2) (..., 2), MPa (or N/mm), at invariants (..., 2)."""
        a = self.architecture
        return np.asarray(
            _derivatives(
                a.inputs, tuple(a.layers), jnp.asarray(a.scales), a.energy_scale, jnp.asarray(self.parameters),
                jnp.asarray(invariants),
            )
        )  # fmt: skip

    def nominal_stress(self, F: Array, plane: str = "stress") -> Array:
        """In-plane first Piola-Kirchhoff stress (..., 2, 2) at F (..., 2, 2), MPa (or N/mm); plane: 'stress' or 'strain'.

        Raises `ConfigError` in plane strain where no bulk modulus is known.
        """
        if plane == "strain":
            if self.bulk_modulus is None:
                raise errors.ConfigError(
                    "the model has no bulk modulus, which plane strain needs: it was calibrated in plane stress; "
                    "calibrate it on a test in plane strain"
                )
            f = np.asarray(plane_strain.isochoric(F))
            return np.asarray(plane_strain.stress(jnp.asarray(F), self.nominal_stress(f), self.bulk_modulus))
        values, derivatives = kinematics.invariants_and_derivatives(jnp.asarray(F))
        psi = self.derivatives(np.asarray(values))
        return np.einsum("...k,...kij->...ij", psi, np.asarray(derivatives))

    def homogeneous(self, mode: str, stretch: Array) -> Array:
        """Nominal stress (k,), MPa (or N/mm), along the pull at stretches (k,).

        mode: 'uniaxial', 'equibiaxial' or 'pure_shear'; raises `ConfigError` for another.
        """
        F = stretches_to_gradient(mode, stretch)
        return self.nominal_stress(F)[:, 0, 0]

    def homogeneous_deviation(self, mode: str, stretch: Array) -> Array | None:
        """Standard deviation (k,), MPa (or N/mm), of `homogeneous`; None where no uncertainty is known."""
        F = jnp.asarray(stretches_to_gradient(mode, stretch))
        values, first = map(np.asarray, kinematics.invariants_and_derivatives(F))
        return self.deviation(values, first[:, :, 0, 0])

    def deviation(self, invariants: Array, weights: Array) -> Array | None:
        """Standard deviation (...) of sum_k weights_k d psi / dI_k at invariants, weights (..., 2); None if unknown."""
        if self.uncertainty is None:
            return None
        return self.uncertainty.deviation(self.architecture, self.parameters, invariants, weights)

    def in_range(self, invariants: Array) -> NDArray[np.bool_]:
        """Whether invariants (..., 2) lie within the calibrated range of the inputs the model uses."""
        inside = np.ones(invariants.shape[:-1], bool)
        for i in INPUT_SETS[self.architecture.inputs]:
            low, high = self.calibrated_range.get(kinematics.INVARIANTS[i], (-np.inf, np.inf))
            inside &= (invariants[..., i] >= low) & (invariants[..., i] <= high)
        return inside

    def largest_stretch(self, mode: str) -> float:
        """Largest stretch of a mode in the calibrated range of the inputs the model uses, rounded down to `STRETCH_STEP`;
        infinite where the model states no range. Raises `ConfigError` for an unknown mode."""
        if mode not in MODES:
            raise errors.ConfigError(f"mode '{mode}' unknown; choose one of {', '.join(MODES)}")
        found = [np.inf]
        for i in INPUT_SETS[self.architecture.inputs]:
            limit = self.calibrated_range.get(kinematics.INVARIANTS[i], (-np.inf, np.inf))[1]
            if limit < mode_invariants(mode, np.array([LARGEST_STRETCH]))[0, i]:
                found.append(largest_stretch(mode, limit, i))
        # a hundredth of a millionth of a step: rounding of the root must not cost a whole step
        steps = np.floor((min(found) - 1) / STRETCH_STEP + 1e-8)
        return float(1 + steps * STRETCH_STEP)

    def to_dict(self) -> dict[str, Any]:
        """Content of a model file, see the module; `from_dict` reads it."""
        hidden, output, skip = self.architecture.unpack(np.asarray(self.parameters))
        optional: dict[str, Any] = {} if self.uncertainty is None else {"uncertainty": self.uncertainty.to_dict()}
        if self.bulk_modulus is not None:
            optional["bulk_modulus"] = {"value": self.bulk_modulus, "standard_deviation": self.bulk_modulus_deviation}
        if self.level_is_nominal:
            optional["level"] = NOMINAL
        if self.fitness is not None:
            optional["fitness"] = self.fitness.to_dict()
        return {
            "format": FORMAT,
            "version": VERSION,
            "kind": "pann",
            "inputs": self.architecture.inputs,
            "layers": list(self.architecture.layers),
            "scales": list(self.architecture.scales),
            "energy_scale": self.architecture.energy_scale,
            "hidden": [{"weights": W.tolist(), "biases": b.tolist()} for W, b in hidden],
            "output": output.tolist(),
            "skip": skip.tolist(),
            "unit": self.unit,
            "calibrated_range": {k: list(v) for k, v in self.calibrated_range.items()},
            "fit": self.fit,
            "provenance": self.provenance,
            **optional,
        }

    def save(self, path: str | Path) -> None:
        """Write the JSON atomically."""
        write_model(path, self.to_dict())

    @classmethod
    def load(cls, path: str | Path) -> Model:
        """Read a model file. Raises `DataNotFoundError`, `ModelFileError` naming the key that is wrong."""
        return read_model(path, cls.file_format())

    @classmethod
    def file_format(cls) -> Format[Model]:
        """What a file of `save` says of itself."""
        return Format(FORMAT, VERSION, "equigap calibrate", cls.from_dict, (MISTAKEN,))

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Model:
        """Model from the content of a model file, or from `to_dict`. Raises KeyError, TypeError or ValueError."""
        if content["kind"] != "pann":
            raise ValueError(f"kind '{content['kind']}' unknown; this program reads 'pann'")
        architecture = pann.Architecture(
            inputs=content["inputs"],
            layers=tuple(content["layers"]),
            scales=_scales(content["scales"]),
            energy_scale=float(content["energy_scale"]),
        )
        if not 0 < architecture.energy_scale < np.inf:
            raise ValueError(f"energy_scale {architecture.energy_scale} is not a positive number")
        _check_inputs(architecture, check_range(content["calibrated_range"]))
        parameters = _parameters(architecture, content)
        if (parameters[architecture.nonnegative] < 0).any():
            raise ValueError("a weight is negative: the energy would not be convex and non-decreasing")
        return cls(
            architecture=architecture,
            parameters=parameters,
            unit=check_unit(content["unit"]),
            calibrated_range=check_range(content["calibrated_range"]),
            fit=content.get("fit", {}),
            provenance=content.get("provenance", {}),
            uncertainty=_uncertainty(content.get("uncertainty"), architecture),
            **_bulk_modulus(content.get("bulk_modulus")),
            level_is_nominal=check_level(content.get("level", MEASURED)) == NOMINAL,
            fitness=Fitness.from_dict(content.get("fitness")),
        )


def _scales(values: Any) -> tuple[float, float]:
    scales = tuple(map(float, values))
    if len(scales) != 2 or not all(0 < s < np.inf for s in scales):
        raise ValueError(f"scales {values} are not two positive numbers")
    return scales[0], scales[1]


def _check_inputs(architecture: pann.Architecture, ranges: dict[str, tuple[float, float]]) -> None:
    """Raises ValueError for scales with which the network overflows in its calibrated range."""
    if architecture.energy_scale > LARGEST_MODULUS:
        raise ValueError(f"energy_scale {architecture.energy_scale:.3g} is none of a soft material")
    for i in INPUT_SETS[architecture.inputs]:
        end = ranges.get(kinematics.INVARIANTS[i], (3.0, 4.0))[1]
        largest = architecture.scales[i] * (end - 3.0 if i == 0 else end**1.5 - 3.0**1.5)
        if largest > LARGEST_INPUT:
            raise ValueError(
                f"scales {list(architecture.scales)}: at the end of the calibrated range the input of {kinematics.INVARIANTS[i]} "
                f"would be {largest:.3g}, which a calibration scales to 1"
            )


def _uncertainty(content: Any, architecture: pann.Architecture) -> Uncertainty | None:
    if content is None:
        return None
    if not isinstance(content, dict):
        raise ValueError("uncertainty is not a table")
    return Uncertainty.from_dict(content, architecture.n_parameters)


def _bulk_modulus(content: Any) -> dict[str, float | None]:
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise ValueError("bulk_modulus is not a table")
    value, deviation = float(content["value"]), content["standard_deviation"]
    if not 0 < value < np.inf:
        raise ValueError(f"bulk_modulus {value} is not a positive number")
    return {"bulk_modulus": value, "bulk_modulus_deviation": None if deviation is None else float(deviation)}


def _parameters(architecture: pann.Architecture, content: dict[str, Any]) -> Array:
    """Parameter vector of the weights in a file; every array must have the shape that `layers` and `inputs` imply."""
    expected: list[tuple[str, Any, tuple[int, ...]]] = []
    if len(content["hidden"]) != len(architecture.layers):
        raise ValueError(f"{len(content['hidden'])} hidden layers, but 'layers' has {len(architecture.layers)}")
    for i, (layer, widths) in enumerate(zip(content["hidden"], architecture.shapes, strict=True), start=1):
        expected += [
            (f"weights of layer {i}", layer["weights"], widths),
            (f"biases of layer {i}", layer["biases"], widths[:1]),
        ]
    expected += [
        ("output", content["output"], architecture.layers[-1:]),
        ("skip", content["skip"], (architecture.n_inputs,)),
    ]
    for name, values, shape in expected:
        if np.shape(values) != shape or not np.isfinite(np.asarray(values, float)).all():
            raise ValueError(f"{name}: need {shape} finite numbers, found shape {np.shape(values)}")
    return np.concatenate([np.ravel(np.asarray(values, float)) for _, values, _ in expected])
