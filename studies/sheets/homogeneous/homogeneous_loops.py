"""Loops of diagnosis that measured homogeneous tests allow: what to fit, and on what a correction must lower the error.

In: nothing but the data. Out: a list of `Loop`, each with training and held-out Experiments and its question.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibrate.data.experiment import Experiment
from studies.sheets.homogeneous.homogeneous_experiments import MODES, hnbr50, kawabata_biaxial, treloar


@dataclass(frozen=True)
class Loop:
    """Experiments to fit and to diagnose, those on which an effect must lower the error, and what is asked."""

    name: str
    training: tuple[Experiment, ...]
    held_out: tuple[Experiment, ...]
    question: str


def every_second(test: Experiment, first: int) -> Experiment:
    """Increments `first`, `first` + 2, ..."""
    return test.select(np.arange(first, test.n_increments, 2), f"{test.name}, every second from {first}")


def treloar_loops() -> list[Loop]:
    """Uniaxial alone; and with every second equi-biaxial point, from which the second invariant can be seen."""
    uniaxial, biaxial, shear = (treloar(mode) for mode in MODES)
    return [
        Loop(
            "treloar-uniaxial", (uniaxial,), (biaxial, shear),
            "Does a model of I1 fitted to uniaxial tension predict the other modes? Nothing in the training data says no.",
        ),
        Loop(
            "treloar-second-invariant", (uniaxial, every_second(biaxial, 0)), (every_second(biaxial, 1), shear),
            "Is the second invariant found from two modes, and does it lower the error in a third?",
        ),
    ]  # fmt: skip


def kawabata_loop() -> Loop:
    """Even numbers of the stretches 2 (uniaxial among them) against odd ones."""
    question = "Is the second invariant found from general biaxial tension, and does it lower the error at other ratios of stretch?"
    return Loop("kawabata", (kawabata_biaxial("training"),), (kawabata_biaxial("held-out"),), question)


def hnbr50_loops() -> list[Loop]:
    """The rate between; and the relaxation, from two rates."""
    slow, medium, fast = (hnbr50(test) for test in ("slow", "medium", "fast"))
    return [
        Loop("hnbr50-rates", (slow, fast), (medium,),
             "Is viscosity found from two rates, and does it lower the error at the rate between? Is softening needed beside it?"),
        Loop("hnbr50-relaxation", (slow, fast), (hnbr50("relaxation"),),
             "Does what was found at two rates hold for relaxation over 12 h, three decades beyond the slow test?"),
    ]  # fmt: skip


def loops() -> list[Loop]:
    """All loops of measured homogeneous tests."""
    return [*treloar_loops(), kawabata_loop(), *hnbr50_loops()]
