"""Disturbances of the recording against what each formula says of a displacement field that is known."""

from dataclasses import replace

import numpy as np
import pytest

from forward.solution import SurfaceSolution
from meshes import Mesh, PlateWithHole, SquareSheet, quads, triangles
from studies.errors import OptionError
from studies.synthetic.camera_disturbances import LensDistortion, MagnificationDrift, OutOfPlane, Rotation, Scale, Tilt
from studies.synthetic.correlation_disturbances import SubsetSmoothing, UnmeasuredStrip, Warp
from studies.synthetic.disturbances import observe
from studies.synthetic.load_cell_disturbances import (
    AxisGain,
    ForceDrift,
    ForceGain,
    ForceOffset,
    Friction,
    Lag,
    LoadCellNonlinearity,
    StiffnessDrift,
)
from studies.synthetic.specimen_edges import inside

SHEET = SquareSheet(half_length=20.0, half_width=20.0, far_size=4.0)
PLATE = PlateWithHole(half_length=30, half_width=15, far_size=3, hole_radius=5, hole_size=0.8)
TIMES = np.array([1.0, 2.0, 3.0])
FACTORS = np.array([0.4, 1.0, 0.7])


def field(x):
    """A quadratic displacement (n, 2), mm."""
    return np.column_stack([0.3 * x[:, 0] + 0.004 * x[:, 0] ** 2, -0.1 * x[:, 1] + 0.002 * x[:, 0] * x[:, 1]])


def solution(specimen, u=field):
    mesh = quads(specimen)
    displacements = FACTORS[:, None, None] * u(mesh.points)
    force = np.column_stack([FACTORS * 12.0, FACTORS * 5.0])
    zero = np.zeros(3)
    reactions = {"left": -force, "right": force}
    return SurfaceSolution(
        mesh, displacements, reactions, TIMES, zero, zero.astype(int), 1.0, {"load_factors": FACTORS.tolist()}
    )


@pytest.fixture(scope="module")
def exact():
    return solution(SHEET)


@pytest.fixture(scope="module")
def mesh():
    return triangles(SHEET)


@pytest.fixture(scope="module")
def clean(exact, mesh):
    return observe(exact, SHEET, mesh)


def force_of(experiment, name="right"):
    return next(b.force for b in experiment.loaded if b.name == name)


def test_nothing_disturbed(exact, mesh, clean):
    np.testing.assert_allclose(clean.points, mesh.points, atol=1e-13)
    np.testing.assert_allclose(clean.displacements, FACTORS[:, None, None] * field(mesh.points), atol=1e-12)
    np.testing.assert_array_equal(force_of(clean), exact.reactions["right"])
    np.testing.assert_array_equal(clean.time, TIMES)
    assert clean.plane == "stress"


def test_a_solution_in_plane_strain_stays_one(exact, mesh):
    strained = replace(exact, description={**exact.description, "plane": "strain"})
    assert observe(strained, SHEET, mesh).plane == "strain"


@pytest.mark.parametrize("disturbance", [LensDistortion(0.0), OutOfPlane(0.0), MagnificationDrift(0.0), Rotation(0.0), Scale(0.0), Tilt(0.0, 0.0),
                                         ForceOffset(0.0), ForceDrift(0.0), ForceGain(0.0), AxisGain(0.0), LoadCellNonlinearity(0.0), Friction(0.0, 0.0), StiffnessDrift(0.0), UnmeasuredStrip(0.0),
                                         Warp(0, 0.0, 1.0, 5.0)])  # fmt: skip
def test_no_amplitude_no_change(exact, mesh, clean, disturbance):
    seen = observe(exact, SHEET, mesh, [disturbance])
    np.testing.assert_allclose(seen.points, clean.points, atol=1e-12)
    np.testing.assert_allclose(seen.displacements, clean.displacements, atol=1e-12)
    np.testing.assert_allclose(force_of(seen), force_of(clean), rtol=1e-14)


def test_lens_distorts_both_pictures(exact, mesh, clean):
    """A corner of the reference is seen at X (1 + 2 k), as |X|^2 = 2 R^2; deformed points follow the same lens."""
    k = 0.01
    seen = observe(exact, SHEET, mesh, [LensDistortion(k)])
    corner = np.flatnonzero((np.abs(mesh.points) == 20).all(axis=1))
    assert len(corner) == 4
    np.testing.assert_allclose(seen.points[corner], mesh.points[corner] * (1 + 2 * k))
    x = clean.points + clean.displacements
    expected = x * (1 + k * (x**2).sum(-1, keepdims=True) / 20.0**2)
    np.testing.assert_allclose(seen.points + seen.displacements, expected)


def test_a_tilted_camera_is_a_pinhole_whose_axis_is_not_the_normal(exact, mesh, clean):
    """Rays through a pinhole in front of the middle, turned about the y axis: exact up to the factor cos(theta) of a whole direction."""
    distance, theta = 400.0, np.radians(3)
    seen = observe(exact, SHEET, mesh, [Tilt(20.0 * np.tan(theta) / distance, 0.0)])

    def pinhole(x):
        across, depth = x[..., 0] * np.cos(theta), distance + x[..., 0] * np.sin(theta)
        return distance * np.stack([across, x[..., 1]], axis=-1) / depth[..., None]

    for found, places in (
        (seen.points, clean.points),
        (seen.points + seen.displacements, clean.points + clean.displacements),
    ):
        assert np.abs(found - places).max() > 0.05  # mm
        np.testing.assert_allclose(found * [np.cos(theta), 1.0], pinhole(places), atol=1e-3)


def test_out_of_plane_motion_follows_the_load(exact, mesh, clean):
    """The reference is seen as it is, the picture at the largest load is magnified by 1 + m."""
    seen = observe(exact, SHEET, mesh, [OutOfPlane(0.01)])
    np.testing.assert_allclose(seen.points, clean.points, atol=1e-12)
    before = clean.points + clean.displacements
    after = seen.points + seen.displacements
    for share, x, y in zip([0.4, 1.0, 0.7], before, after, strict=True):
        np.testing.assert_allclose(y, x * (1 + 0.01 * share), atol=1e-12)


def test_magnification_drifts_with_time(exact, mesh, clean):
    """In proportion to it, to 1 + m in the last picture."""
    seen = observe(exact, SHEET, mesh, [MagnificationDrift(0.01)])
    growth = (0.01 * exact.time / exact.time[-1])[:, None, None]
    np.testing.assert_allclose(seen.points, clean.points, atol=1e-12)
    after = (1 + growth) * (clean.points + clean.displacements)
    np.testing.assert_allclose(seen.points + seen.displacements, after, atol=1e-12)


def test_rotation_turns_the_picture_against_the_loads(exact, mesh, clean):
    """A point on the x axis is seen phi above it; the load cells keep their axes."""
    seen = observe(exact, SHEET, mesh, [Rotation(0.03)])
    right = np.flatnonzero((mesh.points[:, 0] == 20) & (np.abs(mesh.points[:, 1]) < 1e-9))
    np.testing.assert_allclose(seen.points[right], 20 * np.array([[np.cos(0.03), np.sin(0.03)]]))
    np.testing.assert_allclose(
        np.linalg.norm(seen.displacements, axis=-1), np.linalg.norm(clean.displacements, axis=-1), atol=1e-12
    )
    np.testing.assert_array_equal(force_of(seen), force_of(clean))


def test_scale(exact, mesh, clean):
    seen = observe(exact, SHEET, mesh, [Scale(0.02)])
    np.testing.assert_allclose(seen.points, 1.02 * clean.points, atol=1e-12)
    np.testing.assert_allclose(seen.displacements, 1.02 * clean.displacements, atol=1e-12)


def test_load_cells(exact, mesh, clean):
    """An offset along the last force, outward on both sides; a gain that true forces are larger by."""
    direction = np.array([12.0, 5.0]) / 13
    offset = observe(exact, SHEET, mesh, [ForceOffset(0.26)])
    np.testing.assert_allclose(force_of(offset) - force_of(clean), np.tile(0.26 * direction, (3, 1)))
    np.testing.assert_allclose(force_of(offset, "left"), -force_of(offset))
    drift = observe(exact, SHEET, mesh, [ForceDrift(0.26)])
    np.testing.assert_allclose(force_of(drift) - force_of(clean), 0.26 * exact.time[:, None] * direction)
    softer = observe(exact, SHEET, mesh, [StiffnessDrift(-0.01)])
    np.testing.assert_allclose(force_of(softer), force_of(clean) * (1 - 0.01 * exact.time)[:, None])
    axis = observe(exact, SHEET, mesh, [AxisGain(0.05)])
    np.testing.assert_allclose(force_of(axis), force_of(clean) * [1.0, 1.05])
    bent = force_of(observe(exact, SHEET, mesh, [LoadCellNonlinearity(0.05)]))
    size = np.linalg.norm(bent, axis=1, keepdims=True)
    np.testing.assert_allclose(bent / (1 + 0.05 * size / size.max()), force_of(clean))
    friction = observe(exact, SHEET, mesh, [Friction(0.26, 0.0)])
    sign = np.array([[1.0], [1.0], [-1.0]])  # of FACTORS
    np.testing.assert_allclose(force_of(friction) - force_of(clean), 0.26 * sign * direction)
    guided = force_of(observe(exact, SHEET, mesh, [Friction(0.0, 0.26)]))
    np.testing.assert_allclose(guided - force_of(clean), 0.26 * sign * guided / np.linalg.norm(guided, axis=1).max())
    gain = observe(exact, SHEET, mesh, [ForceGain(0.05)])
    np.testing.assert_allclose(force_of(gain), 1.05 * force_of(clean))


@pytest.mark.parametrize("wrong", [ForceOffset(0.26), ForceDrift(0.26), Friction(0.26, 0.1), LoadCellNonlinearity(0.1)])
def test_a_grip_without_a_force_reads_none(wrong):
    none = np.zeros((3, 2))
    np.testing.assert_array_equal(wrong.forces(none, TIMES), none)


@pytest.mark.parametrize("affine", [True, False])
def test_smoothing_adds_half_the_variance_times_the_laplacian(exact, mesh, clean, affine):
    """Inside: 0.004 x^2 has the Laplacian 0.008, and the variance of a square is side^2 / 12."""
    smoothing = SubsetSmoothing(3.0, affine)
    seen = observe(exact, SHEET, mesh, [smoothing])
    interior = (np.abs(mesh.points) < 18.4).all(axis=1)
    s2 = smoothing.label()["amplitudes"]["s2"]
    expected = FACTORS[:, None] * 0.008 * s2 / 2
    change = (seen.displacements - clean.displacements)[:, interior]
    np.testing.assert_allclose(change[..., 0], np.broadcast_to(expected, change.shape[:2]), atol=1e-9)
    np.testing.assert_allclose(change[..., 1], 0, atol=1e-9)


def test_smoothing_at_an_edge(mesh):
    """A straining subset reads a linear field exactly; a mean is that of the half that is there."""
    linear = solution(SHEET, lambda x: np.column_stack([0.3 * x[:, 0], 0.1 * x[:, 0] - 0.2 * x[:, 1]]))
    true = observe(linear, SHEET, mesh).displacements
    strained = observe(linear, SHEET, mesh, [SubsetSmoothing(3.0)]).displacements
    np.testing.assert_allclose(strained, true, atol=1e-9)
    mean = observe(linear, SHEET, mesh, [SubsetSmoothing(3.0, affine=False)]).displacements
    right = np.flatnonzero((mesh.points[:, 0] == 20) & (np.abs(mesh.points[:, 1]) < 15))
    np.testing.assert_allclose(mean[1, right, 0] - true[1, right, 0], 0.3 * -0.75, atol=1e-9)


def test_a_plane_misreads_a_parabola_at_an_edge(exact, mesh, clean):
    """On half a square a plane through x^2 reads -side^2 / 24 at the edge, where the whole one reads side^2 / 12."""
    seen = observe(exact, SHEET, mesh, [SubsetSmoothing(3.0)])
    right = np.flatnonzero((mesh.points[:, 0] == 20) & (np.abs(mesh.points[:, 1]) < 15))
    change = (seen.displacements - clean.displacements)[1, right, 0]
    np.testing.assert_allclose(change, 0.004 * -(3.0**2) / 24, rtol=0.02)


def test_strip_is_as_wide_as_it_says():
    """Nodes of free edges are w inside, those of the hole w away from it, those of grips stay on their line."""
    plate = solution(PLATE)
    mesh = triangles(PLATE, n_nodes=1400)
    seen = observe(plate, PLATE, mesh, [UnmeasuredStrip(0.3)])
    held = np.abs(mesh.points[:, 0]) == 30
    hole = mesh.boundary_nodes("hole_0")
    sides = np.flatnonzero(np.abs(mesh.points[:, 1]) == 15)
    np.testing.assert_allclose(np.linalg.norm(seen.points[hole], axis=1), 5.3, atol=0.002)
    np.testing.assert_allclose(np.abs(seen.points[sides, 1]), 14.7, atol=1e-9)
    np.testing.assert_allclose(np.abs(seen.points[held, 0]), 30, atol=1e-9)
    assert Mesh(seen.points, seen.triangles, "triangle", {}).quality.min() > 0.5
    np.testing.assert_allclose(seen.displacements, plate.evaluate(seen.points), atol=1e-9)
    assert np.linalg.norm(seen.points - mesh.points, axis=1).max() < 0.3 + 1e-9
    assert set(sides) - set(np.flatnonzero(held)) <= set(seen.free_nodes)


def test_lag_reads_later():
    """Instants and factors of a path with a turn, the last line continued; forces are those of the readings."""
    lag = Lag(0.25)
    factors, times = lag.schedule(FACTORS, TIMES)
    np.testing.assert_allclose(times, [1, 1.25, 2, 2.25, 3, 3.25])
    np.testing.assert_allclose(factors, [0.4, 0.55, 1.0, 0.925, 0.7, 0.625])
    mesh = Mesh(np.zeros((9, 2)), np.arange(9)[None], "quad", {})
    zero = np.zeros(6)
    all_of_it = SurfaceSolution(
        mesh, factors[:, None, None] * np.ones((6, 9, 2)), {"right": np.column_stack([factors, zero])},
        times, zero, zero.astype(int), 1.0,
    )  # fmt: skip
    seen = lag.split(all_of_it, TIMES)
    np.testing.assert_allclose(seen.displacements[:, 0, 0], FACTORS)
    np.testing.assert_allclose(seen.reactions["right"][:, 0], [0.55, 0.925, 0.625])
    np.testing.assert_array_equal(seen.time, TIMES)
    with pytest.raises(OptionError, match="before the test"):
        Lag(-1.5).schedule(FACTORS, TIMES)


def test_two_disturbances_act_one_after_the_other(exact, mesh, clean):
    """The turned picture magnified; the offset beside them."""
    seen = observe(exact, SHEET, mesh, [Rotation(0.1), Scale(0.05), ForceOffset(0.5)])
    turned = observe(exact, SHEET, mesh, [Rotation(0.1)])
    np.testing.assert_allclose(seen.displacements, 1.05 * turned.displacements, atol=1e-12)
    assert np.linalg.norm(force_of(seen)[0] - force_of(clean)[0]) == pytest.approx(0.5)


def test_inside():
    points = np.array([[0.0, 0.0], [5.0, 0.0], [5.01, 0.0], [4.99, 0.0], [29.9, 14.9], [30.1, 0.0], [30.0, 3.0]])
    np.testing.assert_array_equal(inside(PLATE, points), [False, True, True, False, True, False, True])


def test_amplitudes_are_numbers():
    with pytest.raises(OptionError, match="finite"):
        LensDistortion(np.nan)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_warp_is_a_length_that_is_regained(exact, mesh, clean, axis):
    """By the length of the arc: over a span dx the sheet is sqrt(dx^2 + dz^2) long, z = h exp(-(s - p)^2 / (2 w^2))."""
    warp = Warp(axis, 0.05, 3.0, 6.0)
    seen = observe(exact, SHEET, mesh, [warp])
    regained = seen.displacements - clean.displacements
    np.testing.assert_allclose(regained[1:], regained[:1].repeat(2, axis=0), atol=1e-12)
    assert not regained[..., 1 - axis].any()
    np.testing.assert_array_equal(force_of(seen), force_of(clean))
    s, x = mesh.points[:, axis], seen.points[:, axis]
    order = np.argsort(s)
    fine = np.linspace(s.min(), s.max(), 20001)
    z = 0.05 * 6.0 * np.exp(0.5) * np.exp(-((fine - 3.0) ** 2) / (2 * 6.0**2))  # small slopes: dz/ds = sin theta
    span = np.interp(s[order], fine, np.concatenate([[0], np.cumsum(np.sqrt(np.diff(fine) ** 2 - np.diff(z) ** 2))]))
    np.testing.assert_allclose(np.diff(x[order]), np.diff(span), atol=3e-6)
