"""Whether a model may be used: the first thing that report, terminal and manifest say of it, and that its file keeps.

In: the `Quality` of a calibration or a diagnosis. Out: `Headline`: usable, usable with reservations, or not to be used, with the reasons
as findings. A small chi-square says that the residual is no larger than noise, which is nothing where the noise hides the forces; a
small force error says nothing of equilibrium inside. Both are weighed, and what the strain, the noise and the network can carry.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from calibrate.data.strain_signal import StrainSignal
from calibrate.fitting.calibrated_range import WEAK_SIGNAL
from calibrate.models.fitness import Fitness, Use
from studies.output.findings import Finding, Macro
from studies.output.words import Words

WORDS = Words("headline")


class Reason(Macro):
    """Macros of ``templates/headline.txt``."""

    FORCES_MISSED = "forces_missed"
    FORCES_NOT_PREDICTED = "forces_not_predicted"
    WORSE_THAN_NEO_HOOKE = "worse_than_one_modulus"
    ABOVE_NOISE = "far_above_noise"
    ATTENUATED = "attenuated"
    WEAK_STRAIN = "weak_strain"
    UNCERTAIN_STIFFNESS = "uncertain_stiffness"
    DEAD_NETWORK = "dead_network"
    FEW_STARTS = "few_starts"
    IMBALANCE = "unbalanced"
    RIM = "only_ratios"
    ASK_RIM = "is_the_force_that_of_the_section"
    UNEXPLAINED = "unexplained"
    UNCONVERGED = "unconverged"


BY_NOISE = 10.0  # over the square of signal to noise; noise alone takes about one over it of a stiffness away (regression dilution), and more than this not


@dataclass(frozen=True)
class Limits:
    """Above the first a reservation, above the second not to be used. Force errors: relative. chi_square: reduced; nominal_chi_square: where no force is known. attenuation:
    factor on the stiffness that makes up for noise. deviation: relative, of the initial shear modulus. strain: signal to noise, below
    which. factor: of a force error over that of one modulus, where that is above the least error."""

    force_error: tuple[float, float] = (0.05, 0.25)
    held_error: tuple[float, float] = (0.1, 0.3)
    chi_square: tuple[float, float] = (10.0, float("inf"))
    nominal_chi_square: tuple[float, float] = (10.0, 100.0)
    attenuation: tuple[float, float] = (1.1, 1.5)
    deviation: tuple[float, float] = (0.1, 0.5)
    strain: float = WEAK_SIGNAL
    factor: float = 1.3
    least_error: float = 0.02
    few_starts: tuple[int, int] = (5, 2)


LIMITS = Limits()


@dataclass(frozen=True)
class Quality:
    """What the verdict rests on. force_error: relative, on the fitted increments, NaN where no force is one of the section; expected_error:
    what noise alone would make of it, None where it is unknown; held_error: on increments held out, None where none were;
    neo_hooke_error: of the best single modulus, NaN where it is not known. attenuation: factor by which noise lowers the stiffness, and
    whether the stiffness was raised by it. relative_deviation: of the initial shear modulus. imbalance: of the measured forces, over the
    largest, None where they balance. alike: of so many starts, those that ended as low as the best. unexplained: whether a diagnosis found nothing that explains the test; unconverged: whether its last fit would still change."""

    signals: tuple[StrainSignal, ...]
    level_is_nominal: bool
    has_rim: bool
    force_error: float
    expected_error: float | None = None
    held_error: float | None = None
    neo_hooke_error: float = float("nan")
    reduced_chi_square: float = float("nan")
    attenuation: float = 1.0
    raised: bool = False
    relative_deviation: float = 0.0
    dead_network: bool = False
    imbalance: float | None = None
    starts: int = 1
    alike: int = 1
    unexplained: bool = False
    unconverged: bool = False


@dataclass(frozen=True)
class Headline:
    """verdict with the reasons against the use, and the reservations."""

    verdict: Use
    against: tuple[Finding, ...]
    reservations: tuple[Finding, ...]

    @property
    def text(self) -> str:
        """'Usable with reservations: ...; ...'."""
        return WORDS.headline(verdict=self.verdict, reasons=self.in_words)

    @property
    def reasons(self) -> tuple[Finding, ...]:
        """Those against the use first."""
        return *self.against, *self.reservations

    @property
    def in_words(self) -> tuple[str, ...]:
        """The reasons as words of a sentence."""
        return tuple(finding.text.removesuffix(".") for finding in self.reasons)

    @property
    def fitness(self) -> Fitness:
        """As the model file keeps it."""
        return Fitness(self.verdict, self.in_words)

    def to_dict(self) -> dict[str, Any]:
        """For a manifest."""
        return {
            "verdict": self.verdict,
            "against": [finding.to_dict() for finding in self.against],
            "reservations": [finding.to_dict() for finding in self.reservations],
        }


def headline(quality: Quality, limits: Limits = LIMITS) -> Headline:
    """The verdict on a model."""
    found = list(_found(quality, limits))
    against = tuple(replace(finding, raised=True) for severe, finding in found if severe)
    reservations = tuple(finding for severe, finding in found if not severe)
    verdict = Use.NOT if against else Use.RESERVATIONS if reservations else Use.USABLE
    return Headline(verdict, against, reservations)


def _found(q: Quality, limits: Limits) -> Iterator[tuple[bool, Finding]]:
    """Each reason, and whether it forbids the use."""
    if not q.level_is_nominal:
        yield from _of_forces(q, limits)
    yield from _of_noise(q, limits)
    if q.dead_network:
        yield False, _finding(Reason.DEAD_NETWORK)
    share, least = limits.few_starts
    if q.starts > 1 and q.alike < max(least, q.starts // share):
        yield False, _finding(Reason.FEW_STARTS, alike=q.alike, starts=q.starts)
    if q.imbalance is not None:
        yield False, _finding(Reason.IMBALANCE, share=q.imbalance)
    if q.unexplained:
        yield False, _finding(Reason.UNEXPLAINED)
    if q.unconverged:
        yield q.unexplained, _finding(Reason.UNCONVERGED)


def _of_forces(q: Quality, limits: Limits) -> Iterator[tuple[bool, Finding]]:
    level = _level(q.force_error, limits.force_error)
    if level is not None:
        yield level, _finding(Reason.FORCES_MISSED, error=q.force_error, expected=q.expected_error)
        if q.has_rim:
            yield False, _finding(Reason.ASK_RIM)
    if q.force_error > max(limits.factor * q.neo_hooke_error, limits.least_error):
        yield False, _finding(Reason.WORSE_THAN_NEO_HOOKE, error=q.force_error, neo_hooke_error=q.neo_hooke_error)
    level = None if q.held_error is None else _level(q.held_error, limits.held_error)
    if level is not None:
        yield level, _finding(Reason.FORCES_NOT_PREDICTED, error=q.held_error)


def _of_noise(q: Quality, limits: Limits) -> Iterator[tuple[bool, Finding]]:
    # where the level is nominal no force judges the model, and the residual alone has to
    level = _level(q.reduced_chi_square, limits.nominal_chi_square if q.level_is_nominal else limits.chi_square)
    if level is not None:
        yield level, _finding(Reason.ABOVE_NOISE, reduced_chi_square=q.reduced_chi_square)
    level = _level(q.attenuation, limits.attenuation)
    ratio = min(one.ratio for one in q.signals)
    if level is not None and not q.level_is_nominal:  # forces that say nothing attenuate by themselves
        yield (
            level,
            _finding(
                Reason.ATTENUATED,
                factor=q.attenuation,
                raised=q.raised,
                by_noise=not q.reduced_chi_square > limits.chi_square[0] and q.attenuation - 1 < BY_NOISE / ratio**2,
            ),
        )
    level = _level(q.relative_deviation, limits.deviation)
    if level is not None and not q.level_is_nominal:
        yield level, _finding(Reason.UNCERTAIN_STIFFNESS, relative=q.relative_deviation)
    if q.level_is_nominal:
        yield False, _finding(Reason.RIM)
    signal = min(q.signals, key=lambda one: one.ratio)
    if signal.ratio < limits.strain:
        data = {"strain": signal.strain, "scatter": signal.scatter, "ratio": signal.ratio}
        # where neither level nor shape is known, nothing is
        yield q.level_is_nominal, _finding(Reason.WEAK_STRAIN, **data, level_is_nominal=q.level_is_nominal)


def _level(value: float, limits: tuple[float, float]) -> bool | None:
    """None below both limits or where the value is unknown (NaN), False above the first, True above the second."""
    if np.isnan(value) or value <= limits[0]:
        return None
    return value > limits[1]


def _finding(code: Reason, **data: Any) -> Finding:
    return Finding("headline", code, data)
