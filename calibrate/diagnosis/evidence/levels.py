"""Levels of several tests whose thicknesses are unknown: of each no more than stiffness times thickness is known, and that may be another one in every test.

In: Experiments without a thickness, and which equations are fitted. Out: the same with forces at the level of the first, and how many times as stiff each was.

A level is the least-squares modulus of a neo-Hookean sheet (`equilibrium.best_shear_modulus`) over that of the first test. What it misses of the level, as a neo-Hookean sheet is no
rubber, is of every test but the first for itself, and the weights allow for it (`StiffnessLevel`, `evidence.own_effects`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibrate.data.experiment import Experiment
from calibrate.diagnosis.problem import Rows, all_rows
from calibrate.effects.effect import Parameter
from calibrate.effects.force_gain import ForceGain
from calibrate.equations.equilibrium import best_shear_modulus, equilibrium
from calibrate.errors import ForceSignError


@dataclass(frozen=True)
class StiffnessLevel(ForceGain):
    """How much stiffer, or thicker, a test is than its `Level` says."""

    name = "stiffness level"
    of_rig = False
    formula = "f / (1 + g)"
    confounded_with = ""
    amplitudes = (Parameter("g", "1", lower=-0.9, typical=0.1),)
    decided_by = "a thickness gauge"

    def loads(self, data, loads, a, shape):
        return loads / (1.0 + a[0])


@dataclass(frozen=True)
class Level:
    """divided_by: stiffness times thickness of a test over that of the first, by neo-Hookean sheets; what its forces were divided by. factor, deviation: the same by the joint fit,
    in which a test has what that missed for itself; deviation 0 of the first test."""

    test: str
    divided_by: float
    factor: float
    deviation: float = 0.0


def have_unknown_levels(experiments: Sequence[Experiment]) -> bool:
    """Whether there are several, and no thickness of theirs is known. Tests whose level is nominal have none to compare."""
    return len(experiments) > 1 and all(e.thickness is None and not e.level_is_nominal for e in experiments)


def at_one_level(
    experiments: Sequence[Experiment], train: Rows, spacing: float | None = None
) -> tuple[list[Experiment], tuple[Level, ...]]:
    """Tests with forces and their noise divided by their levels; as they are, and no levels, where these are known. train: the equations fitted.

    Raises `ForceSignError` where forces oppose the deformation, and the errors of `equilibrium`.
    """
    if not have_unknown_levels(experiments):
        return list(experiments), ()
    moduli = [_modulus(e, train, spacing) for e in experiments]
    factors = [modulus / moduli[0] for modulus in moduli]
    levels = tuple(Level(e.name, factor, factor) for e, factor in zip(experiments, factors, strict=True))
    return [divided(e, factor) for e, factor in zip(experiments, factors, strict=True)], levels


def _modulus(experiment: Experiment, train: Rows, spacing: float | None) -> float:
    system = equilibrium(experiment, spacing)
    modulus = best_shear_modulus(system, train(system) & all_rows(system))[0]
    if not modulus > 0:
        raise ForceSignError(
            f"{experiment.name}: the forces that are fitted oppose the measured deformation; a force is that of the grip ON the specimen"
        )
    return modulus


def divided(experiment: Experiment, factor: float) -> Experiment:
    """With all forces, those of the machine record and their noise, divided by a factor."""
    noise, record = experiment.noise, experiment.record
    return replace(
        experiment,
        loaded=tuple(replace(b, force=b.force / factor) for b in experiment.loaded),
        noise=None if noise is None else replace(noise, force_std=noise.force_std / factor),
        record=None if record is None else replace(record, force=np.asarray(record.force) / factor),
    )
