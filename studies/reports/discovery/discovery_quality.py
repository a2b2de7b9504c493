"""What the verdict on the final model of a diagnosis rests on: a `View` in, a `Quality` out."""

from __future__ import annotations

import numpy as np

from calibrate.diagnosis.problem import stiffness_factor
from calibrate.diagnosis.selection import Discovery, Verdict
from studies.reports.discovery.replays.replayed_models import neo_hooke_replay
from studies.reports.discovery.view import View
from studies.reports.experiments.experiment_findings import imbalance
from studies.reports.headline import Headline, Quality, Reason, headline

# reasons against the final model that say nothing against the data, nor against other models of them
OF_THE_MODEL = {Reason.FORCES_MISSED, Reason.FORCES_NOT_PREDICTED, Reason.WORSE_THAN_NEO_HOOKE, Reason.UNCONVERGED}


def discovery_headline(view: View) -> Headline:
    """The verdict on the final model."""
    return headline(discovery_quality(view))


def others_hold(view: View) -> bool:
    """Whether models with a base of their own, as few effects and neo-Hooke have, hold whatever is said against the final one."""
    against = discovery_headline(view).against
    if against and view.discovery.few is None:
        return False
    at_their_level = {Reason.ATTENUATED} if neo_hooke_replay(view.discovery) is not None else set()
    return all(one.code in OF_THE_MODEL | at_their_level for one in against)


def discovery_quality(view: View) -> Quality:
    """Of the final model."""
    found = view.discovery
    trained, (_, (fitted, held)) = found.problem.trained, view.errors
    unbalanced = next(filter(None, (imbalance(part.experiment) for part in trained)), None)
    return Quality(
        signals=tuple(part.experiment.strain_signal for part in trained),
        level_is_nominal=found.problem.level_is_nominal,
        has_rim=any(part.experiment.has_rim for part in trained),
        force_error=fitted.force,
        held_error=None if held is None else held.force,
        neo_hooke_error=view.neo_hooke_error,
        reduced_chi_square=found.final.reduced_chi_square if found.problem.noise_is_known else float("nan"),
        attenuation=stiffness_factor(found.problem, found.final.c, found.final.additions),
        relative_deviation=modulus_deviation(found),
        imbalance=None if unbalanced is None else unbalanced.data["share"],
        unexplained=found.verdict is Verdict.NOT_EXPLAINED,
        unconverged=not found.final.converged,
    )


def modulus_deviation(found: Discovery) -> float:
    """Relative standard deviation of the modulus of the base at rest, its level included; 0 where it is not known."""
    one, rest = found.uncertainty, found.final.c[0]
    if one is None or not rest > 0:
        return 0.0
    return float(np.hypot(np.linalg.norm(one.root[0]) / rest, one.level_deviation))
