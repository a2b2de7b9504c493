"""Sweep: the cases of a thousand, jobs that a dry run plans, named errors, steps, tables, and (slow) a run taken up again."""

import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from study_stand_in import fit_with, folder_of, parsed, result_of, stretched_sheet

from calibrate.data.experiment import Experiment
from calibrate.errors import ConfigError, FitError
from meshes import Mesh
from studies import cli
from studies.commands.grid_studies import sweep
from studies.errors import DamagedFileError, OptionError, WorkflowError
from studies.grid import report, steps, study, workflow
from studies.grid.axes import Case, Loss, Settings
from studies.grid.case import CaseResult
from studies.grid.presets import sweep_study
from studies.grid.presets.sweep_study import SWEEP
from studies.grid.results import Results
from studies.grid.study import SNAKEFILE, Execution
from studies.synthetic import coarsening

SMALL = replace(SWEEP.default, nodes=800, seeds=(0, 1), starts=2, increments=2, forward_size=2.0,
                specimens=("plate_with_hole",), thicknesses=("2D",), resolutions=("50",))  # fmt: skip
SMALL = replace(SMALL, noises=("0", "0.1"))
APPTAINER = f"""#!/bin/sh
[ "$1" = --version ] && echo apptainer version 1.3.4 && exit
printf '%s\\n' "$@" >> "$(dirname "$0")/said"
while [ "$1" != -c ]; do shift; done
exec bash -c "python() {{ '{sys.executable}' \\"\\$@\\"; }}; $2"
"""


def settings_of(*words: str) -> Settings:
    given = parsed("sweep", *words)
    given["execution"].config(Path())
    return sweep.settings_of(given["options"], given["axes"], given["quick"])


def test_by_default_there_are_about_a_thousand_cases_and_clean_data_know_no_seed():
    cases = SWEEP.default.cases
    assert len(cases) == len(set(cases)) == 2 * 4 * 4 * (1 + 3 * 10)
    assert {case.seed for case in cases if case.noise == "0"} == {"clean"}


def test_options_become_settings():
    assert settings_of() == SWEEP.default
    assert settings_of("--quick") == SWEEP.quick
    words = "--specimens cross,strip --thicknesses 0,5.0 --resolutions 25,100 --noises 0.10 --seeds 3"
    found = settings_of(*words.split())
    assert found == replace(SWEEP.default, specimens=("cross", "strip"), thicknesses=("2D", "5"), resolutions=("100", "25"),
                             noises=("0.1",), seeds=(0, 1, 2))  # fmt: skip


def test_settings_survive_the_folder_and_specimens_are_pulled_in_proportion(tmp_path):
    assert Settings.read(folder_of(tmp_path / "a", SMALL)) == SMALL
    half = replace(SMALL, displacement=30.0)
    assert half.pull("cross") == 30.0 and half.pull("plate_with_hole") == 20.0


@pytest.mark.parametrize(
    ("words", "key"),
    [
        ("--specimens cros", "cross?"),
        ("--thicknesses 2D,-1", "thickness '-1'"),
        ("--thicknesses thin", "thickness 'thin'"),
        ("--resolutions 0", "resolution '0'"),
        ("--resolutions 120", "resolution '120'"),
        ("--noises=-0.1", "noise '-0.1'"),
        ("--noises 0.1,nan", "noise 'nan'"),
        ("--noises 0.1,0.10", "0.1 is"),
        ("--thicknesses 0,2d", "2D is"),
    ],
)
def test_values_that_cannot_be_are_named(words, key):
    with pytest.raises(OptionError, match=re.escape(key)):
        settings_of(*words.split())


@pytest.mark.parametrize("words", ["--seeds 0", "--nodes 10", "--jobs 0", "--profile /nowhere", "--layers x"])
def test_options_shared_with_other_studies_are_checked_too(words):
    with pytest.raises((ConfigError, OptionError)):
        settings_of(*words.split())


def test_a_missing_executor_is_named(tmp_path, capsys):
    (tmp_path / "config.yaml").write_text("executor: no-such\n")
    assert cli.main(["sweep", "--dry-run", "--profile", str(tmp_path)]) == 2
    assert "snakemake-executor-plugin-no-such" in capsys.readouterr().err


def test_a_container_needs_its_program_and_its_image(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(OptionError, match="apptainer"):
        Execution(container="equigap.sif").config(tmp_path)
    (tmp_path / "apptainer").write_text(APPTAINER)
    (tmp_path / "apptainer").chmod(0o755)
    with pytest.raises(OptionError, match="absent.sif"):
        Execution(container="absent.sif").config(tmp_path)
    assert Execution(container="docker://here/equigap").config(tmp_path / "a b") == (
        ["ranks=1", "container=docker://here/equigap"],
        ["--software-deployment-method", "apptainer", "--apptainer-args", f"--bind '{tmp_path / 'a b'}'"],
    )


class TestPlan:
    """What `--dry-run` says."""

    def planned(self, capsys, *words):
        assert cli.main(["sweep", "--dry-run", *map(str, words)]) == 0
        found = dict(re.findall(r"^ *(\w[\w ]*?)  (\d+)$", capsys.readouterr().out, re.MULTILINE))
        return {name: int(count) for name, count in found.items()}

    def test_a_thousand_cases_share_their_forward_solutions(self, tmp_path, capsys):
        folder = tmp_path / "out"
        expected = {"plane": 2, "solid": 2 * 3, "mesh": 2 * 4, "observe": 2 * 4, "fit": 992}
        assert self.planned(capsys, "-o", folder) == {**expected, "jobs to do": 1016}
        assert not folder.exists()

    def test_only_what_is_missing_is_planned_and_nothing_is_touched(self, tmp_path, capsys):
        settings = settings_of("--quick")
        folder = folder_of(tmp_path / "out", settings)
        names = ("forward/cross_2D.npz", "meshes/cross_100.npz", "clean/cross_2D.npz", "clean/cross_2D.json",
                 "cases/cross/2D_100_0.1_1.json")  # fmt: skip
        for name in names:
            (folder / name).parent.mkdir(exist_ok=True, parents=True)
            (folder / name).touch()
        before = sorted(folder.rglob("*"))
        found = self.planned(capsys, "--quick", "-o", folder, "--profile", workflow.PROFILES / "laptop")
        assert found == {"solid": 1, "mesh": 1, "observe": 1, "fit": 11, "jobs to do": 14}
        assert sorted(folder.rglob("*")) == before

    def test_a_folder_of_another_sweep_is_refused_and_left_alone(self, tmp_path, capsys):
        folder = folder_of(tmp_path / "out", SMALL)
        assert cli.main(["sweep", "--dry-run", "--quick", "-o", str(folder)]) == 2
        assert "--overwrite" in capsys.readouterr().err
        assert Settings.read(folder) == SMALL

    def test_the_profile_for_slurm_is_understood(self, tmp_path):
        """All but its executor, which is a package of its own."""
        profile, folder = tmp_path / "profile", folder_of(tmp_path / "out", SMALL)
        profile.mkdir()
        text = (workflow.PROFILES / "slurm" / "config.yaml").read_text()
        (profile / "config.yaml").write_text(text.replace("executor: slurm\n", ""))
        found = workflow.plan(SNAKEFILE, folder, 2, profile)
        assert found == {"plane": 1, "mesh": 1, "observe": 1, "fit": 3}

    def test_a_workflow_that_cannot_be_planned_says_why(self, tmp_path):
        (tmp_path / "broken.smk").write_text("rule all:\n    input: absent_name\n")
        with pytest.raises(WorkflowError, match="absent_name"):
            workflow.plan(tmp_path / "broken.smk", tmp_path)


class TestSteps:
    """The steps on a made-up plane solution: a plate stretched by a tenth, in two increments."""

    @pytest.fixture
    def folder(self, tmp_path):
        folder = folder_of(tmp_path / "out", SMALL)
        stretched_sheet(folder, "plate_with_hole", 0.1, -0.05, {"right": [5.0, 0.0]})
        steps.mesh(folder, SMALL, "plate_with_hole", "50")
        steps.observe(folder, SMALL, "plate_with_hole", "2D")
        return folder

    def test_the_judged_range_is_that_of_the_clean_data(self, folder):
        F = np.diag([1.1, 0.95, 1 / (1.1 * 0.95)])
        limit = json.loads((folder / "clean" / "plate_with_hole_2D.json").read_text())["calibrated_I1"]
        assert limit == pytest.approx(np.trace(F @ F), rel=1e-6)

    def test_noises_of_a_seed_differ_in_size_only(self, folder):
        clean = Experiment.load(folder / "clean" / "plate_with_hole_2D.npz")
        grid = Mesh.load(folder / "meshes" / "plate_with_hole_50.npz")
        projection = coarsening.coarsening(clean.points, clean.triangles, grid)

        def noise(size, seed):
            case = Case("plate_with_hole", "2D", "50", size, seed)
            return projection.apply(steps.record(clean, SMALL, case)).displacements - clean.displacements

        assert not noise("0", "clean").any()
        np.testing.assert_allclose(noise("0.2", "1"), 2 * noise("0.1", "1"), rtol=0, atol=1e-12)
        assert noise("0.1", "1").std() == pytest.approx(0.1, rel=0.2)
        assert np.abs(noise("0.1", "0") - noise("0.1", "1")).max() > 0.1

    def test_what_cannot_be_calibrated_is_a_result_too(self, folder, monkeypatch):
        def fit(*_):
            raise FitError("no solution; more data are needed")

        monkeypatch.setattr("studies.grid.case.fit", fit)
        records = [case.record for case in SMALL.cases]
        steps.fit(folder, SMALL, "plate_with_hole", "2D", "50", *records)
        assert all(path.exists() for path in SMALL.targets(folder))
        results = Results(folder, SMALL)
        assert [result.failed for result in results.cases] == 3 * ["FitError: no solution; more data are needed"]
        path = report.write(results, sweep_study.page(results))
        assert (folder / "sweep.csv").read_text().count("FitError: no solution") == 3
        assert "Cases without a model" in path.read_text()
        with pytest.raises(FitError):
            steps.fit(folder, replace(SMALL, record_failures=False, seeds=(2,)), "plate_with_hole", "2D", "50", "0.1_2")


def made_up(settings: Settings) -> list[CaseResult]:
    """Cases whose bias is known: 1 % of thickness over 10 mm, twice that in pure shear, +- 0.1 % by seed."""
    cases = []
    for case in settings.cases:
        bias = (0 if case.thickness == "2D" else float(case.thickness)) / 1000
        bias += 0 if case.seed == "clean" else 0.001 * (int(case.seed) - 1)
        cases.append(result_of(case, {Loss.WEIGHTED: fit_with(bias, bias, 2 * bias)}))
    return cases


def test_the_table_holds_medians_and_ranges_of_the_worst_mode(tmp_path):
    settings = replace(SWEEP.default, seeds=(0, 1, 2))
    cases = made_up(settings)
    cases[-1] = result_of(cases[-1].case, {}, "FitError: x")
    groups = sweep_study.groups(cases)
    rows = {group.keys: group.row()[4:] for group in groups}
    assert len(rows) == 2 * 4 * 4 * 4
    found = rows["cross", "20", "50", "0.1"]
    assert found[:3] == [3, 0, "pure_shear"]
    np.testing.assert_allclose(found[3:], [4.0, 3.8, 4.2, 1.0, 1.5], atol=1e-12)
    assert rows["plate_with_hole", "40", "12.5", "0.2"][:2] == [2, 1]
    figure = sweep_study.draw(groups, settings)
    assert len(figure.axes) == 2 * 4 + 1
    largest = sweep_study.extremes(groups)[0]
    assert largest[1:3] == ["cross", "40"] and largest[8] == pytest.approx(8.0)
    assert all(len(sweep_study.case_row(case)) == len(sweep_study.CASE_COLUMNS) for case in cases)


def test_a_damaged_case_is_named(tmp_path):
    folder = folder_of(tmp_path / "out", SMALL)
    first = SMALL.cases[0].path(folder)
    first.parent.mkdir(parents=True)
    first.write_text("{")
    with pytest.raises(DamagedFileError, match="2D_50_0_clean.json"):
        _ = Results(folder, SMALL).cases


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_sweep_runs_and_is_taken_up_again_in_a_container_without_doing_anything_twice(tmp_path, monkeypatch):
    """With a stand-in for Apptainer that runs the same words here."""
    settings = replace(SMALL, resolutions=("100",), seeds=(0,))
    folder = folder_of(tmp_path / "an output", settings)
    study.run(SWEEP, settings, folder, Execution(jobs=1))
    clean, noisy = (CaseResult.load(case.path(folder)) for case in settings.cases)
    assert clean.failed is None and abs(clean.losses[Loss.WEIGHTED].inside[0].bias) < 0.02
    fit = noisy.losses[Loss.WEIGHTED]
    assert noisy.case.seed == "0" and fit.reduced_chi_square > 0 and fit.curves is None
    stamps = {path: path.stat().st_mtime_ns for path in folder.glob("*/**/*.npz")}
    kept, lost = (case.path(folder) for case in settings.cases)
    stamps[kept] = kept.stat().st_mtime_ns
    lost.unlink()

    (tmp_path / "apptainer").write_text(APPTAINER)
    (tmp_path / "apptainer").chmod(0o755)
    (tmp_path / "equigap.sif").touch()
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    study.run(SWEEP, settings, folder, Execution(jobs=1, container=str(tmp_path / "equigap.sif")))
    assert CaseResult.load(lost).losses[Loss.WEIGHTED].inside == fit.inside
    assert {path: path.stat().st_mtime_ns for path in stamps} == stamps
    said = (tmp_path / "said").read_text().splitlines()
    assert said.count("exec") == 1 and str(folder) in said and str(tmp_path / "equigap.sif") in said
    assert (folder / "report.html").exists()
