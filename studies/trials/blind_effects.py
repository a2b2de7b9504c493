"""What a blind trial may hide: for every effect of the catalogue, how its amplitude and shape are drawn.

In: random numbers and the situation of a test. Out: amplitudes and shapes in the convention of the catalogue, and what
else the forward model needs. Sizes are drawn evenly on a logarithmic scale, from what no test could show to what none
could miss.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibrate.effects.mullins import LINEAR
from studies.errors import OptionError

FINITE = ("finite viscoelasticity", "second finite relaxation time")
ALSO = {  # either name is right: a patch of another stiffness is both; relaxation has two forms, alike at small strain, and a second branch is more of the first
    "stiffness field": ("inclusion",),
    "viscoelasticity": ("second relaxation time", *FINITE),
    "finite viscoelasticity": ("viscoelasticity", "second relaxation time", FINITE[1]),
}


@dataclass(frozen=True)
class Hidden:
    """An effect: its name in the catalogue, amplitudes and shapes in its convention, and what else the solver needs."""

    name: str
    amplitudes: dict[str, float]
    shape: dict[str, float]
    more: dict[str, float]


@dataclass(frozen=True)
class Situation:
    """What a range may depend on: extent, mm, shear modulus, MPa, duration and shortest interval, s, force, N."""

    extent: float
    shear: float
    duration: float
    interval: float
    force: float


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number between `low` and `high`, even on a logarithmic scale."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _signed(rng: np.random.Generator, low: float, high: float) -> float:
    return float(rng.choice([-1.0, 1.0])) * log_uniform(rng, low, high)


def _second_invariant(rng, s):
    return {"c01": s.shear * log_uniform(rng, 0.005, 0.2)}, {}, {}


def _compressibility(rng, s):
    return {"beta": log_uniform(rng, 0.005, 0.25) / s.shear}, {}, {}


def _one_fibre_family(rng, s):
    return (
        {"k": s.shear * log_uniform(rng, 0.005, 0.15)},
        {"angle": float(rng.uniform(0, np.pi)), "k2": 0.0, "kappa": 0.0},
        {},
    )


def _two_fibre_families(rng, s):
    axis, half = float(rng.uniform(-np.pi / 2, np.pi / 2)), float(rng.uniform(np.pi / 12, np.pi / 4))
    return {"k": s.shear * log_uniform(rng, 0.005, 0.15)}, {"axis": axis, "half": half, "k2": 0.0, "kappa": 0.0}, {}


def _stiffness_gradient(rng, s):
    size, angle = log_uniform(rng, 0.01, 0.4), rng.uniform(0, 2 * np.pi)
    return {"gx": float(size * np.cos(angle)), "gy": float(size * np.sin(angle))}, {}, {}


def _stiffness_field(rng, s):
    x, y = (float(v) for v in s.extent * rng.uniform(-0.3, 0.3, 2))
    width = float(s.extent * rng.uniform(0.12, 0.25))
    return {}, {}, {"height": _signed(rng, 0.03, 0.4), "x": x, "y": y, "width": width}


def _inclusion(rng, s):
    x, y = (float(v) for v in rng.uniform(-0.3, 0.3, 2))
    a, radius = _signed(rng, 0.03, 0.4), float(rng.uniform(0.08, 0.25))
    e, twice = float(rng.uniform(0, 0.5)), float(rng.uniform(0, 2 * np.pi))
    q, four_times = float(rng.uniform(0, 2)), float(rng.uniform(0, 2 * np.pi))
    stretch = {"e1": e * np.cos(twice), "e2": e * np.sin(twice)}
    corners = {"q1": q * np.cos(four_times), "q2": q * np.sin(four_times)}
    return {"a": a}, {"x": x, "y": y, "radius": radius, **stretch, **corners}, {}


def _viscoelasticity(rng, s):
    return {"g": log_uniform(rng, 0.02, 0.5)}, {"tau": s.duration * log_uniform(rng, 0.05, 0.7)}, {}


def _finite_viscoelasticity(rng, s):
    return {"mu": s.shear * log_uniform(rng, 0.02, 0.5)}, {"tau": s.duration * log_uniform(rng, 0.05, 0.7)}, {}


def _mullins(rng, s):
    return {"r": log_uniform(rng, 0.02, 0.5)}, dict(zip(("m", "beta"), LINEAR, strict=True)), {}


def _payne(rng, s):
    return {"r": log_uniform(rng, 0.03, 0.6)}, {"x0": log_uniform(rng, 0.02, 0.5)}, {}


def _permanent_set(rng, s):
    return {"a": log_uniform(rng, 0.01, 0.15)}, {}, {}


def _thickness(rng, s):
    h = float(rng.uniform(1, 6))
    return {"b": h**2 / 12}, {}, {"thickness": h}


def _force_offset(rng, s):
    return {"f0": s.force * _signed(rng, 0.001, 0.05)}, {}, {}


def _force_drift(rng, s):
    return {"d": s.force / s.duration * _signed(rng, 0.003, 0.05)}, {}, {}


def _force_gain(rng, s):
    return {"g": _signed(rng, 0.003, 0.05)}, {}, {}


def _friction(rng, s):
    size, share = s.force * log_uniform(rng, 0.001, 0.05), rng.uniform()
    return {"R0": (1 - share) * size, "R1": share * size}, {}, {}


def _load_cell_nonlinearity(rng, s):
    return {"a": _signed(rng, 0.002, 0.05)}, {}, {}


def _axis_gain(rng, s):
    return {"g": _signed(rng, 0.003, 0.1)}, {}, {}


def _stiffness_drift(rng, s):
    return {"s": _signed(rng, 0.005, 0.2) / s.duration}, {}, {}


def _lag(rng, s):
    return {"dt": s.interval * _signed(rng, 0.005, 0.3)}, {}, {}


def _rotation(rng, s):
    return {"phi": _signed(rng, 0.001, 0.04)}, {}, {}


def _scale(rng, s):
    return {"e": _signed(rng, 0.003, 0.05)}, {}, {}


def _lens(rng, s):
    return {"k": _signed(rng, 3e-4, 0.01)}, {"x": 0.0, "y": 0.0}, {}


def _tilt(rng, s):
    size, angle = log_uniform(rng, 2e-4, 0.008), rng.uniform(0, 2 * np.pi)
    return {"tx": float(size * np.cos(angle)), "ty": float(size * np.sin(angle))}, {}, {}


def _out_of_plane(rng, s):
    return {"m": _signed(rng, 2e-4, 0.008)}, {}, {}


def _subset(rng, s):
    side = s.extent * log_uniform(rng, 0.006, 0.05)
    return {"s2": side**2 / 12}, {}, {"side": side}


def _strip(rng, s):
    return {"w": s.extent * log_uniform(rng, 0.001, 0.01)}, {}, {}


def _warp(rng, s):
    """Bends so wide that the catalogue's polynomials can follow half of them to a quarter of the strain."""
    place, width = (float(s.extent * v) for v in (rng.uniform(-0.3, 0.3), rng.uniform(0.25, 0.5)))
    strain = log_uniform(rng, 2e-4, 5e-3)  # half the square of the slope
    return {}, {}, {"axis": int(rng.integers(2)), "slope": (2 * strain) ** 0.5, "place": place, "width": width}


Draw = Callable[[np.random.Generator, Situation], tuple[dict[str, float], dict[str, float], dict[str, float]]]
MATERIAL: dict[str, Draw] = {
    "second invariant": _second_invariant,
    "compressibility": _compressibility,
    "one fibre family": _one_fibre_family,
    "two fibre families": _two_fibre_families,
    "stiffness gradient": _stiffness_gradient,
    "stiffness field": _stiffness_field,
    "viscoelasticity": _viscoelasticity,
    "Mullins softening": _mullins,
    "Payne softening": _payne,
    "permanent set": _permanent_set,
    "3D effect of thickness": _thickness,
    "inclusion": _inclusion,
    "finite viscoelasticity": _finite_viscoelasticity,
}
RECORDING: dict[str, Draw] = {
    "force offset": _force_offset,
    "force drift": _force_drift,
    "force gain": _force_gain,
    "friction in the load train": _friction,
    "axis gain": _axis_gain,
    "load cell nonlinearity": _load_cell_nonlinearity,
    "stiffness or gain drift": _stiffness_drift,
    "lag between force and image": _lag,
    "image rotation": _rotation,
    "DIC scale": _scale,
    "lens distortion": _lens,
    "out-of-plane motion": _out_of_plane,
    "magnification drift": _out_of_plane,
    "subset smoothing": _subset,
    "unmeasured strip": _strip,
    "initial warp": _warp,
    "camera tilt": _tilt,
}
EFFECTS = {**MATERIAL, **RECORDING}
CONFOUNDED = ("force gain", "DIC scale")
LATER = (
    "permanent set",
    "inclusion",
    "camera tilt",
    "force drift",
    "magnification drift",
    "stiffness or gain drift",
    "finite viscoelasticity",
    "friction in the load train",
    "axis gain",
    "load cell nonlinearity",
)  # their seeds come after all others, so that runs from before them keep their trials
FREQUENT = (*(name for name in EFFECTS if name not in (*CONFOUNDED, *LATER)), *LATER)
UNLOADING = (
    "Mullins softening",
    "Payne softening",
    "permanent set",
    "force drift",
    "magnification drift",
    "stiffness or gain drift",
    "finite viscoelasticity",
    "friction in the load train",
)
SOLID = "3D effect of thickness"
BIAXIAL = "axis gain"
UNPAIRED = (SOLID, *LATER[1:])  # in random pairs, whose seeds are older


def check(names: list[str]) -> None:
    """Raises `OptionError` for effects that are unknown or cannot be hidden together."""
    unknown = [name for name in names if name not in EFFECTS]
    if unknown:
        raise OptionError(f"effect '{unknown[0]}' is unknown; choose from {', '.join(EFFECTS)}, random")
    if len(set(names)) < len(names):
        raise OptionError(f"'{names[0]}' is hidden twice; choose another second effect")
    if SOLID in names and set(names) & (set(MATERIAL) - {SOLID}):
        raise OptionError(f"'{SOLID}' is solved in 3D, with effects of the recording only; choose one of these")
