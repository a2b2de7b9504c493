"""Whether a calibration may be used: the first thing that report, terminal and manifest say of it.

In: a `Review`. Out: `Headline`: usable, usable with reservations, or not to be used, with the reasons as findings. A small
chi-square says that the residual is no larger than noise, which is nothing where the noise hides the forces; a small force error says
nothing of equilibrium inside. Both are weighed, and what the strain, the noise and the network can carry.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from studies.output.findings import Finding
from studies.reports.calibration.fit_review import Review, initial_shear_modulus, modulus_deviation
from studies.reports.experiments.experiment_findings import imbalance


class Use(StrEnum):
    """Verdict of a calibration."""

    USABLE = "usable"
    RESERVATIONS = "usable with reservations"
    NOT = "do not use"


class Reason(StrEnum):
    """Macros of ``templates/calibration.txt``."""

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


@dataclass(frozen=True)
class Limits:
    """Above the first a reservation, above the second not to be used. Force errors: relative. chi_square: reduced. attenuation:
    factor on the stiffness that makes up for noise. deviation: relative, of the initial shear modulus. strain: signal to noise, below
    which. factor: of a force error over that of one modulus, where that is above the least error."""

    force_error: tuple[float, float] = (0.05, 0.25)
    held_error: tuple[float, float] = (0.1, 0.3)
    chi_square: tuple[float, float] = (10.0, float("inf"))
    attenuation: tuple[float, float] = (1.1, 1.5)
    deviation: tuple[float, float] = (0.1, 0.5)
    strain: float = 3.0
    factor: float = 1.3
    least_error: float = 0.02
    few_starts: tuple[int, int] = (5, 2)


LIMITS = Limits()


@dataclass(frozen=True)
class Headline:
    """verdict with the reasons against the use, and the reservations."""

    verdict: Use
    against: tuple[Finding, ...]
    reservations: tuple[Finding, ...]

    @property
    def text(self) -> str:
        """'Usable with reservations: ...; ...'."""
        return Finding("calibration", _Headline.TEXT, {"verdict": self.verdict, "reasons": self.reasons}).text

    @property
    def reasons(self) -> tuple[str, ...]:
        """In words; those against the use first."""
        return tuple(finding.text.removesuffix(".") for finding in (*self.against, *self.reservations))

    def to_dict(self) -> dict[str, Any]:
        """For a manifest."""
        return {
            "verdict": self.verdict,
            "against": [finding.to_dict() for finding in self.against],
            "reservations": [finding.to_dict() for finding in self.reservations],
        }


class _Headline(StrEnum):
    TEXT = "headline"


def headline(view: Review, limits: Limits = LIMITS) -> Headline:
    """The verdict of a calibration."""
    found = list(_found(view, limits))
    against = tuple(finding for severe, finding in found if severe)
    reservations = tuple(finding for severe, finding in found if not severe)
    verdict = Use.NOT if against else Use.RESERVATIONS if reservations else Use.USABLE
    return Headline(verdict, against, reservations)


def _found(view: Review, limits: Limits) -> Iterator[tuple[bool, Finding]]:
    """Each reason, and whether it forbids the use."""
    yield from _of_forces(view, limits)
    yield from _of_noise(view, limits)
    if view.calibration.dead_network:
        yield False, _finding(Reason.DEAD_NETWORK)
    n, alike = len(view.calibration.losses), view.starts_alike
    share, least = limits.few_starts
    if n > 1 and alike < max(least, n // share):
        yield False, _finding(Reason.FEW_STARTS, alike=alike, starts=n)
    unbalanced = imbalance(view.experiment)
    if unbalanced is not None:
        yield False, _finding(Reason.IMBALANCE, share=unbalanced.data["share"])


def _of_forces(view: Review, limits: Limits) -> Iterator[tuple[bool, Finding]]:
    if view.experiment.level_is_nominal:
        return
    error, simple, held = view.force_error(view.fitted), view.neo_hooke_error, view.held_out
    expected = expected_force_error(view)
    level = _level(error, limits.force_error)
    if level is not None:
        yield level, _finding(Reason.FORCES_MISSED, error=error, expected=expected)
        if view.experiment.has_rim:
            yield False, _finding(Reason.ASK_RIM)
    if error > max(limits.factor * simple, limits.least_error):
        yield False, _finding(Reason.WORSE_THAN_NEO_HOOKE, error=error, neo_hooke_error=simple)
    level = None if held is None else _level(held.relative_force_error, limits.held_error)
    if level is not None and held is not None:
        yield level, _finding(Reason.FORCES_NOT_PREDICTED, error=held.relative_force_error)


def _of_noise(view: Review, limits: Limits) -> Iterator[tuple[bool, Finding]]:
    chi_square = view.calibration.reduced_chi_square
    if np.isnan(chi_square) and view.chi_square is not None:
        chi_square = float(view.fitted_chi_square or 0.0)
    level = _level(chi_square, limits.chi_square)
    if level is not None:
        yield level, _finding(Reason.ABOVE_NOISE, reduced_chi_square=chi_square)
    level = _level(view.calibration.attenuation, limits.attenuation)
    if level is not None and not view.experiment.level_is_nominal:  # forces that say nothing attenuate by themselves
        yield level, _finding(Reason.ATTENUATED, factor=view.calibration.attenuation)
    deviation = modulus_deviation(view.model)
    relative = 0.0 if deviation is None else deviation / initial_shear_modulus(view.model)
    nominal = view.experiment.level_is_nominal
    level = _level(relative, limits.deviation)
    if level is not None and not nominal:
        yield level, _finding(Reason.UNCERTAIN_STIFFNESS, relative=relative)
    if nominal:
        yield False, _finding(Reason.RIM)
    signal = view.experiment.strain_signal
    if signal.ratio < limits.strain:
        data = {"strain": signal.strain, "scatter": signal.scatter, "ratio": signal.ratio, "level_is_nominal": nominal}
        yield nominal, _finding(Reason.WEAK_STRAIN, **data)  # where neither level nor shape is known, nothing is


def expected_force_error(view: Review) -> float | None:
    """Relative force error that noise alone would make on the fitted increments; None where it is unknown."""
    if view.deviations is None:
        return None
    expected = measured = 0.0
    for name, force in view.measured.items():
        for k in (0, 1):
            known = np.isfinite(force[:, k]) & view.fitted
            deviation = view.force_deviation(name, k)
            if known.any() and deviation is not None:
                expected += float((deviation[known] ** 2).sum())
                measured += float((force[known, k] ** 2).sum())
    return float(np.sqrt(expected / measured)) if measured else None


def _level(value: float, limits: tuple[float, float]) -> bool | None:
    """None below both limits, False above the first, True above the second, or where the value is not finite."""
    if np.isnan(value) or value <= limits[0]:
        return None
    return value > limits[1]


def _finding(code: Reason, **data: Any) -> Finding:
    return Finding("calibration", code, data)
