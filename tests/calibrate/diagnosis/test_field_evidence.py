"""Evidence of sets of effects for the fields of a replay, against normal distributions by themselves; how often it finds what is there, and what is not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, stats
from scipy.special import logsumexp

from calibrate.diagnosis.evidence.explanations import CERTAIN, Alternatives, Explanation
from calibrate.diagnosis.evidence.linear_evidence import Signature
from calibrate.diagnosis.evidence.signatures import EXPECTED
from calibrate.diagnosis.replayed.field_evidence import FieldEvidence

ROWS, EFFECTS = 18, 6


def signature(name: str, columns: np.ndarray, one_sided: bool = False, shapes: int = 1) -> Signature:
    return Signature(name, (), columns, 1 / shapes, np.full(columns.shape[1], one_sided))


def drawn(seed: int, *amplitudes: float, size: float = 0.3) -> tuple[np.ndarray, list[Signature]]:
    """Residual of unit discrepancy with effects of one or two amplitudes of a signature of `size` a mode; the first of them as strong as told, in prior standard deviations."""
    rng = np.random.default_rng(seed)
    found = [signature(f"effect {i}", size * rng.standard_normal((ROWS, 1 + i % 2))) for i in range(EFFECTS)]
    r = rng.standard_normal(ROWS)
    for value, one in zip(amplitudes, found, strict=False):
        r -= one.columns @ np.full(one.columns.shape[1], value)
    return r, found


def test_log_odds_are_those_of_normal_distributions():
    r, (one, other, *_) = drawn(0, 2.0)
    evidence = FieldEvidence.of(r, ROWS, [one, other], EFFECTS)
    S = np.concatenate([one.columns, other.columns], axis=1)

    def average(columns: np.ndarray) -> float:
        return logsumexp([
            stats.multivariate_normal.logpdf(r, cov=tau**2 * np.eye(ROWS) + columns @ columns.T) for tau in evidence.taus
        ])  # fmt: skip

    expected = average(S) - average(S[:, :0]) + 2 * np.log(EXPECTED / EFFECTS)
    assert evidence.subset((0, 1)).log_evidence == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("sign", [-1, 1])
def test_an_amplitude_of_one_sign_has_a_half_normal_prior(sign):
    r, (one, *_) = drawn(1, 1.0)
    half = signature(one.name, sign * one.columns, one_sided=True, shapes=5)
    evidence = FieldEvidence.of(r, ROWS, [half], EFFECTS)

    def of(tau: float) -> float:
        a = np.linspace(0, 8, 200_001)
        left = ((r[:, None] + half.columns * a) ** 2).sum(axis=0)
        exponent = np.log(2) + stats.norm.logpdf(a) - 0.5 * (left - r @ r) / tau**2
        return float(exponent.max() + np.log(integrate.trapezoid(np.exp(exponent - exponent.max()), a)))

    none = -ROWS * np.log(evidence.taus) - 0.5 * float(r @ r) / evidence.taus**2
    expected = logsumexp(none + [of(tau) for tau in evidence.taus]) - logsumexp(none)
    assert evidence.subset((0,)).log_evidence == pytest.approx(
        expected + np.log(EXPECTED / EFFECTS) - np.log(5), rel=1e-6
    )


def ranked(r: np.ndarray, found: list[Signature]) -> list[tuple[tuple[str, ...], float]]:
    """Sets with their log odds, best first."""
    evidence = FieldEvidence.of(r, ROWS, found, EFFECTS)
    subsets = evidence.best()
    best = evidence.by_names(subsets, len(subsets))
    return [(tuple(sorted(evidence.names(one))), one.log_evidence) for one in best]


def test_neither_a_unit_of_length_nor_a_turn_of_the_modes_changes_the_odds():
    r, found = drawn(2, 2.0, 1.0)
    Q = np.linalg.qr(np.random.default_rng(3).standard_normal((ROWS, ROWS)))[0]
    moved = [signature(one.name, 1e-3 * Q @ one.columns) for one in found]
    once, again = ranked(r, found), ranked(1e-3 * Q @ r, moved)
    assert [names for names, _ in once] == [names for names, _ in again]
    assert [value for _, value in once] == pytest.approx([value for _, value in again], rel=1e-9)


def test_pictures_that_repeat_each_other_are_one_observation():
    """Four times the same, each over the root of four."""
    r, found = drawn(4, 2.0)
    four = [signature(one.name, np.tile(one.columns, (4, 1)) / 2) for one in found]
    once, many = (FieldEvidence.of(*pair, EFFECTS) for pair in ((r, ROWS, found), (np.tile(r, 4) / 2, ROWS, four)))
    assert many.taus == pytest.approx(once.taus)
    assert many.subset((0, 1)).log_evidence == pytest.approx(once.subset((0, 1)).log_evidence, rel=1e-10)


def probable(seed: int, *amplitudes: float, size: float = 0.3) -> tuple[str, ...]:
    """Effects with a probability above 95 %."""
    r, found = drawn(seed, *amplitudes, size=size)
    alternatives = Alternatives.of([Explanation(names, value) for names, value in ranked(r, found)])
    return tuple(name for name, p in sorted(alternatives.inclusion.items()) if p > CERTAIN)


def test_a_discrepancy_alone_names_hardly_an_effect():
    """50 seeds each with signatures smaller than the discrepancy and larger."""
    alarms = [bool(probable(seed, size=size)) for seed in range(50) for size in (0.3, 3.0)]
    assert np.mean(alarms) <= 0.05


def test_an_effect_far_above_the_discrepancy_is_found_and_no_other():
    found = [probable(seed, 2.0, size=3.0) for seed in range(50)]
    assert np.mean([one == ("effect 0",) for one in found]) >= 0.9
