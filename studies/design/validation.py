"""Does the ranking predict the error? Each candidate is tested in simulation and calibrated as a user would: `equigap calibrate`.

In: judged candidates, and a truth that is neither the expected law nor of its family. Out: the actual error of the predicted stress, for
each candidate and seed of the camera's noise, and the rank correlation of predicted and actual error.

The data share no discretisation with the prediction: the test is solved on a mesh of half the element size, pulled as far as the expected law
said, and recorded by the synthetic camera at the nodes of a triangulation, with noise that is made by FFT. The calibration knows neither the
expected law nor its prior.

The rule, fixed before the first run: the ranking *predicts* the error where the median over seeds of Spearman's rank correlation (predicted:
`Criteria.overall` of the test; actual: `ActualError.overall`; all feasible candidates) is at least 0.6 and no seed's is below 0; it *says
something* where the median is at least 0.3; else it does *not* predict. 0.6 is beyond chance at 5 % (one-sided) for nine candidates or more
(Zar 1972, J. Am. Stat. Assoc. 67).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from calibrate.errors import EquigapError
from calibrate.fitting.calibration import Options, calibrate
from forward.errors import ForwardError
from forward.loading import Loading
from forward.materials import Material
from forward.sheet.plane_stress import solve
from meshes.errors import MeshError
from studies.accuracy.metrics import relative_rms_error
from studies.design.candidates import Candidate, Ranking
from studies.design.design_plan import Plan, file_name
from studies.design.expected_information import camera_mesh
from studies.design.law_family import LawFamily
from studies.design.pulls_within_limits import meshed, view_of
from studies.output import Progress, write_json
from studies.synthetic.camera import Camera, GaussianField, observe

Array = NDArray[np.float64]
CALIBRATION = Options(inputs="I1I2", layers=(4, 4), starts=8)
FINER = 0.5  # size of the elements of the test over that of the prediction
GRID = 512  # of the random field


@dataclass(frozen=True)
class Thresholds:
    """Of the median rank correlation over seeds, see the module."""

    predicts: float = 0.6
    says_something: float = 0.3


class Verdict(StrEnum):
    """What the rank correlation says of the ranking."""

    PREDICTS = "predicts"
    SAYS_SOMETHING = "says_something"
    DOES_NOT = "does_not"


@dataclass(frozen=True)
class ActualError:
    """Of one calibration: {mode: root mean square of the stress error over that of the stress}; {} where it failed (reason)."""

    title: str
    seed: int
    modes: dict[str, float]
    reason: str = ""

    @property
    def overall(self) -> float:
        """Root mean square over the modes, as `Criteria.overall`; infinite where the calibration failed."""
        return float(np.sqrt(np.mean(np.square(list(self.modes.values()))))) if self.modes else float("inf")

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        return dict(vars(self))


@dataclass(frozen=True)
class Validation:
    """errors: of every candidate and seed, and of the optimised specimen; correlation: {kind of prediction: rank correlation of each seed}."""

    truth: dict[str, Any]
    errors: list[ActualError]
    correlation: dict[str, list[float]]

    @property
    def verdict(self) -> Verdict:
        """By the rule of the module."""
        found, limits = self.correlation["test"], Thresholds()
        if np.median(found) >= limits.predicts and min(found) >= 0:
            return Verdict.PREDICTS
        return Verdict.SAYS_SOMETHING if np.median(found) >= limits.says_something else Verdict.DOES_NOT

    def of(self, title: str, mode: str | None = None) -> Array:
        """Errors (seeds,) of a candidate, of all modes together or one."""
        return np.array(
            [e.overall if mode is None else e.modes.get(mode, np.inf) for e in self.errors if e.title == title]
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        errors = [e.to_dict() for e in self.errors]
        return {"truth": self.truth, "verdict": str(self.verdict), "correlation": self.correlation, "errors": errors}


def validate(ranking: Ranking, plan: Plan, folder: Path, optimised: Candidate | None = None) -> Validation:
    """Test and calibrate every ranked candidate and the optimised one, which the rank correlation leaves out.

    What `folder` holds is read. Raises `MaterialError`, `OutputWriteError`.
    """
    truth, errors = plan.validation.read(), []
    candidates = [*(place.candidate for place in ranking.places), *([optimised] if optimised else [])]
    with Progress("calibrations", len(candidates) * plan.validation.seeds, "calibrations") as progress:
        for candidate in candidates:
            path = folder / f"{file_name(candidate.title)}.json"
            if not path.exists():
                found = actual_errors(candidate, truth, ranking.family, plan)
                write_json(path, [error.to_dict() for error in found])
            errors += [ActualError(**content) for content in json.loads(path.read_text())]
            progress.update(plan.validation.seeds)
    return Validation(truth.to_dict(), errors, correlations(ranking, errors))


def actual_errors(candidate: Candidate, truth: Material, family: LawFamily, plan: Plan) -> list[ActualError]:
    """Of one candidate, for every seed."""
    assert candidate.end is not None
    specimen, displacement, seeds = candidate.specimen, candidate.end.displacement, range(plan.validation.seeds)
    loading, view = Loading.clamped(specimen.loaded, displacement), view_of(specimen, displacement, plan)
    try:
        points = camera_mesh(specimen, view)
        mesh = meshed(specimen, FINER * plan.size_factor)
        solution = solve(mesh, truth, loading, plan.camera.pictures, plan.sheet.thickness_mm).mirrored()
    except (ForwardError, MeshError) as error:
        return [ActualError(candidate.title, seed, {}, str(error)) for seed in seeds]
    camera = Camera(
        GaussianField(view.correlation_length, GRID), plan.camera.noise, view.field, plan.machine.force_noise
    )
    found = []
    for seed in seeds:
        try:
            model = calibrate(observe(solution, points, camera, seed), CALIBRATION).model
        except EquigapError as error:
            found.append(ActualError(candidate.title, seed, {}, str(error)))
            continue
        found.append(ActualError(candidate.title, seed, stress_errors(model.homogeneous, truth, family)))
    return found


def stress_errors(stress: Any, truth: Material, family: LawFamily) -> dict[str, float]:
    """{mode: error} of a function stress(mode, stretches (p,)), MPa, as `Criteria.deviation` is defined."""
    true = LawFamily(truth, family.stretches)
    found = {}
    for mode in family.stretches:
        expected = true.stress(mode)
        found[mode] = relative_rms_error(expected, np.asarray(stress(mode, true.stretch(mode))))
    return found


def correlations(ranking: Ranking, errors: Sequence[ActualError]) -> dict[str, list[float]]:
    """Spearman's rank correlation over the candidates, of each seed: predicted by the test, by the equations, and of each mode by the test."""
    titles = [place.candidate.title for place in ranking.places]
    actual = {(e.title, e.seed): e for e in errors}
    seeds = sorted({e.seed for e in errors})
    predicted = {"test": [place.test.overall for place in ranking.places]}
    if all(place.equations is not None for place in ranking.places):
        predicted["equations"] = [place.equations.overall for place in ranking.places if place.equations is not None]
    result = {
        kind: [_spearman(values, [actual[title, seed].overall for title in titles]) for seed in seeds]
        for kind, values in predicted.items()
    }
    for mode in ranking.family.stretches:
        values = [place.test.deviation[mode] for place in ranking.places]
        result[mode] = [_spearman(values, [actual[t, seed].modes.get(mode, np.inf) for t in titles]) for seed in seeds]
    return result


def _spearman(one: Sequence[float], other: Sequence[float]) -> float:
    return float(spearmanr(one, other).statistic)
