"""What a model says of a measured sheet: an Experiment and a model in, errors and section forces out.

A sheet's increments are split in two: those up to `until` are fitted, those after it are scored. Errors: of force, the norm of what the two
grips disagree over the norm of the measured forces; of the field, the norm of the virtual work that fields without a load
leave, over the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate import errors
from calibrate.data.experiment import Experiment
from calibrate.diagnosis.hold_out import HoldOut, Kind
from calibrate.effects.chain import Additions, Chain
from calibrate.equations.equilibrium import Equilibrium, equilibrium
from calibrate.equations.virtual_fields import VirtualFields
from calibrate.models.extended_model import ExtendedModel
from studies.sheets.sheet_results import ErrorsOfParts, ForceAndField, ModelErrors, Prediction

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
FEWEST = 4  # increments that can be fitted
SECTIONS = 9  # bands along the pull in which the section force is found


@dataclass(frozen=True)
class Split:
    """Increments (t,) that are fitted, and that are scored."""

    fitted: Mask
    scored: Mask

    @classmethod
    def of(cls, e: Experiment, until: float) -> Split:
        """Those up to `until`, s, are fitted. Raises `ConfigError` without a time, or where one of the two would be too
        small."""
        if e.time is None:
            raise errors.ConfigError(f"{e.name}: has no time, so that no first part can be fitted")
        fitted = HoldOut(Kind.AFTER, until).fitted(e)
        if fitted.sum() < FEWEST or fitted.all():
            raise errors.ConfigError(
                f"{e.name}: {fitted.sum()} of {e.n_increments} increments are before {until:g} s; give more --frames or "
                "another --until"
            )
        return cls(fitted, ~fitted)

    def parts(self) -> dict[str, Mask]:
        """Both by name."""
        return {"fitted": self.fitted, "scored": self.scored}


def prediction(e: Experiment, models: Sequence[ExtendedModel], split: Split, spacing: float) -> Prediction:
    """Errors of a model, or of the mean of several, on a sheet, the grips' forces, and the section forces over the
    measured force.

    spacing: of the virtual fields, mm.
    """
    system = equilibrium(e, spacing)
    r = np.mean([Chain(system, model.basis).residual(model.c, model.additions) for model in models], axis=0)
    grips = grip_rows(system)
    measured = system.loads[:, grips]
    sections = np.mean([section_forces(e, model) for model in models], axis=0)
    pull = force(e)
    thirds = sections.shape[1] // 3
    lower, upper = sections[:, :thirds].mean(axis=1), sections[:, -thirds:].mean(axis=1)
    parts = {
        name: ModelErrors(
            **vars(force_and_field(system, r, rows)),
            mean_force=float(np.sqrt(np.mean((sections[rows].mean(axis=1) / pull[rows] - 1) ** 2))),
            section_scatter=float(np.sqrt(np.mean((sections[rows] / pull[rows, None] - 1) ** 2))),
            lower_over_upper=float(np.mean(lower[rows] / upper[rows])),
        )
        for name, rows in split.parts().items()
    }
    return Prediction(
        errors=ErrorsOfParts(**parts),
        grip_error=(r[:, grips] / np.linalg.norm(measured, axis=1)[:, None]).tolist(),
        force=pull.tolist(),
        sections=(sections / pull[:, None]).tolist(),
    )


def equations(system: Equilibrium, increments: Mask) -> Mask:
    """All equations (t, 2 v) of increments (t,)."""
    return np.repeat(increments[:, None], system.loads.shape[1], axis=1)


def grip_rows(system: Equilibrium) -> Mask:
    """Equations (2 v,) that hold a measured force."""
    return np.tile(system.fields.boundary >= 0, 2) & np.isfinite(system.loads).all(axis=0)


def force_and_field(system: Equilibrium, r: Array, increments: Mask) -> ForceAndField:
    """Relative errors of residuals r (t, 2 v), N, in some increments (t,), see the top of this module."""
    fields = np.tile(system.fields.boundary < 0, 2)
    grips = grip_rows(system)
    size = np.linalg.norm(system.loads[increments][:, grips])
    return ForceAndField(*(float(np.linalg.norm(r[increments][:, rows]) / size) for rows in (grips, fields)))


def force(e: Experiment) -> Array:
    """Pull (t,), N: the mean size of the forces along y of the two grips."""
    return np.mean([np.abs(b.force[:, 1]) for b in e.loaded], axis=0)


def section_forces(e: Experiment, model: ExtendedModel, n: int = SECTIONS) -> Array:
    """Force along y through the sheet (t, n), N, as the model has it, mean over each of n bands, bottom band first."""
    y = e.points[:, 1]
    edges = np.linspace(y.min(), y.max(), n + 1)
    values = np.stack([np.clip((y - a) / (b - a), 0, 1) for a, b in pairwise(edges)], axis=1)
    fields = VirtualFields(sp.csr_array(values), np.full(n, -1), float(edges[1] - edges[0]))
    return Chain(Equilibrium(e, fields), model.basis).residual(model.c, _without_loads(model))[:, n:]


def _without_loads(model: ExtendedModel) -> Additions:
    return tuple(a for a in model.additions if not a.effect.of_forces)
