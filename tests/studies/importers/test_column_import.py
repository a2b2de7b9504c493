"""Column maps: what they read, what they refuse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sheets import (
    COLUMNS,
    MAP,
    PITCH,
    ROWS,
    SCALE,
    force,
    mapped,
    write,
)

from calibrate import errors
from calibrate.data.experiment import Experiment
from calibrate.data.triangulation import signed_areas
from studies.importers import column_import, column_map
from studies.importers.recording.series import to_experiment


def from_map(path: Path) -> Experiment:
    m = column_map.read_map(path)
    return to_experiment(column_import.column_series(m, path.parent), m.selection, m.stated_noise)


@pytest.mark.parametrize("coordinates", ["reference", "current"])
def test_column_map(tmp_path, coordinates):
    text = MAP.replace('y_axis = "down"', f'y_axis = "down"\ncoordinates = "{coordinates}"')
    e = from_map(mapped(tmp_path, text, coordinates=coordinates))
    assert e.name == "mapped"
    assert e.stress_unit == "MPa"
    assert len(e.points) == COLUMNS * ROWS
    np.testing.assert_allclose(np.ptp(e.points, axis=0), [15.0, 13.0], atol=1e-6)
    assert signed_areas(e.points, e.triangles).sum() == pytest.approx(15 * 13)
    names = {b.name: b for b in e.loaded}
    assert len(names["top"].nodes) == COLUMNS
    assert (names["top"].force[:, 1] > 0).all()
    assert names["bottom"].force[-1, 1] == pytest.approx(-force(e.time[-1]), rel=1e-5)
    assert e.free_nodes.size == 2 * (ROWS - 2)
    slope = np.polyfit(e.points[:, 1], e.displacements[-1, :, 1], 1)[0]
    assert slope == pytest.approx(0.01 * 2 * e.time[-1], rel=1e-4)
    assert e.noise.displacement_std == 0.001


@pytest.mark.parametrize(
    ("stated", "origin", "force_std", "relative"),
    [
        ("displacement_std_mm = 0.001\nforce_std_N = 0.3", "stated", 0.3, 0.0),
        ("displacement_std_mm = 0.001\nforce_std_relative = 0.02", "stated", 0.0, 0.02),
        ("displacement_std_mm = 0.001", "estimated", 2.0 * 0.5 / np.sqrt(12), 0.0),  # rate of loading x half a second
    ],
)
def test_what_is_stated_of_the_noise_is_used_and_the_rest_estimated(tmp_path, stated, origin, force_std, relative):
    e = from_map(mapped(tmp_path, MAP.replace("displacement_std_mm = 0.001", stated)))
    assert e.noise.displacement_std == 0.001
    assert e.noise.force_std == pytest.approx(force_std, rel=0.1)
    assert e.noise.force_std_relative == relative
    assert e.provenance["noise"]["force"] == origin
    assert not e.noise.is_common


def test_an_offset_that_is_stated_is_no_noise_of_each_force(tmp_path):
    """The same times, stated one by one, by rate and offset, and by a rate alone."""
    times = ", ".join(f"{0.5 * k + 0.1:.1f}" for k in range(12))
    stds = [
        from_map(mapped(tmp_path, MAP.replace("rate_hz = 2.0", frames))).noise.force_std
        for frames in (f"times_s = [{times}]", "rate_hz = 2.0\noffset_s = 0.1", "rate_hz = 2.0")
    ]
    assert stds[0] == stds[1] < 0.1 * stds[2]


def test_what_is_stated_of_noise_common_to_all_pictures_is_kept(tmp_path):
    stated = "displacement_std_mm = 0.001\npattern_std_mm = 0.003\nreference_std_mm = 0.002\ncorrelation_time_s = 4.0"
    e = from_map(mapped(tmp_path, MAP.replace("displacement_std_mm = 0.001", stated)))
    assert (e.noise.displacement_std, e.noise.pattern_std, e.noise.reference_std) == (0.001, 0.003, 0.002)
    assert e.noise.correlation_time == 4.0


def test_force_noise_stated_alone(tmp_path):
    e = from_map(mapped(tmp_path, MAP.replace("displacement_std_mm = 0.001", "force_std_N = 0.3")))
    assert e.noise.force_std == 0.3
    assert e.provenance["noise"]["displacement"] == "total"
    assert e.noise.displacement_std < 1e-5  # exact fields: only what is rounded in the tables
    columns = column_map.read_map(tmp_path / "map.toml")
    temporal = to_experiment(
        column_import.column_series(columns, tmp_path), noise=columns.stated_noise, noise_kind="temporal"
    )
    assert temporal.provenance["noise"]["displacement"] == "temporal"


@pytest.mark.parametrize(
    ("units", "per_position", "per_displacement"),
    [
        ('unit = "mm"\ndisplacement_unit = "um"', SCALE, 1e3 * SCALE),
        ('position_unit = "px"\nunit = "mm"\nscale_mm_per_px = 0.05', 1.0, SCALE),
        ('displacement_unit = "px"\nposition_unit = "cm"\nscale_mm_per_px = 0.05', 0.1 * SCALE, 1.0),
    ],
)
def test_position_and_displacement_in_units_of_their_own(tmp_path, units, per_position, per_displacement):
    """The same test, written in other units, is the same Experiment."""
    expected = from_map(mapped(tmp_path / "px"))
    path = mapped(tmp_path / "own", MAP.replace('unit = "px"\nscale_mm_per_px = 0.05', units))
    for frame in (tmp_path / "own" / "frames").glob("*.csv"):
        head, *lines = frame.read_text().splitlines()
        rows = np.array([line.split(",") for line in lines], float)
        rows[:, 1:5] *= [per_position, per_position, per_displacement, per_displacement]
        write(frame, "\n".join([head, *(",".join(f"{v:.9g}" for v in row) for row in rows)]) + "\n")
    found = from_map(path)
    np.testing.assert_allclose(found.points, expected.points, atol=1e-6)
    np.testing.assert_allclose(found.displacements, expected.displacements, atol=1e-6)


def test_column_map_keeps_holes_and_finds_their_rims(tmp_path):
    def outside(p):
        centre = [200 + 7.5 * PITCH, 100 + 6.5 * PITCH]
        return (np.abs(p - centre) > 1.6 * PITCH).any(axis=1)

    text = MAP.replace("[noise]", "fit_holes = false\n[noise]")
    e = from_map(mapped(tmp_path, text, keep=outside))
    assert len(e.points) == COLUMNS * ROWS - 16
    assert signed_areas(e.points, e.triangles).sum() == pytest.approx(15 * 13 - 25 + 4 * 0.5)  # corners are bridged
    assert e.free_nodes.size == 2 * (ROWS - 2) + 16


@pytest.mark.parametrize("to_the_end", [True, False])
def test_column_map_drops_points_that_fail_to_the_end(tmp_path, to_the_end):
    """One that fails in a single frame moves in it as its neighbours do."""
    path = mapped(tmp_path)
    whole = from_map(write(path, MAP.replace("count = 4", "list = [3, 8]")))
    frames = sorted((tmp_path / "frames").glob("f_*.csv"), key=lambda one: int(one.stem[2:]))
    for frame in frames[8 : None if to_the_end else 9]:
        lines = frame.read_text().splitlines()
        inner = next(k for k, line in enumerate(lines) if line.startswith(f"{6 * COLUMNS + 7},"))
        lines[inner] = lines[inner].rsplit(",", 1)[0] + ",-1"
        write(frame, "\n".join(lines))
    e = from_map(path)
    assert e.provenance["points_lost"] == int(to_the_end)
    assert e.provenance["bridged"]["readings"] == int(not to_the_end)
    assert e.provenance["frames"] == [3, 8]
    if not to_the_end:
        assert any("1 of" in note and "neighbours move" in note for note in e.provenance["notes"])
        np.testing.assert_allclose(e.displacements, whole.displacements, atol=0.02 * np.abs(whole.displacements).max())


def test_exchanged_displacements_are_told(tmp_path):
    """The grips would then move across the pull, not along it; the right way round nothing is said."""

    def notes(text):
        return [note for note in from_map(mapped(tmp_path, text)).provenance["notes"] if "across the pull" in note]

    assert notes(MAP) == []
    (note,) = notes(MAP.replace('u = "U"\nv = "V"', 'u = "V"\nv = "U"'))
    assert "points.u" in note


def test_force_per_frame(tmp_path):
    path = mapped(tmp_path)
    write(tmp_path / "load.csv", "F\n" + "\n".join(f"{-1e-3 * k:.4f}" for k in range(12)))
    text = MAP.replace('time = "t"\n', "per_frame = true\n").replace("count = 4", "list = [2, 5]")
    e = from_map(write(path, text))
    np.testing.assert_allclose(e.loaded[1].force[:, 1], [2.0, 5.0], atol=1e-9)
    write(tmp_path / "load.csv", "F\n-1\n-2\n")
    with pytest.raises(errors.MeshMismatchError, match="2 forces for 12 frames"):
        from_map(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('x = "X"', 'x = "X"\nxx = 1', "unknown key 'points.xx'; did you mean 'x'"),
        ("rate_hz", "rate_Hz", "unknown key 'frames.rate_Hz'; did you mean 'rate_hz'"),
        ("[edges]", "[edge]", "unknown key 'edge'; did you mean 'edges'"),
        ('y = "Y"\n', "", "key 'points.y' is missing"),
        ("count = 4", "count = 4.5", "frames.count = .*valid integer"),
        ("count = 4", "count = true", "frames.count = .*valid integer"),
        ('free = ["left", "right", "holes"]', 'free = "left"', "edges.free = 'left': .* valid list"),
        ('unit = "kN"', 'unit = "kp"', "force.unit = 'kp' unknown"),
        ('loaded = ["bottom", "top"]', 'loaded = ["bottom", "up"]', "edges.loaded.1 = 'up' unknown"),
        ("scale_mm_per_px = 0.05\n", "", "scale_mm_per_px belongs to a unit 'px'"),
        ('loaded = ["bottom", "top"]', 'loaded = ["bottom", "left"]', "a loaded side is not free"),
        ('time = "t"\n', "", "give frames.rate_hz and force.time"),
        ("[noise]", "[noise", "not valid TOML"),
        ("rate_hz = 2.0", "times_s = [0.0, 1.0, 1.0]", r"map.toml: frames.times_s: picture 2 .* 1 s is not later"),
        ("rate_hz = 2.0", "times_s = [2.0, 1.0]", r"map.toml: frames.times_s: picture 1 .* 1 s is not later .* 2 s"),
        ("displacement_std_mm", "correlation_length_mm", "belongs to noise.displacement_std_mm"),
        ("displacement_std_mm = 0.001", "pattern_std_mm = 0.001", "state noise.displacement_std_mm too"),
        ("displacement_std_mm = 0.001", "correlation_time_s = 2.0", "state noise.displacement_std_mm too"),
        ("displacement_std_mm = 0.001", "force_std_N = -1.0", "noise.force_std_N = -1.0: .*greater than or equal to 0"),
        ("rate_hz = 2.0", "rate_hz = -2.0", "frames.rate_hz = -2.0: .*greater than 0"),
        ("rate_hz = 2.0", "rate_hz = nan", "frames.rate_hz = nan: "),
        ("thickness_mm = 2.0", "thickness_mm = 0.0", "thickness_mm = 0.0: .*greater than 0"),
        ("count = 4", "onset = 1.0", "frames.onset = 1.0: .*less than 1"),
        ('unit = "px"', 'unit = "px"\nposition_unit = "mm"\ndisplacement_unit = "um"', "belongs to a unit 'px'"),
        (
            'loaded = ["bottom", "top"]\nfree = ["left", "right", "holes"]',
            'loaded = ["left", "top"]',
            "names one force",
        ),
        (
            'loaded = ["bottom", "top"]\nfree = ["left", "right", "holes"]',
            'loaded = ["left", "right", "top"]',
            "names one force",
        ),
        ("[noise]\ndisplacement_std_mm = 0.001", "noise = 3", "unknown key 'edges.noise'"),
    ],
)
def test_bad_column_maps(tmp_path, old, new, message):
    assert old in MAP
    path = write(tmp_path / "map.toml", MAP.replace(old, new))
    with pytest.raises(errors.ConfigError, match=message):
        column_map.read_map(path)


def test_a_column_map_in_another_encoding_is_refused_by_its_line(tmp_path):
    path = tmp_path / "map.toml"
    path.write_bytes(b'name = "a"\n[force]\ntime = "Pr\xfcfzeit"\n')
    with pytest.raises(errors.ConfigError, match=r"map.toml, line 3: not UTF-8; save it as UTF-8"):
        column_map.read_map(path)


def test_column_map_and_files_that_do_not_match(tmp_path):
    path = mapped(tmp_path)
    with pytest.raises(errors.DataNotFoundError, match="0 files"):
        from_map(write(path, MAP.replace("f*.csv", "g*.csv")))
    with pytest.raises(errors.FileFormatError, match="no column named 'XX'"):
        from_map(write(path, MAP.replace('"X"', '"XX"')))
    mapped(tmp_path, coordinates="current")
    write(path, MAP)
    far = "\n".join(f"{k},{9e3 + 20 * k},0,1,1,0" for k in range(50))
    write(tmp_path / "frames" / "f_5.csv", "n,X,Y,U,V,sigma\n" + far)
    with pytest.raises(errors.MeshMismatchError, match=r"f_5.csv: .* points.coordinates = 'current'"):
        from_map(path)


def test_column_map_with_duplicate_points(tmp_path):
    path = mapped(tmp_path)
    frame = tmp_path / "frames" / "f_0.csv"
    lines = frame.read_text().splitlines()
    write(frame, "\n".join([*lines, lines[4]]))
    with pytest.raises(
        errors.DegenerateMeshError,
        match=r"f_0.csv: points are listed twice, as in rows \d+ and \d+ of its numbers, at .* mm",
    ):
        from_map(path)


@pytest.mark.parametrize("minimum", ["5.0", "-2.0"])
def test_limits_of_validity_that_no_point_meets(tmp_path, minimum):
    """All points of all frames; the values that were found are named."""
    path = mapped(tmp_path, MAP.replace("valid_minimum = 0.0", f"valid_minimum = {minimum}"))
    if minimum == "5.0":
        with pytest.raises(
            errors.LostPointsError, match=r"'sigma' is from 0.01 to 0.01, check points.valid_minimum \(5.0\)"
        ):
            from_map(path)
    else:
        assert len(from_map(path).points) == COLUMNS * ROWS


def test_frames_that_failed_as_a_whole(tmp_path):
    """The reference counts as zero, a later one is not chosen by itself; one that is listed is refused."""
    expected = from_map(mapped(tmp_path / "whole"))
    path = mapped(tmp_path / "failed")
    for number in (0, 11):
        frame = path.parent / "frames" / f"f_{number}.csv"
        head, *lines = frame.read_text().splitlines()
        write(frame, "\n".join([head, *(line.rsplit(",", 1)[0] + ",-1" for line in lines)]) + "\n")
    found = from_map(path)
    assert any("frame 11: not chosen" in note for note in found.provenance["notes"])
    assert expected.provenance["frames"][-1] == 11
    assert found.provenance["frames"][-1] == 10
    with pytest.raises(errors.LostPointsError, match="frames.list"):
        from_map(write(path, MAP.replace("count = 4", "list = [5, 11]")))


@pytest.mark.parametrize("name", ["matchid", "vic", "dice"])
def test_documented_examples_are_valid(name):
    path = Path(__file__).parents[3] / "docs" / "import" / f"{name}.toml"
    assert column_map.read_map(path).name.startswith(name)
    assert "UNCHECKED" in path.read_text()


def around(centre: tuple[float, float], radius: float):
    """Pixels of the sheet outside of a circle of the imported frame, mm."""

    def keep(pixels):
        mm = np.column_stack([SCALE * pixels[:, 0], SCALE * (pixels[:, 1].max() - pixels[:, 1])])
        return np.hypot(*(mm - mm.min(axis=0) - centre).T) > radius

    return keep


def test_true_edges_of_a_map_are_continued_to(tmp_path):
    """A homogeneous field is continued exactly; area and free nodes are those of the specimen."""
    path = mapped(tmp_path, MAP, keep=around((7.0, 6.0), 3.4))
    bare = from_map(path)
    x0, y0 = bare.points.min(axis=0)
    given = f"beyond_mm = {{left = 0.6}}\n[[edges.holes]]\ncentre = [{x0 + 7.0}, {y0 + 6.0}]\ndiameter = 6.0\n"
    path.write_text(MAP.replace("[noise]", given + "[noise]"))
    e = from_map(path)
    assert signed_areas(e.points, e.triangles).sum() == pytest.approx(15.6 * 13 - 9 * np.pi, rel=2e-3)
    assert e.n_measured < len(e.points) and len(e.given_rims) == len(e.points) - e.n_measured
    slope = np.polyfit(e.points[:, 1], e.displacements[-1, :, 1], 1)
    np.testing.assert_allclose(np.polyval(slope, e.points[:, 1]), e.displacements[-1, :, 1], atol=1e-6)
    assert all(len(b.nodes) == COLUMNS + 1 for b in e.loaded)
    assert [("fitted" in rim, rim["fitted"]) for rim in e.provenance["rims"]] == [(True, False)] * 2
    assert any("its rim, 6 mm in diameter" in note for note in e.provenance["notes"])
    fitted = [note for note in bare.provenance["notes"] if "largest circle that fits between them" in note]
    assert len(fitted) == 1 and "[[edges.holes]] in a column map, with centre = [" in fitted[0]
    path.write_text(MAP.replace("[noise]", "fit_holes = false\n[noise]"))
    assert from_map(path).continued is None


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("beyond_mm = {top = 0.5}", "edges.beyond_mm: side 'top' is not in edges.free"),
        ("[[edges.holes]]\ncentre = [7.0, 6.0]", "edges.holes: give diameter, or diameters of both axes"),
        ("[[edges.arcs]]\ncentre = [0, 0]\nradius = 2.0\nfrom_deg = 90.0\nto_deg = 0.0", "to_deg must be larger"),
        ("[[edges.lines]]\nstart = [1.0, 1.0]\nend = [1.0, 1.0]", "edges.lines: start and end are the same"),
        ("[[edges.holes]]\ncentre = [1.0, 1.0]\ndiameter = 1.0", r"\[edges\] the hole at \(1, 1\) mm: no opening"),
        ("[[edges.arcs]]\ncentre = [90.0, 90.0]\nradius = 2.0\nfrom_deg = 0.0\nto_deg = 90.0", "no edge of the measured region is within 3 distances"),
    ],
)  # fmt: skip
def test_edges_that_cannot_be_are_named(tmp_path, given, message):
    path = mapped(tmp_path, MAP.replace("[noise]", given + "\n[noise]"), keep=around((7.0, 6.0), 3.4))
    with pytest.raises(errors.ConfigError, match=message):
        from_map(path)


def test_times_count_from_the_last_static_picture(tmp_path):
    """The camera ran for 100 s before the machine's clock reads zero stretch, two pictures of which are static; the record is on the same clock."""
    path = mapped(tmp_path, MAP.replace("rate_hz = 2.0\ncount = 4", "rate_hz = 2.0\noffset_s = 100.0\nlist = [4, 8]"))
    for k in range(12):  # the pull begins at the third picture
        rows = (tmp_path / "frames" / f"f_{max(k - 2, 0)}.csv").read_text()
        write(tmp_path / "moved" / f"f_{k}.csv", rows)
    text = path.read_text().replace('files = "frames/f*.csv"', 'files = "moved/f*.csv"')
    times = np.linspace(100, 110, 101)
    write(tmp_path / "load.csv", "t,F\n" + "\n".join(f"{t:.3f},{-1e-3 * force(t - 101):.7f}" for t in times))
    e = from_map(write(tmp_path / "map.toml", text))
    assert e.time.tolist() == [pytest.approx(1.0), pytest.approx(3.0)] and e.provenance["start_s"] == pytest.approx(
        101.0
    )
    assert e.record.time[[0, -1]].tolist() == [pytest.approx(-1.0), pytest.approx(9.0)]
    assert any("begins at 101 s" in note for note in e.provenance["notes"])
    assert e.record.force[1, -1, 1] == pytest.approx(force(9.0), rel=1e-5)


PER_FRAME = (
    MAP[: MAP.index("[force]")]
    + """
[[force]]
file = "one.csv"
force = "F"
unit = "N"
per_frame = true
sides = ["bottom"]
[[force]]
file = "other.csv"
force = "F"
unit = "N"
per_frame = true
sides = ["top"]
[frames]
rate_hz = 2.0
[edges]
loaded = ["bottom", "top"]
free = ["left", "right", "holes"]
[noise]
displacement_std_mm = 0.001
"""
)


def cells(tmp_path: Path, other: list[float | str]) -> Path:
    write(tmp_path / "one.csv", "t,F\n" + "\n".join(f"{10 * k},{0.1 * k:.3f}" for k in range(12)))
    write(tmp_path / "other.csv", "t,F\n" + "\n".join(f"{10 * k},{value}" for k, value in enumerate(other)))
    return mapped(tmp_path, PER_FRAME)


def test_a_picture_that_a_load_cell_did_not_read_is_no_increment(tmp_path):
    """The second of two was switched off before the last three: nothing is made up for it, and the note says which."""
    e = from_map(cells(tmp_path, [0.2 * k if k < 9 else "" for k in range(12)]))
    assert e.n_increments == 8 and e.loaded[1].force[-1, 1] == pytest.approx(1.6)
    notes = e.provenance["notes"]
    assert any("without a force" in note and "9, 10, 11" in note for note in notes)
    assert any("other.csv" in note for note in notes)


@pytest.mark.parametrize("several", [False, True])
def test_the_force_of_a_picture_is_none_of_its_neighbours(tmp_path, several):
    """A picture whose own reading is blank is no increment: on a curved record its neighbours' mean is off by far more than noise. Asked for by its number it is refused."""
    force = [0.2 * k + 0.1 * k**2 for k in range(12)]
    values = [value if k != 5 else "" for k, value in enumerate(force)]
    path = cells(tmp_path, values)
    if not several:
        one = (
            PER_FRAME.replace("one.csv", "other.csv")
            .replace("[[force]]", "[force]", 1)
            .replace('sides = ["bottom"]\n', "")
        )
        write(path, one[: one.index("[[force]]")] + one[one.index("[frames]") :])
    e = from_map(path)
    frames = e.provenance["frames"]
    assert frames == [k for k in range(1, 12) if k != 5]
    assert np.abs(e.loaded[-1].force[:, 1]) == pytest.approx([force[k] for k in frames])
    assert any("no force in reading 6" in note and "left out" in note for note in e.provenance["notes"])
    write(path, path.read_text().replace("rate_hz = 2.0", "rate_hz = 2.0\nlist = [4, 5, 6]"))
    if several:
        assert from_map(path).provenance["frames"] == [4, 6]
    else:
        with pytest.raises(errors.MissingForceError, match=r"frame 5 .*no force"):
            from_map(path)


def test_two_clocks_of_the_same_pictures_are_refused(tmp_path):
    """A row for each picture has its time, and the map another."""
    path = cells(tmp_path, [0.2 * k for k in range(12)])
    timed = PER_FRAME.replace('force = "F"\n', 'force = "F"\ntime = "t"\n')
    write(path, timed.replace("rate_hz = 2.0", f"times_s = {[2.0 * k for k in range(12)]}"))
    with pytest.raises(errors.ConfigError, match=r"frames\.times_s and force\.time both"):
        from_map(path)


def test_load_cells_that_put_the_pictures_at_other_times_are_refused(tmp_path):
    path = cells(tmp_path, [0.2 * k for k in range(12)])
    write(path, PER_FRAME.replace('force = "F"\nunit = "N"\nper_frame = true\nsides = ["bottom"]', 'force = "F"\ntime = "t"\nunit = "N"\nper_frame = true\nsides = ["bottom"]'))  # fmt: skip
    with pytest.raises(errors.TimeError, match=r"other.csv.*5.5 and 110 s"):
        from_map(path)


def test_a_tare_is_of_one_load_cell(tmp_path):
    path = cells(tmp_path, [0.2 * k for k in range(12)])
    write(path, PER_FRAME.replace("rate_hz = 2.0", "rate_hz = 2.0\ntare_N = 0.0"))
    with pytest.raises(errors.ConfigError, match="tare_N"):
        from_map(path)


def test_points_that_are_listed_twice_in_a_picture_are_refused(tmp_path):
    """As where an older evaluation was appended: which of both is right, nobody knows."""
    path = mapped(tmp_path)
    old, last = (tmp_path / "frames" / f"f_{k}.csv" for k in (5, 11))
    write(last, last.read_text() + old.read_text().split("\n", 1)[1])
    with pytest.raises(errors.DegenerateMeshError, match=r"f_11.csv: \d+ points are listed more than once"):
        from_map(path)


def test_a_first_picture_that_has_moved_is_no_reference(tmp_path):
    path = mapped(tmp_path)
    (tmp_path / "frames" / "f_0.csv").unlink()
    with pytest.raises(errors.ConfigError, match=r"f_1.csv: the points have moved .*reference = 'separate'"):
        from_map(path)
    write(path, MAP.replace("[points]", '[points]\nreference = "separate"'))
    assert from_map(path).n_increments > 0


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[points]", '[points]\ndelimiter = ""', "delimiter"),
        ("tare_N = 0.0", "tare_N = nan", "tare_N"),
        ("tare_N = 0.0", "until_s = nan", "until_s"),
        ('files = "frames/f*.csv"', 'files = "/frames/f*.csv"', "relative to points.folder"),
        ('files = "frames/f*.csv"', 'files = ""', "pattern"),
        ("[points]", '[test]\nname = "a"\n[points]', r"\[\[test\]\]"),
        ("[edges]", "[mask]\nboxes = [[-100.0, -100.0, 100.0, -5.5]]\n[edges]", "span no area"),
    ],
)
def test_maps_that_say_nothing_of_use_are_refused_by_name(tmp_path, old, new, said):
    with pytest.raises(errors.ConfigError if "area" not in said else errors.DegenerateMeshError, match=said):
        from_map(mapped(tmp_path, MAP.replace(old, new, 1)))
