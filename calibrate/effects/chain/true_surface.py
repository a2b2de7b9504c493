"""A test as it was, of what was measured: effects of camera, clock and load cell taken out of an Experiment.

In: an Experiment and effects of the measurement. Out: an Experiment with the true places of the reference, the true displacements from there, the
times at which the forces were read, and the forces on the specimen. These are the links of the chain that stand before the deformation gradient
(`stages.motion_stages`, `stages.load_stages`), so that a law without the effects meets it as the chain with them meets what was measured.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment, Noise
from calibrate.effects.chain.addition import Additions
from calibrate.effects.chain.linearisation import Constants, Linearisation
from calibrate.effects.chain.quantities import DISPLACEMENTS, LOADS, MEASURED, PLACES, TIME
from calibrate.effects.chain.stages import load_stages, motion_stages
from calibrate.effects.effect import Effect
from calibrate.effects.support.effect_data import Data
from calibrate.equations import noise_covariance

Array = NDArray[np.float64]
HOOKS = ("places", "displacements", "time", "loads")


def is_expressed(effect: Effect) -> bool:
    """Whether what it does is all in places, displacements, times or forces."""
    return any(getattr(type(effect), hook) is not getattr(Effect, hook) for hook in HOOKS)


def true_surface(experiment: Experiment, additions: Additions) -> Experiment:
    """The test without effects that are expressed so; others among the additions change nothing. The machine record is left out.

    Where a correction amplifies noise, the noise of the displacements is as much larger. Raises `ExperimentError` where no test is left, as of
    triangles that are turned inside out.
    """
    acting = tuple(a for a in additions if is_expressed(a.effect) and not a.is_null)
    bare = replace(experiment, record=None)
    if not acting:
        return bare
    found = _corrected(bare, acting)
    noise = experiment.noise
    if noise is None or not noise.displacement_std > 0:
        return found
    return replace(found, noise=noise.scaled(_amplification(bare, noise, acting, found)))


def _corrected(experiment: Experiment, additions: Additions) -> Experiment:
    data, forces = Data.of(experiment), np.stack([b.force for b in experiment.loaded], axis=-1)
    given = {MEASURED: data.u, DISPLACEMENTS: data.u, PLACES: data.points, LOADS: np.nan_to_num(forces)}
    if data.time is not None:
        given[TIME] = data.time
    stages = (*motion_stages(additions), *load_stages(additions))
    run = Linearisation.run(stages, Constants(data, 0.0, ()), given).quantities
    places, loads = np.asarray(run[PLACES]), np.where(np.isnan(forces), np.nan, np.asarray(run[LOADS]))
    return replace(
        experiment,
        points=places,
        displacements=experiment.points + np.asarray(run[DISPLACEMENTS]) - places,
        time=None if data.time is None else np.asarray(run[TIME]),
        loaded=tuple(replace(b, force=loads[..., i]) for i, b in enumerate(experiment.loaded)),
    )


def _amplification(experiment: Experiment, noise: Noise, additions: Additions, found: Experiment) -> float:
    """Standard deviation of the corrected noise over that of the noise, by one draw of it."""
    factor = noise_covariance.noise_factor(experiment.points, noise)
    draw = noise_covariance.sample(factor, np.random.default_rng(0), experiment.n_increments)
    noisy = _corrected(replace(experiment, displacements=experiment.displacements + draw), additions)
    return float(np.std(noisy.displacements - found.displacements) / np.std(draw))
