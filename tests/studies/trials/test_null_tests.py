"""Tests without an effect, and how their alarms are counted: noise of known covariance, exact intervals, runs that go on."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[3]))
from benchmarks.noise import null_tests, pulls
from benchmarks.noise.false_alarms import CONDITIONS, NullTest, row
from benchmarks.noise.kept_records import records
from benchmarks.noise.null_tests import Condition, Course, Kernel, Told
from calibrate.data.experiment import Noise


class Clean:
    """What the courses of noise need of an Experiment: displacements that grow as 1, 2, 3, 4."""

    displacements = np.arange(1.0, 5.0)[:, None, None] * np.ones((4, 3, 2))
    n_increments = 4


def test_kernels_are_as_said_at_one_length_and_positive():
    points = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 6.0], [1.0, 1.0]])
    assert Kernel.GAUSSIAN.covariance(points, 2.0)[0, 1] == pytest.approx(np.exp(-0.5))
    assert Kernel.EXPONENTIAL.covariance(points, 2.0)[0, 1] == pytest.approx(np.exp(-1))
    for kernel in Kernel:
        covariance = kernel.covariance(points, 2.0)
        np.testing.assert_allclose(np.diag(covariance), 1.0)
        assert np.linalg.eigvalsh(covariance).min() > 0


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.95])
def test_courses_have_their_covariance_between_increments(correlation):
    """Of linear maps, exactly: what unit fields, one at a time, do to the increments."""
    new = np.eye(6)[:, :, None] * np.ones(2)
    clean = Clean()
    drift, common = (
        null_tests._over_increments(new, clean, correlation, course)[..., 0] for course in (Course.DRIFT, Course.COMMON)
    )
    i, share = np.arange(4), np.arange(1, 5) / 4
    np.testing.assert_allclose(drift @ drift.T, correlation ** np.abs(i[:, None] - i), atol=1e-12)
    expected = (1 - correlation) * np.eye(4) + correlation / 2 * (1 + np.outer(share, share))
    np.testing.assert_allclose(common @ common.T, expected, atol=1e-12)


def test_what_is_told_is_the_noise_that_is_there():
    whole = Noise(0.01, 3.0, 1e-3)
    assert null_tests._stated(Condition("", Told.NOTHING), whole) is None
    assert null_tests._stated(Condition("", factor=2.0, correlation=0.5), whole) == whole.scaled(2.0)
    told = null_tests._stated(Condition("", Told.ALL, correlation=0.5), whole)
    assert told.total_std == pytest.approx(whole.total_std)
    common = told.common_between(np.ones(2))
    np.testing.assert_allclose(np.eye(2) + common @ common.T, [[2, 1], [1, 2]])  # half is new, half in common


def test_a_condition_that_tells_what_is_common_has_nothing_that_drifts():
    for condition in CONDITIONS:
        drifts = {condition.course(seed) for seed in range(12)}
        assert (Course.DRIFT in drifts) is (condition.told is not Told.ALL)
        assert {condition.kernel(seed) for seed in range(3)} == set(Kernel)


def result(verdict, named=(), seconds=1.0):
    return {"verdict": verdict, "named": list(named), "seconds": seconds, "best": [["initial warp", 20.0, 10, 0.01]]}


def test_the_interval_of_a_rate_is_exact():
    """Clopper and Pearson: without an alarm the upper end is 1 - 0.025^(1/n); an error of the data is no test."""
    quiet = [result("nothing significant")] * 8
    line = row("x", [*quiet, {"error": "FitError: has not converged"}])
    assert line[1:4] == [8, 0, 0] and line[7] == 1
    assert line[5:7] == pytest.approx([0.0, 1 - 0.025 ** (1 / 8)])
    alarmed = row("x", [*quiet, result("explained", ["initial warp"]), result("significant, not explained")])
    assert alarmed[1:5] == [10, 2, 1, pytest.approx(0.2)]


def test_rows_of_pulls_are_of_strong_effects_alone():
    amplitude = {"true": 1.0, "fitted": 1.2, "deviation": 0.1}
    strong = [{"score": 20.0, "amplitudes": {"g": {**amplitude, "pull": pull}}} for pull in (3.0, -1.0)]
    weak = {"score": 1.0, "amplitudes": {"g": {**amplitude, "pull": 50.0}}}
    line = pulls.row("viscoelasticity", [*strong, weak])
    assert line[:5] == ["viscoelasticity", 3, 2, 0, 2]
    assert line[5:] == pytest.approx([5**0.5, 1.0, 2 / pulls.NORMAL, 0.5])


def written(test: NullTest, folder: Path) -> None:
    """In place of a diagnosis."""
    (folder / f"{test.name}.json").write_text(json.dumps({"name": test.name}))


def test_a_run_goes_on_where_it_was_stopped(tmp_path):
    tests = [NullTest(CONDITIONS[0], seed) for seed in range(3)]
    kept = tmp_path / f"{tests[0].name}.json"
    kept.write_text('{"kept": true}')
    found = records(written, tmp_path, tests, 1, "tests")
    assert len(found) == 3 and {"kept": True} in found
    assert {"name": tests[2].name} in found
