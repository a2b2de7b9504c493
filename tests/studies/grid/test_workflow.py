"""Running a study's workflow: what is missing is made, what exists is kept, failures say why, interruptions end all jobs."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from calibrate.errors import ConfigError
from studies.errors import WorkflowError
from studies.grid import workflow

SNAKEFILE = """
from pathlib import Path
folder = Path(config["folder"])
rule all:
    input: [f"{folder}/{name}" for name in ("one", "two", "three")]
rule one:
    output: f"{folder}/one"
    shell: "sleep {config[wait]}; echo one > {output}"
rule batch:
    input: f"{folder}/one"
    output: [update(f"{folder}/{name}") for name in ("two", "three")]
    shell: "cd {folder}; [ -e two ] || echo two > two; sh then; [ -e three ] || echo three > three"
"""


@pytest.fixture
def study(tmp_path):
    """run(then, wait=0): the workflow above, `then` between the two files of its batch."""
    snakefile = tmp_path / "study.smk"
    snakefile.write_text(SNAKEFILE)
    targets = [tmp_path / name for name in ("one", "two", "three")]

    def run(then: str, wait: float = 0) -> list[Path]:
        (tmp_path / "then").write_text(then)
        workflow.run_workflow("test", snakefile, tmp_path, targets, jobs=2, config=[f"wait={wait}"])
        return targets

    return run


def test_a_failed_job_says_why_and_what_it_finished_is_kept(study, tmp_path):
    with pytest.raises(WorkflowError, match="ConvergenceError: no equilibrium"):
        study("echo 'forward.errors.ConvergenceError: no equilibrium; load less.'; exit 1")
    assert (tmp_path / "one").exists() and (tmp_path / "two").exists() and not (tmp_path / "three").exists()
    before = {name: (tmp_path / name).stat().st_mtime_ns for name in ("one", "two")}
    (tmp_path / "two").write_text("mine")
    assert all(path.exists() for path in study("true"))
    assert (tmp_path / "one").stat().st_mtime_ns == before["one"]
    assert (tmp_path / "two").read_text() == "mine"


def test_nothing_is_started_when_nothing_is_missing(study, tmp_path, monkeypatch):
    for name in ("one", "two", "three"):
        (tmp_path / name).touch()
    monkeypatch.setattr(subprocess, "Popen", None)
    study("true")


@pytest.mark.slow
def test_an_interruption_ends_snakemake_and_its_jobs(tmp_path):
    (tmp_path / "study.smk").write_text(SNAKEFILE)
    seconds = "97531"
    code = (
        "from pathlib import Path; from studies.grid import workflow; import sys; folder = Path(sys.argv[1])\n"
        f"workflow.run_workflow('test', folder / 'study.smk', folder, [folder / 'one'], 1, "
        f"config=['wait={seconds}'])"
    )
    process = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stderr=subprocess.PIPE)
    sleeping = ["pgrep", "-f", f"^sleep {seconds}"]
    deadline = time.monotonic() + 120
    while subprocess.run(sleeping, capture_output=True, check=False).returncode:
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.2)
    os.kill(process.pid, signal.SIGINT)
    process.communicate(timeout=60)
    assert subprocess.run(sleeping, capture_output=True, check=False).returncode == 1


def test_here_jobs_share_cores_and_memory_and_a_profile_brings_its_own_limits(tmp_path):
    here = workflow.command(Path("a.smk"), tmp_path, ["folder=x"], 3, None)
    assert here[here.index("--cores") + 1] == "3"
    assert int(here[here.index("--resources") + 1].removeprefix("mem_mb=")) > 500
    assert here[-2:] == ["--config", "folder=x"]
    there = workflow.command(Path("a.smk"), tmp_path, [], None, Path("profiles/mine"))
    assert there[there.index("--profile") + 1] == str(Path("profiles/mine").resolve())
    assert not {"--cores", "--jobs", "--resources"} & set(there)
    assert "--jobs" in workflow.command(Path("a.smk"), tmp_path, [], 5, Path("profiles/mine"))


def test_options_that_cannot_be_are_named(tmp_path):
    with pytest.raises(ConfigError, match="--jobs 0"):
        workflow.check(0, None)
    with pytest.raises(ConfigError, match="config.yaml"):
        workflow.check(None, tmp_path)
    (tmp_path / "config.yaml").write_text("executor: no-such\n")
    with pytest.raises(ConfigError, match="snakemake-executor-plugin-no-such"):
        workflow.check(None, tmp_path)
    (tmp_path / "config.yaml").write_text("jobs: 3\n")
    workflow.check(None, tmp_path)


def test_the_reason_of_a_failure_is_the_last_named_error_of_this_run(tmp_path):
    log = tmp_path / "log"
    log.write_text("OldError: of an earlier run\n")
    start = log.stat().st_size
    with log.open("a") as file:
        file.write("CalledProcessError in file x.smk, line 3:\n")
    assert workflow._reason(log, start) == ""
    with log.open("a") as file:
        file.write("Traceback\nforward.errors.SolutionError: damaged; remove it\nExiting because a job failed\n")
    assert workflow._reason(log, start) == " (SolutionError: damaged; remove it)"


def test_the_profile_is_part_of_the_package():
    profile = workflow.PROFILES / "slurm" / "config.yaml"
    assert profile.exists()
    metadata = (Path(__file__).parents[3] / "pyproject.toml").read_text()
    assert "profiles/*/*" in metadata
    assert "\nexecutor: slurm\n" in profile.read_text()


def test_two_runs_do_not_share_a_folder(tmp_path, monkeypatch, capsys):
    """The lock is held by whoever works there, and free again afterwards."""
    monkeypatch.setattr(workflow, "LONGEST_WAIT", 0.0)
    with (
        workflow._alone(tmp_path),
        pytest.raises(WorkflowError, match="another run"),
        workflow._alone(tmp_path),
    ):
        pass
    assert capsys.readouterr().err
    with workflow._alone(tmp_path) as lock:
        assert lock > 0


def test_the_lock_outlives_a_killed_command(tmp_path, monkeypatch):
    """What was started keeps the lock until it has ended itself."""
    monkeypatch.setattr(workflow, "LONGEST_WAIT", 0.0)
    with workflow._alone(tmp_path) as lock:
        child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE, pass_fds=(lock,))
    with pytest.raises(WorkflowError), workflow._alone(tmp_path):
        pass
    child.communicate(b"\n")
    with workflow._alone(tmp_path):
        pass
