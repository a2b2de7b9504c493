"""What the verdict on a calibration rests on: a `Review` in, a `Quality` out."""

from __future__ import annotations

import numpy as np

from studies.reports.calibration.fit_review import Review, initial_shear_modulus, modulus_deviation
from studies.reports.experiments.experiment_findings import imbalance
from studies.reports.headline import Quality


def calibration_quality(view: Review) -> Quality:
    """Of a calibration, on fitted and on held-out increments."""
    calibration, experiment = view.calibration, view.experiment
    chi_square = calibration.reduced_chi_square
    if np.isnan(chi_square) and view.chi_square is not None:
        chi_square = float(view.fitted_chi_square or 0.0)
    deviation, unbalanced = modulus_deviation(view.model), imbalance(experiment)
    return Quality(
        signals=(experiment.strain_signal,),
        level_is_nominal=experiment.level_is_nominal,
        has_rim=experiment.has_rim,
        force_error=view.force_error(view.fitted),
        expected_error=expected_force_error(view),
        held_error=None if view.held_out is None else view.held_out.relative_force_error,
        neo_hooke_error=view.neo_hooke_error,
        reduced_chi_square=chi_square,
        attenuation=calibration.attenuation,
        raised=True,
        relative_deviation=0.0 if deviation is None else deviation / initial_shear_modulus(view.model),
        dead_network=calibration.dead_network,
        imbalance=None if unbalanced is None else unbalanced.data["share"],
        starts=len(calibration.losses),
        alike=view.starts_alike,
    )


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
