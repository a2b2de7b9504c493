"""What a reader of any report should know of an Experiment, in sentences.

In: an Experiment, and whether its noise is known. Out: remarks for the reports of `calibrate` and `discover`.
"""

from __future__ import annotations

from calibrate.data.experiment import Experiment

LEAST = 0.005  # of the largest force, by which forces that were measured need not balance


def experiment_remarks(experiment: Experiment, noise_is_known: bool) -> list[str]:
    """Forces that do not balance; a bulk modulus that unknown noise may have lowered."""
    unbalanced = imbalance_remark(experiment)
    remarks = [] if unbalanced is None else [unbalanced]
    if experiment.plane == "strain" and not noise_is_known:
        remarks.append(
            "Plane strain with unknown noise: noise in the change of volume may make the bulk modulus far too small. Give the noise "
            "to the Experiment."
        )
    return remarks


def imbalance_remark(experiment: Experiment) -> str | None:
    """A sentence where measured forces do not add up to zero by more than noise, and nothing else can carry the rest."""
    found = experiment.force_imbalance
    if found is None or found[0] <= max(LEAST, 4 * found[1]):
        return None
    return (
        f"The measured forces of {experiment.name} do not balance: their sum is {100 * found[0]:.2g} % of the largest force, which "
        "equilibrium does not allow and no model can meet; check the load cells and which boundary carries which force."
    )
