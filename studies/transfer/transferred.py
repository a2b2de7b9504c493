"""A model of another specimen on a test: as it is, with factors refitted, and with a stiffness that varies from place to place.

In: an Experiment, an `ExtendedModel`, what is held out. Out: `Transferred`.

Only effects of the material are carried over. A factor on the stiffness, and one on the strength of relaxation where there is any, are fitted to the
measured forces of the increments that are not held out. The same forces give the modulus of a neo-Hookean model, beside which all are judged.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calibrate import errors
from calibrate.data.experiment import Experiment
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.equations.equilibrium import Equilibrium, best_neo_hooke
from calibrate.models.extended_model import Applied, ExtendedModel
from studies.output.plain import Plain
from studies.transfer.stiffness_map import StiffnessMap, stiffness_map

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
STRONGEST = 10.0  # factor on the relaxation
EQUAL = 1e-3  # difference of relative errors that is none
NEO_HOOKE, AS_IT_IS, STIFFNESS, RELAXATION, MAP = (
    "neo-Hooke, fitted to the forces", "as it is", "stiffness refitted", "stiffness and relaxation refitted", "stiffness map",
)  # fmt: skip


@dataclass(frozen=True)
class ForceAndField(Plain):
    """Relative errors. force: norm of the force errors over that of the measured forces; field: norm of the virtual work that fields without
    a load leave, over the same."""

    force: float
    field: float

    def is_no_larger_than(self, other: ForceAndField) -> bool:
        """Whether neither error is larger than another's, by more than a load cell could tell."""
        return self.force <= other.force + EQUAL and self.field <= other.field + EQUAL


@dataclass(frozen=True)
class Row(Plain):
    """Errors of one variant. stiffness, relaxation: factors on those of the model, None where there is no such factor. over_increments (t,): norm of
    the force errors over that of the largest measured force; NaN where none is known."""

    name: str
    stiffness: float | None
    relaxation: float | None
    fitted: ForceAndField
    held_out: ForceAndField
    over_increments: list[float]


@dataclass(frozen=True, eq=False)
class Transferred:
    """What a model says of a test. rows: variants in the order of their freedom; left_out: effects that belong to other tests; was_fitted: whether
    the model was fitted to this test; model: with its factors; fitted (t,): increments that are not held out; spacing: of the virtual fields, mm."""

    experiment: Experiment
    hold_out: str
    fitted: Mask
    spacing: float
    rows: tuple[Row, ...]
    left_out: tuple[str, ...]
    model: ExtendedModel
    map: StiffnessMap
    was_fitted: bool = False

    def row(self, name: str) -> Row:
        """The variant of that name."""
        return next(row for row in self.rows if row.name == name)

    @property
    def final(self) -> Row:
        """With its factors, the same everywhere."""
        return [row for row in self.rows if row.name != MAP][-1]

    @property
    def best(self) -> Row:
        """The map where virtual fields that it does not know ask for it, else the model with its factors."""
        return self.row(MAP) if self.map.is_real else self.final


def transfer(
    e: Experiment, model: ExtendedModel, rule: HoldOut = HoldOut(), spacing: float | None = None
) -> Transferred:
    """A model on a test. rule: what is held out; spacing: of the virtual fields, mm, from the noise where none
    is given.

    Raises `ConfigError` where model and test, or rule and test, do not go together; `FitError` where the test has no force, or no factor fits
    it.
    """
    if e.n_increments < 2:
        raise errors.ConfigError(
            f"{e.name}: has one increment, and a transfer fits to some and is judged on others; import more pictures"
        )
    fitted = rule.increments(e)
    if fitted.all():
        raise errors.ConfigError(
            f"{e.name}: no increment is held out by which to judge; give every:N, after:SECONDS, last or random"
        )
    applied = model.applied_to(e, spacing)
    system = applied.chain.system
    loaded = grip_rows(system)
    loads = np.where(loaded, system.loads, 0.0)
    for part, words in ((fitted, "fitted, so that no factor can be found"), (~fitted, "held out, by which to judge")):
        if not loads[part].any():
            raise errors.FitError(f"{e.name}: no force is known in the increments that are {words}")
    size, is_known = np.linalg.norm(loads, axis=1).max(), loaded.any(axis=1)

    def row(name: str, residual: Array, stiffness: float | None = None, relaxation: float | None = None) -> Row:
        over = np.where(is_known, np.linalg.norm(np.where(loaded, residual, 0.0), axis=1) / size, np.nan)
        before, after = (force_and_field(system, residual, part) for part in (fitted, ~fitted))
        return Row(name, stiffness, relaxation, before, after, over.tolist())

    same = 1.0 if applied.model.relaxes else None
    rows = [
        row(NEO_HOOKE, _neo_hooke(e, model, system, fitted)),
        row(AS_IT_IS, applied.residual(), 1.0, same),
    ]
    factors: tuple[float, ...] = (1.0,)
    for name in (STIFFNESS, RELAXATION)[: 2 if applied.model.relaxes else 1]:
        factors = factors_of(applied, fitted, strength=name == RELAXATION)
        stiffness, relaxation = (*factors, same)[:2]
        rows.append(row(name, applied.residual(*factors), stiffness, relaxation))
    final = replace(applied, model=applied.model.scaled(*factors), shift=factors[0] * applied.shift)
    located = stiffness_map(final, fitted)
    rows.append(row(MAP, located.residual, None, rows[-1].relaxation))
    kept = {a.effect.name for a in applied.model.additions}
    left_out = tuple(a.effect.name for a in model.additions if a.effect.name not in kept)
    was_fitted = any(e.is_of(one["fingerprint"]) for one in model.training)
    return Transferred(
        e, str(rule), fitted, system.fields.spacing, tuple(rows), left_out, final.model, located, was_fitted
    )


def factors_of(applied: Applied, fitted: Mask, strength: bool) -> tuple[float, ...]:
    """The factor on the stiffness, and with `strength` on the relaxation, that fits the forces of increments (t,) best. Raises `FitError`."""
    system = applied.chain.system
    used = grip_rows(system) & fitted[:, None]

    def residuals(x: Array) -> Array:
        return applied.residual(float(np.exp(x[0])), *map(float, x[1:]))[used]

    load = system.loads[used]
    guess = float(load @ load) / max(float(load @ (residuals(np.zeros(1)) + load)), 1e-3 * float(load @ load))
    start = [np.log(guess), *([1.0] if strength else [])]
    bounds = [-np.inf, *([0.0] if strength else [])], [np.inf, *([STRONGEST] if strength else [])]
    best = least_squares(residuals, start, bounds=bounds, x_scale=0.1, diff_step=1e-2, xtol=1e-4, max_nfev=50)
    if not best.success:
        raise errors.FitError(
            f"{system.experiment.name}: the material cannot be scaled to its forces: {best.message}; check units and signs of the forces"
        )
    return (float(np.exp(best.x[0])), *map(float, best.x[1:]))


def _neo_hooke(e: Experiment, model: ExtendedModel, system: Equilibrium, fitted: Mask) -> Array:
    """Residual (t, 2 v), N, of the neo-Hookean model that fits the forces of increments (t,) best."""
    c = best_neo_hooke(Equilibrium(e.select(np.flatnonzero(fitted)), system.fields), model.basis)
    applied = replace(model, c=c, additions=(), errors=()).applied_to(e, system.fields.spacing)
    return applied.residual(*factors_of(applied, fitted, strength=False))  # noise shifts its forces, too


def grip_rows(system: Equilibrium) -> Mask:
    """Equations (t, 2 v) that hold a measured force."""
    return np.tile(system.fields.boundary >= 0, 2) & np.isfinite(system.loads)


def force_and_field(system: Equilibrium, residual: Array, increments: Mask) -> ForceAndField:
    """Relative errors of residuals (t, 2 v), N, in some increments (t,)."""
    grips = grip_rows(system)
    fields = np.isfinite(system.loads) & ~grips
    size = np.linalg.norm(system.loads[grips & increments[:, None]])
    return ForceAndField(
        *(float(np.linalg.norm(residual[rows & increments[:, None]]) / size) for rows in (grips, fields))
    )
