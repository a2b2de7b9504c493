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


def test_noise_that_is_common_to_the_increments_is_kept(tmp_path):
    """Also by a subset without the largest deformation, whose displacements have the same covariance."""
    whole = stretched(noise=Noise(0.01, 1.0, 1e-3, 0.0, 0.04, 0.02))
    whole.save(tmp_path / "sheet.npz")
    assert Experiment.load(tmp_path / "sheet.npz").noise == whole.noise
    part = whole.select([0, 1])
    s = whole.deformation_shares
    before, after = whole.noise.common_between(s), part.noise.common_between(part.deformation_shares)
    np.testing.assert_allclose(after, before[:2], rtol=1e-12)
    np.testing.assert_allclose(before @ before.T, 16 * np.outer(s, s) + 4)
    np.testing.assert_allclose(whole.noise.variances(s), 1 + 16 * s**2 + 4)
    assert whole.noise.total_std == pytest.approx(0.01 * np.sqrt(21))
    with pytest.raises(errors.ExperimentError, match="give displacement_std too"):
        Noise(0.0, reference_std=0.01)


def test_a_drift_of_the_noise_is_kept(tmp_path):
    """In s, whatever increments are left; without time in increments, which are counted anew."""
    timed = stretched(noise=Noise(0.01, 1.0, correlation_time=2.5))
    timed.save(tmp_path / "sheet.npz")
    assert Experiment.load(tmp_path / "sheet.npz").noise == timed.noise
    assert timed.select([0, 2]).noise == timed.noise
    between = timed.noise.own_between(timed.clock)
    assert between[0, 2] == pytest.approx(np.exp(-2 / 2.5)) and between[1, 1] == 1
    slow = replace(timed, time=2 * timed.time)
    for same, part in ((slow, slow.without_time()), (slow.without_time(), slow.without_time().select([0, 2]))):
        index = [0, 2] if part.n_increments == 2 else [0, 1, 2]
        expected = same.noise.own_between(same.clock)[np.ix_(index, index)]
        np.testing.assert_allclose(part.noise.own_between(part.clock), expected, rtol=1e-12)


def test_files_without_a_drift_are_as_before(tmp_path):
    for noise, numbers, version in (
        (Noise(0.01), 4, 1),
        (Noise(0.01, pattern_std=0.01), 6, 4),
        (Noise(0.01, correlation_time=1.0), 7, 5),
        (Noise(0.01, 1.0, second_length=2.0, second_share=0.3), 9, 6),
    ):
        stretched(noise=noise).save(tmp_path / "sheet.npz")
        with np.load(tmp_path / "sheet.npz") as data:
            assert data["noise"].shape == (numbers,) and int(data["version"]) == version


def test_the_share_of_the_deformation_does_not_see_rigid_motion():
    still = stretched()
    a = 0.4 * np.arange(1, 4)
    turn = np.moveaxis(np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]), -1, 0)
    places = np.einsum("tij,tnj->tni", turn, still.points + still.displacements) + [3.0, -2.0]
    turned = replace(still, displacements=places - still.points)
    gradients = [
        np.linalg.lstsq(still.points - still.points.mean(axis=0), u, rcond=None)[0] for u in still.displacements
    ]
    sizes = np.linalg.norm(gradients, axis=(1, 2))  # homogeneous
    np.testing.assert_allclose(still.deformation_shares, sizes / sizes.max(), rtol=1e-9)
    np.testing.assert_allclose(turned.deformation_shares, still.deformation_shares, rtol=1e-12)


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
    with pytest.raises(errors.DataNotFoundError, match="nothing.npz"):
        Experiment.load(tmp_path / "nothing.npz")


# NumPy leaves a damaged archive open until it is collected
def test_other_files_are_refused(tmp_path):
    stretched().save(tmp_path / "cut.npz")
    (tmp_path / "cut.npz").write_bytes((tmp_path / "cut.npz").read_bytes()[:-400])
    (tmp_path / "text.npz").write_text("no archive")
    (tmp_path / "json.npz").write_bytes(b"{}")
    np.savez(tmp_path / "arrays.npz", points=np.zeros((3, 2)))
    for name in ("cut.npz", "text.npz", "json.npz", "arrays.npz"):
        with pytest.raises(errors.FileFormatError, match=name) as raised:
            Experiment.load(tmp_path / name)
        assert "pickle" not in str(raised.value)


def test_other_versions_and_missing_arrays_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    stretched().save(path)
    with np.load(path) as data:
        content = {key: data[key] for key in data.files}
    assert json.loads(str(content["provenance"])) == {"source": "test"}
    without = {key: {k: v for k, v in content.items() if k != key} for key in ("version", "displacements")}
    for wrong, key in (
        ({**content, "version": 8}, "version 8"),
        ({**content, "version": "new"}, "version new"),
        ({**content, "provenance": "{"}, "garbled"),
        ({**content, "noise": ["a", "b"]}, "garbled"),
        (without["version"], "'version' is missing"),
        (without["displacements"], "displacements"),
    ):
        np.savez(path, **wrong)
        with pytest.raises(errors.FileFormatError, match=key):
            Experiment.load(path)


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
    with pytest.raises(errors.MeshMismatchError, match="inside"):
        replace(sheet, loaded=(LoadedBoundary("top", np.array([7, 8]), sheet.loaded[1].force),))


def test_inverted_triangles():
    sheet = stretched()
    triangles = sheet.triangles.copy()
    triangles[3] = triangles[3, ::-1]
    with pytest.raises(errors.DegenerateMeshError, match=r"inverted .* at \("):
        replace(sheet, triangles=triangles)
    with pytest.raises(errors.DegenerateMeshError, match="flip y"):
        replace(sheet, points=sheet.points * [1, -1])


def test_duplicate_flat_and_unused_nodes():
    sheet = stretched()
    points = np.concatenate([sheet.points, sheet.points[:1]])
    u = np.concatenate([sheet.displacements, sheet.displacements[:, :1]], axis=1)
    with pytest.raises(errors.DegenerateMeshError, match="no triangle"):
        replace(sheet, points=np.concatenate([sheet.points, [[30.0, 30.0]]]), displacements=u)
    triangles = sheet.triangles.copy()
    triangles[triangles == 0] = len(points) - 1
    # node 0 stays in one triangle, its copy is in another
    split = np.concatenate([sheet.triangles[:1], triangles[1:]])
    with pytest.raises(errors.DegenerateMeshError, match="duplicate"):
        replace(sheet, points=points, displacements=u, triangles=split)
    with pytest.raises(errors.DegenerateMeshError, match="area"):
        replace(sheet, triangles=np.concatenate([sheet.triangles, [[0, 1, 2]]]))
    with pytest.raises(errors.DegenerateMeshError, match="finite"):
        replace(sheet, points=np.where(np.arange(30)[:, None] == 4, np.nan, sheet.points))


def test_det_F_not_positive():
    sheet = stretched()
    u = sheet.displacements.copy()
    u[1, 14] += [9.0, 0.0]
    with pytest.raises(errors.InvalidDeformationError, match="increment 1"):
        replace(sheet, displacements=u)


def test_failed_points_must_be_masked_first():
    u = stretched().displacements.copy()
    u[2, 9, 0] = np.nan
    with pytest.raises(errors.InvalidDeformationError, match="drop_points"):
        stretched(displacements=u)


@pytest.mark.parametrize(
    ("time", "key"),
    [
        ([1.0, 3.0, 2.0], "increase"),
        ([1.0, 1.0, 2.0], "increase"),
        ([1.0, np.nan, 2.0], "increase"),
        ([-1.0, 1.0, 2.0], "-1 s"),
    ],
)
def test_time_increases_from_the_start_of_loading(time, key):
    with pytest.raises(errors.TimeError, match=key):
        stretched(time=np.array(time))
    assert stretched(time=np.array([0.0, 1.0, 2.0])).time[0] == 0.0


def test_missing_and_infinite_force():
    sheet = stretched()
    nothing = tuple(LoadedBoundary(b.name, b.nodes, np.full((3, 2), np.nan)) for b in sheet.loaded)
    infinite = (replace(sheet.loaded[0], force=np.full((3, 2), np.inf)), sheet.loaded[1])
    for loaded, key in ((nothing, "record"), ((), "record"), (infinite, "infinite")):
        with pytest.raises(errors.MissingForceError, match=key):
            replace(sheet, loaded=loaded)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        (lambda s: {"points": s.points * 1e-3, "displacements": s.displacements * 1e-3}, "points"),
        (lambda s: {"points": s.points * 1e4, "displacements": s.displacements * 1e4}, "points"),
        (lambda s: {"displacements": s.displacements + 1e4}, "displacements"),
        (lambda s: {"displacements": s.displacements * 1e-8}, "displacements"),
        (lambda s: {"thickness": 1e-6}, "thickness"),
        (lambda s: {"thickness": 100.0}, "thickness"),
        (lambda s: {"loaded": tuple(replace(b, force=1e6 * b.force) for b in s.loaded)}, "force"),
        (lambda s: {"loaded": tuple(replace(b, force=1e-9 * b.force) for b in s.loaded)}, "force"),
    ],
)
def test_implausible_units(changes, key):
    sheet = stretched()
    with pytest.raises(errors.UnitsError, match=key):
        replace(sheet, **changes(sheet))


def test_shared_nodes_and_bad_noise():
    sheet = stretched()
    with pytest.raises(errors.ExperimentError, match="shares"):
        replace(sheet, loaded=(sheet.loaded[0], replace(sheet.loaded[1], nodes=sheet.loaded[0].nodes)))
    with pytest.raises(errors.ExperimentError, match="free"):
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


def test_relative_and_absolute_errors_of_a_force_are_independent():
    """Their variances add up, as those of two draws do."""
    noise, force = Noise(0.0, force_std_relative=0.02, force_std=0.3), np.array([-20.0, 0.0, 5.0])
    draws = np.random.default_rng(0).normal(size=(2, 100_000, 3))
    error = noise.force_std_relative * np.abs(force) * draws[0] + noise.force_std * draws[1]
    np.testing.assert_allclose(noise.force_deviation(force), error.std(axis=0), rtol=0.01)
