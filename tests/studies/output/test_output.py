"""Files are written whole or not at all, records tell how they came about, folders are never lost silently."""

from __future__ import annotations

import errno
import io
import json
import os
import stat
from pathlib import Path

import numpy as np
import pytest

from studies.errors import OutputFolderError, OutputWriteError
from studies.output import (
    Manifest,
    Progress,
    atomic_path,
    callback,
    open_output_folder,
    track,
    write_csv,
    write_json,
    write_npz,
    write_text,
    writing,
)
from studies.output import folder as folders
from studies.output import manifest as manifests
from studies.output import progress as progresses


def test_text_replaces_the_file_and_leaves_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.txt"
    write_text(path, "one")
    write_text(path, "two, µm")
    assert path.read_text(encoding="utf-8") == "two, µm"
    assert os.listdir(path.parent) == ["a.txt"]


def test_an_interrupted_write_keeps_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old")
    with pytest.raises(KeyboardInterrupt), atomic_path(path) as temporary:
        temporary.write_text("ne")
        raise KeyboardInterrupt
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_files_are_readable_as_the_user_wants(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_text(tmp_path / "a.txt", "x")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == 0o640


def test_a_full_disk_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: Path, content: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OutputWriteError, match="No space left"):
        write_text(tmp_path / "a.txt", "x")
    assert os.listdir(tmp_path) == []


def test_an_unwritable_place_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputWriteError, match="file/a.txt.*--output"):
        write_text(tmp_path / "file" / "a.txt", "x")


def test_json_takes_arrays_and_refuses_nan(tmp_path: Path) -> None:
    write_json(
        tmp_path / "a.json", {"a": np.arange(2), "b": [np.nan, np.float64(1.5)], "c": Path("x"), "d": np.int8(1)}
    )
    content = json.loads((tmp_path / "a.json").read_text(), parse_constant=lambda name: pytest.fail(name))
    assert content == {"a": [0, 1], "b": [None, 1.5], "c": "x", "d": 1}


def test_npz_and_csv_return_what_was_written(tmp_path: Path) -> None:
    write_npz(tmp_path / "a.npz", x=np.eye(2))
    assert np.array_equal(np.load(tmp_path / "a.npz")["x"], np.eye(2))
    write_csv(tmp_path / "a.csv", ["x", "a, b"], [[0.1, "t"], [None, 2]], ["in mm"])
    assert (tmp_path / "a.csv").read_text() == '# in mm\nx,"a, b"\n0.1,t\n,2\n'


class TestManifest:
    def test_tells_how_an_output_came_about(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("sys.argv", ["/some/where/equigap", "predict", "m.json"])
        (tmp_path / "in.txt").write_text("abc")
        write_text(tmp_path / "curve.csv", "1")
        record = Manifest(seed=3, settings={"a": 1}, inputs=[tmp_path / "in.txt"])
        path = record.beside(tmp_path / "curve.csv", bias=0.5)
        content = json.loads(path.read_text())
        assert path == tmp_path / "curve.json"
        assert content["command"] == ["equigap", "predict", "m.json"]
        assert content["seed"] == 3
        assert content["settings"] == {"a": 1}
        # SHA-256 of "abc", FIPS 180-2, appendix B.1
        assert content["inputs"][str(tmp_path / "in.txt")].startswith("ba7816bf8f01cfea414140de5dae2223")
        assert content["results"] == {"bias": 0.5}
        assert {"python", "equigap", "numpy", "jax"} <= set(content["versions"])
        assert content["wall_seconds"] >= 0

    def test_does_not_overwrite_an_output_of_the_same_name(self, tmp_path: Path) -> None:
        write_text(tmp_path / "model.json", "{}")
        path = Manifest().beside(tmp_path / "model.json")
        assert path.name == "model.manifest.json"
        assert (tmp_path / "model.json").read_text() == "{}"

    def test_works_without_git(self, monkeypatch: pytest.MonkeyPatch) -> None:
        manifests.revision.cache_clear()
        monkeypatch.setenv("PATH", "")
        try:
            assert manifests.revision() is None
        finally:
            manifests.revision.cache_clear()


class TestFolder:
    def test_is_made_and_resumed(self, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
        target = tmp_path / "a" / "b"
        assert open_output_folder(target, False, {"seeds": (0, 1)}) == target
        (target / "done.txt").write_text("x")
        open_output_folder(target, False, {"seeds": [0, 1]})
        assert (target / "done.txt").exists()
        assert "going on in" in capsys.readouterr().err

    def test_with_other_settings_is_refused_and_names_them(self, tmp_path: Path) -> None:
        open_output_folder(tmp_path / "a", False, {"seeds": 10, "nodes": 5})
        with pytest.raises(OutputFolderError, match=r"seeds: 10.*--overwrite"):
            open_output_folder(tmp_path / "a", False, {"seeds": 20, "nodes": 5})

    def test_names_of_a_list_what_is_other(self, tmp_path: Path) -> None:
        """As the one file that was edited, of several that were read."""
        open_output_folder(tmp_path / "a", False, {"files": ["test.npz " + 64 * "0", "priors.toml 1111"]})
        with pytest.raises(OutputFolderError, match=r'files: \["priors.toml 1111"\] there, \["priors.toml 2222"\] now'):
            open_output_folder(tmp_path / "a", False, {"files": ["test.npz " + 64 * "0", "priors.toml 2222"]})

    def test_of_a_run_that_was_refused_before_it_made_anything_is_free(self, tmp_path: Path) -> None:
        target = open_output_folder(tmp_path / "a", False, {"hold_out": "every:100"})
        with pytest.raises(ValueError, match="nothing"), folders.released_if_refused(target):
            raise ValueError("holds out nothing")
        target = open_output_folder(tmp_path / "a", False, {"hold_out": "every:3"})
        assert json.loads((target / folders.RUN_FILE).read_text())["settings"] == {"hold_out": "every:3"}
        (target / "made.csv").write_text("")
        with pytest.raises(ValueError, match="late"), folders.released_if_refused(target):
            raise ValueError("late")
        assert (target / folders.RUN_FILE).exists()

    def test_is_emptied_on_request(self, tmp_path: Path) -> None:
        target = open_output_folder(tmp_path / "a", False, {"n": 1})
        (target / "sub").mkdir()
        (target / "sub" / "old").write_text("")
        outside = tmp_path / "kept"
        outside.mkdir()
        (outside / "file").write_text("")
        (target / "link").symlink_to(outside)
        open_output_folder(target, True, {"n": 2})
        assert os.listdir(target) == [folders.RUN_FILE]
        assert (outside / "file").exists()
        open_output_folder(target, False, {"n": 2})

    @pytest.mark.parametrize("overwrite", [False, True])
    @pytest.mark.parametrize("run_file", [None, "not json", '{"format": "other"}', "[]"])
    def test_of_someone_else_is_left_alone(self, tmp_path: Path, overwrite: bool, run_file: str | None) -> None:
        (tmp_path / "thesis.tex").write_text("x")
        if run_file is not None:
            (tmp_path / folders.RUN_FILE).write_text(run_file)
        with pytest.raises(OutputFolderError):
            open_output_folder(tmp_path, overwrite, {})
        assert (tmp_path / "thesis.tex").exists()

    def test_that_is_a_file_is_refused(self, tmp_path: Path) -> None:
        (tmp_path / "a").write_text("")
        with pytest.raises(OutputFolderError, match="file"):
            open_output_folder(tmp_path / "a", True, {})

    def test_that_cannot_be_made_is_named(self, tmp_path: Path) -> None:
        (tmp_path / "a").write_text("")
        with pytest.raises(OutputWriteError, match="--output"):
            open_output_folder(tmp_path / "a" / "b", False, {})

    def test_keys_do_not_depend_on_order_or_kind_of_list(self) -> None:
        assert folders.key_hash({"a": (1,), "b": 2.0}) == folders.key_hash({"b": 2.0, "a": [1]})
        assert folders.key_hash({"a": 1}) != folders.key_hash({"a": 2})


class TestProgress:
    def test_is_silent_in_logs_for_short_work(self) -> None:
        stream = io.StringIO()
        with Progress("short", 3, stream=stream) as progress:
            progress.update(3)
        assert stream.getvalue() == ""

    def test_writes_lines_to_logs_for_long_work(self, monkeypatch: pytest.MonkeyPatch) -> None:
        clock = iter(range(0, 1000, 15))
        monkeypatch.setattr(progresses.time, "monotonic", lambda: next(clock))
        stream = io.StringIO()
        with Progress("long", 3, "cases", stream=stream) as progress:
            progress.to(1)
            progress.to(2)
            progress.to(3)
        lines = stream.getvalue().splitlines()
        assert lines[0].startswith("long: 2/3 cases")
        assert lines[-1].startswith("long: 3/3 cases")

    def test_is_a_bar_on_a_terminal(self) -> None:
        class Terminal(io.StringIO):
            def isatty(self) -> bool:
                return True

        stream = Terminal()
        with Progress("bar", None, "cases", stream=stream) as progress:
            progress.to(2, 4)
        assert "bar" in stream.getvalue()
        assert "2/4" in stream.getvalue()

    def test_passes_items_and_counts_through(self) -> None:
        assert list(track([1, 2], "items")) == [1, 2]
        show = callback("steps")
        for done in (1, 2, 2):
            show(done, 2)


def test_write_error_passes_named_errors_on() -> None:
    error = OutputWriteError("x")
    assert writing.write_error("a", error) is error
