"""Evidence where an explanation changes what noise does: displacements are noisy, and a stiffer law makes larger errors of the same noise."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from relaxing_plate import FAST, held

from calibrate.diagnosis.base_fit import prepare
from calibrate.diagnosis.evidence import refinement, signatures
from calibrate.diagnosis.evidence.priors import read_priors
from calibrate.diagnosis.problem import all_rows
from calibrate.effects import CATALOGUE

RELAXATION, OFFSET = (next(e for e in CATALOGUE if e.name == name) for name in ("viscoelasticity", "force offset"))


def probability(branches, seed: int) -> float:
    """That a ramp with noise of 0.1 % of its length, a quarter of the largest strain, relaxes."""
    ramp = held(*branches, noise=1e-3, seed=seed).select(np.arange(6))
    problem, base = prepare([ramp], [all_rows])
    effects, priors = (RELAXATION, OFFSET), read_priors()
    linear = signatures.evidence(problem, base, base.chains, effects, priors, {})
    found = refinement.alternatives(
        problem, base, effects, linear, linear.by_names(linear.best(1), len(effects) + 1), priors
    )
    return found.inclusion.get(RELAXATION.name, 0.0)


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_a_relaxing_sheet_is_not_told_as_one_that_makes_less_of_its_noise(seed):
    """Beside what the noise of a relaxing law is, a third more, an elastic law that misses the test seems to leave nothing: by the weights of one model for all, relaxation had a probability of zero."""
    assert probability((FAST,), seed) > 0.95


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_an_elastic_sheet_is_not_told_as_one_that_makes_more_of_its_noise(seed):
    assert probability((), seed) < 0.2


@pytest.mark.parametrize("amplified", [10.0, 1000.0])
def test_noise_that_an_effect_makes_itself_excuses_no_misfit(amplified):
    """As of a stiff fibre that is not there: chi-squares of the same residuals, 20 times the noise of the base, differ by the noise that is allowed alone. They would by twenty times."""
    base, stiff = (
        refinement._Refit(SimpleNamespace(reduced_chi_square=20.0 / r), SimpleNamespace(), r) for r in (1.0, amplified)
    )
    excess = min(one.excess(2.0) for one in (base, stiff))
    weighed = [one.fit.reduced_chi_square / one.variance(2.0, excess) for one in (base, stiff)]
    assert weighed[1] == pytest.approx(1.0) and weighed[0] == pytest.approx(20 / 19)
