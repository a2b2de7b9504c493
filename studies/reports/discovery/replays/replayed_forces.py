"""Forces and fields of models that were replayed, picture by picture: a `Discovery` in; `ForceCourse`s and rows of files out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.diagnosis.replayed.checked_replay import ReplayCheck
from calibrate.diagnosis.replayed.observations import Observations
from calibrate.diagnosis.selection import Discovery
from calibrate.models.parameter_covariance import Z95
from studies.reports.discovery.replays.replay_section import Table, models_of
from studies.reports.discovery.replays.replayed_models import replayed_models

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ForceCourse:
    """A model on a test, by its number. pictures (k,): numbers of those that were compared, from 0; held (k,): whether they were held out. measured, as it was read, and
    replayed, as it should have been read (k,): root mean square over the grips of the size of their forces, N."""

    model: str
    test: int
    pictures: NDArray[np.int64]
    held: NDArray[np.bool_]
    measured: Array
    replayed: Array

    @property
    def difference(self) -> Array:
        """(k,): over the largest measured force."""
        return np.asarray((self.replayed - self.measured) / self.measured.max())


def force_courses(found: Discovery) -> list[ForceCourse]:
    """Of every test with forces and every model; none without a replay."""
    check = found.replay_check
    if not isinstance(check, ReplayCheck):
        return []
    models, read = models_of(check, replayed_models(found)), check.base.rows.measured  # the base corrects nothing
    return [one for name, model in models for one in _courses(name, model.rows, read)]


def _courses(name: str, rows: Observations, read: Array) -> Iterator[ForceCourse]:
    for test in np.unique(rows.test[rows.is_force]).tolist():
        own = np.flatnonzero(rows.is_force & (rows.test == test))
        grips = len({rows.labels[i].rsplit(" ", 1)[0] for i in own})
        pictures, first, which = np.unique(rows.increment[own], return_index=True, return_inverse=True)
        sizes = (np.sqrt(np.bincount(which, values[own] ** 2) / grips) for values in (read, read - rows.residual))
        yield ForceCourse(name, test, pictures, rows.held[own][first], *sizes)


def course_rows(courses: Sequence[ForceCourse], tests: Sequence[Experiment]) -> tuple[list[str], list[list[Any]]]:
    """One row a model, test and picture."""
    columns = ["experiment", "increment", "time", "held_out", "model", "measured", "replayed"]
    rows: list[list[Any]] = []
    for one in courses:
        time = tests[one.test].time
        seen = None if time is None else time[tests[one.test].pictures]
        for k, picture in enumerate(one.pictures.tolist()):
            now = None if seen is None else float(seen[picture])
            rows.append([tests[one.test].name, picture + 1, now, int(one.held[k]), one.model, float(one.measured[k]), float(one.replayed[k])])  # fmt: skip
    return columns, rows


def band_rows(check: ReplayCheck, names: list[str], times: list[Any]) -> Table:
    """Forces of every increment that was compared, N, with half their 95 % band. names, times: of the tests, and of their pictures, s, or None."""
    base, final, deviation = check.base.rows, check.final.rows, check.band.deviation
    columns = ["experiment", "increment", "time", "held_out", "boundary_component", "measured", "base", "final", "half_band"]  # fmt: skip
    rows = []
    for i in np.flatnonzero(final.is_force):
        test, k = int(final.test[i]), int(final.increment[i])
        time = None if times[test] is None else float(times[test][k])
        rows.append([names[test], k + 1, time, int(final.held[i]), final.labels[i], *map(float, (
            final.measured[i], base.replayed[i], final.replayed[i], Z95 * deviation[i]))])  # fmt: skip
    return columns, rows


def band_fields(check: ReplayCheck, names: list[str]) -> Table:
    """Smooth part of measured minus replayed displacement of every increment that was compared, mm, with half its 95 % band; of tests that have points which the grips do not prescribe."""
    base, final, variance = check.base.rows, check.final.rows, check.band.deviation**2
    columns = ["experiment", "increment", "held_out", "residual_rms", "smooth_base", "smooth_final", "half_band"]
    rows = []
    pairs = sorted(set(zip(final.test.tolist(), final.increment.tolist(), strict=True)))
    for test, k in ((test, k) for test, k in pairs if final.points[test]):
        where = (final.test == test) & (final.increment == k) & ~final.is_force
        size = np.sqrt(2 * final.points[test])
        smooth = [float(np.sqrt((one.residual[where] ** 2).sum()) / size) for one in (base, final)]
        band = Z95 * float(np.sqrt(variance[where].sum())) / size
        held = int(final.held[where].any())
        rows.append([names[test], k + 1, held, float(np.sqrt(final.squares[test, k])), *smooth, float(band)])
    return columns, rows
