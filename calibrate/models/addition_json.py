"""Effects of a model file as JSON: their names, amplitudes and shapes with units."""

from __future__ import annotations

from typing import Any

import numpy as np

from calibrate.effects import CATALOGUE, FORMS, Parameter
from calibrate.effects.chain import Addition


def amplitude_unit(parameter: Parameter, stress_unit: str) -> str:
    """Unit of an amplitude or shape; without a thickness, stress is in N/mm."""
    if stress_unit == "MPa":
        return parameter.unit
    return {"MPa": stress_unit, "1/MPa": "mm/N"}.get(parameter.unit, parameter.unit)


def addition_to_dict(addition: Addition, deviations: tuple[float, ...], stress_unit: str) -> dict[str, Any]:
    """One of the ``additions`` of a model file. deviations (p,): of its amplitudes."""
    effect = addition.effect
    return {
        "effect": effect.name,
        "formula": effect.formula,
        "of_material": effect.of_material,
        "amplitudes": [
            {"name": p.name, "unit": amplitude_unit(p, stress_unit), "value": float(v), "standard_deviation": float(d)}
            for p, v, d in zip(effect.amplitudes, addition.amplitudes, deviations, strict=True)
        ],
        "shape": [
            {"name": p.name, "unit": amplitude_unit(p, stress_unit), "value": float(v)}
            for p, v in zip(effect.shapes, addition.shape, strict=True)
        ],
    }


def addition_from_dict(content: dict[str, Any]) -> tuple[Addition, tuple[float, ...]]:
    """Of a model file: an effect with its values, and their standard deviations. Raises KeyError, TypeError, ValueError."""
    known = {effect.name: effect for effect in (*CATALOGUE, *FORMS)}
    if content["effect"] not in known:
        raise ValueError(
            f"effect '{content['effect']}' unknown; this version knows {', '.join(e.name for e in CATALOGUE)}"
        )
    effect = known[content["effect"]]
    written = effect.shapes[: len(content["shape"])]
    later = len(effect.shapes) - len(written)  # than the file
    former = effect.former_shape[-later:] if 0 < later <= len(effect.former_shape) else ()
    shapes = written if former else effect.shapes
    for key, parameters in (("amplitudes", effect.amplitudes), ("shape", shapes)):
        names, found = [p.name for p in parameters], [str(p["name"]) for p in content[key]]
        if found != names:
            raise ValueError(f"{effect.name}: {key} {found}, but it has {names}")
    amplitudes = tuple(float(p["value"]) for p in content["amplitudes"])
    shape = (*(float(p["value"]) for p in content["shape"]), *former)
    if not np.isfinite([*amplitudes, *shape]).all():
        raise ValueError(f"{effect.name}: amplitudes {amplitudes} and shape {shape} must be finite numbers")
    return Addition(effect, amplitudes, shape), tuple(float(p["standard_deviation"]) for p in content["amplitudes"])
