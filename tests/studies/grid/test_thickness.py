"""Thickness study: settings, jobs, steps that skip what exists, truthful Experiments, and (slow) a run killed and resumed."""

import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from study_stand_in import fit_with, folder_of, parsed, stretched_sheet

from calibrate.data.experiment import Experiment
from calibrate.errors import ConfigError
from studies import cli
from studies.commands.grid_studies import thickness
from studies.errors import OptionError
from studies.grid import report, steps, workflow
from studies.grid.axes import PLANE, Case, Loss, Settings
from studies.grid.case import CaseResult
from studies.grid.presets.thickness_study import THICKNESS
from studies.grid.study import SNAKEFILE

SMALL = replace(THICKNESS.default, nodes=900, seeds=(0, 1), thicknesses=(PLANE, "10", "12.5"), increments=2)


def settings_of(*words: str) -> Settings:
    given = parsed("thickness", *words)
    given["execution"].config(Path())
    return thickness.settings_of(given["options"], given["pull"], given["quick"])


def test_options_become_settings():
    assert settings_of() == THICKNESS.default
    assert settings_of("--fine").forward_size == 0.5
    assert settings_of("--quick").thicknesses == (PLANE, "10", "40")
    words = "--thicknesses 5,7.5 --displacement 30 --seeds 3 --layers 8 --dependent-seeds 1 --inputs I1I2 --nodes 900"
    expected = replace(
        THICKNESS.default, thicknesses=(PLANE, "5", "7.5"), displacement=30.0, seeds=(0, 1, 2), layers=(8,), dependent_seeds=1, inputs="I1I2", nodes=900
    )  # fmt: skip
    assert settings_of(*words.split()) == expected


@pytest.mark.parametrize(
    ("words", "key"),
    [
        *((f"--thicknesses {value}", "--thicknesses") for value in ("10,x", "10,-5", "0", "nan", "inf")),
        ("--thicknesses 20,10,20", "10,20"),
        ("--thicknesses 10,10.000001", "10"),
        ("--displacement -1", "--displacement"),
        ("--displacement nan", "--displacement"),
        ("--ranks 0", "--ranks"),
        ("--jobs 0", "--jobs"),
        ("--profile /nowhere", "config.yaml"),
        ("--quick --fine", "--fine"),
        ("--seeds 0", "--seeds"),
        ("--layers 4,x", "4,x"),
        ("--nodes 10", "800"),
    ],
)
def test_impossible_options_are_named(words, key):
    with pytest.raises((ConfigError, OptionError), match=re.escape(key)):
        settings_of(*words.split())


def test_settings_survive_the_folder(tmp_path):
    assert Settings.read(folder_of(tmp_path / "a", SMALL)) == SMALL


def test_clean_data_are_always_fitted_with_the_dependent_scaling():
    for condition, more in ((PLANE, 0), ("10", 1)):
        records = [("0", "clean"), ("0.1", "0"), ("0.1", "1")]
        cases = [Case("cross", condition, "100", *record) for record in records]
        for settings, expected in ((replace(SMALL, dependent_seeds=1), [3, 3, 2]), (SMALL, [3, 2, 2])):
            assert [len(settings.losses_of(case)) - more for case in cases] == expected
        assert (Loss.CORRECTED in SMALL.losses_of(cases[-1])) is (condition != PLANE)


@pytest.mark.parametrize("seeds", [1, 5, 6, 10, 100])
def test_batches_hold_every_record_once_and_are_balanced(seeds):
    settings = replace(SMALL, seeds=tuple(range(seeds)))
    batches = settings.batches()
    assert sorted(chain(*batches)) == sorted(["0_clean", *(f"0.1_{seed}" for seed in range(seeds))])
    sizes = [len(batch) for batch in batches]
    assert max(sizes) <= settings.batch and max(sizes) - min(sizes) <= 1
    assert batches[0][0] == "0_clean"


def test_memory_grows_with_what_is_solved():
    usual = THICKNESS.default
    assert usual.solid_memory() < 3000
    assert replace(usual, forward_size=0.5).solid_memory() > 4 * usual.solid_memory()
    assert replace(usual, extra_layers=2).solid_memory() > usual.solid_memory()
    assert usual.solid_memory(ranks=4) > usual.solid_memory()


@pytest.fixture(scope="module")
def dry_run(tmp_path_factory):
    """What Snakemake would do with the profile, but its executor, for a study that has begun."""
    profile, folder = tmp_path_factory.mktemp("profile"), tmp_path_factory.mktemp("out") / "a folder"
    text = (workflow.PROFILES / "slurm" / "config.yaml").read_text()
    (profile / "config.yaml").write_text(text.replace("executor: slurm\n", ""))
    folder_of(folder, replace(SMALL, seeds=tuple(range(8))))
    for name in (
        "forward/cross_2D.npz",
        "forward/cross_10.npz",
        "solids/cross_10.npz",
        "epsilon/cross_10.npz",
        "cases/cross/12.5_100_0.1_1.json",
        "cases/cross/12.5_100_0.1_3.json",
    ):
        (folder / name).parent.mkdir(exist_ok=True, parents=True)
        (folder / name).touch()
    command = workflow.command(SNAKEFILE, folder / "workflow", [f"folder={folder}", "ranks=2"], 2, profile)
    done = subprocess.run([*command, "--dry-run", "--printshellcmds"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


def blocks(text: str, rule: str) -> list[str]:
    """What a dry run says of each job of a rule."""
    return re.findall(rf"^(?:local)?rule {rule}:.*?(?=^(?:local)?rule |\Z)", text, re.MULTILINE | re.DOTALL)


def test_the_workflow_has_the_expected_jobs_and_only_what_is_missing(dry_run):
    counts = dict(re.findall(r"^(\w+) +(\d+)$", dry_run, re.MULTILINE))
    expected = {"solid": 1, "epsilon": 1, "mesh": 1, "states": 1, "observe": 3, "fit_0": 3, "fit_1": 3, "all": 1}
    assert counts == {**{name: str(n) for name, n in expected.items()}, "total": "14"}
    assert re.search(r"fit '.*/a folder' cross 12.5 100 0_clean 0.1_1 0.1_3 0.1_5 0.1_7", dry_run)


def test_ranks_and_memory_are_passed_on_and_the_profile_adds_its_own(dry_run):
    (solid,), fit = blocks(dry_run, "solid"), blocks(dry_run, "fit_0")[0]
    assert re.search(r"mpiexec -n 2 \S+ -m studies.grid.steps forward '.*/a folder' cross 12.5", solid)
    memory = f"mem_mb={SMALL.solid_memory(2)},"
    for words in ("priority: 22.5", "tasks=2", "cpus_per_task=1", memory, "runtime=720", "nodes=1"):
        assert words in solid
    assert "slurm_account=your_account" in fit and "runtime=60" in fit and "mem_mb=2500" in fit
    assert "mpi=" not in fit and "tasks=" not in fit


class TestSteps:
    """The steps on a made-up plane solution: every arm stretched by a tenth, in two increments."""

    @pytest.fixture
    def folder(self, tmp_path):
        folder = folder_of(tmp_path / "study", SMALL)
        for h in (PLANE, "12.5"):
            stretched_sheet(folder, "cross", 0.1, 0.1, {"right": [10.0, 2.0], "top": [2.0, 10.0]}, h)
        steps.mesh(folder, SMALL, "cross", "100")
        steps.states(folder, SMALL, "cross")
        for h in (PLANE, "12.5"):
            steps.observe(folder, SMALL, "cross", h)
        return folder

    def test_experiments_say_truly_where_they_come_from(self, folder, monkeypatch):
        monkeypatch.setattr("studies.grid.case.fit", lambda *_: fit_with(0.0))
        steps.fit(folder, SMALL, "cross", "12.5", "100", "0_clean", "0.1_1")
        steps.fit(folder, SMALL, "cross", PLANE, "100", "0.1_1")
        clean, noisy, flat = (Experiment.load(folder / "experiments" / "cross" / f"{name}.npz")
                              for name in ("12.5_100_0_clean", "12.5_100_0.1_1", "2D_100_0.1_1"))  # fmt: skip
        assert clean.thickness == 12.5 and flat.thickness == 1.0
        assert "3D, 12.5 mm thick" in clean.name
        told = noisy.provenance
        assert told["forward_model"].startswith("3D") and told["thickness_mm"] == 12.5
        assert told["displacement_of_each_arm_mm"] == 60.0 and told["solution"]["digest"] == "abc"
        assert told["noise_seed"] == 1 and told["camera"]["field"]["normalisation"] == "unit-variance"
        assert noisy.noise.displacement_std == 0.1
        assert "noise_seed" not in clean.provenance and clean.noise is None
        assert flat.provenance["forward_model"].startswith("2D plane stress")
        np.testing.assert_allclose(clean.displacements[-1], 0.1 * clean.points, atol=1e-9)
        np.testing.assert_array_equal(
            noisy.displacements, flat.displacements
        )  # a seed's noise is that of all conditions
        forces = {boundary.name: boundary.force[-1] for boundary in clean.loaded}
        np.testing.assert_allclose(forces["right"], [20, 0])
        np.testing.assert_allclose(forces["left"], [-20, 0])

    def test_cases_are_written_one_by_one_and_finished_ones_are_skipped(self, folder, monkeypatch):
        fitted, limits = [], set()

        def fit(experiment, settings, loss, limit, reference):
            if len(fitted) == 5:
                raise KeyboardInterrupt
            limits.add((limit, len(reference.energy)))
            fitted.append((experiment.provenance.get("noise_seed"), loss))
            return fit_with(0.0)

        monkeypatch.setattr("studies.grid.case.fit", fit)
        records = [case.record for case in SMALL.cases if case.thickness == PLANE]
        with pytest.raises(KeyboardInterrupt):
            steps.fit(folder, SMALL, "cross", PLANE, "100", *records)
        assert fitted == [(None, Loss.WEIGHTED), (None, Loss.FROZEN), (None, Loss.DEPENDENT), (0, Loss.WEIGHTED),
                          (0, Loss.FROZEN)]  # fmt: skip
        cases = folder / "cases" / "cross"
        assert sorted(path.stem for path in cases.iterdir()) == ["2D_100_0.1_0", "2D_100_0_clean"]
        fitted.clear()
        steps.fit(folder, SMALL, "cross", PLANE, "100", *records)
        assert fitted == [(1, Loss.WEIGHTED), (1, Loss.FROZEN)]
        result = CaseResult.load(cases / "2D_100_0.1_1.json")
        ((limit, states),) = limits
        assert result.calibrated_I1 == limit == pytest.approx(2 * 1.1**2 + 1.1**-4, rel=1e-6) and states > 0
        assert result.case == Case("cross", PLANE, "100", "0.1", "1") and result.nodes > 800
        assert set(result.losses) == {Loss.WEIGHTED, Loss.FROZEN}


def test_a_finished_study_starts_nothing_and_writes_its_report(tmp_path, monkeypatch, capsys):
    settings = replace(THICKNESS.quick, nodes=900, seeds=(0,))
    folder = folder_of(tmp_path / "a", settings)
    for path in settings.targets(folder):
        path.parent.mkdir(exist_ok=True, parents=True)
        path.touch()
    monkeypatch.setattr(subprocess, "Popen", None)
    monkeypatch.setattr(report, "write", lambda results, page: results.folder / f"{len(results.settings.seeds)}.html")
    monkeypatch.setattr(thickness, "THICKNESS", replace(THICKNESS, page=lambda results: None))
    words = ["--quick", "--nodes", "900", "--seeds", "1", "-o", str(folder)]
    assert cli.main(["thickness", *words]) == 0
    assert capsys.readouterr().out == f"report: {folder / '1.html'}\n"


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_killed_run_resumes_without_doing_finished_steps_again(tmp_path):
    out = tmp_path / "out"
    words = ["thickness", "--quick", "--seeds", "1", "--thicknesses", "10", "--nodes", "900", "--output", str(out)]
    command = [sys.executable, "-m", "studies.cli", *words]
    process = subprocess.Popen(command, start_new_session=True)
    deadline = time.monotonic() + 400
    while not (out / "cases").is_dir() or not any((out / "cases" / "cross").glob("*.json")):
        assert time.monotonic() < deadline, "no case was finished"
        assert process.poll() is None
        time.sleep(0.2)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    finished = [*out.rglob("*.npz"), *out.glob("cases/*/*.json")]
    before = {path: path.stat().st_ino for path in finished}  # a file that is written again is another one
    subprocess.run(command, check=True, timeout=400)
    assert before and all(path.stat().st_ino == number for path, number in before.items())
    settings = Settings.read(out)
    assert all(path.exists() for path in settings.targets(out))
    result = CaseResult.load(out / "cases" / "cross" / "10_100_0_clean.json")
    assert abs(result.losses[Loss.WEIGHTED].inside[0].bias) < 0.05
    assert (out / "report.html").exists()
    assert not list(out.rglob("*checkpoint*"))
