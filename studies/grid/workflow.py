"""Run the Snakemake workflow of a study: snakefile, folder and the files that must exist in; those files out.

Files are written whole or not at all, so one that exists is complete, whatever Snakemake thinks of a killed job:
what exists is kept, what is missing is made. Jobs run on this machine, or where a Snakemake profile sends them.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path

import psutil

from calibrate.errors import ConfigError
from studies.errors import WorkflowError
from studies.output import Progress

# Asks Linux to end Snakemake when the program that started it has gone, however, then becomes Snakemake.
MORTAL = (
    "import ctypes, os, sys; libc = ctypes.CDLL(None); hasattr(libc, 'prctl') and libc.prctl(1, 15); "
    "os.execv(sys.argv[1], sys.argv[1:])"
)
PROFILES = Path(__file__).with_name("profiles")
EXECUTOR = re.compile(r"^executor:\s*['\"]?([\w-]+)", re.MULTILINE)
OWN_EXECUTORS = ("local", "dryrun", "touch")  # of Snakemake itself
REASON = re.compile(r"^(?:\w+\.)*(\w*(?:Error|Exception)): (.+)", re.MULTILINE)
BATCH = re.compile(r"_\d+$")  # at the end of the name of a rule that makes one of several batches
PLANNED = re.compile(r"^(\w+) +(\d+)$", re.MULTILINE)  # a rule and its number of jobs, as a dry run lists them
LONGEST_WAIT = 600.0  # s that a run waits for an earlier one in the same folder
PATIENCE = 3.0  # s that Snakemake is given to end, each time that it is asked


def check(jobs: int | None, profile: Path | None) -> None:
    """Raise `ConfigError` for a number of jobs or a profile that cannot be."""
    if jobs is not None and jobs < 1:
        raise ConfigError(f"--jobs {jobs}: at least 1")
    if profile is None:
        return
    found = [*profile.glob("config*.yaml")]
    if not found:
        raise ConfigError(
            f"--profile {profile}: no folder with a config.yaml; copy {PROFILES / 'slurm'} and adapt it to your cluster"
        )
    executor = EXECUTOR.search(found[0].read_text())
    name = executor[1] if executor else "local"
    if name not in OWN_EXECUTORS and not find_spec(f"snakemake_executor_plugin_{name.replace('-', '_')}"):
        package = f"snakemake-executor-plugin-{name}"
        raise ConfigError(f"--profile {profile}: its executor needs a package; pip install {package}")


def run_workflow(
    name: str,
    snakefile: Path,
    folder: Path,
    targets: Sequence[Path],
    jobs: int | None = None,
    profile: Path | None = None,
    config: Sequence[str] = (),
    words: Sequence[str] = (),
) -> None:
    """Make every missing one of `targets`, showing progress. name: in words. config: 'key=value' for the snakefile.

    words: more options of Snakemake. Raises `WorkflowError` with the reason and the path of the log.
    """
    if all(target.exists() for target in targets):
        return
    folder = folder.resolve()
    work, log = folder / "workflow", folder / "workflow.log"
    work.mkdir(exist_ok=True)
    call = command(snakefile, work, [f"folder={folder}", *config], jobs, profile, words)
    start = log.stat().st_size if log.exists() else 0
    with _alone(work) as lock:
        code = _follow(name, call, environment(work), log, targets, lock)
    if code:
        raise WorkflowError(
            f"a job of the study failed{_reason(log, start)}; more is in {log}. Finished files are kept: "
            "mend it and run the same command again"
        )


def plan(
    snakefile: Path,
    folder: Path,
    jobs: int | None = None,
    profile: Path | None = None,
    config: Sequence[str] = (),
    words: Sequence[str] = (),
) -> dict[str, int]:
    """Jobs of each rule, its batches taken together, that `run_workflow` would start now; makes no file in `folder`. Raises `WorkflowError`."""
    with tempfile.TemporaryDirectory() as work:
        dry = ["--dry-run", "--quiet", "rules", *words]
        call = command(snakefile, Path(work), [f"folder={folder.resolve()}", *config], jobs, profile, dry)
        done = subprocess.run(call, env=environment(Path(work)), capture_output=True, text=True, check=False)
    said = done.stdout + done.stderr
    if done.returncode:
        last = [line.strip() for line in said.splitlines() if line.strip()][-3:]
        raise WorkflowError(f"the workflow cannot be planned: {' '.join(last) or 'Snakemake failed'}")
    jobs_of: Counter[str] = Counter()
    for rule, count in dict(PLANNED.findall(said)).items():  # said twice
        jobs_of[BATCH.sub("", rule)] += int(count)
    return {rule: count for rule, count in jobs_of.items() if rule not in ("all", "total")}


def command(
    snakefile: Path,
    work: Path,
    config: Sequence[str],
    jobs: int | None,
    profile: Path | None,
    more: Sequence[str] = (),
) -> list[str]:
    """Words of the Snakemake call. Here, jobs share the cores and the memory; a profile brings its own limits."""
    words = [sys.executable, "-m", "snakemake", "--snakefile", str(snakefile), "--directory", str(work),
             "--ignore-incomplete", "--keep-incomplete", "--keep-going", "--rerun-triggers", "mtime", "--nolock"]  # fmt: skip
    if profile is None:
        words += ["--cores", str(jobs or os.cpu_count() or 1), "--resources", f"mem_mb={_memory()}"]
    else:
        words += ["--profile", str(profile.resolve()), *(["--jobs", str(jobs)] if jobs else [])]
    return [*words, *more, "--config", *config]


def environment(work: Path) -> dict[str, str]:
    """One thread a job, no bars in the log, compiled functions shared between jobs."""
    return {
        **os.environ,
        "OMP_NUM_THREADS": "1",
        "MKL_NUM_THREADS": "1",
        "TQDM_DISABLE": "1",
        "JAX_COMPILATION_CACHE_DIR": str(work / "jax"),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
    }


def _memory() -> int:
    """Memory of this machine, MB."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 10**6


@contextlib.contextmanager
def _alone(work: Path) -> Iterator[int]:
    """Hold the folder's lock, which Snakemake inherits: it is free when both have ended. Waits for an earlier run.

    Raises `WorkflowError` if that does not end.
    """
    with (work / "lock").open("w") as file:
        waited = 0.0
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if waited == 0:
                    print(f"an earlier run is still at work in {work.parent}; waiting for it to end", file=sys.stderr)
                if waited >= LONGEST_WAIT:
                    raise WorkflowError(
                        f"another run is at work in {work.parent}; wait until it has ended, or end its snakemake"
                    ) from None
                time.sleep(1.0)
                waited += 1.0
        yield file.fileno()


def _follow(
    name: str, call: list[str], environment: dict[str, str], log: Path, targets: Sequence[Path], lock: int
) -> int:
    """Run Snakemake with its words appended to `log`, count the targets there are; its exit code."""
    tick = threading.Event()
    with log.open("a") as file, Progress(name, len(targets), "files") as progress:
        mortal = [sys.executable, "-c", MORTAL, *call]
        process = subprocess.Popen(mortal, stdout=file, stderr=subprocess.STDOUT, env=environment, pass_fds=(lock,))
        try:
            while process.poll() is None:
                progress.to(sum(target.exists() for target in targets))
                tick.wait(1.0)
        except BaseException:
            _end(process)
            raise
        progress.to(sum(target.exists() for target in targets))
    return process.returncode


def _end(process: subprocess.Popen[bytes]) -> None:
    """End Snakemake and its jobs, with rising insistence.

    A terminal has sent its interruption to all of them already. Asked alone, Snakemake withdraws jobs from a cluster but
    waits for those that run here.
    """

    def to_all(method: str) -> None:
        with contextlib.suppress(psutil.NoSuchProcess):
            family = [*psutil.Process(process.pid).children(recursive=True), psutil.Process(process.pid)]
            for member in family:
                with contextlib.suppress(psutil.NoSuchProcess):
                    getattr(member, method)()

    steps: list[Callable[[], None]] = [
        lambda: None, lambda: process.send_signal(signal.SIGINT), lambda: to_all("terminate"), lambda: to_all("kill"),
    ]  # fmt: skip
    for step in steps:
        step()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(PATIENCE)
            return


def _reason(log: Path, start: int) -> str:
    """' (Kind: what)' of the last named error that a job wrote to the log after byte `start`, or nothing."""
    with log.open("rb") as file:
        file.seek(start)
        found = REASON.findall(file.read().decode(errors="replace"))
    return f" ({found[-1][0]}: {found[-1][1].rstrip('. ')})" if found else ""
