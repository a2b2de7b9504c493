"""Compiled code is kept between commands, old code is forgotten, and a folder that cannot be written stops nothing."""

from __future__ import annotations

import os
import subprocess
import sys

from studies.commandline import compiled_code

SQUARE = """
from pathlib import Path
from studies.commandline import compiled_code
assert compiled_code.keep(Path(r"{folder}"))
import jax
print(jax.jit(lambda x: x @ x + 1)(jax.numpy.ones((3, 3)))[0, 0])
"""


def run(folder):
    """A command that compiles one function; the files of compiled code that are there after it."""
    own = {k: v for k, v in os.environ.items() if k != compiled_code.VARIABLE} | {compiled_code.LEAST: "0"}
    done = subprocess.run([sys.executable, "-c", SQUARE.format(folder=folder)], env=own, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "4.0"
    return {path.name for path in folder.iterdir() if not path.name.endswith("-atime")}


def test_a_second_command_compiles_nothing_and_old_code_is_forgotten(tmp_path):
    first = run(tmp_path)
    assert first and run(tmp_path) == first
    for path in tmp_path.iterdir():
        os.utime(path, (0, 0))
    (tmp_path / "old").touch()
    os.utime(tmp_path / "old", (0, 0))
    assert run(tmp_path) == first


def test_a_folder_of_the_user_is_kept_and_one_that_cannot_be_is_done_without(tmp_path, monkeypatch):
    monkeypatch.setenv(compiled_code.VARIABLE, "mine")
    assert compiled_code.keep(tmp_path / "other") and os.environ[compiled_code.VARIABLE] == "mine"
    assert not (tmp_path / "other").exists()
    monkeypatch.delenv(compiled_code.VARIABLE)
    (tmp_path / "file").touch()
    assert not compiled_code.keep(tmp_path / "file") and compiled_code.VARIABLE not in os.environ
