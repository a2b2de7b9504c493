"""Experiment: what it refuses, and that its file keeps everything."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from small_sheet import stretched

from calibrate import errors
from calibrate.data.experiment import Experiment, LoadedBoundary, Noise
from calibrate.data.triangulation import boundary_nodes, signed_areas
from studies.reports.experiments.experiment_findings import imbalance


def test_good_data_pass_and_know_their_unit():
    sheet = stretched()
    assert sheet.n_increments == 3
    assert sheet.stress_unit == "MPa"
    assert replace(sheet, thickness=None).stress_unit == "N/mm"
    assert signed_areas(sheet.points, sheet.triangles).sum() == pytest.approx(10.0 * 8.0)
    assert boundary_nodes(sheet.triangles).size == 2 * (6 + 5) - 4


@pytest.mark.parametrize("missing", [(), ("thickness",), ("time",), ("noise",), ("thickness", "time", "noise")])
def test_file_keeps_everything(tmp_path, missing):
    sheet = stretched(**dict.fromkeys(missing))
    sheet.save(tmp_path / "deep" / "sheet.npz")
    again = Experiment.load(tmp_path / "deep" / "sheet.npz")
    for key in ("points", "triangles", "displacements", "free_nodes"):
        np.testing.assert_array_equal(getattr(again, key), getattr(sheet, key))
    for key in ("name", "thickness", "noise", "provenance"):
        assert getattr(again, key) == getattr(sheet, key)
    assert (again.time is None) == (sheet.time is None)
    for a, b in zip(again.loaded, sheet.loaded, strict=True):
        assert a.name == b.name
        np.testing.assert_array_equal(a.force, b.force)
    assert list(tmp_path.joinpath("deep").iterdir()) == [tmp_path / "deep" / "sheet.npz"]


def test_select_keeps_the_chosen_increments():
    chosen = stretched().select([0, 2])
    assert chosen.time.tolist() == [1.0, 3.0]
    assert chosen.loaded[1].force[:, 1].tolist() == [1.0, 3.0]


def test_forces_that_do_not_balance_are_seen():
    force = np.array([[0.1, 1.0], [0.0, 2.0], [0.0, 3.0]])
    bottom, top = stretched().loaded

    def pulled(share, **changes):
        loaded = (replace(bottom, force=-force), replace(top, force=share * force))
        return stretched(loaded=loaded, noise=Noise(0.01, 1.0, 1e-3), **changes)

    assert pulled(1.0).force_imbalance[0] == 0
    found, noise = pulled(1.1).force_imbalance
    assert found == pytest.approx(0.1 / 1.1)
    assert noise == pytest.approx(1e-3 * np.hypot(1, 1.1) / 1.1)
    assert stretched().force_imbalance is None  # one component was not measured
    assert pulled(1.1, free_nodes=np.array([], int)).force_imbalance is None  # the rim may carry the rest
    assert imbalance(pulled(1.0)) is None
    assert imbalance(pulled(1.1)).data["share"] == pytest.approx(0.1 / 1.1)


def test_no_such_file(tmp_path):
    with pytest.raises(errors.DataNotFoundError, match="no such file"):
        Experiment.load(tmp_path / "nothing.npz")


# NumPy leaves a damaged archive open until it is collected
def test_other_files_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    path.write_text("no archive")
    with pytest.raises(errors.FileFormatError, match="not a readable Experiment"):
        Experiment.load(path)
    np.savez(path, points=np.zeros((3, 2)))
    with pytest.raises(errors.FileFormatError, match="not an Experiment"):
        Experiment.load(path)
    stretched().save(path)
    path.write_bytes(path.read_bytes()[:-400])
    with pytest.raises(errors.FileFormatError, match="not a readable Experiment"):
        Experiment.load(path)


def test_other_versions_and_missing_arrays_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    stretched().save(path)
    with np.load(path) as data:
        content = {key: data[key] for key in data.files}
    np.savez(path, **{**content, "version": 4})
    with pytest.raises(errors.FileFormatError, match="version 4, this program reads 1 to 3"):
        Experiment.load(path)
    for garbled, message in (
        ({"version": "new"}, "version new"),
        ({"provenance": "{"}, "an array is garbled"),
        ({"noise": ["a", "b"]}, "an array is garbled"),
    ):
        np.savez(path, **{**content, **garbled})
        with pytest.raises(errors.FileFormatError, match=message):
            Experiment.load(path)
    np.savez(path, **{key: value for key, value in content.items() if key != "version"})
    with pytest.raises(errors.FileFormatError, match="version None"):
        Experiment.load(path)
    del content["displacements"]
    np.savez(path, **content)
    with pytest.raises(errors.FileFormatError, match="displacements"):
        Experiment.load(path)
    assert json.loads(str(content["provenance"])) == {"source": "test"}


def test_mesh_and_data_that_do_not_match():
    sheet = stretched()
    cases = {
        "displacements": sheet.displacements[:, :-1],
        "time": np.array([1.0, 2.0]),
        "triangles": sheet.triangles + 1,
        "free_nodes": np.array([8]),
        "loaded": (LoadedBoundary("top", sheet.loaded[1].nodes, np.ones((2, 2))),),
    }
    for key, value in cases.items():
        with pytest.raises(errors.MeshMismatchError):
            replace(sheet, **{key: value})
    with pytest.raises(errors.MeshMismatchError, match="inside the specimen"):
        replace(sheet, loaded=(LoadedBoundary("top", np.array([7, 8]), sheet.loaded[1].force),))


def test_inverted_triangles():
    sheet = stretched()
    triangles = sheet.triangles.copy()
    triangles[3] = triangles[3, ::-1]
    with pytest.raises(errors.DegenerateMeshError, match="inverted triangles: 1 \\(first: 3\\)"):
        replace(sheet, triangles=triangles)
    with pytest.raises(errors.DegenerateMeshError, match="flip y"):
        replace(sheet, points=sheet.points * [1, -1])


def test_duplicate_flat_and_unused_nodes():
    sheet = stretched()
    points = np.concatenate([sheet.points, sheet.points[:1]])
    u = np.concatenate([sheet.displacements, sheet.displacements[:, :1]], axis=1)
    with pytest.raises(errors.DegenerateMeshError, match="belong to no triangle"):
        replace(sheet, points=np.concatenate([sheet.points, [[30.0, 30.0]]]), displacements=u)
    triangles = sheet.triangles.copy()
    triangles[triangles == 0] = len(points) - 1
    # node 0 stays in one triangle, its copy is in another
    split = np.concatenate([sheet.triangles[:1], triangles[1:]])
    with pytest.raises(errors.DegenerateMeshError, match="duplicate nodes"):
        replace(sheet, points=points, displacements=u, triangles=split)
    with pytest.raises(errors.DegenerateMeshError, match="without area"):
        replace(sheet, triangles=np.concatenate([sheet.triangles, [[0, 1, 2]]]))
    with pytest.raises(errors.DegenerateMeshError, match="not finite"):
        replace(sheet, points=np.where(np.arange(30)[:, None] == 4, np.nan, sheet.points))


def test_det_F_not_positive():
    sheet = stretched()
    u = sheet.displacements.copy()
    u[1, 14] += [9.0, 0.0]
    with pytest.raises(errors.InvalidDeformationError, match="increment 1: det F <= 0"):
        replace(sheet, displacements=u)


def test_failed_points_must_be_masked_first():
    u = stretched().displacements.copy()
    u[2, 9, 0] = np.nan
    with pytest.raises(errors.InvalidDeformationError, match="drop_points"):
        stretched(displacements=u)


@pytest.mark.parametrize("time", [[1.0, 3.0, 2.0], [1.0, 1.0, 2.0], [1.0, np.nan, 2.0]])
def test_time_must_increase(time):
    with pytest.raises(errors.TimeError, match="time does not increase"):
        stretched(time=np.array(time))


def test_time_counts_from_the_start_of_loading():
    with pytest.raises(errors.TimeError, match="begins at -1 s; count it from the start of loading"):
        stretched(time=np.array([-1.0, 1.0, 2.0]))
    assert stretched(time=np.array([0.0, 1.0, 2.0])).time[0] == 0.0


def test_missing_and_infinite_force():
    sheet = stretched()
    nothing = tuple(LoadedBoundary(b.name, b.nodes, np.full((3, 2), np.nan)) for b in sheet.loaded)
    with pytest.raises(errors.MissingForceError, match="load-cell record"):
        replace(sheet, loaded=nothing)
    with pytest.raises(errors.MissingForceError, match="load-cell record"):
        replace(sheet, loaded=())
    infinite = (replace(sheet.loaded[0], force=np.full((3, 2), np.inf)), sheet.loaded[1])
    with pytest.raises(errors.MissingForceError, match="infinite"):
        replace(sheet, loaded=infinite)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (lambda s: {"points": s.points * 1e-3, "displacements": s.displacements * 1e-3}, "points must be in mm"),
        (lambda s: {"points": s.points * 1e4, "displacements": s.displacements * 1e4}, "points must be in mm"),
        (lambda s: {"displacements": s.displacements + 1e4}, "not pixels"),
        (lambda s: {"displacements": s.displacements * 1e-8}, "not m"),
        (lambda s: {"thickness": 1e-6}, "thickness"),
        (lambda s: {"thickness": 100.0}, "thickness"),
        (lambda s: {"loaded": tuple(replace(b, force=1e6 * b.force) for b in s.loaded)}, "not kN or mN"),
        (lambda s: {"loaded": tuple(replace(b, force=1e-9 * b.force) for b in s.loaded)}, "not kN or mN"),
    ],
)
def test_implausible_units(changes, message):
    sheet = stretched()
    with pytest.raises(errors.UnitsError, match=message):
        replace(sheet, **changes(sheet))


def test_shared_nodes_and_bad_noise():
    sheet = stretched()
    with pytest.raises(errors.ExperimentError, match="shares nodes"):
        replace(sheet, loaded=(sheet.loaded[0], replace(sheet.loaded[1], nodes=sheet.loaded[0].nodes)))
    with pytest.raises(errors.ExperimentError, match="both loaded and free"):
        replace(sheet, free_nodes=sheet.loaded[0].nodes)
    with pytest.raises(errors.ExperimentError, match="displacement_std"):
        Noise(-1.0)
    with pytest.raises(errors.ExperimentError, match="correlation_length"):
        Noise(1.0, float("nan"))


def test_content_that_fails_a_check_names_the_file(tmp_path):
    path = tmp_path / "sheet.npz"
    stretched().save(path)
    with np.load(path) as data:
        content = dict(data)
    content["displacements"][0, 0, 0] = np.nan
    np.savez(path, **content)
    with pytest.raises(errors.EquigapError, match=r"sheet\.npz: .*displacement"):
        Experiment.load(path)
    path.write_bytes(b"{}")
    with pytest.raises(errors.FileFormatError, match="not a readable Experiment") as raised:
        Experiment.load(path)
    assert "pickle" not in str(raised.value)
