"""Resolution study: scores against closed forms, settings, table, findings, and (slow) a run that is killed and resumed."""

import argparse
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from calibrate.errors import ConfigError
from calibrate.models import pann
from calibrate.models.network_model import Model
from studies.accuracy import metrics
from studies.commands import resolution
from studies.grid import resolution_report
from studies.grid.resolution_case import Settings, losses_for


def neo_hooke(mu: float) -> Model:
    """A PANN that is neo-Hookean: only the skip connection acts, psi = mu / 2 (I1 - 3)."""
    architecture = pann.Architecture("I1", (1,))
    return Model(architecture, np.array([0.0, 0.0, 0.0, mu / 2]))


def test_stress_of_the_truth_has_the_closed_form():
    stretch = np.linspace(1, 3, 7)
    I1 = stretch**2 + 2 / stretch
    c, mu, N = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750), 0.2698, 21.49
    slope = sum(mu * (k + 1) * c[k] * I1**k / N**k for k in range(5))
    found = metrics.nominal_stress(metrics.ArrudaBoyceTruth(), "uniaxial", stretch)
    np.testing.assert_allclose(found, 2 * slope * (stretch - stretch**-2), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(
    ("mode", "I1"),
    [
        ("uniaxial", lambda x: x**2 + 2 / x),
        ("equibiaxial", lambda x: 2 * x**2 + x**-4),
        ("pure_shear", lambda x: x**2 + 1 + x**-2),
    ],
)
def test_largest_stretch_inverts_the_first_invariant(mode, I1):
    assert metrics.largest_stretch(mode, I1(2.3)) == pytest.approx(2.3, abs=1e-10)
    assert metrics.largest_stretch(mode, 3.0) == 1.0


def test_agreement_of_a_model_that_is_five_percent_too_stiff():
    truth = lambda invariants: np.stack([np.full(invariants.shape[:-1], 0.5), 0 * invariants[..., 1]], axis=-1)  # noqa: E731
    for score in metrics.agreement(neo_hooke(1.05), truth, 6.0):
        assert score.bias == pytest.approx(0.05, abs=1e-12)
        assert score.max_error == pytest.approx(0.05, abs=1e-12)
        assert 0.98 < score.r2 < 1
    assert all(s.r2 == pytest.approx(1, abs=1e-14) for s in metrics.agreement(neo_hooke(1.0), truth, 6.0))


def test_dependent_scaling_is_fitted_for_the_first_seeds_only():
    settings = Settings(seeds=(0, 1, 2), dependent_seeds=1)
    assert "paper-dependent" in losses_for(settings, "clean")
    assert "paper-dependent" in losses_for(settings, "0")
    assert "paper-dependent" not in losses_for(settings, "1")


@pytest.mark.parametrize("words", [["--layers", "4,x"], ["--nodes", "100"], ["--seeds", "0"], ["--jobs", "0"]])
def test_impossible_options_are_named(words):
    parser = argparse.ArgumentParser()
    resolution.add_arguments(parser)
    with pytest.raises(ConfigError):
        resolution.settings_from(parser.parse_args(words))


def fake_cases(bias_noisy: float) -> list[dict]:
    """Cases whose numbers are known: no bias without noise, `bias_noisy` +- 0.001 with noise."""

    def result(bias):
        score = {"stretch": 2.0, "bias": bias, "r2": 1 - abs(bias), "max_error": abs(bias)}
        return {
            "inside": [{**score, "mode": m} for m in metrics.MODES],
            "outside": [{**score, "mode": m} for m in metrics.MODES],
        }

    cases = []
    for level in (100.0, 50.0):
        for seed, bias in (("clean", 0.0), ("0", bias_noisy - 0.001), ("1", bias_noisy), ("2", bias_noisy + 0.001)):
            cases.append({"level": level, "seed": seed, "nodes": int(50 * level), "losses": {"weighted": result(bias)}})
    return cases


def test_table_holds_medians_and_targets_judge_them():
    settings = Settings(levels=(100.0, 50.0), seeds=(0, 1, 2), dependent_seeds=0)
    rows = resolution_report.table(fake_cases(0.004), settings)
    noisy = [r for r in rows if r[3] == "noisy" and r[5] == "inside" and r[1] == 50.0]
    assert len(noisy) == 3
    for row in noisy:
        np.testing.assert_allclose(row[7:10], [0.4, 0.3, 0.5], atol=1e-12)
    assert [t[-1] for t in resolution_report.targets_met(rows)] == [True, True, True]
    rows = resolution_report.table(fake_cases(0.02), settings)
    assert [t[-1] for t in resolution_report.targets_met(rows)] == [True, False, False]
    assert any("only in part" in text for text in resolution_report.findings(rows, settings))


@pytest.mark.slow
def test_a_killed_run_resumes_without_doing_finished_cases_again(tmp_path):
    command = [
        sys.executable,
        "-m",
        "studies.cli",
        "resolution",
        "--quick",
        "--seeds",
        "1",
        "--output",
        str(tmp_path / "out"),
    ]
    process = subprocess.Popen(command, start_new_session=True)
    cases = tmp_path / "out" / "cases"
    deadline = time.monotonic() + 240
    while not (cases.is_dir() and any(cases.glob("*.json"))):
        assert time.monotonic() < deadline, "no case was finished"
        assert process.poll() is None
        time.sleep(0.5)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    before = {path.name: path.stat().st_mtime_ns for path in cases.glob("*.json")}
    subprocess.run(command, check=True, timeout=280)
    assert len(list(cases.glob("*.json"))) == 4
    assert all((cases / name).stat().st_mtime_ns == stamp for name, stamp in before.items())
    case = json.loads((cases / "100_clean.json").read_text())
    assert abs(case["losses"]["weighted"]["inside"][0]["bias"]) < 0.02
    assert (tmp_path / "out" / "report.html").exists()
