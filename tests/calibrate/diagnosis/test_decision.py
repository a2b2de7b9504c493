"""The verdict in the light of all explanations: names by probability, groups, doubts, a better explanation taken over."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import synthetic
from discoveries import explained, nothing

from calibrate.data.experiment import Noise
from calibrate.diagnosis import discovery
from calibrate.diagnosis.discovery import discover
from calibrate.diagnosis.evidence import decision
from calibrate.diagnosis.evidence.decision import decided
from calibrate.diagnosis.evidence.explanations import UNKNOWN, Alternatives, Explanation, Finding, Power, Weighing
from calibrate.diagnosis.evidence.priors import Prior, read_priors
from calibrate.diagnosis.evidence.signatures import modulus
from calibrate.diagnosis.evidence.weighing import weigh
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.residual_tests import ChiSquare, Misfits
from calibrate.diagnosis.selection import Verdict
from calibrate.diagnosis.selection.rounds import Doubt
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from calibrate.models.parameter_covariance import Z95

HIDDEN, OTHER = "second invariant", "lens distortion"
FEW = tuple(e for e in CATALOGUE if e.name in (HIDDEN, OTHER, "force offset", "image rotation"))


@cache
def found(without: str = ""):
    """What the rounds find in a Mooney-Rivlin plate; without an effect in the catalogue."""
    sheet = synthetic.plate_experiment(synthetic.MooneyRivlin(0.15, 0.03), n_increments=4)
    noisy = synthetic.with_noise(sheet, Noise(1e-4, 3.0, 3e-4, 2e-3), 1)
    effects = [e for e in FEW if e.name != without]
    return discover([noisy], HoldOut("none", None), effects=effects, fitted=False)


def after(*explanations: tuple[tuple[str, ...], bool, float], groups=None):
    """The verdict where the alternatives are these: effects, whether something unknown is with them, probability."""
    known = [Explanation(names, float(np.log(p)), unknown) for names, unknown, p in explanations]
    weighing = Weighing(Alternatives.of(known), groups or {}, (), True)
    return decided(found(), weighing, read_priors(), FEW)


def test_an_effect_is_named_by_its_probability_alone_or_with_those_like_it():
    assert found().named == (HIDDEN,)
    sure = after(((HIDDEN,), False, 0.97), ((), False, 0.03))
    assert sure.verdict is Verdict.EXPLAINED and sure.named == (HIDDEN,) and sure.groups == {HIDDEN: (HIDDEN,)}
    tie = after(((HIDDEN,), False, 0.6), ((OTHER,), False, 0.38), ((), False, 0.02))
    assert tie.verdict is Verdict.EXPLAINED and tie.groups == {HIDDEN: (HIDDEN, OTHER)}
    beside = after(((HIDDEN,), False, 0.6), ((HIDDEN, OTHER), False, 0.4))
    assert beside.groups == {HIDDEN: (HIDDEN,)}  # another beside it does not take its place
    for probability, told in (
        (0.02, (HIDDEN, OTHER)),
        (0.005, (HIDDEN,)),
    ):  # what is refuted is told apart, however alike
        rivals = ((HIDDEN,), False, 1 - probability), ((OTHER,), False, probability)
        assert after(*rivals, groups={HIDDEN: (OTHER, "a with b")}).groups == {HIDDEN: told}


@pytest.mark.parametrize(
    ("both", "nested", "most", "named"),
    [
        (0.97, False, 2, (HIDDEN, OTHER)),  # certain in spite of what the formula of the other may be wrong by
        (0.90, False, 2, (HIDDEN,)),
        (0.97, True, 2, (HIDDEN,)),  # may be what a series leaves out
        (0.97, False, 1, (HIDDEN,)),  # more names than an explanation has
    ],
)
def test_a_lesser_effect_of_an_explanation_is_named_where_it_is_certain(monkeypatch, both, nested, most, named):
    good, rival = explained(), next(e for e in FEW if e.name == OTHER)
    if nested:
        monkeypatch.setattr(type(rival), "nested_in", HIDDEN)
    (mine,), (error,) = good.final.additions, good.final.errors
    two = replace(good.final, additions=(mine, Addition(rival, (0.001,))), errors=(error, (0.0005,)))
    there = replace(good, rounds=(good.rounds[0], replace(good.rounds[1], fit=two)), closest=(OTHER,))
    there = replace(there, thresholds=replace(there.thresholds, most_named=most))
    known = [
        Explanation((HIDDEN, OTHER), float(np.log(both))),
        Explanation((HIDDEN,), float(np.log(1 - both)), additions=(mine,)),
    ]
    result = decided(there, Weighing(Alternatives.of(known), {}, (), True), read_priors(), FEW)
    assert result.verdict is Verdict.EXPLAINED and result.named == named
    assert result.closest == tuple(name for name in (HIDDEN, OTHER) if name not in named)


def test_with_quick_what_the_test_excludes_is_no_look_alike():
    """Nor what it has itself: the rounds take effects of a similar signature together, whatever a limit beside the final model says."""
    parameter = next(e for e in FEW if e.name == OTHER).amplitudes[0]
    effect = next(e for e in FEW if e.name == OTHER)
    rounds = replace(found(), groups={HIDDEN: (HIDDEN, OTHER)})
    for finding, left in ((Finding.EXCLUDED, (HIDDEN,)), (Finding.INVISIBLE, (HIDDEN, OTHER))):
        weighing = Weighing(Alternatives.of([Explanation((), 0.0)]), {}, (Power(effect, finding, parameter),), False)
        assert decided(rounds, weighing, read_priors(), FEW).groups == {HIDDEN: left}


def test_an_effect_that_is_not_needed_is_not_named():
    result = after(((HIDDEN,), False, 0.8), ((), False, 0.2))
    assert result.verdict is Verdict.NOT_EXPLAINED and result.named == () and result.closest == (HIDDEN,)
    assert Doubt.NOT_NEEDED in result.confirmation.doubts


@pytest.mark.parametrize(("deviations", "verdict"), [(2.9, Verdict.EXPLAINED), (3.1, Verdict.NOT_EXPLAINED)])
def test_an_amplitude_that_nobody_expects_explains_nothing(deviations, verdict):
    """c01 of 0.03 MPa, less 95 % of its error, where this is so many deviations of its prior."""
    good = explained()
    (c01,), (error,) = good.final.additions[0].amplitudes, good.final.errors[0]
    narrow = read_priors() | {HIDDEN: Prior((c01 - Z95 * error) / deviations / modulus(good.problem), "modulus", "")}
    sure = Weighing(Alternatives.of([Explanation((HIDDEN,), 0.0)]), {}, (), True)
    result = decided(good, sure, narrow, FEW)
    assert result.verdict is verdict
    assert decided(good, sure, read_priors(), FEW).verdict is Verdict.EXPLAINED
    if verdict is Verdict.NOT_EXPLAINED:
        assert (result.named, result.closest) == ((), (HIDDEN,))
        assert result.confirmation.doubts == (Doubt.BEYOND_PRIOR,)
        (found,) = result.confirmation.beyond_prior
        assert (found.effect, found.amplitude, found.of) == (HIDDEN, "c01", "modulus")
        assert found.deviations == pytest.approx(c01 / (narrow[HIDDEN].std * modulus(good.problem)))
        wider = narrow | {HIDDEN: replace(narrow[HIDDEN], std=1.001 * found.needed)}
        assert decided(good, sure, wider, FEW).verdict is Verdict.EXPLAINED


@pytest.mark.parametrize(("none", "verdict"), [(0.8, Verdict.NOTHING_SIGNIFICANT), (0.7, Verdict.NOT_EXPLAINED)])
def test_a_refused_candidate_that_no_evidence_needs_is_no_alarm(none, verdict):
    """Where the residual is noise; a residual that is more than noise stays unexplained whatever is said to be needed."""
    known = [Explanation((), float(np.log(none))), Explanation((OTHER,), float(np.log(1 - none)))]
    weighing = Weighing(Alternatives.of(known), {}, (), True)
    quiet = replace(nothing(), verdict=Verdict.NOT_EXPLAINED)
    assert decided(quiet, weighing, read_priors(), FEW).verdict is verdict
    loud = explained()
    loud = replace(loud, rounds=loud.rounds[:1], verdict=Verdict.NOT_EXPLAINED, named=(), closest=())
    assert decided(loud, weighing, read_priors(), FEW).verdict is Verdict.NOT_EXPLAINED


@pytest.mark.parametrize(
    ("noise", "certain", "smooth", "none", "verdict"),
    [
        (1.0, 1.0, 1.0, 0.80, Verdict.NOTHING_SIGNIFICANT),
        (1.6, 1.6, 1.6, 0.80, Verdict.NOTHING_SIGNIFICANT),
        (1.2, 1.6, 1.6, 0.80, Verdict.NOTHING_SIGNIFICANT),  # errors of the mesh are allowed for, and are not there
        (1.6, 1.6, 1.6, 0.70, Verdict.NOT_EXPLAINED),  # something may be needed
        (1.6, 1.6, 4.0, 0.97, Verdict.NOT_EXPLAINED),  # smooth over place and load
        (0.8, 5.0, 1.0, 0.97, Verdict.NOT_EXPLAINED),  # large where no error of the mesh can be
        (3.0, 3.0, 3.0, 0.97, Verdict.NOT_EXPLAINED),  # far more than what noise of another kind is taken for
    ],
)
def test_what_rounds_add_and_no_evidence_needs_is_taken_out(noise, certain, smooth, none, verdict):
    """noise, certain, smooth: mean squares of the residual of the base, of all, of what no error of the mesh can be, and of its smooth part, over those of noise."""
    first, last = explained().rounds
    tests = nothing().rounds[0].misfits
    sizes = (noise, certain, smooth)
    changed = Misfits(*(ChiSquare(size * test.degrees, test.degrees) for size, test in zip(sizes, tests, strict=True)))
    predicted = ChiSquare(noise * first.predicted.degrees, first.predicted.degrees)
    base = replace(first, misfits=changed, predicted=predicted)
    ended = replace(explained(), rounds=(base, last), verdict=Verdict.NOT_EXPLAINED, named=(), closest=(HIDDEN,))
    known = [Explanation((), float(np.log(none))), Explanation((OTHER,), float(np.log(1 - none)))]
    result = decided(ended, Weighing(Alternatives.of(known), {}, (), True), read_priors(), FEW)
    assert result.verdict is verdict
    quiet = verdict is Verdict.NOTHING_SIGNIFICANT
    assert result.final.names == (() if quiet else (HIDDEN,))
    assert result.replaced == ((HIDDEN,) if quiet else None)
    assert not quiet or (result.closest == () and result.problem is result.start and result.weighing.powers)


def test_something_unknown_beside_it_takes_no_name_away():
    """What a strong effect leaves by the error of its formula is smooth, too."""
    result = after(((HIDDEN,), True, 0.6), ((HIDDEN,), False, 0.4))
    assert result.verdict is Verdict.EXPLAINED and result.named == (HIDDEN,)
    assert result.weighing.alternatives.unexplained > UNKNOWN


def test_the_rounds_are_run_on_from_a_far_better_explanation():
    """Rounds that did not know the effect, weighed with a catalogue that does."""
    missed = found(without=HIDDEN)
    assert HIDDEN not in missed.named
    result = decided(missed, weigh(missed, read_priors(), FEW), read_priors(), FEW)
    assert result.verdict is Verdict.EXPLAINED and result.named == (HIDDEN,)
    assert result.replaced == missed.final.names
    (c01,) = result.final.additions[0].amplitudes
    assert abs(c01 - 0.03) < 3 * result.final.errors[0][0]


def test_rounds_that_go_back_to_the_less_probable_are_run_again_without_it(monkeypatch):
    """Priors tell an effect from another one that fits as well; exchanges by the fit alone would take the other one again."""
    good = explained()
    rival = next(one for one in FEW if one.name not in good.final.names)
    (mine,) = good.final.additions
    there = replace(
        good,
        rounds=(
            good.rounds[0],
            replace(good.rounds[1], fit=replace(good.final, additions=(Addition(rival, (0.01,)),))),
        ),
    )
    known = [Explanation((HIDDEN,), 0.0, False, additions=(mine,)), Explanation((rival.name,), -4.0, False)]
    weighing, tried = Weighing(Alternatives.of(known), {}, (), True), []

    def rounds(start, base, effects, *_):
        tried.append([one.name for one in effects])
        return there if rival in effects else good

    monkeypatch.setattr(decision, "close_loop", rounds)
    result = decided(there, weighing, read_priors(), FEW)
    assert [rival.name in names for names in tried] == [True, False]
    assert result.final.names == (HIDDEN,)
    assert result.replaced == (rival.name,)


def test_what_is_less_probable_is_put_in_the_place_of_no_effect():
    """More beside the best explanation, a part of it, and what is as probable are no exchange to the less probable."""
    best, alike, poor = ("a", "b"), ("a", "c"), ("a", "d")
    alternatives = Alternatives.of([Explanation(best, 0.0, False), Explanation(alike, -1.0, False), Explanation(poor, -3.0, False)])  # fmt: skip
    first = alternatives.explanations[0]
    for names, left in ((poor, {"d"}), (("a", "e"), {"e"}), (alike, set()), (("a",), set()), (("a", "b", "e"), set())):
        assert decision._less_probable(names, first, alternatives) == left


def test_a_model_that_explains_nothing_and_predicts_worse_takes_no_place(monkeypatch):
    """Evidence is that of what was fitted: an exponential that stiffens where nothing was fitted may have more of it."""
    good = explained()
    first, last = good.rounds
    missed = replace(good, rounds=(first,), verdict=Verdict.NOT_EXPLAINED, named=(), closest=())
    known = [Explanation((HIDDEN,), 0.0, False, additions=good.final.additions), Explanation((), -9.0, False)]
    weighing = Weighing(Alternatives.of(known), {}, (), True)
    for factor, verdict, names in (
        (0.5, Verdict.NOT_EXPLAINED, (HIDDEN,)),
        (3.0, Verdict.NOT_EXPLAINED, ()),
        (3.0, Verdict.EXPLAINED, (HIDDEN,)),
    ):
        worse = replace(
            last, held=replace(first.held, force=factor * first.held.force, field=factor * first.held.field)
        )
        other = replace(good, rounds=(first, worse), verdict=verdict, named=(HIDDEN,) if verdict == "explained" else ())
        monkeypatch.setattr(decision, "close_loop", lambda *_, other=other: other)
        result = decided(missed, weighing, read_priors(), FEW)
        assert result.final.names == names, (factor, verdict)
        assert (result.replaced is None) == (not names)


@pytest.mark.parametrize(
    ("doubts", "leaves", "sought"),
    [
        ((Doubt.BEYOND_PRIOR,), 1.0, False),
        ((Doubt.BEYOND_PRIOR,), 3.0, True),  # more than noise is left
        ((Doubt.BEYOND_PRIOR, Doubt.OUTSIDE_BAND), 1.0, True),
        ((Doubt.NOT_NEEDED,), 1.0, True),
    ],
)
def test_few_effects_are_not_sought_where_a_prior_alone_speaks_against_a_model(monkeypatch, doubts, leaves, sought):
    """They are held within the same priors: they would leave what the model does not."""
    good, asked = explained(), []
    tests = good.rounds[-1].misfits
    left = Misfits(*(ChiSquare(leaves * one.degrees, one.degrees) for one in tests))
    doubted = replace(good, rounds=(good.rounds[0], replace(good.rounds[-1], misfits=left))).doubted(*doubts)
    monkeypatch.setattr(discovery, "close_loop", lambda *_: good)
    monkeypatch.setattr(discovery, "weigh", lambda *_: None)
    monkeypatch.setattr(discovery, "decided", lambda *_: doubted)
    monkeypatch.setattr(discovery, "judged_by_replay", lambda found, check: found)
    monkeypatch.setattr(discovery, "uncertainty_of", lambda *_: None)
    monkeypatch.setattr(discovery, "dominant_effect", lambda *_: None)

    class Check:
        def __call__(self, found):
            return None

        def few_effects(self, *_):
            asked.append(True)

    found = discovery.diagnose(good.start, good.base, FEW, check=Check())
    assert found.verdict is Verdict.NOT_EXPLAINED
    assert bool(asked) == sought
