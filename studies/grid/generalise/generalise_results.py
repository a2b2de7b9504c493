"""A finished study of generalisation: its folder in, its calibrations in typed form out, and what several seeds have in common.

Errors and ambiguities are relative: root of the mean square over a mode's stretches, over that of the truth (ambiguity: of the median prediction).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.equations.deformation_modes import MODES, mode_invariants, nominal_stress
from forward.materials import MATERIALS
from studies.accuracy.metrics import MaterialDerivatives, relative_rms_error
from studies.grid.generalise import calibrated_set, coverage
from studies.grid.generalise.calibrated_set import CalibratedSet, stretches
from studies.grid.generalise.coverage import States
from studies.grid.generalise.generalise_settings import MEASURED, SHEETS, GeneraliseSettings
from studies.grid.results import Spread, read

Array = NDArray[np.float64]
WORST = -1.0  # below which an r2_F is no worse


@dataclass(frozen=True)
class GeneraliseResults:
    """The calibrations in a study's folder."""

    folder: Path
    settings: GeneraliseSettings

    @cached_property
    def calibrations(self) -> dict[tuple[str, int], list[CalibratedSet]]:
        """By truth and seed. Raises `DamagedFileError`."""
        found: dict[tuple[str, int], list[CalibratedSet]] = {}
        for truth, seed, inputs in self.settings.cases:
            path = self.settings.case_path(self.folder, truth, seed, inputs)
            found.setdefault((truth, seed), []).extend(read(path, calibrated_set.load))
        return found

    def widths(self, truth: str) -> list[CalibratedSet]:
        """Those with the width that is seen, of the first seed."""
        return read(self.settings.width_path(self.folder, truth), calibrated_set.load)

    @cached_property
    def states(self) -> dict[str, dict[str, States]]:
        """By truth and specimen."""
        load = lambda path: coverage.from_arrays(dict(np.load(path)))  # noqa: E731
        return {truth: read(self.folder / "states" / f"{truth}.npz", load) for truth in self.settings.truths}

    def coverage(self, truth: str, tests: str) -> float:
        """Share of the states that a set reaches."""
        return coverage.coverage(self.states[truth][name].cells for name in tests.split("+"))

    def limits(self, truth: str, tests: str) -> Array:
        """(2,): ends of the calibrated range of I1 and I2 of a set."""
        return np.array([self.states[truth][name].limits for name in tests.split("+")]).max(axis=0)

    def chosen(self, truth: str, seed: int, **keys: Any) -> list[CalibratedSet]:
        """Calibrations of a seed whose `tests`, `inputs`, `layers` are those of `keys`."""
        return [one for one in self.calibrations[truth, seed] if all(getattr(one, k) == v for k, v in keys.items())]

    def spread(self, number: Callable[..., float], *arguments: Any) -> Spread:
        """Median and range over seeds of number(seed, *arguments)."""
        return Spread.of(number(seed, *arguments) for seed in self.settings.seeds)

    def inputs(self) -> list[Path]:
        """Files that the report is made of."""
        return self.settings.targets(self.folder)

    @cached_property
    def truth_curves(self) -> dict[tuple[str, str], Array]:
        """Nominal stress (k,), MPa, by truth and mode; none of what was measured."""
        return {(truth, mode): true_stress(truth, mode, self.settings.end_I1)
                for truth in self.settings.truths if truth != MEASURED for mode in MODES}  # fmt: skip

    def error(self, truth: str, one: CalibratedSet, mode: str) -> float:
        """Relative error of a predicted mode."""
        expected = self.truth_curves[truth, mode]
        return relative_rms_error(expected, np.array(one.predictions[mode].stress))

    def end_error(self, truth: str, one: CalibratedSet, mode: str) -> float:
        """Relative error at the last stretch, with its sign."""
        return float(one.predictions[mode].stress[-1] / self.truth_curves[truth, mode][-1] - 1)

    def set_ambiguity(self, seed: int, truth: str, tests: str, inputs: str, mode: str) -> float:
        """Of all sizes and their likely starts."""
        return self.ambiguity(truth, self.chosen(truth, seed, tests=tests, inputs=inputs), mode)

    def ambiguity(self, truth: str, group: Sequence[CalibratedSet], mode: str, beyond: str = "") -> float:
        """Half the width of the band over calibrations and their likely starts. beyond: a set; only stretches out of its range count."""
        low, high = band(group, mode)
        middle = np.median([one.predictions[mode].stress for one in group], axis=0)
        used = np.ones(len(low), bool)
        if beyond:
            values = mode_invariants(mode, stretches(mode, self.settings.end_I1))
            used = (values > self.limits(truth, beyond)).any(axis=1)
        return rms((high - low)[used] / 2) / rms(middle[used]) if used.any() else 0.0


def band(group: Sequence[CalibratedSet], mode: str) -> tuple[Array, Array]:
    """Lowest and highest stress (k,) over calibrations and their likely starts."""
    low, high = (np.array([getattr(one.predictions[mode], end) for one in group]) for end in ("low", "high"))
    return low.min(axis=0), high.max(axis=0)


def mean_score(one: CalibratedSet, specimens: Iterable[str] = SHEETS) -> float:
    """Mean of r2_F over specimens, each not below `WORST`."""
    return float(np.mean([max(one.scores[name], WORST) for name in specimens if name in one.scores]))


def true_stress(truth: str, mode: str, end_I1: float) -> Array:
    """Nominal stress (k,), MPa, of a material in a mode."""
    return nominal_stress(MaterialDerivatives(MATERIALS[truth]()), mode, stretches(mode, end_I1))


def rms(values: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
