"""Resolution study: scores against closed forms, settings, table, findings, and (slow) a run that is killed and resumed."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from study_stand_in import fit_with, parsed, result_of, results_with

from calibrate.equations.deformation_modes import largest_stretch, nominal_stress
from calibrate.errors import ConfigError
from calibrate.models import pann
from calibrate.models.network_model import Model
from studies.accuracy import metrics
from studies.commands.grid_studies import resolution
from studies.errors import OptionError
from studies.grid.axes import Loss
from studies.grid.claims import ClaimVerdict, Statement
from studies.grid.presets import resolution_study
from studies.grid.presets.resolution_study import RESOLUTION
from studies.grid.results import Results


def settings_of(*words: str):
    given = parsed("resolution", *words)
    given["execution"].config(Path())
    return resolution.settings_of(given["options"], given["quick"])


def neo_hooke(mu: float) -> Model:
    """A PANN that is neo-Hookean: only the skip connection acts, psi = mu / 2 (I1 - 3)."""
    architecture = pann.Architecture("I1", (1,))
    return Model(architecture, np.array([0.0, 0.0, 0.0, mu / 2]))


def test_stress_of_the_truth_has_the_closed_form():
    stretch = np.linspace(1, 3, 7)
    I1 = stretch**2 + 2 / stretch
    c, mu, N = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750), 0.2698, 21.49
    slope = sum(mu * (k + 1) * c[k] * I1**k / N**k for k in range(5))
    found = nominal_stress(metrics.ArrudaBoyceTruth(), "uniaxial", stretch)
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
    assert largest_stretch(mode, I1(2.3)) == pytest.approx(2.3, abs=1e-10)
    assert largest_stretch(mode, 3.0) == 1.0


def test_agreement_of_a_model_that_is_five_percent_too_stiff():
    truth = lambda invariants: np.stack([np.full(invariants.shape[:-1], 0.5), 0 * invariants[..., 1]], axis=-1)  # noqa: E731
    for score in metrics.agreement(neo_hooke(1.05), truth, 6.0):
        assert score.bias == pytest.approx(0.05, abs=1e-12)
        assert score.max_error == pytest.approx(0.05, abs=1e-12)
        assert 0.98 < score.r2 < 1
    assert all(s.r2 == pytest.approx(1, abs=1e-14) for s in metrics.agreement(neo_hooke(1.0), truth, 6.0))


def test_the_coarsest_camera_alone_is_polished():
    settings = RESOLUTION.default
    fitted = {case.resolution for case in settings.cases if Loss.POLISHED in settings.losses_of(case)}
    assert fitted == {min(settings.resolutions, key=float)}


def test_dependent_scaling_is_fitted_for_clean_data_and_the_first_seeds_only():
    settings = replace(RESOLUTION.default, seeds=(0, 1, 2), dependent_seeds=1)
    fitted = {case.seed: Loss.DEPENDENT in settings.losses_of(case) for case in settings.cases}
    assert fitted == {"clean": True, "0": True, "1": False, "2": False}
    assert Loss.DEPENDENT not in settings_of("--dependent-seeds", "0").losses
    assert Loss.DEPENDENT in settings_of("--quick", "--dependent-seeds", "1").losses


@pytest.mark.parametrize(
    "words",
    [
        ["--layers", "4,x"],
        ["--nodes", "100"],
        ["--seeds", "0"],
        ["--jobs", "0"],
        ["--profile", "/nowhere"],
        ["--ranks", "0"],
    ],
)
def test_impossible_options_are_named(words):
    with pytest.raises((ConfigError, OptionError)):
        settings_of(*words)


def results(path, bias):
    """No bias without noise, `bias` +- 0.001 with noise."""
    settings = replace(RESOLUTION.default, resolutions=("100", "50"), seeds=(0, 1, 2), losses=(Loss.WEIGHTED,))
    cases = [result_of(case, {Loss.WEIGHTED: fit_with(bias + 0.001 * (int(case.seed) - 1) if case.noisy else 0.0)})
             for case in settings.cases]  # fmt: skip
    return results_with(Results, path, settings, cases)


def test_table_holds_medians_and_targets_judge_them(tmp_path):
    rows = resolution_study.rows_of(results(tmp_path, 0.004))
    noisy = [row.cells() for row in rows if row.noisy and row.place == "inside" and row.resolution == "50"]
    assert len(noisy) == 3
    for cells in noisy:
        np.testing.assert_allclose(cells[7:10], [0.4, 0.3, 0.5], atol=1e-12)
    assert [target[-1] for target in resolution_study.targets(rows)] == [True, True, True]
    rows = resolution_study.rows_of(results(tmp_path, 0.02))
    assert [target[-1] for target in resolution_study.targets(rows)] == [True, False, False]


@pytest.mark.parametrize(("bias", "verdict"), [(0.004, ClaimVerdict.CONFIRMED), (0.02, ClaimVerdict.REFUTED)])
def test_claims_are_judged_by_the_limits(tmp_path, bias, verdict):
    found = results(tmp_path, bias)
    inside, outside = resolution_study.claims(found, resolution_study.rows_of(found))
    assert inside.statement is Statement.RELIABLE_INSIDE and inside.verdict is verdict
    assert inside.found["bias"] == pytest.approx(100 * bias)
    assert outside.verdict is ClaimVerdict.OPEN  # the modes do not differ
    assert all(range_ == pytest.approx(0.2) for range_ in outside.found.values())


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
    while not (cases.is_dir() and any(cases.glob("cross/*.json"))):
        assert time.monotonic() < deadline, "no case was finished"
        assert process.poll() is None
        time.sleep(0.5)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    before = {path.name: path.stat().st_mtime_ns for path in cases.glob("cross/*.json")}
    subprocess.run(command, check=True, timeout=280)
    assert len(list(cases.glob("cross/*.json"))) == 4
    assert all((cases / "cross" / name).stat().st_mtime_ns == stamp for name, stamp in before.items())
    case = json.loads((cases / "cross" / "2D_100_0_clean.json").read_text())
    assert abs(case["losses"]["weighted"]["inside"][0]["bias"]) < 0.02
    assert (tmp_path / "out" / "report.html").exists()
