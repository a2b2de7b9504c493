"""A finished study: its folder in, its cases in typed form out, and what several seeds have in common.

Nothing is computed here but selections, medians and ranges.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np

from studies.errors import DamagedFileError
from studies.grid.axes import Case, Loss, Settings
from studies.grid.case import CaseResult, Fit


def read[T](path: Path, reader: Callable[[Path], T]) -> T:
    """What `reader` makes of a file. Raises `DamagedFileError` if it is not what was written."""
    try:
        return reader(path)
    except (OSError, ValueError, TypeError, KeyError, zipfile.BadZipFile, zlib.error, NotImplementedError) as error:
        raise DamagedFileError(f"{path}: damaged; delete it and run the same command again") from error


@dataclass(frozen=True)
class Spread:
    """Median and range over noise seeds, of `count` fits."""

    median: float
    low: float
    high: float
    count: int

    @classmethod
    def of(cls, values: Iterable[float]) -> Self:
        """Of at least one value; NaN where one of them is."""
        found = np.array(list(values), float)
        return cls(float(np.median(found)), float(found.min()), float(found.max()), len(found))

    def text(self, digits: int = 2) -> str:
        """'0.12 [-0.30, 0.45]', or the number alone where there is one fit."""
        if not np.isfinite(self.median):
            return "–"
        text = f"{self.median:.{digits}f}"
        if self.count > 1:
            text += f" [{self.low:.{digits}f}, {self.high:.{digits}f}]"
        return text.replace("-", "\N{MINUS SIGN}")


def median_biases(fits: Sequence[Fit], outside: bool = False) -> np.ndarray:
    """Median over fits of the bias (3,) in the homogeneous modes, relative."""
    return np.median([[s.bias for s in (fit.outside if outside else fit.inside)] for fit in fits], axis=0)


@dataclass(frozen=True)
class Results:
    """The cases in a study's folder. settings: those of its ``run.json``."""

    folder: Path
    settings: Settings

    @cached_property
    def cases(self) -> list[CaseResult]:
        """Every case, in the order of the settings. Raises `DamagedFileError`."""
        return [read(case.path(self.folder), CaseResult.load) for case in self.settings.cases]

    def fits(self, loss: Loss, noisy: bool | None = None, **keys: str) -> dict[Case, Fit]:
        """Fits of a loss where specimen, thickness, resolution, noise and seed are those of `keys`."""
        return {
            result.case: result.losses[loss]
            for result in self.cases
            if loss in result.losses
            and noisy in (None, result.case.noisy)
            and all(getattr(result.case, key) == value for key, value in keys.items())
        }

    @property
    def losses(self) -> list[Loss]:
        """Losses that some case was fitted with."""
        return [loss for loss in self.settings.losses if any(loss in result.losses for result in self.cases)]

    def inputs(self) -> list[Path]:
        """Files that the report is made of."""
        return [case.path(self.folder) for case in self.settings.cases]
