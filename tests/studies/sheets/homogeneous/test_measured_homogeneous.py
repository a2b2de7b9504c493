"""The loop on measured homogeneous tests: a model that is returned never predicts worse than the one before."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from calibrate.diagnosis.misfit import Misfit, is_larger
from calibrate.diagnosis.selection import DEFAULT, Verdict
from studies.sheets.homogeneous import homogeneous_loops, measured_homogeneous

DATA = os.environ.get("EQUIGAP_DATA")
needs_data = pytest.mark.skipif(
    not DATA or not Path(DATA, "miehe_goktepe_hnbr50").is_dir(),
    reason="EQUIGAP_DATA names no folder with the homogeneous data",
)


@pytest.mark.parametrize(
    ("before", "after", "larger"),
    [
        ((0.10, 0.05), (0.10, 0.05), False),
        ((0.10, 0.05), (0.80, 0.00), True),
        ((0.10, 0.05), (0.00, 0.12), True),
        ((0.02, 0.01), (0.022, 0.01), False),  # within what noise may make of it
        ((0.0, 0.0), (0.05, 0.0), True),
    ],
)
def test_errors_grow_where_noise_does_not_explain_it(
    before: tuple[float, float], after: tuple[float, float], larger: bool
) -> None:
    noise = (2e-4, 1e-4)
    first, second = (Misfit(f, g, 1.0, 10, noise) for f, g in (before, after))
    assert is_larger(first, second, DEFAULT.worse) is larger
    assert not is_larger(first, None, DEFAULT.worse)


@pytest.mark.slow
@needs_data
def test_filled_rubber_at_the_rate_between_is_not_made_worse() -> None:
    """No energy of I1 is near it, so that effects beside a base with any energy, a negative one too, fit where none may be used."""
    loop = next(one for one in homogeneous_loops.hnbr50_loops() if one.name == "hnbr50-rates")
    found = measured_homogeneous.close(loop)
    assert found.verdict is Verdict.NOT_EXPLAINED
    for line in found.tests:
        assert line.after < 0.6 * line.before, line.name
