"""States that a test reaches: deformation gradients in; its points in the plane of the invariants, and how much of the states are covered, out.

Coverage counts cells of the plane of Hencky norm and Lode angle (uniaxial tension at -30 degrees, pure shear at 0, equi-biaxial tension at 30),
in which no cell is out of reach, up to the norm of uniaxial tension at the end of the predictions. A cell counts where a test is for at least
`LEAST` of its area times increments; the coverage of tests together is that of the union of their cells.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibrate.equations.deformation_modes import largest_stretch
from calibrate.equations.equilibrium import Equilibrium
from calibrate.equations.inputs import hencky_to_lode
from calibrate.equations.kinematics import invariants_and_derivatives
from calibrate.fitting.calibrated_range import calibrated_range

Array = NDArray[np.float64]
CELLS = (12, 6)  # of norm and angle
LEAST = 1e-4
SHOWN = 4000  # points of a picture, each


@dataclass(frozen=True)
class States:
    """points (k, 2): I1 and I2; cells (12, 6): which are covered; limits (2,): ends of the calibrated range of I1 and I2."""

    points: Array
    cells: NDArray[np.bool_]
    limits: Array


def states(system: Equilibrium, end_I1: float) -> States:
    """Of a test: every increment, every triangle."""
    F = system.deformation_gradients.reshape(-1, 2, 2)
    weights = np.broadcast_to(system.areas, system.deformation_gradients.shape[:2]).ravel()
    norm, angle = hencky_to_lode(F)
    end = np.sqrt(1.5) * np.log(largest_stretch("uniaxial", end_I1))
    place = [np.clip((CELLS[0] * norm / end).astype(int), 0, CELLS[0] - 1),
             np.clip((CELLS[1] * (angle + np.pi / 6) / (np.pi / 3)).astype(int), 0, CELLS[1] - 1)]  # fmt: skip
    share = np.zeros(CELLS)
    np.add.at(share, tuple(place), weights / weights.sum())
    chosen = np.random.default_rng(0).choice(len(F), min(SHOWN, len(F)), replace=False)
    points = np.array(invariants_and_derivatives(F[chosen])[0])
    limits = calibrated_range(system)
    return States(points, share >= LEAST, np.array([limits["I1"][1], limits["I2"][1]]))


def coverage(cells: Iterable[NDArray[np.bool_]]) -> float:
    """Share of the states that tests reach together."""
    return float(np.any(list(cells), axis=0).mean())


def to_arrays(found: Mapping[str, States]) -> dict[str, Array]:
    """For `studies.output.write_npz`."""
    return {
        f"{kind}_{name}": getattr(one, kind) for name, one in found.items() for kind in ("points", "cells", "limits")
    }


def from_arrays(content: Mapping[str, Array]) -> dict[str, States]:
    """Of what `to_arrays` gave."""
    names = [key.removeprefix("points_") for key in content if key.startswith("points_")]
    return {
        n: States(content[f"points_{n}"], content[f"cells_{n}"].astype(bool), content[f"limits_{n}"]) for n in names
    }
