"""Manifest: how a figure, table or model came about, as NAME.json beside it.

In: seed, settings and input files of a run. Out: command, versions, hashes of the inputs, revision, times.
"""

from __future__ import annotations

import hashlib
import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

from studies.output.writing import write_json

PACKAGES = (
    "equigap", "numpy", "scipy", "jax", "jaxlib", "gmsh", "matplotlib", "fenics-dolfinx", "dolfinx-solver-real",
    "fenics-ffcx", "pypardiso", "snakemake",
)  # fmt: skip


@dataclass
class Manifest:
    """Record of one run. seed: number or numbers the random draws start from, None where there are none.

    inputs: files that were read; their SHA-256 is stored. settings: whatever reproduces the run, free JSON.
    """

    seed: int | list[int] | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    inputs: Iterable[str | Path] = ()
    started: float = field(default_factory=time.time)

    def to_dict(self) -> dict[str, Any]:
        """What is written: command, settings, digests of the inputs, versions, revision, date and duration, s."""
        now = time.time()
        return {
            "format": "equigap-manifest",
            "version": 1,
            "command": command_line(),
            "seed": self.seed,
            "settings": dict(self.settings),
            "inputs": {str(path): file_hash(path) for path in self.inputs},
            "versions": versions(),
            "revision": revision(),
            "written": datetime.fromtimestamp(now, UTC).isoformat(timespec="seconds"),
            "wall_seconds": round(now - self.started, 2),
        }

    @property
    def read_files(self) -> list[str]:
        """'NAME SHA-256' of every input: what a run is known by, wherever its files lie."""
        return [f"{Path(path).name} {file_hash(path)}" for path in self.inputs]

    def beside(self, *outputs: str | Path, **results: Any) -> Path:
        """Write NAME.json beside `outputs` (named after the first) and return its path.

        results: numbers that belong to the outputs. Raises `OutputWriteError`.
        """
        path = Path(outputs[0]).with_suffix(".json")
        if path in map(Path, outputs):
            path = path.with_suffix(".manifest.json")
        hashes = {Path(output).name: file_hash(output) for output in outputs}
        write_json(path, {**self.to_dict(), "outputs": hashes, "results": results})
        return path


def command_line() -> list[str]:
    """The command as typed, without the folder the program lies in."""
    return [Path(sys.argv[0]).name or "python", *sys.argv[1:]]


def file_hash(path: str | Path) -> str | None:
    """SHA-256 of a file; None if it cannot be read."""
    try:
        return sha256_of(path)
    except OSError:
        return None


def sha256_of(path: str | Path) -> str:
    """SHA-256 of a file. Raises `OSError`."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@cache
def versions() -> dict[str, str]:
    """Versions of Python and of the packages results depend on; what is not installed is left out."""
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


@cache
def source_hash() -> str:
    """Hash of all files of the packages, code and tables."""
    digest, root = hashlib.sha256(), Path(__file__).resolve().parents[2]
    for package in ("meshes", "forward", "calibrate", "studies"):
        for path in sorted((root / package).rglob("*")):
            if path.is_file() and "__pycache__" not in path.parts:
                digest.update(path.read_bytes())
    return digest.hexdigest()


def made_by() -> dict[str, str]:
    """Source and versions of packages, by which results of other code are told."""
    return {**versions(), "source": source_hash()}


@cache
def revision() -> str | None:
    """Revision of the source, with '+changes' where files differ from it; outside a working copy
    what EQUIGAP_REVISION says, or None."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return os.environ.get("EQUIGAP_REVISION")  # of the source that a container was built from
    try:
        head = _git(root, "rev-parse", "HEAD")
        changes = _git(root, "status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.SubprocessError):
        return None
    return head + ("+changes" if changes else "")


def _git(root: Path, *arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, timeout=10, check=True)
    return done.stdout.strip()
