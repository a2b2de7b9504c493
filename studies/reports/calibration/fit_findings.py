"""What the numbers of a calibration mean: a `Review` in, typed findings out, worded by ``templates/calibration.txt``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibrate.fitting.classical_fit import Comparison
from calibrate.fitting.classical_fit import Verdict as Enough
from calibrate.models.fitness import SOFT
from calibrate.models.network_model import Model
from calibrate.models.parameter_covariance import MISFIT
from studies.output.findings import Finding, Macro
from studies.reports.calibration.classical_table import force_error
from studies.reports.calibration.fit_review import Review, initial_shear_modulus, section_shares
from studies.reports.calibration.polish_record import Kept, PolishRecord
from studies.reports.experiments.experiment_findings import experiment_findings, noise_found
from studies.reports.prediction.predicted_curves import band_finding


class FitCode(Macro):
    """Macros of ``templates/calibration.txt``."""

    NOISE_UNKNOWN = "noise_unknown"
    ABOVE_NOISE = "residuals_above_noise"
    FAR_ABOVE_NOISE = "residuals_far_above_noise"
    BELOW_NOISE = "residuals_below_noise"
    AS_NOISE = "residuals_as_noise"
    STARTS = "starts"
    FORCES = "forces"
    GRIPS = "grips_differ"
    NOT_SOFT = "not_soft"
    NOMINAL_LEVEL = "nominal_level"
    HELD_OUT = "held_out"
    CLASSICAL = "classical_laws"
    CLASSICAL_NOT_FITTED = "classical_not_fitted"
    CLASSICAL_NOT_COMPARED = "classical_not_compared"
    POLISHED = "polished"
    NOT_POLISHED = "not_polished"
    NOTHING_HELD_OUT = "nothing_held_out"
    THICKNESS_UNKNOWN = "thickness_unknown"
    PLANE_STRAIN = "plane_strain"


@dataclass(frozen=True)
class Thresholds:
    """Where a number is remarked upon. Reduced chi-square: below `overestimated`, above `misfit`, above `far`.

    few_starts: share of the starts that should agree, and their least number. Forces: worse than neo-Hooke by `factor` and
    more than `negligible`; held-out ones worse than `held_factor` times the fitted and more than `held_least`. Equilibrium of
    held-out increments: `held_chi_square` times the chi-square per equation of the fitted ones, or of noise if that is more. imbalance: of the model's forces, over the largest.
    """

    overestimated: float = 0.6
    misfit: float = MISFIT
    far: float = 10.0
    few_starts: tuple[int, int] = (5, 2)
    factor: float = 1.3
    negligible: float = 0.02
    held_factor: float = 3.0
    held_least: float = 0.05
    held_chi_square: float = 2.0
    imbalance: float = 0.05


LIMITS = Thresholds()


def findings(view: Review) -> list[Finding]:
    """What a reader of the numbers should know, the most important first."""
    found = [residuals(view), starts(view), forces(view), *grips(view), held_out(view), classical(view)]
    if not view.experiment.level_is_nominal:
        found += stiffness(view.model)
    if view.polish is not None:
        found.insert(0, polish(view.polish))
    if view.model.uncertainty is not None:
        found.append(band_finding(view.model))
    if view.experiment.thickness is None:
        found.append(_finding(FitCode.THICKNESS_UNKNOWN))
    found += experiment_findings(view.experiment, view.chi_square is not None)
    if view.noise is not None and view.noise.corrected:
        found.append(noise_found(view.experiment.name, view.noise, view.experiment.clock_unit))
    if view.experiment.plane == "strain":
        found.append(_finding(FitCode.PLANE_STRAIN))
    return found


def polish(record: PolishRecord) -> Finding:
    """What the polish did, or why its model was not kept."""
    data = {"iterations": record.iterations, "before": record.before, "after": record.after}
    if record.kept is Kept.POLISHED:
        return _finding(FitCode.POLISHED, held_before=record.held_before, held_after=record.held_after, **data)
    return _finding(FitCode.NOT_POLISHED, kept=str(record.kept), detail=record.detail,
                    held_before=record.held_before, held_after=record.held_after, **data)  # fmt: skip


def classical(view: Review) -> Finding:
    """Whether the data can tell the network from the classical laws, or why these were not fitted."""
    if view.classical is None:
        return _finding(FitCode.CLASSICAL_NOT_COMPARED, plane=view.experiment.plane)
    laws = view.classical.converged
    pair = (view.classical.network, laws[0]) if laws else ()
    missed = [force_error(view, one, view.fitted) for one in pair]
    return classical_finding(view.classical, view.model.architecture.inputs, missed)


def classical_finding(found: Comparison, inputs: str, missed: Sequence[float | None] = ()) -> Finding:
    """The best law against the network of `inputs`; missed: force errors of the network and of that law, where forces are met."""
    failed = [c.name for c in found.laws if c.fit is not None and not c.fit.reason.is_success]
    if not found.converged:
        return _finding(FitCode.CLASSICAL_NOT_FITTED, failed=failed)
    best, alike = found.converged[0], found.alike
    return _finding(
        FitCode.CLASSICAL, found.verdict is Enough.BETTER, verdict=str(found.verdict), law=best.name, numbers=int(best.numbers),
        difference=best.criterion, inputs=inputs, missed=[one for one in missed if one is not None], alike=[c.name for c in alike], failed=failed,
        unstable=[c.name for c in (best, *alike) if c.fit is not None and not c.fit.stability > 0],
    )  # fmt: skip


def residuals(view: Review) -> Finding:
    """Whether the residuals are as large as the stated noise."""
    if view.chi_square is None:
        return _finding(FitCode.NOISE_UNKNOWN)
    value = view.calibration.reduced_chi_square
    weighted = bool(np.isfinite(value))
    value = value if weighted else float(view.fitted_chi_square or 0.0)
    code = FitCode.AS_NOISE
    if value > LIMITS.misfit:
        code = FitCode.FAR_ABOVE_NOISE if value > LIMITS.far else FitCode.ABOVE_NOISE
    elif value < LIMITS.overestimated:
        code = FitCode.BELOW_NOISE
    return _finding(code, reduced_chi_square=value, loss_is_weighted=weighted)


def starts(view: Review) -> Finding:
    """How many random starts agree."""
    n, alike = len(view.calibration.losses), view.starts_alike
    share, least = LIMITS.few_starts
    few = n > 1 and alike < max(least, n // share)
    return _finding(FitCode.STARTS, few, alike=alike, starts=n, stopped=str(view.calibration.reason), few=few)


def forces(view: Review) -> Finding:
    """How well forces are met, beside the best neo-Hookean modulus; how the level was fixed where they are not those of the section."""
    if view.experiment.level_is_nominal:
        return _finding(FitCode.NOMINAL_LEVEL, increment=level_increment(view) + 1, shares=section_shares(view))
    error, simple = view.force_error(view.fitted), view.neo_hooke_error
    worse = bool(error > max(LIMITS.factor * simple, LIMITS.negligible))
    return _finding(FitCode.FORCES, worse, error=error, neo_hooke_error=simple, worse_than_neo_hooke=worse)


def stiffness(model: Model) -> list[Finding]:
    """Whether the model is as stiff as something soft; nothing where it is."""
    modulus, (least, most) = initial_shear_modulus(model), SOFT[model.unit]
    if least <= modulus <= most:
        return []
    return [_finding(FitCode.NOT_SOFT, modulus=modulus, unit=model.unit, limit=most if modulus > most else least)]


def grips(view: Review) -> list[Finding]:
    """Whether the model's forces of the grips balance as the measured ones do, in components that were measured at all of them; nothing where there is one grip, or forces are not
    those of the section."""
    if view.experiment.level_is_nominal or len(view.measured) < 2:
        return []
    both = [np.array([forces[name][view.fitted] for name in view.measured]) for forces in (view.forces, view.measured)]
    known = np.isfinite(both[1]).all(axis=0)
    if not known.any():
        return []
    largest = max(float(np.nanmax(np.abs(one[view.fitted]))) for one in view.measured.values())
    own, measured = (float(np.max(np.abs(one.sum(axis=0)[known]))) / largest for one in both)
    if own <= LIMITS.imbalance + measured:
        return []
    each = {name: float(np.linalg.norm(view.forces[name][view.fitted][-1])) for name in view.measured}
    return [_finding(FitCode.GRIPS, share=own, measured=measured, each=each)]


def level_increment(view: Review) -> int:
    """The increment, counted from 0, whose forces fix a nominal level."""
    fitted = int(np.argwhere(view.calibration.system.level_equation)[0, 0])
    return int(np.flatnonzero(view.fitted)[fitted])


def held_out(view: Review) -> Finding:
    """How well increments that were held out are predicted."""
    held = view.held_out
    if held is None:
        return _finding(FitCode.NOTHING_HELD_OUT)
    numbers = np.flatnonzero(~view.fitted) + 1
    n, fitted_error = view.experiment.n_increments, view.force_error(view.fitted)
    last = numbers.size == numbers[-1] - numbers[0] + 1 and numbers[-1] == n
    nominal = view.experiment.level_is_nominal
    usual, there = view.fitted_chi_square, held.chi_square_per_equation
    forces_worse = bool(
        not nominal and held.relative_force_error > max(LIMITS.held_least, LIMITS.held_factor * fitted_error)
    )
    equilibrium_worse = bool(
        usual is not None and there is not None and there > LIMITS.held_chi_square * max(1.0, usual)
    )
    return _finding(
        FitCode.HELD_OUT, forces_worse or equilibrium_worse, increments=held.increments, of=n, last=bool(last), error=held.relative_force_error,
        fitted_error=fitted_error, chi_square=there, fitted_chi_square=usual,
        forces_worse=forces_worse, equilibrium_worse=equilibrium_worse, level_is_nominal=nominal,
    )  # fmt: skip


def _finding(code: FitCode, raised: bool = False, /, **data: Any) -> Finding:
    return Finding("calibration", code, data, raised)
