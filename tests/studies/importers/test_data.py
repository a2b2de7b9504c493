"""Measured data: where they are found, and that the published sheets are what they were."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pooch
import pytest
from sheets import DATA, needs_data, write, write_frames

from calibrate import errors
from studies.commands import import_data
from studies.importers import measured_data, printed_sheets
from studies.output.manifest import file_hash


@pytest.fixture
def folder(tmp_path) -> Path:
    """Frames and machine record of a small sheet."""
    return write_frames(tmp_path)


@pytest.fixture
def nowhere(tmp_path, monkeypatch) -> Path:
    """No EQUIGAP_DATA, an empty cache."""
    monkeypatch.delenv(measured_data.VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path


def offline(address: str, digest: str | None, path: Path) -> None:
    raise OSError("no network")


def serving(content: Callable[[str], bytes]) -> measured_data.Fetch:
    """Stands for the network: pooch copies the bytes of an address and checks them."""

    def fetch(address: str, digest: str | None, path: Path) -> None:
        def copy(url: str, file: str, mover: object) -> None:
            Path(file).write_bytes(content(url))

        pooch.retrieve(address, digest and f"sha256:{digest}", path.name, path.parent, downloader=copy)

    return fetch


def test_data_folder_wins(nowhere, monkeypatch):
    write(nowhere / "mine" / "a" / "b.csv", "x")
    monkeypatch.setenv(measured_data.VARIABLE, str(nowhere / "mine"))
    assert measured_data.find("a/b.csv", offline) == nowhere / "mine" / "a" / "b.csv"
    monkeypatch.setenv(measured_data.VARIABLE, str(nowhere / "nothing"))
    with pytest.raises(errors.DataNotFoundError, match=r"names .*nothing, which is no folder"):
        measured_data.find("a/b.csv")


def test_absent_data_say_what_to_put_where(nowhere):
    relative = next(iter(measured_data.FILES))
    with pytest.raises(errors.DataNotFoundError, match=r"treloar_0.csv not found .*no network.*set EQUIGAP_DATA"):
        measured_data.find(relative, offline)
    with pytest.raises(errors.DataNotFoundError, match="no public source in this form"):
        measured_data.find("kawabata_jl/kawabata1981_biaxial.csv", offline)
    with pytest.raises(errors.DataNotFoundError, match=r"Soft_Homo.npz not found .*fetching its frames"):
        measured_data.sheet("Soft_Homo", offline)
    with pytest.raises(errors.ConfigError, match="sheet 'Soft' unknown"):
        measured_data.sheet("Soft")


def test_fetched_file_is_checked_and_kept(nowhere, monkeypatch):
    content, relative = b"1.0, 0.0\n", "some/file.csv"
    address = ("https://example.org/file.csv", hashlib.sha256(content).hexdigest())
    monkeypatch.setitem(measured_data.FILES, relative, address)
    with pytest.raises(errors.DataNotFoundError, match="has changed"):
        measured_data.find(relative, serving(lambda a: b"something else"))
    assert not list((nowhere / "cache").rglob("*.csv"))
    assert measured_data.find(relative, serving(lambda a: content)).read_bytes() == content
    assert measured_data.find(relative, offline) == nowhere / "cache" / "equigap" / relative


def test_fetched_sheet_is_packed_and_checked(nowhere, folder, monkeypatch):
    record = (folder / "force_disp.txt").read_bytes()
    frames = printed_sheets.read_frames(folder)
    digest = measured_data.displacement_digest(frames.displacements.astype(np.float32))
    monkeypatch.setitem(
        measured_data.SHEETS, "Sheet", measured_data.Sheet(12, digest, hashlib.sha256(record).hexdigest())
    )

    def served(address: str) -> bytes:
        name = address.rsplit("/", 1)[1].replace("Sheet_Final", "Sheet")
        return record if name == "force_disp.csv" else (folder / name).read_bytes()

    again, kept = printed_sheets.read_packed(measured_data.sheet("Sheet", serving(served)))
    np.testing.assert_allclose(again.displacements, frames.displacements, atol=1e-5)
    assert kept.force[0] == pytest.approx(0.1)
    assert measured_data.sheet("Sheet", offline).is_file()
    for displacements, force in (("0", hashlib.sha256(record).hexdigest()), (digest, "0" * 64)):
        monkeypatch.setitem(measured_data.SHEETS, "Sheet2", measured_data.Sheet(12, displacements, force))
        with pytest.raises(errors.DataNotFoundError, match=r"checksums differ|does not match"):
            measured_data.sheet("Sheet2", serving(lambda a: served(a.replace("Sheet2", "Sheet"))))


@needs_data
def test_published_frames_match_the_packed_sheet():
    root = Path(str(DATA), "printed_elastomer_dic")
    frames, _ = printed_sheets.read_packed(root / "Soft_Homo.npz")
    files = printed_sheets.frame_files(root / "raw_sample")
    assert [p.name[-8:-4] for p in files] == ["0001", "0100", "0189"]
    for path in files:
        raw = printed_sheets.read_frame(path).astype(np.float32)
        np.testing.assert_array_equal(raw[:, :2], frames.points)
        np.testing.assert_array_equal(raw[:, 2:], frames.displacements[int(path.name[-8:-4]) - 1])


@needs_data
@pytest.mark.parametrize("name", list(measured_data.SHEETS))
def test_published_sheets(name):
    root = Path(str(DATA), "printed_elastomer_dic")
    frames, record = printed_sheets.read_packed(measured_data.sheet(name))
    u = frames.displacements.astype(np.float32)
    assert (len(u), measured_data.displacement_digest(u)) == (
        measured_data.SHEETS[name].frames,
        measured_data.SHEETS[name].displacements,
    )
    again = printed_sheets.read_record(root / f"{name}_force_disp.csv")
    assert file_hash(root / f"{name}_force_disp.csv") == measured_data.SHEETS[name].record
    np.testing.assert_array_equal(again.force, record.force)
    e = import_data.import_experiment(name)
    assert e.n_increments == len(u) - 1  # every frame but the reference
    assert len(e.record.time) == len(record.time)
    assert e.is_synchronised and e.record.crosshead is not None
    assert e.thickness is None
    np.testing.assert_allclose(np.ptp(e.points, axis=0), [41.73, 36.76], atol=0.01)
    top, bottom = e.displacements[-1, e.loaded[1].nodes, 1], e.displacements[-1, e.loaded[0].nodes, 1]
    assert top.mean() > 10
    assert 0 < bottom.mean() < 0.1 * top.mean()
    assert (np.diff(e.loaded[1].force[:, 1]) > 0).all()
    assert e.loaded[1].force[-1, 1] > 15
    # between what changes from frame to frame (0.5 um) and 1 % of the largest displacement
    assert 0.005 < e.noise.displacement_std < 0.02
    assert 0.5 < e.noise.correlation_length < 1.0
    assert 4e-4 < e.provenance["noise"]["temporal"]["std"] < 8e-4
