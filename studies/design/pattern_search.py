"""The best dimensions of one kind of specimen: ranges in, the specimen that predicts the stress best out.

Half of the evaluations are spread over the ranges (Sobol points), the others follow Nelder and Mead's simplex (1965, Computer J. 7) from the best of
these: the score has no derivative, as each specimen is meshed anew. Dimensions are rounded to 0.01 mm. A specimen that breaks a limit scores
infinitely. Each evaluation is kept in a file, so that a search that was interrupted goes through them again in no time.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import qmc

from meshes import Specimen, specimen_from_dict
from meshes.errors import SpecimenError
from studies.design.candidates import Candidate, family_of, judge, known_before
from studies.design.design_plan import OptimiseTable, Plan
from studies.design.information import Criteria
from studies.errors import DesignError
from studies.output import Progress, write_json
from studies.output.folder import key_hash

Array = NDArray[np.float64]
DECIMALS = 2
SIMPLEX = 0.15  # edge of the first simplex, of the ranges


@dataclass(frozen=True)
class Evaluation:
    """Dimensions that were sought, mm or rad, and their score: `Criteria.overall`, infinite where a limit is broken (reason)."""

    values: dict[str, float]
    score: float
    reason: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain data; an infinite score is None."""
        return {"values": self.values, "score": self.score if np.isfinite(self.score) else None, "reason": self.reason}

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Evaluation:
        """Of what `to_dict` gave."""
        score = content["score"]
        return cls(content["values"], np.inf if score is None else score, content["reason"])


@dataclass(frozen=True)
class Search:
    """A search that came to its end: the evaluations of different specimens in order, and the specimen of the best."""

    evaluations: list[Evaluation]
    specimen: Specimen

    @property
    def best(self) -> Evaluation:
        """With the smallest score."""
        return min(self.evaluations, key=lambda e: e.score)


def search(plan: Plan, candidates: Sequence[Candidate], folder: Path) -> Search:
    """Optimise what the plan's [optimise] names, beside the tests that exist. Raises `DesignError` where no specimen keeps the limits."""
    assert plan.optimise is not None
    table = plan.optimise
    score = _Score(plan, table, candidates, folder)
    low = np.array([ends[0] for ends in table.between.values()])
    spread = max(2, table.evaluations // 2)
    with score.progress:
        points = qmc.Sobol(len(low), seed=table.seed).random_base2(int(np.ceil(np.log2(spread))))[:spread]
        for point in points:
            score(point)
        start = points[int(np.argmin([e.score for e in score.evaluations]))]
        if np.isfinite(min(e.score for e in score.evaluations)):
            simplex = np.vstack([start, start + SIMPLEX * np.diag(np.where(start + SIMPLEX <= 1, 1.0, -1.0))])
            most = table.evaluations - spread + 1  # the start again
            options = {"maxfev": most, "initial_simplex": simplex, "xatol": 1e-3, "fatol": 0.0}
            minimize(score, start, method="Nelder-Mead", bounds=[(0, 1)] * len(low), options=options)
    best = min(score.evaluations, key=lambda e: e.score)
    if not np.isfinite(best.score):
        raise DesignError(
            f"[optimise] no specimen in these ranges keeps the limits; the last: {score.evaluations[-1].reason}"
        )
    return Search(score.evaluations, with_dimensions(table, best.values))


@dataclass
class _Score:
    """The score at a point of the unit cube; what was evaluated is looked up."""

    plan: Plan
    table: OptimiseTable
    candidates: Sequence[Candidate]
    folder: Path
    evaluations: list[Evaluation] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.family = family_of(self.plan)
        self.known = known_before(self.candidates, self.family)
        self.progress = Progress("search", self.table.evaluations, "specimens")

    def __call__(self, point: Array) -> float:
        values = {
            name: round(float(low + x * (high - low)), DECIMALS)
            for x, (name, (low, high)) in zip(point, self.table.between.items(), strict=True)
        }
        path = self.folder / f"{key_hash(values)}.json"
        if not path.exists():
            write_json(path, self.evaluate(values).to_dict())
        found = Evaluation.from_dict(json.loads(path.read_text()))
        if found not in self.evaluations:
            self.evaluations.append(found)
            self.progress.update()
        return found.score

    def evaluate(self, values: dict[str, float]) -> Evaluation:
        """Mesh, pull and judge."""
        try:
            specimen = with_dimensions(self.table, values)
        except SpecimenError as error:
            return Evaluation(values, np.inf, str(error))
        found = judge("sought", specimen, self.plan, equations=False)
        if found.test is None:
            return Evaluation(values, np.inf, found.reason)
        return Evaluation(values, Criteria.of(self.known + found.test, self.family).overall)


def with_dimensions(table: OptimiseTable, values: dict[str, float]) -> Specimen:
    """The specimen with dimensions at their places: 'perforation.0.y' is the y of the first hole. Raises `SpecimenError`, `DesignError`."""
    content = {"specimen": table.kind, **copy.deepcopy(table.dimensions)}
    for name, value in values.items():
        *path, last = [int(part) if part.isdigit() else part for part in name.split(".")]
        place: Any = content
        try:
            for part in path:
                place = place[part]
            place[last] = value
        except (KeyError, IndexError, TypeError) as error:
            raise DesignError(
                f"[optimise] between '{name}': [optimise.dimensions] of {table.kind} has no such place"
            ) from error
    return specimen_from_dict(content)
