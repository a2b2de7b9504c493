"""Noise of the displacements as the equations of equilibrium see it, beside what is stated.

In: an Experiment. Out: `NoiseCheck`, with the noise that a diagnosis works with.

The standard deviation is that of what a hyperelastic fit leaves in the equations of fine virtual fields (`fine_fields`). Of each of them the fit takes hardly a
degree of freedom, so that this is also the restricted maximum likelihood.

Where no noise is stated, or one that an import estimated from the fields alone, which takes fine structure for noise, its correlation length, or two of them, are found by `noise_lengths`, and what
increments have in common of it, and how it drifts, from the fine fields (`common_noise`). An error of the material grows with the deformation as
noise of the pattern does, so that the fit is then one of both invariants. A drift is seen between neighbours, so that each increment that is looked at
brings the ones before it along.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment, Noise
from calibrate.equations.basis import Basis, basis_for
from calibrate.equations.equilibrium import equilibrium
from calibrate.equations.reduction import assemble
from calibrate.fitting.network_fit import convex_spline
from calibrate.fitting.noise.common_noise import CommonRatios
from calibrate.fitting.noise.fine_fields import FINE, MOST_INCREMENTS, FineFields, evenly
from calibrate.fitting.noise.noise_lengths import correlated_unit

Array = NDArray[np.float64]
AGREES = 1.1  # factor by which a stated standard deviation may differ from what the equations see
INPUTS = "I1I2"
PASSES = 2  # of the weights of the fit
MATERIAL_INCREMENTS = 12  # of the fit, at most
NEIGHBOURS = 2  # before each increment, looked at for what increments have in common
FORCE_STD = 1e-3, 5e-4  # of a load cell whose noise is not stated: of the force, of the largest one


@dataclass(frozen=True)
class NoiseCheck:
    """stated: what the Experiment says, None where it says nothing. found: standard deviation of all parts (`Noise.total_std`), mm, that the
    equations see; NaN where too few points are there to tell. used: what a diagnosis works with, None where nothing is known."""

    stated: Noise | None
    found: float
    used: Noise | None

    @property
    def factor(self) -> float:
        """Standard deviation found over the stated one; NaN without either."""
        return self.found / self.stated.total_std if self.stated else float("nan")

    @property
    def common_found(self) -> bool:
        """Whether increments have noise in common, or one that drifts, that is not stated."""
        return bool(self.used and self.used.is_correlated and not (self.stated and self.stated.is_correlated))

    @property
    def corrected(self) -> bool:
        """Whether what is stated is not what is used."""
        return self.used != self.stated


def with_checked_noise(experiment: Experiment) -> tuple[Experiment, NoiseCheck]:
    """The Experiment with the noise that its equations see, where that is not what is stated."""
    return _with(experiment, check_noise(experiment))


def with_found_noise(experiment: Experiment) -> tuple[Experiment, NoiseCheck | None]:
    """The same for a calibration, where nobody stated a noise; as it is, and None, where someone did.

    All of it counts as new in each increment. An error of the model grows with the deformation and lasts over pictures as noise of the pattern and a drift do; weights that
    took it for these would follow small differences between increments, and give up the forces for them.
    """
    if experiment.noise_is_stated:
        return experiment, None
    check = check_noise(experiment)
    if check.used is not None and check.used.is_correlated:
        std, none = check.used.total_std, {"pattern_std": 0.0, "reference_std": 0.0, "correlation_time": 0.0}
        check = replace(check, used=replace(check.used, displacement_std=std, **none))
    return _with(experiment, check)


def _with(experiment: Experiment, check: NoiseCheck) -> tuple[Experiment, NoiseCheck]:
    return (replace(experiment, noise=check.used) if check.corrected else experiment), check


def check_noise(experiment: Experiment) -> NoiseCheck:
    """Raises the errors of `calibrate.equations.equilibrium.equilibrium`. In plane strain the stated noise is used unseen."""
    stated = experiment.noise if experiment.noise and experiment.noise.displacement_std > 0 else None
    unseen = NoiseCheck(stated, float("nan"), stated)
    if experiment.plane == "strain":
        return unseen
    basis, c = material(experiment)
    fine = FineFields.of(experiment, FINE, basis, c)
    if fine is None:
        return unseen
    if stated is None or not experiment.noise_is_stated:
        return _of_unstated(experiment, stated, fine, basis, c)
    return _of_stated(
        stated,
        fine,
        CommonRatios() if stated.is_correlated else _ratios(experiment, fine, unit_of(stated), basis, c),
    )


def _of_stated(stated: Noise, fine: FineFields, ratios: CommonRatios) -> NoiseCheck:
    """With what increments have in common, where none of it is stated but some is there."""
    unit = unit_of(stated)
    if any(ratios):
        used = _with_common(replace(stated, displacement_std=fine.std(unit, ratios.variances(fine.shares))), ratios)
        used = with_least_own(used, fine.system.experiment.temporal_std)
        return NoiseCheck(stated, used.total_std, used)
    factor = fine.std(unit, stated.variances(fine.shares)) / stated.displacement_std
    used = stated if 1 / AGREES <= factor <= AGREES else stated.scaled(factor)
    return NoiseCheck(stated, factor * stated.total_std, used)


def unit_of(noise: Noise) -> Noise:
    """Of 1 mm, new in each increment, with the same correlation between points."""
    return Noise(1.0, noise.correlation_length, second_length=noise.second_length, second_share=noise.second_share)


def with_least_own(noise: Noise, least: float) -> Noise:
    """The same variance in all, of which no less than least^2, mm^2, is not common to the increments: a few pictures of one ramp may show hardly any of it, and what
    changes from picture to picture is known from all of them."""
    total, common = noise.total_std, float(np.hypot(noise.pattern_std, noise.reference_std))
    if not noise.displacement_std < least < total:
        return noise
    share = float(np.sqrt(total**2 - least**2)) / common
    return replace(
        noise, displacement_std=least, pattern_std=share * noise.pattern_std, reference_std=share * noise.reference_std
    )


def _ratios(experiment: Experiment, fine: FineFields, unit: Noise, basis: Basis, c: Array) -> CommonRatios:
    """What increments have in common of noise of 1 mm, and its drift: of runs of neighbours where it drifts, else of increments far
    apart, between which an error of the material changes most."""
    runs = FineFields.of(experiment, FINE, basis, c, MOST_INCREMENTS, NEIGHBOURS)
    found = runs.common_ratios(unit, runs.clock) if runs else CommonRatios()
    return found if found.time else fine.common_ratios(unit)


def _with_common(noise: Noise, ratios: CommonRatios) -> Noise:
    """With variances over that of what increments have of their own."""
    pattern, reference = (float(noise.displacement_std * ratio**0.5) for ratio in (ratios.pattern, ratios.reference))
    return replace(noise, pattern_std=pattern, reference_std=reference, correlation_time=ratios.time)


def _of_unstated(
    experiment: Experiment, estimated: Noise | None, fine: FineFields, basis: Basis, c: Array
) -> NoiseCheck:
    """With its correlation lengths, and the load cell of what was estimated at import, or one of usual accuracy. An estimate that agrees is kept."""
    unit = correlated_unit(experiment, basis, c)
    ratios = _ratios(experiment, fine, unit, basis, c)
    std = fine.std(unit, ratios.variances(fine.shares))
    if not std > 0:
        return NoiseCheck(estimated, std, estimated)
    largest = max(float(np.nanmax(np.abs(b.force), initial=0.0)) for b in experiment.loaded)
    forces = {"force_std_relative": FORCE_STD[0], "force_std": FORCE_STD[1] * largest}
    if estimated is not None:
        forces = {name: getattr(estimated, name) for name in forces}
    used = _with_common(replace(unit, displacement_std=std, **forces), ratios)
    used = with_least_own(used, experiment.temporal_std)
    kept = estimated is not None and not any(ratios) and _agree(estimated, used)
    return NoiseCheck(estimated, used.total_std, estimated if kept else used)


def _agree(one: Noise, other: Noise) -> bool:
    """Whether standard deviations and correlation lengths are equal but for a factor of `AGREES`."""
    pairs = (one.total_std, other.total_std), (one.mean_length, other.mean_length)
    return all(a == b or (min(a, b) > 0 and 1 / AGREES <= a / b <= AGREES) for a, b in pairs)


def material(experiment: Experiment) -> tuple[Basis, Array]:
    """A convex spline of both invariants and its coefficients, as a calibration begins."""
    system = equilibrium(experiment.select(evenly(experiment, MATERIAL_INCREMENTS)))
    basis = basis_for(INPUTS, system.deformation_gradients.reshape(-1, 2, 2), plane=experiment.plane)
    assembled = assemble(system, basis)
    neo_hooke = assembled.first_guess()
    c = weights = neo_hooke
    for _ in range(PASSES):
        quadratic = assembled.quadratic(assembled.weights(weights))
        c = convex_spline(quadratic, INPUTS)
        weights = quadratic.coefficients_of_weights(c, neo_hooke)
    return basis, c
