"""A test as it was, of what was measured: effects of camera, clock and load cell taken out of an Experiment.

In: an Experiment and effects of the measurement. Out: an Experiment with the true places of the reference, the true displacements from there, the
times at which the forces were read, and the forces on the specimen, of the machine record too. These are the links of the chain that stand before the deformation gradient
(`stages.motion_stages`, `stages.load_stages`), so that a law without the effects meets it as the chain with them meets what was measured;
but for a clock, where the chain has the forces at the pictures (`readings`), and here the displacements are those of the readings.
"""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment, Noise
from calibrate.data.load_record import LoadRecord
from calibrate.effects.chain.addition import Additions
from calibrate.effects.chain.linearisation import Constants, Linearisation
from calibrate.effects.chain.quantities import DISPLACEMENTS, LOADS, MEASURED, PLACES
from calibrate.effects.chain.readings import are_of_the_clock, reading_weights
from calibrate.effects.chain.stages import load_stages, motion_stages
from calibrate.effects.effect import Effect
from calibrate.effects.support.effect_data import Data
from calibrate.equations import noise_covariance
from calibrate.errors import ExperimentError, ImpossibleCorrectionError

Array = NDArray[np.float64]
HOOKS = ("places", "displacements", "readings", "loads")


def is_expressed(effect: Effect) -> bool:
    """Whether what it does is all in places, displacements, forces or the times of these."""
    return any(getattr(type(effect), hook) is not getattr(Effect, hook) for hook in HOOKS)


def true_surface(experiment: Experiment, additions: Additions) -> Experiment:
    """The test without effects that are expressed so; others among the additions change nothing.

    Where a correction amplifies noise, the noise of the displacements is as much larger. The machine record is on the clock of the forces; where that
    of the pictures, corrected, goes beyond it, it is left out. Raises `ImpossibleCorrectionError` where no test is left, as of triangles that are turned inside out.
    """
    acting = tuple(a for a in additions if is_expressed(a.effect) and not a.is_null)
    if not acting:
        return experiment
    bare = replace(experiment, record=None)
    found = _corrected(bare, acting)
    found = replace(found, record=_corrected_record(experiment, found, acting))
    noise = experiment.noise
    if noise is None or not noise.displacement_std > 0:
        return found
    return replace(found, noise=noise.scaled(_amplification(bare, noise, acting, found)))


def _corrected(experiment: Experiment, additions: Additions) -> Experiment:
    data, forces = Data.of(experiment), np.stack([b.force for b in experiment.loaded], axis=-1)
    given = {MEASURED: data.u, DISPLACEMENTS: data.u, PLACES: data.points, LOADS: np.nan_to_num(forces)}
    stages = (*motion_stages(additions), *load_stages(additions))
    run = Linearisation.run(stages, Constants(data, 0.0, ()), given).quantities
    places, loads = np.asarray(run[PLACES]), np.where(np.isnan(forces), np.nan, np.asarray(run[LOADS]))
    u, time = np.asarray(run[DISPLACEMENTS]), experiment.time
    if time is not None and are_of_the_clock(additions):
        weights = reading_weights(data, additions)
        u, time = np.einsum("ts,sni->tni", weights, u), time + (weights - np.eye(len(time))) @ time
    try:
        return replace(
            experiment,
            points=places,
            displacements=experiment.points + u - places,
            time=time,
            loaded=tuple(replace(b, force=loads[..., i]) for i, b in enumerate(experiment.loaded)),
        )
    except ExperimentError as error:  # its remedies are for what was measured
        names = " and ".join(a.effect.name for a in additions)
        raise ImpossibleCorrectionError(
            f"{experiment.name}, corrected for {names}, is no test that could be: an effect so large is not in it"
        ) from error


def _corrected_record(experiment: Experiment, found: Experiment, additions: Additions) -> LoadRecord | None:
    """The record with its forces corrected; None where there is none, or the pictures as they are `found` go beyond it."""
    record, pictures, time = experiment.record, experiment.time, found.time
    if record is None or pictures is None or time is None or time[0] < record.time[0] or time[-1] > record.time[-1]:
        return None
    data, forces = Data.of(replace(experiment, record=None)), np.moveaxis(record.force, 0, -1)
    next_picture = np.searchsorted(pictures, record.time).clip(max=len(data.motion_sign) - 1)
    data = replace(data, time=jnp.asarray(record.time), motion_sign=data.motion_sign[next_picture])
    run = Linearisation.run(load_stages(additions), Constants(data, 0.0, ()), {LOADS: np.nan_to_num(forces)}).quantities
    loads = np.where(np.isnan(forces), np.nan, np.asarray(run[LOADS]))
    return replace(record, force=np.moveaxis(loads, -1, 0))


def _amplification(experiment: Experiment, noise: Noise, additions: Additions, found: Experiment) -> float:
    """Standard deviation of the corrected noise over that of the noise, by one draw of it."""
    factor = noise_covariance.noise_factor(experiment, noise)
    draw = noise_covariance.sample(factor, np.random.default_rng(0), experiment.n_increments)
    noisy = _corrected(replace(experiment, displacements=experiment.displacements + draw), additions)
    return float(np.std(noisy.displacements - found.displacements) / np.std(draw))
