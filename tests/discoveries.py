"""Discoveries on the plate for the tests of the command and its report: made once a process."""

from __future__ import annotations

from functools import cache

import numpy as np
from synthetic import ArrudaBoyce, MooneyRivlin, plate_experiment, with_noise

from calibrate.discovery import Discovery, HoldOut, discover
from calibrate.effects import CATALOGUE, Effect
from calibrate.experiment import Experiment, Noise
from studies.discovery_review import View

NOISE = Noise(0.005, 2.0, 1e-3, 1e-3)
C01 = 0.03
FEW = ("second invariant", "stiffness gradient", "viscoelasticity", "Mullins softening", "force gain")


def few() -> tuple[Effect, ...]:
    """One effect that is there, one that is not, two that the plate cannot show, one gauge."""
    return tuple(effect for effect in CATALOGUE if effect.name in FEW)


@cache
def sheet(c01: float = C01, seed: int = 1) -> Experiment:
    """A noisy plate of a Mooney-Rivlin material, or of Arruda and Boyce's where c01 is 0; no time, no unloading."""
    energy = MooneyRivlin(0.1, c01) if c01 else ArrudaBoyce()
    return with_noise(plate_experiment(energy, n_increments=6), NOISE, seed)


@cache
def explained() -> Discovery:
    """What is found in the Mooney-Rivlin plate, every third increment held out."""
    return discover([sheet()], HoldOut("every", 3), effects=few())


@cache
def nothing() -> Discovery:
    """What is found in the plate of an I1 material."""
    return discover([sheet(0.0)], HoldOut("every", 3), effects=few(), whole_table=False)


def view(found: Discovery) -> View:
    return View(found, "every third increment")


def held() -> np.ndarray:
    """(6,): the increments that `every third` holds out."""
    return ~HoldOut("every", 3).training(explained().problem.parts[0].system).any(axis=1)
