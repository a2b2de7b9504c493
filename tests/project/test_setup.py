"""Set-up: what is missing is named with its remedy, before anything long; nothing is installed by these tests."""

from __future__ import annotations

import ast
import importlib.metadata
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tomllib
import types
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[2]
CI = ROOT / ".ci"


@pytest.fixture
def preflight() -> types.ModuleType:
    spec = importlib.util.spec_from_file_location("preflight", CI / "preflight.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_preflight_needs_the_standard_library_only() -> None:
    tree = ast.parse((CI / "preflight.py").read_text())
    names = {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    names |= {n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert names
    assert {name.split(".")[0] for name in names} <= sys.stdlib_module_names


def test_this_machine_passes(preflight: types.ModuleType) -> None:
    assert preflight.problems() == []
    assert preflight.main([]) == 0


def test_missing_libraries_are_named_with_their_packages(
    preflight: types.ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(preflight, "LIBRARIES", {"libabsent.so.1": "libabsent1", "libc.so.6": "libc6"})
    assert preflight.main([]) == 1
    error = capsys.readouterr().err
    assert "no libabsent.so.1 for gmsh" in error
    assert "apt-get install -y libabsent1\n" in error
    assert preflight.main(["--packages"]) == 0
    assert capsys.readouterr().out == "libabsent1\n"


def test_a_missing_compiler_is_named(preflight: types.ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(preflight.shutil, "which", lambda name: None)
    ((text, packages),) = preflight.compiler_problems()
    assert "no C compiler" in text
    assert packages == ["gcc", "libc6-dev"]


def test_missing_headers_are_named(preflight: types.ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(preflight.sysconfig, "get_path", lambda name: "/absent")
    ((text, packages),) = preflight.compiler_problems()
    assert "no Python.h in /absent" in text
    assert packages == [f"python3.{sys.version_info[1]}-dev"]
    monkeypatch.setattr(preflight, "compiles", lambda *arguments: False)
    ((text, packages),) = preflight.compiler_problems()
    assert "no C headers" in text
    assert packages == ["libc6-dev"]


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("machine", lambda: "aarch64", "Linux x86-64 only"),
        ("libc_ver", lambda: ("glibc", "2.31"), "glibc 2.34 is needed"),
        ("libc_ver", lambda: ("", ""), "glibc 2.34 is needed"),
    ],
)
def test_other_machines_are_sent_to_the_container(
    preflight: types.ModuleType, monkeypatch: pytest.MonkeyPatch, name: str, value: object, message: str
) -> None:
    monkeypatch.setattr(preflight.platform, name, value)
    ((text, packages),) = preflight.platform_problems()
    assert message in text
    assert "container" in text
    assert packages == []


def test_an_old_python_and_a_python_without_venv_are_named(
    preflight: types.ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(preflight.sys, "version_info", (3, 11, 2))
    assert "3.12, 3.13 or 3.14 is needed" in preflight.platform_problems()[0][0]
    monkeypatch.setattr(preflight.importlib.util, "find_spec", lambda name: None)
    assert preflight.venv_problems()[0][1] == ["python3.11-venv"]
    assert not any("virtual environments" in text for text, _ in preflight.problems(uv=True))


def test_a_full_disk_is_named(preflight: types.ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(preflight.shutil, "disk_usage", lambda path: types.SimpleNamespace(free=1e9))
    assert "1.0 GB free" in preflight.disk_problems()[0][0]
    (tmp_path / ".venv").mkdir()
    assert preflight.disk_problems() == []


def tools(folder: Path, **scripts: str) -> dict[str, str]:
    """An environment whose PATH has a few system tools and the given shell scripts only."""
    folder.mkdir()
    for name in ("sh", "cat", "cksum", "dirname", "rm"):
        (folder / name).symlink_to(str(shutil.which(name)))
    for name, text in scripts.items():
        path = folder / name.replace("_", ".")
        path.write_text(f"#!/bin/sh\n{text}\n")
        path.chmod(0o755)
    return {"PATH": str(folder)}


def run(script: Path, environment: dict[str, str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run([script], env=environment, capture_output=True, text=True, check=False, timeout=60)


class TestFindPython:
    def test_names_the_remedy_where_there_is_none(self, tmp_path: Path) -> None:
        done = run(CI / "find-python", tools(tmp_path / "bin"))
        assert done.returncode == 1
        assert "no Python 3.12" in done.stderr
        assert "apt-get install" in done.stderr

    def test_passes_over_what_is_too_old_or_broken(self, tmp_path: Path) -> None:
        # a command of pyenv exists for every version that any project uses, and fails where it is not chosen
        environment = tools(tmp_path / "bin", python3_12="exit 127", python3=f'exec "{sys.executable}" "$@"')
        done = run(CI / "find-python", environment)
        assert done.returncode == 0
        assert os.path.samefile(done.stdout.strip(), sys.executable)


class TestSetup:
    @pytest.fixture
    def copy(self, tmp_path: Path) -> Path:
        """The files set-up depends on, in a folder of their own."""
        folder = tmp_path / "copy"
        shutil.copytree(CI, folder / ".ci")
        for name in ("requirements.lock", "pyproject.toml"):
            shutil.copy(ROOT / name, folder)
        return folder

    def environment(self, folder: Path) -> dict[str, str]:
        """A python3.12 that passes every check and a uv that only says what it was asked to do."""
        uv = (
            'echo "uv $*"; case "$1" in venv) mkdir -p .venv/bin; cp "$(command -v python3.12)" .venv/bin/python;; esac'
        )
        environment = tools(folder, uv=uv, python3_12=f'case "$1" in .ci/preflight.py|-c) [ "$2" != "import gmsh, '
                            f'studies.cli" ] || exit 0;; esac; exec "{sys.executable}" "$@"')  # fmt: skip
        for name in ("mkdir", "cp", "gcc"):
            (folder / name).symlink_to(str(shutil.which(name)))
        return environment

    def test_checks_installs_once_and_again_when_something_changed(self, copy: Path, tmp_path: Path) -> None:
        environment = self.environment(tmp_path / "bin")
        first = run(copy / ".ci" / "setup", environment)
        assert first.returncode == 0, first.stderr
        assert "uv venv" in first.stdout
        assert "--require-hashes -r requirements.lock" in first.stdout
        assert "--no-deps --no-build-isolation -e ." in first.stdout
        again = run(copy / ".ci" / "setup", environment)
        assert (again.returncode, again.stdout) == (0, "")
        with (copy / "requirements.lock").open("a") as file:
            file.write("# changed\n")
        changed = run(copy / ".ci" / "setup", environment)
        assert "-r requirements.lock" in changed.stdout
        assert "uv venv" not in changed.stdout
        copy.rename(tmp_path / "moved")
        assert "-e ." in run(tmp_path / "moved" / ".ci" / "setup", environment).stdout

    def test_stops_at_what_is_missing(self, copy: Path, tmp_path: Path) -> None:
        environment = self.environment(tmp_path / "bin")
        (copy / ".ci" / "preflight.py").write_text("import sys; sys.exit('equigap: error: no C compiler')")
        done = run(copy / ".ci" / "setup", environment)
        assert done.returncode == 1
        assert "no C compiler" in done.stderr
        assert "uv" not in done.stdout
        assert not (copy / ".venv").exists()


def test_every_locked_package_has_a_hash() -> None:
    text = (ROOT / "requirements.lock").read_text().replace("\\\n", " ")
    entries = [line for line in text.splitlines() if line and not line.lstrip().startswith("#")]
    assert len(entries) > 50
    assert all("==" in entry and "--hash=sha256:" in entry for entry in entries)


def locked_extras() -> dict[str, set[str]]:
    """The extras of every locked package by its name."""
    text = (ROOT / "requirements.lock").read_text()
    found = re.findall(r"^([a-z0-9-]+)(?:\[(.*)\])?==", text, re.MULTILINE)
    return {name: set(extras.split(",")) - {""} for name, extras in found}


def test_every_dependency_is_locked() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = [*project["dependencies"], *(d for group in project["optional-dependencies"].values() for d in group)]
    names = {re.split(r"[<>=!~; \[]", requirement)[0].lower() for requirement in wanted}
    assert names <= locked_extras().keys()


def test_extras_that_packages_ask_for_are_locked_with_them() -> None:
    """Else a pip of Python 3.12's age takes the newest release of such a package, which has no hash in the lock."""
    extras = locked_extras()
    checked = 0
    for name in extras:
        try:
            needed = [Requirement(line) for line in importlib.metadata.requires(name) or ()]
        except importlib.metadata.PackageNotFoundError:  # for another system
            continue
        for other in needed:
            if other.extras and (other.marker is None or other.marker.evaluate({"extra": ""})):
                assert set(other.extras) <= extras[other.name], f"{name} needs {other}"
                checked += 1
    assert checked, "no package asks for extras, so nothing was checked: pytest-cov did"


def test_no_file_names_a_registry() -> None:
    words = re.compile("|".join(("index" + "-url", "find" + "-links", "pypi" + r"\.org", "files" + r"\.pythonhosted")))
    folders = ("meshes", "forward", "calibrate", "studies", "tests", "benchmarks", "docs", "docker", ".ci")
    files = [p for folder in folders for p in (ROOT / folder).rglob("*") if p.is_file() and p.suffix != ".pyc"]
    files += [ROOT / name for name in ("Makefile", "README.md", "pyproject.toml", "requirements.lock", "CITATION.cff")]
    found = [str(path) for path in files if path.exists() and words.search(path.read_text(errors="ignore"))]
    assert found == []


def test_make_names_its_commands() -> None:
    done = subprocess.run(["make", "help"], cwd=ROOT, capture_output=True, text=True, check=True)
    for name in ("setup", "study", "quick", "test", "lint"):
        assert f"make {name} " in done.stdout


def test_every_package_is_installed() -> None:
    """An installation that is not editable holds what `pyproject.toml` names, and nothing else."""
    from setuptools import find_namespace_packages

    rules = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]["find"]
    found = find_namespace_packages(str(ROOT), include=rules["include"])
    modules = [p for top in ("meshes", "forward", "calibrate", "studies") for p in (ROOT / top).rglob("*.py")]
    assert {".".join(p.parent.relative_to(ROOT).parts) for p in modules} <= set(found)


def test_every_file_that_is_read_at_run_time_is_packaged() -> None:
    """What is no module but lies in a package must be matched by its package data, or an installed copy lacks it."""
    packaged = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    for package in ("meshes", "forward", "calibrate", "studies"):
        root = ROOT / package
        there = {p for p in root.rglob("*") if p.is_file() and p.suffix != ".py" and "__pycache__" not in p.parts}
        matched = {p for pattern in packaged.get(package, []) for p in root.glob(pattern)}
        assert there <= matched, f"not packaged: {sorted(str(p.relative_to(ROOT)) for p in there - matched)}"
