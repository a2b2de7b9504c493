"""What the verdict on the final model of a diagnosis rests on: a `View` in, a `Quality` out."""

from __future__ import annotations

from calibrate.diagnosis.problem import stiffness_factor
from calibrate.diagnosis.selection import Verdict
from studies.reports.discovery.view import View
from studies.reports.headline import Headline, Quality, headline


def discovery_headline(view: View) -> Headline:
    """The verdict on the final model."""
    return headline(discovery_quality(view))


def discovery_quality(view: View) -> Quality:
    """Of the final model."""
    found = view.discovery
    last, trained = found.rounds[-1], found.problem.trained
    return Quality(
        signals=tuple(part.experiment.strain_signal for part in trained),
        level_is_nominal=found.problem.level_is_nominal,
        has_rim=any(part.experiment.has_rim for part in trained),
        force_error=last.train.force,
        held_error=None if last.held is None else last.held.force,
        reduced_chi_square=found.final.reduced_chi_square if found.problem.noise_is_known else float("nan"),
        attenuation=stiffness_factor(found.problem, found.final.c, found.final.additions),
        unexplained=found.verdict is Verdict.NOT_EXPLAINED,
        unconverged=not found.final.converged,
    )
