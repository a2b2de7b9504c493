"""Evidence of subsets of effects: the marginal likelihood, false inclusions, limits that cover, priors that are read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import synthetic
from scipy import special, stats

from calibrate import errors
from calibrate.diagnosis.base_fit import prepare
from calibrate.diagnosis.evidence import refinement, weighing
from calibrate.diagnosis.evidence.explanations import Alternatives, Explanation
from calibrate.diagnosis.evidence.formula_error import SHARES, FittedEffect, SecondOrder
from calibrate.diagnosis.evidence.linear_evidence import Evidence, Signature
from calibrate.diagnosis.evidence.power import upper_limit
from calibrate.diagnosis.evidence.priors import Scales, deviations, read_priors
from calibrate.diagnosis.evidence.weighing import cost, spanning
from calibrate.diagnosis.problem import all_rows
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from calibrate.effects.effect import FORMULA_ERROR
from studies.trials import blind_data

N = 60
EMPTY = np.zeros((N, 0))


def signature(name, S, one_sided=False):
    return Signature(name, (), S, 1.0, np.full(S.shape[1], one_sided))


def test_evidence_is_the_marginal_likelihood():
    rng = np.random.default_rng(0)
    S, T, r = rng.standard_normal((N, 2)), rng.standard_normal((N, 1)), rng.standard_normal(N)
    found = Evidence((signature("a", S), signature("b", T)), r, EMPTY, 0.0).subset((0, 1))
    both = np.concatenate([S, T], axis=1)
    law = stats.multivariate_normal(np.zeros(N), np.eye(N) + both @ both.T)
    alone = stats.multivariate_normal(np.zeros(N), np.eye(N))
    assert found.log_evidence == pytest.approx(law.logpdf(r) - alone.logpdf(r), abs=1e-9)
    one_sided = Evidence((signature("b", T, True),), r, EMPTY, 0.0).subset((0,)).log_evidence
    a = np.linspace(0, 8, 20001)  # a half-normal prior: twice the integral over the admissible side
    density = np.exp(-0.5 * ((r[:, None] + T * a) ** 2).sum(axis=0) + 0.5 * r @ r) * stats.norm.pdf(a)
    assert one_sided == pytest.approx(np.log(2 * np.trapezoid(density, a)), abs=1e-6)


def test_the_charge_of_a_subset_is_its_evidence_without_its_gain():
    """With a residual of zero nothing is gained, and what is left of the log evidence is what the effects cost."""
    rng = np.random.default_rng(4)
    S, T, r = rng.standard_normal((N, 2)), rng.standard_normal((N, 1)), rng.standard_normal(N)
    both = (signature("a", S), signature("b", T))
    found = Evidence(both, r, EMPTY, -1.5).subset((0, 1))
    assert found.charge == pytest.approx(Evidence(both, np.zeros(N), EMPTY, -1.5).subset((0, 1)).log_evidence)
    gains = Evidence(both, -5 * T[:, 0], EMPTY, -1.5)
    larger, smaller = gains.subset((0, 1)), gains.subset((0,))
    assert larger.log_evidence > smaller.log_evidence + 10  # linearly
    assert cost(larger, smaller) == pytest.approx(larger.charge - smaller.charge) and cost(larger, smaller) < -1.5


def test_what_is_more_of_another_effect_is_in_no_subset_without_it():
    """However well it does alone: it would be the other one under another name."""
    S, T = np.random.default_rng(5).standard_normal((2, N, 1))
    branches = (signature("first", S), replace(signature("second", T), beside="first"), signature("other", S + T))
    found = Evidence(branches, -5 * T[:, 0], EMPTY, -1.5)
    names = [found.names(one) for one in found.best()]
    assert {"first", "second"} in names and {"first"} in names
    assert all("first" in one for one in names if "second" in one)


def test_what_is_more_of_another_effect_stands_for_nothing_without_it():
    """An effect that does the same can be told in its place; not one that is a candidate beside another alone, unless that is in the model."""
    S, T = np.random.default_rng(6).standard_normal((2, N, 1))
    second = replace(signature("second", S), beside="first")
    found = Evidence(
        (signature("found", S), signature("alike", 2 * S), second, signature("first", T)),
        -5 * S[:, 0] - 5 * T[:, 0],
        EMPTY,
        -1.5,
    )
    assert spanning(found, found.subset((0,))) == {"found": ("alike",)}
    assert spanning(found, found.subset((0, 3)))["found"] == ("alike", "second")
    assert "alike" not in spanning(found, found.subset((0, 1, 3)))["found"]  # it is there already


def test_a_smooth_disturbance_that_is_in_no_signature_is_none_of_these():
    rng = np.random.default_rng(1)
    D = np.linalg.qr(rng.standard_normal((N, 6)))[0]
    S = [signature(name, 3 * rng.standard_normal((N, 1))) for name in "abc"]
    r = D @ np.full(6, 6.0) + rng.standard_normal(N)
    found = Evidence(tuple(S), r, D, -2.0)
    assert found.discrepancy() > found.best()[0].log_evidence + 10
    assert Evidence(tuple(S), rng.standard_normal(N), D, -2.0).discrepancy() < 0


def test_inclusion_in_noise_alone_and_of_a_true_effect():
    """False inclusions above 95 % stay below 5 % of the draws; a strong effect is included, its neighbour is not."""
    rng = np.random.default_rng(2)
    S = tuple(signature(str(k), 5 * rng.standard_normal((N, 1)) / np.sqrt(N)) for k in range(12))
    false = right = 0
    for _ in range(20):
        noise = rng.standard_normal(N)
        for r, true in ((noise, None), (noise - 2.5 * S[3].columns[:, 0], "3")):
            found = Evidence(S, r, EMPTY, float(np.log(0.5 / 12)))
            ranked = found.by_names(found.best(2), 50)
            inclusion = Alternatives.of([Explanation(tuple(found.names(s)), s.log_evidence) for s in ranked]).inclusion
            certain = {name for name, p in inclusion.items() if p > 0.95}
            false += bool(certain - {true})
            right += true in certain
    assert false <= 2 and right >= 18


@pytest.mark.parametrize("truth", [0.0, 0.7, 3.0])
@pytest.mark.parametrize("one_sided", [True, False])
def test_limits_cover(truth, one_sided):
    estimates = truth + np.random.default_rng(3).standard_normal(4000)
    covered = np.mean([upper_limit(x, 1.0, one_sided) >= truth for x in estimates])
    assert covered >= 0.94


def test_priors_are_in_the_units_of_the_test_and_read_from_a_file(tmp_path):
    scales = Scales(modulus=0.4, force=20.0, spacing=2.0, thickness=3.0, duration=np.nan)
    known = {effect.name: effect for effect in CATALOGUE}
    standard = read_priors()
    assert set(known) - set(standard) == {"force gain", "DIC scale"}  # never tested
    assert deviations(known["second invariant"], standard, [scales]) == pytest.approx([0.3 * 0.4])
    assert deviations(known["3D effect of thickness"], standard, [scales]) == pytest.approx([1.5 * 0.75])
    (tmp_path / "own.toml").write_text('["second invariant"]\nstd = 0.02\n')
    own = read_priors(tmp_path / "own.toml")
    assert deviations(known["second invariant"], own, [scales]) == pytest.approx([0.02])
    assert own["upturn"] == standard["upturn"]
    for text, message in (('["second"]\nstd=1', "'second'"), ('["upturn"]\nstd=0', "std = 0"), ("x", "no TOML"),
                          ('["upturn"]\nstd=1\nof="metre"', "metre"), ('["upturn"]\nof="modulus"', "no std"),
                          ('["upturn"]\nstd=1\nof="duration"', "'duration' is in s, its amplitude in MPa; give of = 'modulus'"),
                          ('["inclusion"]\nstd=1\nof="modulus"', "give no 'of'")):  # fmt: skip
        (tmp_path / "bad.toml").write_text(text)
        with pytest.raises(errors.ConfigError, match=message):
            read_priors(tmp_path / "bad.toml")


def test_the_final_model_is_weighed_though_many_others_seem_better():
    """A strong pair beside thirty effects: the one that the rounds have ended at comes after hundreds of sets with the pair."""
    rng = np.random.default_rng(5)
    columns = {name: rng.standard_normal((N, 1)) for name in ("a", "b", *(f"x{i}" for i in range(28)))}
    r = 30 * columns["a"][:, 0] + 30 * columns["b"][:, 0] + rng.standard_normal(N)
    linear = Evidence(tuple(signature(name, S) for name, S in columns.items()), r, EMPTY, -4.0)
    final = frozenset({"x0"})
    assert final not in map(linear.names, linear.by_names(linear.best(), weighing.SHOWN))
    ranked = weighing._ranked(linear, final)
    assert final in map(linear.names, ranked) and ranked == sorted(ranked, key=lambda one: -one.log_evidence)
    assert linear.of_names(["none of these"]) is None


def test_a_test_of_one_instant_has_no_duration():
    scales = Scales.of_test(replace(synthetic.plate_experiment(n_increments=1), time=np.zeros(1)), 0.3)
    assert np.isnan(scales.size("duration")) and scales.size("force") > 0


@pytest.mark.slow
def test_an_explanation_that_ends_as_a_simpler_effect_is_fitted_on_as_that():
    """Two fibre families that close up, of one hidden; but not where the one is left out of the catalogue."""
    trial = next(t for s in range(60) if (t := blind_data.draw(s, "one fibre family")).specimen == "plate"
                 and t.effects[0].amplitudes["k"] > 0.02 * t.material.shear_modulus)  # fmt: skip
    problem, base = prepare([blind_data.make(trial)[0]], [all_rows])
    known = {effect.name: effect for effect in CATALOGUE}
    (hidden,) = trial.effects
    angle, k = hidden.shape["angle"], hidden.amplitudes["k"]
    closed = (Addition(known["two fibre families"], (0.5 * k,), (angle, 0.02, 0.0, 0.0)),)
    _, fit = refinement._fitted(problem, base, closed, known)
    assert fit.names == ("one fibre family",)
    assert fit.additions[0].amplitudes[0] == pytest.approx(k, rel=0.1)
    assert np.cos(2 * (fit.additions[0].shape[0] - angle)) > 0.99
    assert refinement._fitted(problem, base, closed, {"two fibre families": known["two fibre families"]}) is None


def fitted(r, signatures, L=100.0, log_prior=-4.0, one_sided=False, sets=None):
    """Least squares of effects (names to columns (N, p)) to second order, with three smooth disturbances. sets (s, p): of amplitudes that may be there, None for all alone."""
    S = np.concatenate([np.zeros((N, 0)), *signatures.values()], axis=1)
    a = np.linalg.lstsq(S, r, rcond=None)[0] if signatures else np.zeros(0)
    left = r - S @ a
    ends = np.cumsum([0, *(one.shape[1] for one in signatures.values())])
    effects = tuple(
        FittedEffect(
            name,
            a[start:end],
            one,
            np.full(end - start, L),
            FORMULA_ERROR,
            log_prior,
            np.full(end - start, one_sided),
            np.ones((1, end - start), bool) if sets is None else np.array(sets),
        )
        for (name, one), start, end in zip(signatures.items(), ends[:-1], ends[1:], strict=True)
    )
    return SecondOrder(float(left @ left), left[:3], effects, np.zeros((N, 0)))


@pytest.mark.parametrize("one_sided", [False, True])
@pytest.mark.parametrize("noise", [1.0, 30.0])
@pytest.mark.parametrize("L", [0.02, 1.0, 100.0])
def test_a_fit_to_second_order_has_the_evidence_of_its_linear_model(noise, L, one_sided):
    """Though the fit knows no prior: of amplitudes that the data hardly tell (L = 0.02 times one that is 0.13 uncertain), and of residuals that are larger than what is described."""
    rng = np.random.default_rng(11)
    S, r = rng.standard_normal((N, 6)), np.sqrt(noise) * rng.standard_normal(N)
    r += S @ np.full(6, 0.3)
    none, one = fitted(r, {}), fitted(r, {"a": S}, L, one_sided=one_sided)
    exact = replace(one, effects=tuple(replace(effect, error=0.0) for effect in one.effects))
    linear = Evidence((signature("a", -L * S / np.sqrt(noise), one_sided),), r / np.sqrt(noise), EMPTY, -4.0).subset(
        (0,)
    )
    gained = exact.log_evidence(noise, ("a",)) - none.log_evidence(noise, ())
    assert gained == pytest.approx(linear.log_evidence, abs=1e-8)


@pytest.mark.parametrize("one_sided", [False, True])
def test_an_effect_that_may_have_some_amplitudes_alone_has_the_evidence_of_all_its_sets(one_sided):
    """As a sheet that is bent about one axis or both: of columns where one half explains something and the other nothing. The sets have the prior probability of the effect together."""
    rng = np.random.default_rng(12)
    S, r = rng.standard_normal((N, 6)), rng.standard_normal(N)
    r += S[:, :3] @ np.full(3, 0.5)
    sets = np.array([[True] * 3 + [False] * 3, [False] * 3 + [True] * 3, [True] * 6])
    none, one = fitted(r, {}), fitted(r, {"a": S}, 10.0, one_sided=one_sided, sets=sets)
    exact = replace(one, effects=tuple(replace(effect, error=0.0) for effect in one.effects))
    gained = exact.log_evidence(1.0, ("a",)) - none.log_evidence(1.0, ())
    each = [
        Evidence((signature("a", -10.0 * S * some, one_sided),), r, EMPTY, -4.0).subset((0,)).log_evidence
        for some in sets
    ]
    assert gained == pytest.approx(special.logsumexp(each), abs=1e-8)
    assert max(each) == each[0] > each[2] + 3 > each[1]
    alone = fitted(r, {"a": S[:, :3]}, 10.0, one_sided=one_sided)
    assert each[0] == pytest.approx(
        replace(alone, effects=tuple(replace(effect, error=0.0) for effect in alone.effects)).log_evidence(1.0, ("a",))
        - none.log_evidence(1.0, ()),
        abs=1e-8,
    )


def test_a_warp_has_either_axis_alone_or_both():
    warp = next(effect for effect in CATALOGUE if effect.name == "initial warp")
    letters = [{p.name[0] for p, there in zip(warp.amplitudes, some, strict=True) if there} for some in warp.sets]
    assert letters == [{"a"}, {"b"}, {"a", "b"}]
    assert all(effect.sets.all() for effect in CATALOGUE if effect is not warp)


def test_an_effect_taken_for_an_error_has_its_size_as_a_prior():
    """Of two columns, beside an effect that explains much: the density of their amplitudes, of noise and an error of the largest size, over that of noise alone."""
    rng = np.random.default_rng(7)
    A, B, r = rng.standard_normal((N, 1)), rng.standard_normal((N, 2)), rng.standard_normal(N)
    one = fitted(r + 30 * A[:, 0], {"a": A, "b": B})
    out = B - A @ np.linalg.lstsq(A, B, rcond=None)[0]
    inside, error = one.effects
    w, size = FORMULA_ERROR**2 * inside.square, np.linalg.norm(out)
    noise = np.linalg.inv(out.T @ out)
    densities = []
    for share in SHARES:
        law = stats.multivariate_normal(np.zeros(2), noise + share * w / size**2 * np.eye(2))
        densities.append(law.logpdf(error.a) - stats.multivariate_normal(np.zeros(2), noise).logpdf(np.zeros(2)))
    smooth = [one.with_smooth(1.0, share * w / 3) for share in SHARES]
    alone = one.log_evidence(1.0, ("a", "b")) - one.log_evidence(1.0, ("a",))
    both = sum(e.error**2 * e.square for e in one.effects)
    all_smooth = special.logsumexp([one.with_smooth(1.0, share * both / 3) for share in SHARES])
    costs = []
    for S, a in ((A, inside.a), (np.concatenate([A, B], axis=1), np.concatenate([inside.a, error.a]))):
        information = S.T @ S
        prior = a @ np.linalg.solve(100**2 * np.eye(len(a)) + np.linalg.inv(information), a)
        costs.append(-0.5 * (prior + np.linalg.slogdet(np.eye(len(a)) + 100**2 * information)[1]))
    cost = costs[1] - costs[0] - 4.0
    wanted = all_smooth + cost - special.logsumexp(np.add(densities, smooth))
    assert alone == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize(("size", "least", "most"), [(0.0, 0, 2), (0.02, 0, 6), (0.2, 95, 100)])
def test_an_error_of_a_formula_is_no_effect(size, least, most):
    """What one of 100 formulas has beside it, that looks like another effect: an error of 2 % of what it explains (one standard deviation) is told as an effect in no more than 6, 20 % in 95."""
    rng, certain = np.random.default_rng(8), 0
    A, B = rng.standard_normal((2, N, 1))
    B -= A @ np.linalg.lstsq(A, B, rcond=None)[0]
    for _ in range(100):
        strength = 400.0
        wrong = size * strength * (rng.standard_normal() if size < 0.1 else 1.0)
        r = strength * A[:, 0] / np.linalg.norm(A) + wrong * B[:, 0] / np.linalg.norm(B) + rng.standard_normal(N)
        fits = [fitted(r, {}), fitted(r, {"a": A}), fitted(r, {"b": B}), fitted(r, {"a": A, "b": B})]
        found = refinement._with_errors_of_formulas([(one, 1.0) for one in fits])
        told = Alternatives.of([Explanation(tuple(names), value) for names, value in found.items()]).inclusion
        certain += told["b"] > 0.95
        assert told["a"] > 0.95
    assert least <= certain <= most
