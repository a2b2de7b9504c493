"""What a reader of a discovery has to know: a `View` in, typed findings out, worded by ``templates/discovery.txt``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np

from calibrate.diagnosis.distillation import bulk_modulus
from calibrate.diagnosis.replayed.checked_replay import ReplayCheck
from calibrate.diagnosis.selection import Discovery, Verdict
from calibrate.effects.chain.readings import are_of_the_clock
from calibrate.effects.inclusion import Inclusion
from calibrate.effects.unmeasured_strip import UnmeasuredStrip
from calibrate.equations.equilibrium import best_shear_modulus
from calibrate.fitting.calibrated_range import WEAK_SIGNAL
from calibrate.models.fitness import Use
from calibrate.models.parameter_covariance import Z95
from forward.interpolation import in_triangles
from meshes import Mesh
from studies.output.findings import Finding, Macro
from studies.output.words import plus_minus
from studies.reports.alert_table import merged
from studies.reports.discovery.candidate_outcome import round_remarks
from studies.reports.discovery.discovery_quality import discovery_headline, discovery_quality, others_hold
from studies.reports.discovery.own_effects_table import alike, seen, stand_ins
from studies.reports.discovery.replays.few_effects_section import few_findings
from studies.reports.discovery.replays.replay_section import replay_findings
from studies.reports.discovery.replays.replayed_models import use_finding
from studies.reports.discovery.view import View
from studies.reports.discovery.weighing_tables import alternatives_data, power_data
from studies.reports.experiments.experiment_findings import experiment_findings, noise_found

ATTENUATED = 1.1  # factor on the stiffness that makes up for noise, from which it is told
RIM = 0.25  # of the sheet: an inclusion that covers more is not the rim of a hole
OTHER_LEVEL = 0.3  # from that of the first test, which thicknesses of one kind of specimen do not explain
OTHER_MODULUS = 1.25, 1.5  # largest over smallest modulus of tests: it is told, and it is a warning
OVERSTATED = 0.5  # reduced chi-square: the allowance for discretisation alone does not bring it so low


class DiscoveryCode(Macro):
    """Macros of ``templates/discovery.txt``."""

    NO_TIME = "no_time"
    NOISE_UNKNOWN = "unknown_noise"
    NOISE_OVERSTATED = "overstated_noise"
    NO_TWIN = "no_twin"
    NOTHING_HELD_OUT = "nothing_held_out"
    HELD_OUT = "held_out"
    ROUND = "round_remark"
    ALTERNATIVES = "alternatives"
    REPLACED = "replaced"
    AT_A_HOLE = "inclusion_at_a_hole"
    STRIP = "edges_not_reached"
    NO_EXPLANATION = "no_explanation"
    DOMINANT = "dominant_effect"
    TIE = "tie"
    POWER = "power"
    ALIKE = "alike_in_all"
    OF_ONE_TEST = "of_one_test"
    OWN_STAND_INS = "own_stand_ins"
    THICKNESS_UNKNOWN = "no_thickness"
    LEVELS_UNKNOWN = "levels_unknown"
    MODULI_DIFFER = "moduli_differ"
    ATTENUATED = "attenuated"
    WEAK_STRAIN = "weak_strain"
    PLANE_STRAIN = "plane_strain"


def remarks(view: View) -> list[Finding]:
    """The reasons of the headline first, then what the numbers rest on."""
    found = discovery_headline(view)
    result = [*view.remarks, *_of_noise(view), *_of_twins(view), _of_hold_out(view)]
    result += replay_findings(view.discovery)
    if found.verdict is not Use.NOT:
        result += [*_of_effects(view), *_of_own_effects(view)]
    if others_hold(view):
        result += [*few_findings(view.discovery), *use_finding(view.discovery)]
    result += [*_of_stiffness(view), *_of_tests(view), *_of_plane_strain(view)]
    return merged(found.reasons, result)


def no_time(name: str) -> Finding:
    """Of the test without times, where others have them."""
    return _finding(DiscoveryCode.NO_TIME, name=name)


def _of_noise(view: View) -> Iterator[Finding]:
    found = view.discovery
    if not found.problem.noise_is_known:
        yield _finding(DiscoveryCode.NOISE_UNKNOWN)
        return
    for part, check in zip(found.problem.parts, found.noise, strict=False):
        if check.corrected:
            yield noise_found(part.experiment.name, check, part.experiment.clock_unit)
    chi_square = found.base.reduced_chi_square
    attenuated = discovery_quality(view).attenuation > ATTENUATED  # a stiffness too small leaves residuals too small
    if chi_square < OVERSTATED and not attenuated:
        yield _finding(DiscoveryCode.NOISE_OVERSTATED, chi_square=chi_square)


def _of_twins(view: View) -> Iterator[Finding]:
    for reason in view.discovery.without_twin:
        yield _finding(DiscoveryCode.NO_TWIN, reason=reason)


def _of_hold_out(view: View) -> Finding:
    parts, first = view.discovery.problem.parts, view.discovery.rounds[0]
    if first.held is None:
        few = min(part.experiment.n_increments for part in parts) < 3
        return _finding(DiscoveryCode.NOTHING_HELD_OUT, few=few)
    other_test = any(not part.train.size for part in parts)
    moved = are_of_the_clock(view.discovery.final.additions)
    return _finding(DiscoveryCode.HELD_OUT, what=view.hold_out, other_test=other_test, moves_readings=moved)


def _of_effects(view: View) -> Iterator[Finding]:
    for i, now in enumerate(view.discovery.rounds, start=1):
        for text in round_remarks(now):
            yield _finding(DiscoveryCode.ROUND, number=i, remark=text)
    yield from _of_verdict(view)
    yield from _of_inclusions(view.discovery)
    yield from _of_edges(view.discovery)
    if view.discovery.replaced is not None:
        by = view.discovery.rounds[1].fit.names if len(view.discovery.rounds) > 1 else ()
        yield _finding(DiscoveryCode.REPLACED, by=list(by), names=list(view.discovery.replaced))
    if view.weighing is not None:
        found = view.discovery
        alternatives = alternatives_data(view.weighing, [found.groups.get(name, (name,)) for name in found.named])
        explained = found.verdict is Verdict.EXPLAINED
        confirmed = explained and isinstance(found.replay_check, ReplayCheck) and found.replay_check.confirms
        alarming = alternatives["unknown"] is not None and not confirmed
        yield _finding(DiscoveryCode.ALTERNATIVES, alarming, **alternatives, confirmed=confirmed, explained=explained)
        yield _finding(DiscoveryCode.POWER, **power_data(view.weighing))


def _of_inclusions(found: Discovery) -> Iterator[Finding]:
    """Of an inclusion whose middle is where the specimen has no material, and that is no larger than a rim."""
    for addition in found.final.additions:
        if isinstance(addition.effect, Inclusion) and found.final.chains:
            data = found.final.chains[0].data
            middle = np.asarray(data.centre) + float(data.size) * np.array(addition.shape[:2])
            sheet = Mesh(np.asarray(data.points), found.problem.trained[0].experiment.triangles, "triangle", {})
            is_rim = addition.effect.share_of(data, addition.shape) < RIM
            if is_rim and in_triangles(sheet, middle).excess[0] > 0:
                yield _finding(DiscoveryCode.AT_A_HOLE, place=addition.effect.located(data, addition.shape))


def _of_edges(found: Discovery) -> Iterator[Finding]:
    """Of a strip that the points do not reach."""
    for addition, (deviation, *_) in zip(found.final.additions, found.final.deviations, strict=True):
        if isinstance(addition.effect, UnmeasuredStrip):
            yield _finding(DiscoveryCode.STRIP, width=addition.amplitudes[0], half=Z95 * deviation)


def _of_own_effects(view: View) -> Iterator[Finding]:
    """Of what several tests have for themselves."""
    if names := alike(view.discovery.own, view.unit):
        yield _finding(DiscoveryCode.ALIKE, names=names)
    if names := seen(view.discovery.own):
        yield _finding(DiscoveryCode.OF_ONE_TEST, names=names)
    if names := stand_ins(view.discovery.own):
        yield _finding(DiscoveryCode.OWN_STAND_INS, names=names)


def _of_verdict(view: View) -> Iterator[Finding]:
    """What speaks against the effects that were found, and what they cannot be told from."""
    found = view.discovery
    if found.confirmation is not None and found.confirmation.doubts:
        sure = found.confirmation
        sizes = {
            "force_after": sure.after.force,
            "force_allowed": sure.force_allowed,
            "beyond_prior": [asdict(one) for one in sure.beyond_prior],
        }
        doubts = [str(doubt) for doubt in sure.doubts]
        yield _finding(DiscoveryCode.NO_EXPLANATION, names=list(found.closest), doubts=doubts, c=sizes)
    if found.dominant is not None:
        yield _finding(DiscoveryCode.DOMINANT, **asdict(found.dominant))
    for name in found.named:
        like = list(found.groups.get(name, (name,))[1:])
        if like:
            known = view.inclusion
            better = max(
                (one for one in like if known.get(one, 0.0) > known.get(name, 0.0)), key=known.__getitem__, default=None
            )
            yield _finding(DiscoveryCode.TIE, name=name, like=like, probabilities=known, better=better)


def _of_stiffness(view: View) -> Iterator[Finding]:
    if view.unit != "MPa":
        yield _finding(DiscoveryCode.THICKNESS_UNKNOWN)
    if view.discovery.levels:
        first, *others = view.discovery.levels
        far = any(abs(one.factor - 1) > OTHER_LEVEL for one in others)
        said = [(one.test, plus_minus(one.factor, Z95 * one.deviation), f"{one.divided_by:.4g}") for one in others]
        yield _finding(DiscoveryCode.LEVELS_UNKNOWN, far, first=first.test, levels=said)
    else:
        yield from _of_moduli(view)
    factor = discovery_quality(view).attenuation
    replayed = isinstance(view.discovery.replay_check, ReplayCheck)  # whose level makes up for it
    if factor > ATTENUATED and not (replayed or view.discovery.problem.level_is_nominal):
        yield _finding(DiscoveryCode.ATTENUATED, factor=factor)


def _of_moduli(view: View) -> Iterator[Finding]:
    """Of several tests whose level is known, where their stiffness differs."""
    parts = [part for part in view.discovery.problem.trained if not part.experiment.level_is_nominal]
    moduli = {part.experiment.name: best_shear_modulus(part.system, part.train.rows)[0] for part in parts}
    if len(moduli) > 1 and max(moduli.values()) > OTHER_MODULUS[0] * min(moduli.values()):
        far = max(moduli.values()) > OTHER_MODULUS[1] * min(moduli.values())
        yield _finding(DiscoveryCode.MODULI_DIFFER, far, moduli=moduli, unit=view.unit)


def _of_tests(view: View) -> Iterator[Finding]:
    parts = view.discovery.problem.parts
    for part in parts:
        signal = part.experiment.strain_signal
        if signal.ratio < WEAK_SIGNAL:
            yield _finding(
                DiscoveryCode.WEAK_STRAIN,
                name=part.experiment.name,
                signal=signal.to_dict(),
                one_modulus=view.discovery.one_modulus,
            )
    for part in parts:
        yield from experiment_findings(part.experiment, part.assembled.noise_is_known)


def _of_plane_strain(view: View) -> Iterator[Finding]:
    bulk = bulk_modulus(view.discovery.problem, view.discovery.final)
    if bulk is not None:
        yield _finding(DiscoveryCode.PLANE_STRAIN, value=plus_minus(bulk[0], Z95 * bulk[1]), unit=view.unit)


def _finding(code: DiscoveryCode, raised: bool = False, /, **data: Any) -> Finding:
    return Finding("discovery", code, data, raised)
