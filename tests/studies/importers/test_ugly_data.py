"""Ugly data: spurious points, masks, inner edges, windows in larger bodies, and what an import says of each; every remedy is followed."""

from __future__ import annotations

import os
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree
from sheets import COLUMNS, MAP, PITCH, ROWS, SCALE, mapped, motion, pixels, write

from calibrate import errors
from calibrate.data.experiment import Experiment
from calibrate.data.triangulation import signed_areas
from studies import cli
from studies.importers import column_import, column_map, importer_of
from studies.importers.column_map import MaskTable
from studies.importers.masking.outliers import outliers
from studies.importers.pad_tracks import PadTest, write_tables
from studies.importers.recording import noise_estimate
from studies.importers.recording.importer import SheetOptions
from studies.importers.recording.notes import noise_notes
from studies.importers.recording.series import to_experiment

SKIN = Path(os.environ.get("EQUIGAP_DATA", "nowhere")) / "sutula_skin_dic" / "monolithic.npz"
STEP = PITCH * SCALE  # mm
EVERYTHING = COLUMNS * ROWS


def from_map(path: Path) -> Experiment:
    m = column_map.read_map(path)
    return to_experiment(column_import.column_series(m, path.parent), m.selection, m.stated_noise)


def said(experiment: Experiment) -> str:
    return " ".join(experiment.provenance["notes"])


def place(column: int, row: int) -> tuple[float, float]:
    """mm of a point, y up."""
    x, y = pixels()[row * COLUMNS + column] * SCALE
    return float(x), -float(y)


def spoil(tmp_path: Path, points, frames=range(3, 12), by="5", column=3) -> None:
    """Write another value into a column of some frames, at points (column, row)."""
    numbers = {row * COLUMNS + at for at, row in points}
    for k in frames:
        path = tmp_path / "frames" / f"f_{k}.csv"
        head, *lines = path.read_text().splitlines()
        fields = [line.split(",") for line in lines]
        for f in fields:
            if int(f[0]) in numbers:
                f[column] = by
        write(path, "\n".join([head, *(",".join(f) for f in fields)]) + "\n")


# --- spurious points --------------------------------------------------------------------------------------------


def field(n=40, seed=0, noise=0.01):
    """A stretched grid with a hole, steep beside it, and white noise: points (k, 2), displacements (4, k, 2), mm."""
    x, y = np.meshgrid(np.arange(n, dtype=float), np.arange(n, dtype=float))
    points = np.column_stack([x.ravel(), y.ravel()])
    points = points[np.linalg.norm(points - n / 2, axis=1) > 5]
    r = np.linalg.norm(points - n / 2, axis=1)
    u = points * [0.2, -0.1] + (points - n / 2) * (2.0 / r**2)[:, None]
    rng = np.random.default_rng(seed)
    return points, np.stack([(k + 1) * u / 4 + rng.normal(0, noise, u.shape) for k in range(4)])


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.05])
def test_noise_and_steep_fields_are_no_outliers(noise):
    for seed in range(3):
        assert outliers(*field(seed=seed, noise=noise)).index.size == 0


@pytest.mark.parametrize("cluster", [0, 3, 10])
def test_spurious_points_are_found_alone_and_in_clusters(cluster):
    """A cluster of ten moves as one, by eighteen deviations of the noise; nothing else is taken for spurious."""
    points, u = field()
    apart = np.array([100, 500, 1200])
    wrong = np.sort(cKDTree(points).query(points[333], k=cluster)[1]) if cluster else apart
    u[1:, wrong] += np.array([0.15, -0.1])
    assert np.array_equal(outliers(points, u).index, wrong)


def test_a_point_that_jumps_for_one_frame_is_found():
    points, u = field(noise=0.001)
    u = np.concatenate([u, u[-1:] * 1.2, u[-1:] * 1.4])
    u[4, 700] += 0.2
    assert outliers(points, u).index.tolist() == [700]


def test_spurious_points_are_masked_with_their_places_and_kept_on_request(tmp_path):
    path = mapped(tmp_path)
    good = from_map(path)
    spoil(tmp_path, [(5, 5), (9, 8)])
    found = from_map(path)
    assert len(found.points) == EVERYTHING - 2
    x, y = place(5, 5)
    assert f"({x:.4g}, {y:.4g})" in said(found) and "left out" in said(found)
    assert found.displacements.max() == pytest.approx(good.displacements.max(), rel=0.02)
    kept = from_map(write(path, MAP + '[mask]\noutliers = "keep"\n'))
    assert len(kept.points) == EVERYTHING
    assert "kept" in said(kept)


@pytest.mark.parametrize(("spoilt", "closed"), [([(5, 5)], True), ([(5, 0)], True), ([(5, 5), (6, 5), (6, 6)], False)])
def test_a_lone_spurious_point_leaves_no_gap(tmp_path, spoilt, closed):
    """Inside or on a loaded side; where several go together there may be no material."""
    path = mapped(tmp_path)
    good = from_map(path)
    spoil(tmp_path, spoilt)
    found = from_map(path)
    area, whole = (signed_areas(e.points, e.triangles).sum() for e in (found, good))
    assert len(found.points) == EVERYTHING - len(spoilt)
    assert bool(area == pytest.approx(whole)) is closed
    assert len(found.free_nodes) == len(good.free_nodes)
    assert not np.isnan(found.displacements).any()


# --- masks and inner edges --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mask", "gone"),
    [
        ("points = [[{0}, {1}]]", 1),
        ("boxes = [[{0}, {1}, {2}, {3}]]", 4),
        ("circles = [[{0}, {1}, 1.1]]", 5),
        ('column = "n"', EVERYTHING - 1),  # all but point 0
    ],
)
def test_masks_leave_out_what_they_name(tmp_path, mask, gone):
    text = MAP + "[mask]\n" + mask.format(*place(6, 7), *place(7, 6)) + "\n"
    if "column" in mask:
        with pytest.raises(errors.ConfigError, match="leave 1 of"):
            from_map(mapped(tmp_path, text))
        return
    e = from_map(mapped(tmp_path, text))
    assert len(e.points) == EVERYTHING - gone
    assert f"{gone} of {EVERYTHING} points were left out" in said(e)


def test_a_mask_that_names_no_point_says_where_the_nearest_is(tmp_path):
    path = mapped(tmp_path, MAP + "[mask]\npoints = [[-3.0, 4.0]]\n")
    with pytest.raises(errors.ConfigError, match=r"no point at \(-3, 4\) mm; the nearest is at") as refused:
        from_map(path)
    near = re.findall(r"nearest is at \((.*?), (.*?)\) mm$", str(refused.value))[0]
    assert len(from_map(write(path, MAP + f"[mask]\npoints = [[{near[0]}, {near[1]}]]\n")).points) == EVERYTHING - 1


@pytest.mark.parametrize(("drop", "rows"), [("drop_points = {top = 2}", 2), (f"drop_mm = {{top = {1.5 * STEP}}}", 2)])
def test_inner_edges(tmp_path, drop, rows):
    e = from_map(mapped(tmp_path, MAP.replace('"holes"]', f'"holes"]\n{drop}')))
    assert len(e.points) == EVERYTHING - rows * COLUMNS
    top = next(b for b in e.loaded if b.name == "top")
    assert len(top.nodes) == COLUMNS
    assert np.ptp(e.points[:, 1]) == pytest.approx((ROWS - 1 - rows) * STEP)


def test_the_rim_of_a_masked_gap_is_no_free_hole(tmp_path):
    box = "boxes = [[{}, {}, {}, {}]]".format(*place(6, 9), *place(9, 6))
    e = from_map(mapped(tmp_path, MAP + f"[mask]\n{box}\n"))
    assert e.free_nodes.size == 2 * (ROWS - 2)  # the sides alone


def test_a_point_that_failed_on_a_grip_moves_as_those_beside_it(tmp_path):
    path = mapped(tmp_path)
    whole = from_map(path)
    spoil(tmp_path, [(4, 0), (5, 0)], by="nan")
    e = from_map(path)
    assert len(e.points) == EVERYTHING and "move as those beside them on the grip" in said(e)
    np.testing.assert_allclose(e.displacements, whole.displacements, atol=1e-5)


def test_points_that_failed_on_most_of_a_loaded_edge_and_the_remedy(tmp_path):
    path = mapped(tmp_path)
    spoil(tmp_path, [(at, 0) for at in range(2, 13)], by="nan")
    with pytest.raises(
        errors.LostPointsError,
        match=r"11 failed points lie on the loaded edge 'top', the first at \(.*\) mm.*edges\.drop_points.*frames\.list",
    ):
        from_map(path)
    inner = from_map(write(path, MAP.replace('"holes"]', '"holes"]\ndrop_points = {top = 1}')))
    assert len(inner.points) == EVERYTHING - COLUMNS
    early = from_map(write(path, MAP.replace("count = 4", "list = [1, 2]")))
    assert len(early.points) == EVERYTHING


def test_a_triangle_that_folds_over_and_the_remedies(tmp_path):
    text = MAP + '[mask]\noutliers = "keep"\n'
    path = mapped(tmp_path, text)
    spoil(tmp_path, [(5, 5)], frames=range(9, 12), by="90")
    with pytest.raises(errors.InvalidDeformationError, match=r"det F <= 0 .* at \(.*\) mm.*\[mask\].*frames\.list"):
        from_map(path)
    x, y = place(5, 5)
    assert len(from_map(write(path, text + f"points = [[{x}, {y}]]\n")).points) == EVERYTHING - 1
    assert len(from_map(write(path, text.replace("count = 4", "list = [2, 4, 6]"))).points) == EVERYTHING
    assert len(from_map(write(path, MAP)).points) == EVERYTHING - 1  # found by itself


# --- a window in a larger body ----------------------------------------------------------------------------------

OPEN = MAP.replace('free = ["left", "right", "holes"]\n', "")


def test_an_import_asks_whether_the_section_carries_the_force(tmp_path):
    path = mapped(tmp_path, OPEN)
    assert "edges.rim = true" in said(from_map(path))
    assert "edges.rim" not in said(from_map(write(path, MAP)))
    window = from_map(write(path, OPEN.replace('"top"]', '"top"]\nrim = true')))
    assert window.level_is_nominal
    assert "only ratios" in said(window)
    with pytest.raises(errors.ConfigError, match=r"edges\.rim.* no free edge"):
        from_map(write(path, MAP.replace('"top"]', '"top"]\nrim = true')))


# --- small things that are said ----------------------------------------------------------------------------------


def test_blank_forces_are_counted(tmp_path):
    path = mapped(tmp_path)
    record = tmp_path / "load.csv"
    lines = record.read_text().splitlines()
    for row in (20, 40):
        lines[row] = lines[row].split(",")[0] + ","
    write(record, "\n".join(lines))
    assert "no force in reading 20, 40," in said(from_map(path))


def test_a_point_without_a_triangle_is_told_and_kept_where_asked(tmp_path):
    far = [COLUMNS - 1, ROWS - 1]

    def keep(p):
        index = np.arange(len(p))
        column, row = index % COLUMNS, index // COLUMNS
        return (column < COLUMNS - 4) | ((column == far[0]) & (row == far[1]))

    path = mapped(tmp_path, keep=keep)
    e = from_map(path)
    assert len(e.points) == ROWS * (COLUMNS - 4)
    assert "1 point(s) belong to no triangle" in said(e) and "points.max_edge_mm" in said(e)
    more = from_map(write(path, MAP.replace('y_axis = "down"', 'y_axis = "down"\nmax_edge_mm = 40.0')))
    assert len(more.points) == ROWS * (COLUMNS - 4) + 1


def test_a_force_in_kilonewtons_read_as_newtons_is_asked_about(tmp_path):
    path = mapped(tmp_path)
    assert "is the force in N" not in said(from_map(path))
    assert "is the force in N" in said(
        from_map(write(path, MAP.replace('unit = "kN"\nsign = -1.0', 'unit = "kN"\nsign = -1e3')))
    )


def test_temporal_noise_of_filtered_data_is_told():
    x, y = np.meshgrid(0.5 * np.arange(30), 0.5 * np.arange(20))
    points = np.column_stack([x.ravel(), y.ravel()])
    pattern = np.random.default_rng(0).normal(0, 0.01, points.shape)  # an error that stays with the specimen
    frames = np.stack([k * (0.01 * points + pattern) for k in np.linspace(0, 1, 12)])
    found = noise_estimate.displacement_noise(points, frames).to_dict()
    assert noise_notes({"displacement": "temporal", "force": "stated", **found}) != []
    assert noise_notes({"displacement": "total", "force": "stated", **found}) == []


@pytest.mark.parametrize(("clock", "told"), [(0.5, True), (0.01, False), (0.0, False)])
def test_a_force_that_the_clocks_leave_uncertain_is_told(clock, told):
    """Half a second at 0.7 N/s, beside a load cell that reads to 0.01 N."""
    report = {"displacement": "total", "force": "stated", "load_cell_std_N": 0.01, "synchronisation_std_s": clock, "force_rate_N_per_s": 0.7}  # fmt: skip
    notes = noise_notes(report)
    assert bool(notes) is told
    assert not told or ("0.35 N" in notes[0] and "per_frame" in notes[0])


def test_one_grip_lengthens_against_the_other_end(tmp_path):
    """A window that moves as a whole towards the grip that rests is still stretched."""
    path = mapped(tmp_path, OPEN.replace('loaded = ["bottom", "top"]', 'loaded = ["bottom"]'))
    e = from_map(path)
    assert [b.name for b in e.loaded] == ["bottom"]
    assert (e.displacements[:, e.loaded[0].nodes, 1] < 1e-9).all()


def test_defaults_of_a_mask_are_those_of_the_docs():
    assert MaskTable().outliers == "mask"
    assert motion(1.0).max() == 0


# --- a packed test between two pads --------------------------------------------------------------------------------


def packed(tmp_path) -> Path:
    x, y = np.meshgrid(np.linspace(11, 28, 18), np.linspace(-4, 4, 9))
    points = np.column_stack([x.ravel(), y.ravel()])
    pad = np.linspace(0, 3, 10)
    positions = np.stack([points + p * (points - [36, 0]) * [0.03, -0.01] for p in pad])
    moved = np.linspace(0, 8, 200)
    path = tmp_path / "skin.npz"
    np.savez(
        path,
        xt_dic_mm=positions,
        xt_pad_mov_mm=np.column_stack([-pad, 0 * pad]),
        ux_pad_mm=-moved,
        fx_pad_N=-0.01 * moved**2,
    )
    return path


def test_tables_of_a_packed_test_have_the_force_at_the_same_displacement_of_the_pad(tmp_path):
    path = packed(tmp_path)
    assert PadTest.load(path).force == pytest.approx(0.01 * np.linspace(0, 3, 10) ** 2, abs=1e-4)
    direct = importer_of(str(path)).read(str(path), SheetOptions(), "skin", None)
    unpacked = from_map(write_tables(path, tmp_path / "tables", "skin"))
    assert np.allclose(direct.experiment().displacements, unpacked.displacements)
    assert len(unpacked.points) == 18 * 9
    np.savez(tmp_path / "other.npz", xt_dic_mm=np.zeros((2, 4, 2)))
    with pytest.raises(errors.FileFormatError, match="has no xt_pad_mov_mm"):
        PadTest.load(tmp_path / "other.npz")


def test_a_packed_test_is_found_in_the_data_folder_and_a_missing_one_leaves_nothing(tmp_path, monkeypatch):
    (tmp_path / "data").mkdir()
    packed(tmp_path / "data")
    monkeypatch.setenv("EQUIGAP_DATA", str(tmp_path / "data"))
    assert cli.main(["unpack", "skin.npz", "-o", str(tmp_path / "tables")]) == 0
    assert (tmp_path / "tables" / "columns.toml").is_file()
    assert cli.main(["unpack", "nothing.npz", "-o", str(tmp_path / "none")]) == 2
    assert not (tmp_path / "none").exists()


@pytest.mark.skipif(not SKIN.is_file(), reason="EQUIGAP_DATA has no sutula_skin_dic")
def test_healthy_skin(tmp_path):
    """What a careful engineer would note of it: few spurious points, strain near its noise, a force that may not be the section's."""
    e = from_map(write_tables(SKIN, tmp_path, "skin"))
    assert 525 <= len(e.points) < 537
    assert 1 < e.strain_signal.ratio < 2
    for words in ("move unlike their neighbours", "signal to noise of the strain", "edges.rim = true"):
        assert words in said(e)
