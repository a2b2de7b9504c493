"""What each specimen would tell: a plan in, one judged candidate a specimen out, kept in a file each so that a run can go on.

A candidate that cannot be tested keeps the reason instead.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.equations.kinematics import invariants_and_derivatives
from calibrate.errors import EquigapError
from forward.errors import FormsCacheError, ForwardError, MissingSolverError
from meshes import Specimen, specimen_from_dict
from meshes.errors import MeshError
from studies.design.design_plan import Plan, file_name
from studies.design.expected_information import equation_information, test_information
from studies.design.information import Criteria, Information
from studies.design.law_family import LawFamily
from studies.design.pulls_within_limits import Pull, limited_pull
from studies.errors import DesignError
from studies.output import track, write_json, write_npz

Array = NDArray[np.float64]
SHOWN = 4000  # states that are kept for a figure


@dataclass(frozen=True)
class End:
    """Of a pull: displacement of each grip, mm; limit that was met; largest force, N, and stretch; side of the field, mm; noise, mm."""

    displacement: float
    limit: str
    force: float
    stretch: float
    field: float
    noise: float

    @classmethod
    def of(cls, pull: Pull) -> End:
        """Of a solved pull."""
        force = max(float(values.max()) for values in pull.forces.values())
        view = pull.view
        return cls(pull.displacement, str(pull.limit), force, float(pull.stretches.max()), view.field, view.std)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A judged specimen. test, equations: information of the test, and of the equations of a calibration; None where there is none, for
    the reason given; without the first it is not feasible; tested: its data exist. states (s, 2): I1 and I2 that it reaches, in equal shares of area and picture."""

    title: str
    specimen: Specimen
    tested: bool = False
    end: End | None = None
    test: Information | None = None
    equations: Information | None = None
    states: Array | None = None
    reason: str = ""

    @property
    def axes(self) -> int:
        """Number of axes along which it is pulled."""
        return len({side in ("left", "right") for side in self.specimen.loaded})


def family_of(plan: Plan) -> LawFamily:
    """The laws that a plan holds possible. Raises `DesignError`, `MaterialError`."""
    law = plan.law
    return LawFamily(
        law.read(), plan.stretches, plan.sheet.largest_stretch, law.deviation, law.correlation_length, law.knots
    )


def judge(title: str, specimen: Specimen, plan: Plan, tested: bool = False, equations: bool = True) -> Candidate:
    """Pull a specimen as far as the limits allow and find what it would tell. Without `equations` in a tenth of the time. tested: it was on a machine,
    whatever this one allows."""
    family = family_of(plan)

    def tell() -> tuple[Pull, Information]:
        pull = limited_pull(specimen, family.base, plan, tested=tested)
        return pull, test_information(pull, family.base, family, plan)

    found, reason = _attempt(tell)
    if found is None:
        return Candidate(title, specimen, tested, reason=reason)
    pull, test = found
    calibration, reason = _attempt(lambda: equation_information(pull, family, plan)) if equations else (None, "")
    return Candidate(title, specimen, tested, End.of(pull), test, calibration, reached_states(pull), reason)


def _attempt[T](make: Callable[[], T]) -> tuple[T | None, str]:
    """What is made, or why it cannot be."""
    try:
        return make(), ""
    except (FormsCacheError, MissingSolverError):
        raise  # of the machine, and of no specimen
    except (DesignError, MeshError, ForwardError, EquigapError) as error:
        return None, str(error)


def reached_states(pull: Pull) -> Array:
    """I1 and I2 (s, 2) at places and pictures drawn by area."""
    _, weights, F = pull.quarter.gauss()
    values = np.asarray(invariants_and_derivatives(F.reshape(-1, 2, 2))[0])
    share = np.tile(weights, len(F)) / weights.sum() / len(F)
    steps = (np.arange(SHOWN) + 0.5) / SHOWN
    return values[np.searchsorted(np.cumsum(share), steps).clip(max=len(values) - 1)]


def judge_all(plan: Plan, folder: Path) -> list[Candidate]:
    """Every specimen of the plan, in its order; those that `folder` holds are read. Raises `OutputWriteError`."""
    found = []
    for table in track(plan.specimen, "specimens", unit="specimens"):
        path = folder / f"{file_name(table.title)}.json"
        if not path.exists():
            save(judge(table.title, table.read(), plan, table.tested), path)
        found.append(load(path))
    return found


def save(candidate: Candidate, path: Path) -> None:
    """Write a candidate: JSON, and its arrays beside it. Raises `OutputWriteError`."""
    arrays = {} if candidate.states is None else {"states": candidate.states}
    for name in ("test", "equations"):
        information = getattr(candidate, name)
        if information is not None:
            arrays |= {name: information.fisher, "prior": information.prior}
    write_npz(path.with_suffix(".npz"), **arrays)
    write_json(path, to_dict(candidate))


def load(path: Path) -> Candidate:
    """Read what `save` wrote."""
    content = json.loads(path.read_text())
    with np.load(path.with_suffix(".npz")) as arrays:
        kept = dict(arrays)
    information = {name: Information(kept[name], kept["prior"]) for name in ("test", "equations") if name in kept}
    return Candidate(
        content["title"], specimen_from_dict(content["specimen"]), content["tested"],
        None if content["end"] is None else End(**content["end"]), states=kept.get("states"), reason=content["reason"],
        **information,
    )  # fmt: skip


def to_dict(candidate: Candidate) -> dict[str, Any]:
    """Plain data without arrays."""
    end = candidate.end
    return {
        "title": candidate.title,
        "specimen": candidate.specimen.to_dict(),
        "tested": candidate.tested,
        "end": None if end is None else dict(vars(end)),
        "reason": candidate.reason,
    }


@dataclass(frozen=True, eq=False)
class Place:
    """A candidate and what is known after its test, beside the tests that exist already; equations: of the calibration's equations."""

    candidate: Candidate
    test: Criteria
    equations: Criteria | None


@dataclass(frozen=True, eq=False)
class Ranking:
    """places: feasible candidates that were not tested, best first by `Criteria.overall` of the test; refused: the others; before: what
    is known without any of them; known: from the tests that exist."""

    family: LawFamily
    known: Information
    places: list[Place]
    refused: list[Candidate]
    before: Criteria

    @property
    def best_on_one_axis(self) -> Place | None:
        """The first that a tensile machine can pull."""
        return next((place for place in self.places if place.candidate.axes == 1), None)


def known_before(candidates: Sequence[Candidate], family: LawFamily, kind: str = "test") -> Information:
    """Information of the tests that exist. kind: 'test' or 'equations'."""
    total = Information(np.zeros((family.size, family.size)), family.prior)
    for candidate in candidates:
        information = getattr(candidate, kind)
        if candidate.tested and information is not None:
            total = total + information
    return total


def rank(candidates: Sequence[Candidate], family: LawFamily) -> Ranking:
    """Best first."""
    known, of_equations = (known_before(candidates, family, kind) for kind in ("test", "equations"))
    places = []
    for candidate in candidates:
        if candidate.test is None or candidate.tested:
            continue
        equations = None if candidate.equations is None else Criteria.of(of_equations + candidate.equations, family)
        places.append(Place(candidate, Criteria.of(known + candidate.test, family), equations))
    places.sort(key=lambda place: place.test.overall)
    return Ranking(family, known, places, [c for c in candidates if c.test is None], Criteria.of(known, family))
