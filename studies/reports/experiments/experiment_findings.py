"""What a reader of any report should know of an Experiment: pictures that were not used, forces that do not balance, a bulk modulus that noise may
lower, noise that is not what was stated."""

from __future__ import annotations

from dataclasses import asdict

from calibrate.data.experiment import Experiment
from calibrate.fitting.noise.noise_check import NoiseCheck
from studies.importers.recording.notes import against_the_force
from studies.output.findings import Finding, Macro

FAR = 1.5  # factor between the noise that is used and the stated one, from which it is a warning
LEAST = 0.005  # of the largest force, by which forces that were measured need not balance


class ExperimentCode(Macro):
    """Macros of ``templates/experiment.txt``."""

    IMBALANCE = "forces_do_not_balance"
    BULK_MODULUS = "bulk_modulus_with_unknown_noise"
    PICTURES = "pictures_used"
    NOISE_FOUND = "noise_found"
    AGAINST = "against_the_force"


def experiment_findings(experiment: Experiment, noise_is_known: bool) -> list[Finding]:
    """Pictures that were not used; forces that do not balance; increments that get longer while the force falls; a bulk modulus that unknown noise may have lowered."""
    unbalanced = imbalance(experiment)
    found = pictures(experiment) + ([] if unbalanced is None else [unbalanced])
    if increments := against_the_force(experiment):
        found.append(Finding("experiment", ExperimentCode.AGAINST, {"name": experiment.name, "increments": increments}))
    if experiment.plane == "strain" and not noise_is_known:
        found.append(Finding("experiment", ExperimentCode.BULK_MODULUS))
    return found


def pictures(experiment: Experiment) -> list[Finding]:
    """How many of all pictures were used, where it was not all."""
    told = experiment.provenance.get("pictures")
    return [] if told is None else [Finding("experiment", ExperimentCode.PICTURES, {"name": experiment.name, **told})]


def imbalance(experiment: Experiment) -> Finding | None:
    """Where measured forces do not add up to zero by more than noise, and nothing else can carry the rest."""
    found = experiment.force_imbalance
    if found is None or found[0] <= max(LEAST, 4 * found[1]):
        return None
    return Finding("experiment", ExperimentCode.IMBALANCE, {"name": experiment.name, "share": float(found[0])})


def noise_found(name: str, check: NoiseCheck, clock_unit: str = "s") -> Finding:
    """The noise that is used in place of the stated one; stated, found: standard deviations, mm. clock_unit: see `Experiment.clock_unit`."""
    used = check.used and {
        **asdict(check.used),
        "is_common": check.used.is_common,
        "is_correlated": check.used.is_correlated,
    }
    stated = None if check.stated is None else check.stated.total_std
    data = {
        "stated": stated,
        "found": check.found,
        "factor": check.factor,
        "used": used,
        "common_found": check.common_found,
        "clock_unit": clock_unit,
    }
    far = stated is None or not 1 / FAR <= check.factor <= FAR
    return Finding("experiment", ExperimentCode.NOISE_FOUND, {"name": name, **data, "far": far}, far)
