"""The force between pictures separates strength and time of a relaxation that is faster than the pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibrate.data.experiment import Experiment
from calibrate.data.readings_between import with_readings
from calibrate.diagnosis.base_fit import prepare
from calibrate.diagnosis.effect_fit import Fit, refit
from calibrate.diagnosis.problem import all_rows
from calibrate.effects.chain import Addition
from calibrate.effects.viscosity import Viscosity
from forward.loading import Loading
from forward.materials import NeoHooke
from forward.sheet.inelastic import solve_history
from forward.sheet.thin_sheet import Prony, Sheet
from meshes import quads, triangles
from meshes.known_specimens import SPECIMENS
from studies.synthetic import camera

PLATE = SPECIMENS["plate_with_hole"]()
G, TAU, INTERVAL, END, RAMP = 0.3, 0.8, 2.0, 14.0, 6.0  # s between pictures, at the end, of the ramp before the hold
LOAD_CELL = 0.02  # N


def recorded(seed: int) -> Experiment:
    """A ramp and a hold, a picture every 2 s, the load cell read ten times as often."""
    pictures = np.arange(INTERVAL, END + 1e-9, INTERVAL)
    others = [t for t in np.arange(0.2, END, 0.2) if np.abs(pictures - t).min() > 1e-6]
    sheet, pull = Sheet(NeoHooke(0.4), 1.0, (), (Prony(G, TAU),)), Loading.clamped(PLATE.loaded, 25.0)
    true = solve_history(
        quads(PLATE, size_factor=3.0), sheet, pull, np.minimum(pictures / RAMP, 1), pictures,
        readings=[(float(t), float(min(t / RAMP, 1))) for t in others],
    )  # fmt: skip
    e = camera.observe(true, triangles(PLATE, n_nodes=400), camera.Camera(relative_noise=1e-4, force_noise=0.0), seed)
    errors = LOAD_CELL * np.random.default_rng(seed).standard_normal(e.record.force.shape)
    record = replace(e.record, force=e.record.force + errors)
    loaded = tuple(replace(b, force=force) for b, force in zip(e.loaded, record.at(e.time), strict=True))
    return replace(e, record=record, loaded=loaded, noise=replace(e.noise, force_std=LOAD_CELL, force_std_relative=0.0))


def fitted(experiment: Experiment) -> Fit:
    problem, base = prepare([experiment], [all_rows])
    return refit(problem, base.c, (Addition(Viscosity(), (G,), (TAU,)),))


@pytest.mark.slow
def test_strength_and_time_are_separated_by_the_force_between_the_pictures():
    test = recorded(0)
    pictures, readings = fitted(test), fitted(with_readings(test, 2, 0))
    (g,), (tau,) = readings.additions[0].amplitudes, readings.additions[0].shape
    (deviation,), (alone,) = readings.errors[0], pictures.errors[0]
    assert deviation < 0.5 * alone  # twice as many increments that tell the same would make it 0.7
    assert abs(g - G) < 3 * deviation
    assert abs(tau / TAU - 1) < 0.3
    assert readings.reduced_chi_square < 1.2 * pictures.reduced_chi_square + 0.1  # they fit as well as the pictures
