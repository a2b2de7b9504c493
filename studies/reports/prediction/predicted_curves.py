"""Curves of the three homogeneous tests that a calibrated model predicts.

In: a `Model`, or the law of a diagnosis. Out: a `Curve` for each mode, with 95 % bands where the model file holds an uncertainty, and findings on
where the model extrapolates.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis.selection.rounds import Verdict
from calibrate.equations.deformation_modes import MODES, largest_stretch, mode_invariants
from calibrate.equations.kinematics import invariants_and_derivatives
from calibrate.fitting.calibrated_range import near
from calibrate.models.compressible_sheet import compressible_deviation, compressible_sheet
from calibrate.models.diagnosed_law import DiagnosedLaw
from calibrate.models.model_uncertainty import Kind
from calibrate.models.network_model import Model
from calibrate.models.parameter_covariance import Z95
from studies.output.findings import Finding, Macro
from studies.reports.model_remarks import model_remarks
from studies.reports.prediction.diagnosed_bands import variances

Array = NDArray[np.float64]
MARGIN, NO_RANGE, LARGEST = 1.25, 2.0, 20.0
ROUND_OFF = 1e-9  # of a share of the calibrated range
LEAST, LIKELY = 1e-3, 0.5  # probability of a competing explanation that is counted; that is named


class Extent(Macro):
    """How far a curve is calibrated, and what its bands hold; macros of ``templates/prediction.txt``."""

    NO_RANGE = "no_calibrated_range"
    WITHIN = "within_calibrated_range"
    EXTRAPOLATES = "leaves_calibrated_range"
    OTHER_MODE = "leaves_calibrated_mode"
    BANDS = "bands"
    NO_BANDS = "no_bands"
    OF_DIAGNOSIS = "curves_of_diagnosis"
    DIAGNOSED_BANDS = "bands_of_diagnosis"
    SLOW = "infinitely_slow"
    AT_SPEED = "at_constant_speed"
    COMPRESSIBLE = "volume_changes_along_curves"
    LEFT_OUT = "effects_left_out_of_curves"


@dataclass(frozen=True)
class Curve:
    """A homogeneous test: stretch (k,), nominal stress (k,), invariants (k, 2), calibrated (k,), truth (k,) or None.

    Stresses in MPa, or N/mm where the thickness was unknown. limit: largest stretch within the calibrated range; by_mode: whether it ends there since the data have no states
    near this mode beyond.
    deviation (k,): standard deviation of the stress, None where the model file holds no uncertainty. direction: axis of the pull, '' where all are alike.
    """

    mode: str
    stretch: Array
    stress: Array
    invariants: Array
    calibrated: NDArray[np.bool_]
    limit: float
    truth: Array | None = None
    deviation: Array | None = None
    direction: str = ""
    by_mode: bool = False

    @property
    def name(self) -> str:
        """Of the mode, with its direction."""
        return f"{self.mode}_along_{self.direction}" if self.direction else self.mode

    @property
    def band(self) -> tuple[Array, Array] | None:
        """Lower and upper end (k,) of the 95 % band of the stress, or None."""
        if self.deviation is None:
            return None
        return self.stress - Z95 * self.deviation, self.stress + Z95 * self.deviation

    @property
    def extrapolates(self) -> bool:
        """Whether the curve leaves the calibrated range."""
        return not self.calibrated.all()

    @property
    def finding(self) -> Finding:
        """Where the curve leaves the calibrated range."""
        data: dict[str, Any] = {"mode": self.name.replace("_", " ")}
        if self.limit >= LARGEST:
            return Finding("prediction", Extent.NO_RANGE, data)
        data["end"] = float(self.stretch[-1])
        if not self.extrapolates:
            return Finding("prediction", Extent.WITHIN, data)
        macro = Extent.OTHER_MODE if self.by_mode else Extent.EXTRAPOLATES
        return Finding("prediction", macro, {**data, "limit": self.limit})

    def stress_at(self, stretch: float) -> float | None:
        """Stress at a stretch, by interpolation; None beyond the curve."""
        return float(np.interp(stretch, self.stretch, self.stress)) if stretch <= self.stretch[-1] else None

    def deviation_at(self, stretch: float) -> float | None:
        """Standard deviation of the stress at a stretch; None beyond the curve or where it is unknown."""
        if self.deviation is None or stretch > self.stretch[-1]:
            return None
        return float(np.interp(stretch, self.stretch, self.deviation))


def predict(
    model: Model | DiagnosedLaw,
    stretch: float | None = None,
    points: int = 101,
    truth: Callable[[str, Array, str], Array] | None = None,
) -> list[Curve]:
    """Curves of the three modes up to `stretch`, or a quarter beyond what was calibrated.

    truth: nominal stress (k,) of a known material in a mode at stretches (k,), along an axis where it has fibres.
    """
    curves = []
    for mode in MODES:
        furthest, limit = min(model.largest_stretch(mode), LARGEST), calibrated_stretch(model, mode)
        top = stretch or (1 + MARGIN * (furthest - 1) if 1 < furthest < LARGEST else NO_RANGE)
        x = np.linspace(1.0, top, max(points, 2))
        for axis in model.directions if isinstance(model, DiagnosedLaw) else ("",):
            known = None if truth is None else truth(mode, x, axis)
            if isinstance(model, DiagnosedLaw):
                curves.append(_of_diagnosis(model, mode, x, axis, limit, known))
            else:
                curves.append(_of_network(model, mode, x, limit, known))
    return curves


def _of_network(model: Model, mode: str, x: Array, limit: float, known: Array | None) -> Curve:
    """With a bulk modulus the sheet changes its volume, and is strained less than at constant volume: the calibrated range ends no earlier."""
    calibrated = x <= limit * (1 + ROUND_OFF)
    by_mode = limit < min(model.largest_stretch(mode), LARGEST) * (1 - ROUND_OFF)
    if model.bulk_modulus is None:
        values, stress, deviation = (
            mode_invariants(mode, x),
            model.homogeneous(mode, x),
            model.homogeneous_deviation(mode, x),
        )
    else:
        found, deviation = compressible_sheet(model, mode, x), compressible_deviation(model, mode, x)
        values, stress = found.invariants, found.stress
    return Curve(mode, x, stress, values, calibrated, limit, known, deviation, by_mode=by_mode)


def _of_diagnosis(law: DiagnosedLaw, mode: str, x: Array, axis: str, limit: float, known: Array | None) -> Curve:
    """Fibres and compressibility change the lateral stretch, so that the range ends elsewhere than for an isotropic and incompressible material."""
    F, stress = law.homogeneous(mode, x, axis)
    invariants = np.asarray(invariants_and_derivatives(jnp.asarray(F))[0])
    beyond = law.beyond(invariants, F)
    reached = float(x[np.logical_and.accumulate(beyond <= ROUND_OFF)][-1])
    if not axis and np.allclose(invariants, mode_invariants(mode, x)):
        reached = min(law.largest_stretch(mode), LARGEST)
    limit = min(limit, reached)
    calibrated = x <= limit * (1 + ROUND_OFF)
    beyond = np.maximum(beyond, _beyond_mode(law, mode, invariants))
    spread, deviation = law.model.uncertainty, None
    if spread is not None:
        parts = variances(law, spread, mode, x, axis, stress, np.maximum(beyond, 0.0))
        deviation = np.sqrt(np.sum(list(parts.values()), axis=0))
    return Curve(mode, x, stress, invariants, calibrated, limit, known, deviation, axis, limit < reached)


def calibrated_stretch(model: Model | DiagnosedLaw, mode: str) -> float:
    """Largest stretch of a mode within the calibrated range, in all and near the mode; `LARGEST` where the model states none."""
    return min(model.largest_stretch(mode), largest_stretch(mode, _end_near(model, mode)), LARGEST)


def _end_near(model: Model | DiagnosedLaw, mode: str) -> float:
    """I1 to which the data have states near a mode; infinite where the file does not say."""
    file = model.model if isinstance(model, DiagnosedLaw) else model
    return file.calibrated_range.get(near(mode), (3.0, np.inf))[1]


def _beyond_mode(law: DiagnosedLaw, mode: str, invariants: Array) -> Array:
    """(k,): strain of (I1, I2) (k, 2) beyond the states near a mode, over that of all the data."""
    end, whole = _end_near(law, mode), law.model.calibrated_range.get("I1", (3.0, np.inf))[1]
    if not np.isfinite(end) or not np.isfinite(whole):
        return np.zeros(len(invariants))
    strain, reached = np.sqrt(np.maximum(invariants[:, 0] - 3.0, 0.0)), np.sqrt(end - 3.0)
    return np.asarray((strain - reached) / np.sqrt(max(whole - 3.0, 1e-12)))


def band_finding(model: Model | DiagnosedLaw) -> Finding:
    """What the 95 % bands of a model hold."""
    if isinstance(model, DiagnosedLaw):
        spread = model.model.uncertainty
        if spread is None:
            return Finding("prediction", Extent.OF_DIAGNOSIS)
        missed = model.model.verdict == Verdict.NOT_EXPLAINED
        others = sorted(
            (one for one in spread.competitors if one.kind is not Kind.UNSEEN), key=lambda one: -one.probability
        )
        other = list(others[0].names) if others and others[0].probability > LIKELY else None
        count = sum(one.probability > LEAST for one in others)
        unseen = any(one.kind is Kind.UNSEEN for one in spread.competitors)
        given = {"competitors": count, "unseen": unseen, "missed": missed, "other": other}
        return Finding("prediction", Extent.DIAGNOSED_BANDS, given, missed)
    found = model.uncertainty
    if found is None:
        return Finding("prediction", Extent.NO_BANDS)
    data = {
        "noise_is_known": found.noise_is_known, "lower_bound": found.is_lower_bound,
        "widened": float(np.sqrt(found.scale)), "effective_parameters": found.effective_parameters,
        "parameters": len(found.factor),
    }  # fmt: skip
    return Finding("prediction", Extent.BANDS, data, not found.noise_is_known or found.is_lower_bound)


def findings(model: Model | DiagnosedLaw, curves: list[Curve]) -> list[Finding]:
    """What a reader of the curves should know."""
    own, file = (_of_law(model), model.model) if isinstance(model, DiagnosedLaw) else (_of_volume(model), model)
    return [*model_remarks(file), *own, *(curve.finding for curve in curves), band_finding(model)]


def _of_volume(model: Model) -> list[Finding]:
    """That the curves are those of a compressible sheet; nothing of an incompressible one."""
    if model.bulk_modulus is None:
        return []
    return [Finding("prediction", Extent.COMPRESSIBLE, {"bulk_modulus": model.bulk_modulus, "unit": model.unit})]


def _of_law(law: DiagnosedLaw) -> list[Finding]:
    """Speed, and what of the diagnosis is not in the curves."""
    found: list[tuple[Extent, dict[str, Any]]] = []
    if law.model.relaxes:
        found.append((Extent.SLOW, {}) if law.duration is None else (Extent.AT_SPEED, {"duration": law.duration}))
    if law.left_out:
        found.append((Extent.LEFT_OUT, {"effects": list(law.left_out)}))
    return [Finding("prediction", macro, data) for macro, data in found]
