"""Compiled forms: a process killed while it compiles must not stop those after it."""

import fcntl
from pathlib import Path

import pytest

from forward.compilation import FOLDER, JIT_OPTIONS, compilation
from forward.errors import FormsCacheError


@pytest.fixture
def folder(tmp_path):
    """A finished form, one that was claimed, one whose claim was removed, and a library."""
    for name in ("done.c", "done.c.cached", "claimed.c", "lost.c.cached", "lost.o", "element.so"):
        (tmp_path / name).touch()
    return tmp_path


def names(folder):
    return {path.name for path in folder.iterdir()} - {"lock"}


def test_unfinished_forms_are_removed(folder):
    with compilation(folder):
        assert names(folder) == {"done.c", "done.c.cached", "lost.o", "element.so"}


def test_forms_of_a_process_that_compiles_stay(folder):
    """Another process holds the shared lock; what it claims is its own."""
    before = names(folder)
    with open(folder / "lock", "a") as other:
        fcntl.flock(other, fcntl.LOCK_SH)
        with compilation(folder):
            assert names(folder) == before
    with compilation(folder):
        assert "claimed.c" not in names(folder)


def test_a_form_that_does_not_come_is_a_named_error(tmp_path):
    with pytest.raises(FormsCacheError, match=str(tmp_path)), compilation(tmp_path):
        raise TimeoutError


def test_a_folder_that_cannot_be_written_is_a_named_error(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(FormsCacheError, match=str(tmp_path)), compilation(tmp_path / "file" / "forms"):
        pass


def test_forms_are_kept_in_a_folder_of_our_own():
    """Another program's unfinished forms are not ours to remove."""
    assert FOLDER.parts[-2:] == ("equigap", "forms")
    assert JIT_OPTIONS["cache_dir"] == FOLDER


def test_forms_are_compiled_by_what_holds_the_lock():
    """Without it another process removes the source of a form under the compiler. It happens once in many runs."""
    root = Path(__file__).parents[2]
    files = [path for folder in ("forward", "studies", "tests", "benchmarks") for path in (root / folder).rglob("*.py")]
    users = {path.name for path in files if path != Path(__file__) and "jit_options=" in path.read_text()}
    assert users == {"compilation.py"}
