"""Thickness study: settings, jobs, steps that skip what exists, truthful Experiments, and (slow) a run killed and resumed."""

import argparse
import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import asdict, replace
from itertools import chain
from pathlib import Path

import numpy as np
import pytest

from calibrate.data.experiment import Experiment
from calibrate.errors import ConfigError
from forward.solution import SurfaceSolution
from meshes import Cross, quads, triangles
from studies.commands import thickness
from studies.grid import thickness_case, workflow
from studies.grid.thickness_case import CORRECTED, PLANE, Settings, losses_for, solid_memory, targets
from studies.output import open_output_folder

SMALL = Settings(nodes=900, seeds=(0, 1), thicknesses=(10.0, 12.5), increments=2)


def settings_of(*words: str) -> Settings:
    parser = argparse.ArgumentParser()
    thickness.add_arguments(parser)
    return thickness.settings_from(parser.parse_args(words))


def folder_of(path: Path, settings: Settings) -> Path:
    return open_output_folder(path, False, {"study": "thickness", **asdict(settings)})


def test_options_become_settings():
    assert settings_of() == Settings()
    assert settings_of("--fine").forward_size == 0.5
    assert settings_of("--quick").thicknesses == (10.0, 40.0)
    words = "--thicknesses 5,7.5 --displacement 30 --seeds 3 --layers 8 --dependent-seeds 1 --inputs I1I2 --nodes 900"
    expected = Settings(
        thicknesses=(5.0, 7.5), displacement=30.0, seeds=(0, 1, 2), layers=(8,), dependent_seeds=1, inputs="I1I2", nodes=900
    )  # fmt: skip
    assert settings_of(*words.split()) == expected


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--thicknesses 10,x", "numbers of mm separated by commas"),
        ("--thicknesses 10,-5", "positive number"),
        ("--thicknesses 0", "positive number"),
        ("--thicknesses nan", "positive number"),
        ("--thicknesses inf", "positive number"),
        ("--thicknesses 20,10,20", "rising, with at most six digits: 10,20"),
        ("--thicknesses 10,10.000001", "rising, with at most six digits: 10"),
        ("--displacement -1", "positive number of mm"),
        ("--displacement nan", "positive number of mm"),
        ("--ranks 0", "--ranks 0: at least 1"),
        ("--jobs 0", "--jobs 0: at least 1"),
        ("--profile /nowhere", "no folder with a config.yaml"),
        ("--quick --fine", "exclude each other"),
        ("--seeds 0", "one seed"),
        ("--layers 4,x", "whole numbers"),
        ("--nodes 10", "at least 800 nodes"),
    ],
)
def test_impossible_options_are_named(words, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        settings_of(*words.split())


def test_settings_survive_the_folder(tmp_path):
    assert Settings.read(folder_of(tmp_path / "a", SMALL)) == SMALL


def test_clean_data_are_always_fitted_with_the_dependent_scaling():
    settings = replace(SMALL, dependent_seeds=1)
    for condition, more in ((PLANE, 0), ("10", 1)):
        assert [len(losses_for(settings, condition, seed)) - more for seed in ("clean", "0", "1")] == [3, 3, 2]
        assert [len(losses_for(SMALL, condition, seed)) - more for seed in ("clean", "0", "1")] == [3, 2, 2]
    assert CORRECTED in losses_for(SMALL, "10", "1") and CORRECTED not in losses_for(SMALL, PLANE, "1")


@pytest.mark.parametrize("seeds", [1, 5, 6, 10, 100])
def test_batches_hold_every_seed_once_and_are_balanced(seeds):
    settings = replace(SMALL, seeds=tuple(range(seeds)))
    assert sorted(chain(*settings.batches)) == sorted(settings.noise_seeds)
    sizes = [len(batch) for batch in settings.batches]
    assert max(sizes) <= thickness_case.BATCH and max(sizes) - min(sizes) <= 1
    assert settings.batches[0][0] == "clean"


def test_memory_grows_with_what_is_solved():
    assert solid_memory(Settings()) < 3000
    finer = solid_memory(Settings(forward_size=0.5))
    assert finer > 4 * solid_memory(Settings())
    assert solid_memory(Settings(extra_layers=2)) > solid_memory(Settings())
    assert solid_memory(Settings(), ranks=4) > solid_memory(Settings())


@pytest.fixture(scope="module")
def dry_run(tmp_path_factory):
    """What Snakemake would do with the profile, but its executor, for a study that has begun."""
    profile, folder = tmp_path_factory.mktemp("profile"), tmp_path_factory.mktemp("out") / "a folder"
    text = (workflow.PROFILES / "slurm" / "config.yaml").read_text()
    (profile / "config.yaml").write_text(text.replace("executor: slurm\n", ""))
    folder_of(folder, replace(SMALL, seeds=tuple(range(8))))
    for name in ("plane.npz", "solid_10.npz", "epsilon_10.npz", "cases/12.5_1.json", "cases/12.5_3.json"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).touch()
    snakefile = workflow.PROFILES.with_name("thickness.smk")
    command = workflow.command(snakefile, folder / "workflow", [f"folder={folder}", "ranks=2"], 2, profile)
    done = subprocess.run([*command, "--dry-run", "--printshellcmds"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


def blocks(text: str, rule: str) -> list[str]:
    """What a dry run says of each job of a rule."""
    return re.findall(rf"^(?:local)?rule {rule}:.*?(?=^(?:local)?rule |\Z)", text, re.MULTILINE | re.DOTALL)


def test_the_workflow_has_the_expected_jobs_and_only_what_is_missing(dry_run):
    counts = dict(re.findall(r"^(\w+) +(\d+)$", dry_run, re.MULTILINE))
    expected = {"solid": 1, "epsilon": 1, "mesh": 1, "states": 1, "observe": 3, "case_0": 3, "case_1": 3, "all": 1}
    assert counts == {**{name: str(n) for name, n in expected.items()}, "total": "14"}
    assert re.search(r"case '.*/a folder' 12.5 clean 1 3 5 7", dry_run)


def test_ranks_and_memory_are_passed_on_and_the_profile_adds_its_own(dry_run):
    (solid,), case = blocks(dry_run, "solid"), blocks(dry_run, "case_0")[0]
    assert re.search(r"mpiexec -n 2 \S+ -m studies.grid.thickness_case solid '.*/a folder' 12.5", solid)
    memory = f"mem_mb={solid_memory(SMALL, 2)},"
    for words in ("priority: 22.5", "tasks=2", "cpus_per_task=1", memory, "runtime=720", "nodes=1"):
        assert words in solid
    assert "slurm_account=your_account" in case and "runtime=60" in case and "mem_mb=2500" in case
    assert "mpi=" not in case and "tasks=" not in case


class TestSteps:
    """The steps on a made-up plane solution: every arm stretched by a tenth, in two increments."""

    @pytest.fixture
    def folder(self, tmp_path):
        folder = folder_of(tmp_path / "study", SMALL)
        mesh = quads(Cross(), quarter=True, size_factor=4)
        u = np.array([t * np.diag([0.1, 0.1]) @ mesh.points[..., None] for t in (0.5, 1.0)])[..., 0]
        forces = {"right": np.array([[5.0, 1.0], [10.0, 2.0]]), "top": np.array([[1.0, 5.0], [2.0, 10.0]])}
        time = np.array([0.5, 1.0])
        solution = SurfaceSolution(mesh, u, forces, time, time, np.ones(2, np.int64), 1.0, {"digest": "abc"})
        solution.save(folder / "plane.npz")
        triangles(Cross(), n_nodes=900).save(folder / "mesh.npz")
        return folder

    def test_experiments_say_truly_where_they_come_from(self, folder, monkeypatch):
        plane = SurfaceSolution.load(folder / "plane.npz")

        class Solid:
            surface = staticmethod(lambda: replace(plane, thickness=12.5, description={"bulk_modulus": 3e3}))

        monkeypatch.setattr("forward.solid.solid_solution.SolidSolution.load", staticmethod(lambda path: Solid()))
        thickness_case.observe(folder, SMALL, "12.5", "clean", "1")
        thickness_case.observe(folder, SMALL, "plane", "1")
        clean, noisy, flat = (Experiment.load(folder / "experiments" / f"{name}.npz")
                              for name in ("12.5_clean", "12.5_1", "plane_1"))  # fmt: skip
        assert clean.thickness == 12.5 and flat.thickness == 1.0
        assert "3D, 12.5 mm thick" in clean.name
        told = noisy.provenance
        assert told["forward_model"].startswith("3D") and told["thickness_mm"] == 12.5
        assert told["displacement_of_each_arm_mm"] == 60.0 and told["solution"]["bulk_modulus"] == 3e3
        assert told["noise_seed"] == 1 and told["camera"]["field"]["normalisation"] == "unit-variance"
        assert "noise_seed" not in clean.provenance and clean.noise is None
        assert flat.provenance["forward_model"].startswith("2D plane stress")
        np.testing.assert_allclose(clean.displacements[-1], 0.1 * clean.points, atol=1e-9)
        np.testing.assert_array_equal(
            noisy.displacements, flat.displacements
        )  # a seed's noise is that of all conditions
        forces = {boundary.name: boundary.force[-1] for boundary in clean.loaded}
        np.testing.assert_allclose(forces["right"], [20, 0])
        np.testing.assert_allclose(forces["left"], [-20, 0])

    def test_an_experiment_that_exists_is_not_made_again(self, folder, monkeypatch):
        (folder / "experiments").mkdir()
        for seed in ("clean", "0"):
            (folder / "experiments" / f"plane_{seed}.npz").write_text("mine")
        monkeypatch.setattr(thickness_case, "surface", None)
        thickness_case.observe(folder, SMALL, "plane", "clean", "0")
        assert (folder / "experiments" / "plane_0.npz").read_text() == "mine"

    def test_cases_are_written_one_by_one_and_finished_ones_are_skipped(self, folder, monkeypatch):
        thickness_case.states(folder, SMALL)
        thickness_case.observe(folder, SMALL, "plane", "clean", "0", "1")
        fitted = []

        def fit_loss(experiment, settings, loss, reference, limit):
            if len(fitted) == 5:
                raise KeyboardInterrupt
            fitted.append((experiment.provenance.get("noise_seed"), loss))
            return {"states": len(reference.energy), "limit": limit}

        monkeypatch.setattr(thickness_case, "fit_loss", fit_loss)
        with pytest.raises(KeyboardInterrupt):
            thickness_case.case(folder, SMALL, "plane", "clean", "0", "1")
        assert fitted == [(None, "weighted"), (None, "paper-frozen"), (None, "paper-dependent"), (0, "weighted"),
                          (0, "paper-frozen")]  # fmt: skip
        assert sorted(path.stem for path in (folder / "cases").iterdir()) == ["plane_0", "plane_clean"]
        fitted.clear()
        thickness_case.case(folder, SMALL, "plane", "clean", "0", "1")
        assert fitted == [(1, "weighted"), (1, "paper-frozen")]
        content = json.loads((folder / "cases" / "plane_1.json").read_text())
        stretched = 2 * 1.1**2 + 1.1**-4
        assert content["calibrated_I1"] == pytest.approx(stretched, rel=1e-6)
        assert content["condition"] == "plane" and content["thickness"] == 1.0 and content["seed"] == "1"
        assert content["nodes"] > 800 and set(content["losses"]) == {"weighted", "paper-frozen"}


def test_a_finished_study_starts_nothing_and_writes_its_report(tmp_path, monkeypatch, capsys):
    from studies.grid import thickness_report

    folder = folder_of(tmp_path / "a", replace(thickness.QUICK, nodes=900, seeds=(0,)))
    for path in targets(folder, replace(thickness.QUICK, nodes=900, seeds=(0,))):
        path.parent.mkdir(exist_ok=True)
        path.touch()
    monkeypatch.setattr(subprocess, "Popen", None)
    monkeypatch.setattr(thickness_report, "write", lambda folder, settings: folder / f"{len(settings.seeds)}.html")
    parser = argparse.ArgumentParser()
    thickness.add_arguments(parser)
    words = ["--quick", "--nodes", "900", "--seeds", "1", "-o", str(folder)]
    assert thickness.main(parser.parse_args(words)) == 0
    assert capsys.readouterr().out == f"report: {folder / '1.html'}\n"


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_killed_run_resumes_without_doing_finished_steps_again(tmp_path):
    out = tmp_path / "out"
    words = ["thickness", "--quick", "--seeds", "1", "--thicknesses", "10", "--nodes", "900", "--output", str(out)]
    command = [sys.executable, "-m", "studies.cli", *words]
    process = subprocess.Popen(command, start_new_session=True)
    deadline = time.monotonic() + 400
    while not (out / "cases").is_dir() or not any((out / "cases").glob("*.json")):
        assert time.monotonic() < deadline, "no case was finished"
        assert process.poll() is None
        time.sleep(0.2)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    finished = [*out.glob("*.npz"), *out.glob("cases/*.json"), *out.glob("experiments/*.npz")]
    before = {path: path.stat().st_ino for path in finished}  # a file that is written again is another one
    subprocess.run(command, check=True, timeout=400)
    assert before and all(path.stat().st_ino == number for path, number in before.items())
    settings = Settings.read(out)
    assert all(path.exists() for path in targets(out, settings))
    case = json.loads((out / "cases" / "10_clean.json").read_text())
    assert abs(case["losses"]["weighted"]["inside"][0]["bias"]) < 0.05
    assert case["thickness"] == 10.0
    assert (out / "report.html").exists()
    assert not list(out.glob("*checkpoint*"))
