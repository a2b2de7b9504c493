r"""A calibrated network as a material: model file (JSON, 'equigap-model' version 1) in, energy in UFL out.

With J1 = I1, J2 = I2^(3/2) and x_i = s_i (J_i - J_i at rest) for the inputs the model uses,

    z_1 = softplus(W_1 x + b_1),  z_k = softplus(W_k z_(k-1) + b_k),
    psi = e (w . z_K + v . x) - (the same at rest),

where s are the file's `scales`, e its `energy_scale`, w its `output` and v its `skip` (Linden et al. 2023).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from forward.errors import MaterialError
from forward.materials.strain_energy import Material

INPUTS = {"I1": (0,), "I2": (1,), "I1I2": (0, 1)}
AT_REST = (3.0, 3.0**1.5)


@dataclass(frozen=True)
class Pann(Material):
    """Network energy. `values`: scale of each input, energy scale, then W and b of each layer (row by row), w, v.

    unit: 'MPa', or 'N/mm' if the thickness was unknown at calibration: then solve with thickness 1.
    """

    inputs: str
    layers: tuple[int, ...]
    values: tuple[float, ...]
    unit: str = "MPa"
    name: ClassVar[str] = "pann"

    def __post_init__(self) -> None:
        if self.inputs not in INPUTS:
            raise MaterialError(f"pann: inputs '{self.inputs}' unknown; choose one of {', '.join(INPUTS)}")
        if self.unit not in ("MPa", "N/mm"):
            raise MaterialError(f"pann: unit '{self.unit}' unknown; 'MPa' or 'N/mm'")
        if len(self.values) != self._size or not np.isfinite(self.values).all():
            raise MaterialError(f"pann: {self._size} finite numbers are needed, got {len(self.values)}")
        if not self.shear_modulus > 0:
            raise MaterialError("pann: the network has no stiffness at rest; calibrate it anew")

    @classmethod
    def from_file(cls, path: str | Path) -> Pann:
        """Read a model file. Raises `MaterialError` naming the file and what is wrong."""
        try:
            content = json.loads(Path(path).read_text())
        except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
            raise MaterialError(f"{path}: no readable model file ({error})") from error
        try:
            return cls.from_dict(content)
        except MaterialError as error:
            raise MaterialError(f"{path}: {error}") from error

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Pann:
        """Material from the content of a model file, or from `to_dict()`. Raises `MaterialError`."""
        try:
            if (content["format"], content["version"], content["kind"]) != ("equigap-model", 1, "pann"):
                raise MaterialError("this is no 'equigap-model' of version 1 and kind 'pann'")
            inputs, layers = content["inputs"], tuple(int(n) for n in content["layers"])
            used = [content["scales"][i] for i in INPUTS[inputs]]
            hidden = [np.array(layer[k], float) for layer in content["hidden"] for k in ("weights", "biases")]
            parts = [used, [content["energy_scale"]], *hidden, content["output"], content["skip"]]
            shapes = [part.shape for part in hidden]
            values = np.concatenate([np.ravel(np.asarray(part, float)) for part in parts])
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise MaterialError(
                f"pann: the model file lacks an entry, or one is garbled ({error}); write it again"
            ) from error
        widths = (len(used), *layers)
        if shapes != [shape for a, b in pairwise(widths) for shape in ((b, a), (b,))]:
            raise MaterialError(f"pann: weights and biases do not fit layers {layers}")
        return cls(inputs, layers, tuple(values.tolist()), content.get("unit", "MPa"))

    @property
    def parameters(self) -> tuple[float, ...]:
        return self.values

    @property
    def shear_modulus(self) -> float:
        """2 (psi_1 + psi_2) at rest, by central differences, in the unit of the energy."""
        step = 1e-5
        return (self.energy(3 + step, 3 + step) - self.energy(3 - step, 3 - step)) / step

    def energy(self, I1: Any, I2: Any, parameters: Sequence[Any] | None = None) -> Any:
        p = self.values if parameters is None else parameters
        J, n = (I1, I2**1.5), len(INPUTS[self.inputs])
        x = [p[i] * (J[k] - AT_REST[k]) for i, k in enumerate(INPUTS[self.inputs])]
        return p[n] * (self._network(x, p) - self._network([0.0] * n, p))

    def to_dict(self) -> dict[str, Any]:
        """Content of a model file."""
        p, n = self.values, len(INPUTS[self.inputs])
        scales = [1.0, 1.0]
        for i, k in enumerate(INPUTS[self.inputs]):
            scales[k] = p[i]
        hidden, at = [], n + 1
        for a, b in pairwise((n, *self.layers)):
            W = np.reshape(p[at : at + a * b], (b, a)).tolist()
            hidden.append({"weights": W, "biases": list(p[at + a * b : at + a * b + b])})
            at += a * b + b
        return {
            "material": self.name,
            "format": "equigap-model",
            "version": 1,
            "kind": "pann",
            "inputs": self.inputs,
            "layers": list(self.layers),
            "scales": scales,
            "energy_scale": p[n],
            "hidden": hidden,
            "output": list(p[at : at + self.layers[-1]]),
            "skip": list(p[at + self.layers[-1] :]),
            "unit": self.unit,
        }

    @property
    def _size(self) -> int:
        n = len(INPUTS[self.inputs])
        hidden = sum(b * (a + 1) for a, b in pairwise((n, *self.layers)))
        return 2 * n + 1 + hidden + self.layers[-1]

    def _network(self, x: list[Any], p: Sequence[Any]) -> Any:
        """w . z_K + v . x, from the parameters in their order."""
        at = len(x) + 1
        z = x
        for width in self.layers:
            W, b = at, at + width * len(z)
            z = [_softplus(p[b + i] + _dot(p, W + i * len(z), z)) for i in range(width)]
            at = b + width
        return _dot(p, at, z) + _dot(p, at + len(z), x)


def _dot(p: Sequence[Any], start: int, x: list[Any]) -> Any:
    return sum(p[start + i] * value for i, value in enumerate(x))


def _softplus(x: Any) -> Any:
    """log(1 + exp(x)) without overflow, of a number or a UFL expression."""
    if isinstance(x, (float, np.ndarray)):
        return np.logaddexp(0.0, x)
    from forward._dolfinx import ufl

    return ufl.conditional(ufl.gt(x, 0), x + ufl.ln(1 + ufl.exp(-x)), ufl.ln(1 + ufl.exp(x)))
