"""Course of the forces of every model that was replayed: a `Discovery` in, `ForceCourse`s and rows of a file out."""

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
from studies.reports.discovery.replay_section import models_of, replayed_models

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
