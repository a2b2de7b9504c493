"""An inclusion: of the triangles that its edge cuts, places that are tried, and what it is in a replay."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import ufl
from made_up import made_up_chain

from calibrate.diagnosis.parameters import Variables
from calibrate.effects.chain import Addition
from calibrate.effects.inclusion import GRID, Inclusion, corners, half_axes
from forward.sheet.damage_and_dispersion import RectangularInclusion, SquircularInclusion, TriangularInclusion
from studies.synthetic import effect_laws
from studies.trials.blind_data import draw
from studies.trials.blind_trial import SPECIMENS
from studies.trials.foreign import foreign, laws


@pytest.fixture(scope="module")
def data():
    return made_up_chain(fine=2).data


def factor(data, a, shape):
    one = np.ones((1, len(data.triangles), 1, 1))
    return np.asarray(Inclusion().stress(data, None, one, np.array([a]), np.array(shape))).ravel()


@pytest.mark.parametrize("ellipse", [(0.21, 0.0, 0.0), (0.21, 0.3, -0.3), (0.15, -0.5, 0.1)])
def test_a_cut_triangle_counts_by_its_share_within(data, ellipse):
    """Against 5050 points in each triangle: a few per cent of the triangles that are cut, nothing in the mean."""
    shape, (long, short, angle) = (0.05, -0.1, *ellipse, 0.0, 0.0), half_axes(*ellipse)
    axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    weights = np.array([(i, j, 100 - i - j) for i in range(101) for j in range(101 - i)]) / 100
    corners = (np.asarray(data.points) - np.asarray(data.centre))[np.asarray(data.triangles)] / float(data.size)
    places = np.einsum("kc,mcd->mkd", weights, corners) - shape[:2]
    inside = np.linalg.norm(places @ axes.T / [long, short], axis=2) < 1
    share, found = inside.mean(axis=1), factor(data, 1.0, shape) - 1
    cut = (share > 0) & (share < 1)
    assert cut.sum() > 20
    assert np.abs(found - share)[~cut].max() < 0.1
    assert np.sqrt(np.mean((found - share)[cut] ** 2)) < 0.08
    assert found @ np.asarray(data.areas) == pytest.approx(share @ np.asarray(data.areas), rel=0.01)


def test_every_place_of_the_specimen_is_within_a_circle_that_is_tried(data):
    tried = np.array(Inclusion().shape_values(data))
    places = (np.asarray(data.centroids) - np.asarray(data.centre)) / float(data.size)
    for along, radius in GRID:
        centres = tried[tried[:, 2] == radius, :2]
        nearest = np.linalg.norm(places[:, None] - centres, axis=2).min(axis=1)
        assert 0 < len(centres) <= along**2
        assert nearest.max() < 0.75 / along


def test_its_place_is_told_in_the_picture(data):
    x, y = np.asarray(data.centre) + float(data.size) * np.array([0.1, -0.2])
    assert (
        Inclusion().located(data, (0.1, -0.2, 0.25, 0.0, 0.0, 0.0, 0.0))
        == f"within {0.25 * float(data.size):.3g} mm of ({x:.3g}, {y:.3g}) mm"
    )


def test_an_ellipse_is_told_by_its_half_axes(data):
    told = Inclusion().located(data, (0.0, 0.0, 0.25, *(0.5 * np.array([np.cos(0.8), np.sin(0.8)])), 0.1, 0.0))
    long, short = (0.25 * float(data.size) * np.exp(e) for e in (0.5, -0.5))
    assert told.startswith(f"within {long:.3g} mm by {short:.3g} mm, the long axis at 23 degrees to x")


@pytest.mark.parametrize("e1", [0.0, 0.4])
def test_a_shape_is_smooth_where_it_is_an_ellipse(data, e1):
    """Derivatives by it there are those of central differences, at the place in the middle, too."""
    shape = np.array([0.05, -0.1, 0.21, e1, 0.0, 0.0, 0.0])

    def stiffness(at):
        one = jnp.ones((1, len(data.triangles), 1, 1))
        return Inclusion().stress(data, None, one, jnp.array([1.0]), at).ravel()

    found, h = np.asarray(jax.jacfwd(stiffness)(jnp.asarray(shape))), 1e-5
    expected = np.stack([(stiffness(shape + d) - stiffness(shape - d)) / (2 * h) for d in h * np.eye(7)], axis=1)
    assert np.abs(found).max(axis=0).min() > 0.03
    assert found == pytest.approx(expected, abs=1e-3 * np.abs(expected).max())


def test_a_place_at_the_middle_has_a_size(data):
    """A fit moves it by a share of the sheet, not of its own value, which is 0."""
    held = Variables((Addition(Inclusion(), (0.1,), (0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0)),))
    assert held.scale[1:].tolist() == pytest.approx([0.1, 0.1, 0.1, 0.5, 0.5, 1.0, 1.0])
    lower, upper = held.bounds(())
    assert (upper[1:3] - lower[1:3] > 0.05).all()
    assert np.isfinite(held.shape_deviations[1:]).all()
    assert (held.shape_deviations[1:] > 0.05).all()


def of_rectangle(long, short, angle):
    """Shape, beside its place, of a rectangle of these half sides."""
    e, radius = 0.5 * np.log(long / short), 2 * np.sqrt(long * short / np.pi)
    return (
        radius,
        e * np.cos(2 * angle),
        e * np.sin(2 * angle),
        *(4.0 * np.array([np.cos(4 * angle), np.sin(4 * angle)])),
    )


@pytest.mark.parametrize("rectangle", [(0.3, 0.15, 0.4), (0.2, 0.2, 1.1), (0.25, 0.2, 0.0)])
def test_a_rectangle_is_one_of_its_shapes(data, rectangle):
    """Shares of triangles are those of a rectangle, by points in each, as those of an ellipse are."""
    (long, short, angle), place = rectangle, np.array([0.05, -0.1])
    axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    weights = np.array([(i, j, 50 - i - j) for i in range(51) for j in range(51 - i)]) / 50
    spots = (np.asarray(data.points) - np.asarray(data.centre))[np.asarray(data.triangles)] / float(data.size)
    apart = (np.einsum("kc,mcd->mkd", weights, spots) - place) @ axes.T
    share = (np.abs(apart / [long, short]) < 1).all(axis=2).mean(axis=1)
    found = factor(data, 1.0, (*place, *of_rectangle(*rectangle))) - 1
    cut = (share > 0) & (share < 1)
    assert np.sqrt(np.mean((found - share)[cut] ** 2)) < 0.1
    assert found @ np.asarray(data.areas) == pytest.approx(share @ np.asarray(data.areas), rel=0.01)
    expected = np.array([[a, b] for a in (long, -long) for b in (short, -short)]) @ axes
    told = corners(of_rectangle(*rectangle))
    assert max(np.linalg.norm(told - one, axis=1).min() for one in expected) < 0.01


def is_inside(law, places):
    """Of an inclusion of the forward model, at places (m, 2), mm."""
    fields = [ufl.as_ufl(v) for v in law.values]
    return np.array(
        [float(law.field(ufl.as_vector([ufl.as_ufl(float(v)) for v in one]), fields)) != 1 for one in places]
    )


def test_outlines_of_the_forward_model_are_those_of_the_diagnosis(data):
    """Of both squircles, and of a triangle, a rectangle and an ellipse the areas."""
    extent = effect_laws.Extent(float(data.size), tuple(np.asarray(data.centre).tolist()))
    rng, shape = (
        np.random.default_rng(1),
        {"x": 0.1, "y": -0.05, "radius": 0.25, "e1": -0.2, "e2": 0.3, "q1": 0.8, "q2": -1.1},
    )
    law = effect_laws.ADDITIONS["inclusion"]({"a": 1.0}, shape, extent)
    stiff = factor(data, 1.0, tuple(shape.values())) - 1
    chosen = rng.choice(np.flatnonzero(np.abs(stiff - 0.5) > 0.4), 300)
    assert ((stiff > 0.5)[chosen] == is_inside(law, np.asarray(data.centroids)[chosen])).all()
    assert 50 < (stiff > 0.5)[chosen].sum() < 250


def test_a_foreign_trial_labels_a_rectangle_as_the_catalogue_has_it():
    """What it solves and what its label says have one outline, but for the corners."""
    trial = foreign(draw(3, "inclusion"))
    hidden, (law,) = trial.effects[0], laws(trial).additions
    assert type(law) is RectangularInclusion
    extent = effect_laws.Extent(2 * max(SPECIMENS[trial.specimen].half_extent))
    told = effect_laws.ADDITIONS["inclusion"](hidden.amplitudes, hidden.shape, extent)
    places = np.array([law.x, law.y]) + np.random.default_rng(2).uniform(-1.5, 1.5, (600, 2)) * law.long
    one, other = is_inside(law, places), is_inside(told, places)
    assert 50 < one.sum() < 550
    assert (one != other).mean() < 0.01


@pytest.mark.parametrize(
    ("law", "area", "error"),
    [
        *((SquircularInclusion(1.0, 0.0, 0.0, 0.5, 0.3, 0.7, square, 0.3), np.pi, 0.01) for square in (0.4, 0.8)),
        *((SquircularInclusion(1.0, 0.0, 0.0, 0.5, 0.3, 0.7, square, 0.3), np.pi, 0.002) for square in (0.0, 1.0)),
        (RectangularInclusion(1.0, 0.0, 0.0, 0.5, 0.3, 0.7), 4.0, 0.002),
        (TriangularInclusion(1.0, 0.0, 0.0, 0.5, 0.3, 0.7), np.pi, 0.002),
    ],
)
def test_areas_of_outlines(law, area, error):
    """By the distance of the outline along rays, halved: that of an ellipse of the same half axes, within a hundredth between ellipse and parallelogram; of the rectangle that of its sides."""
    angles = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    rays, low, high = np.stack([np.cos(angles), np.sin(angles)], axis=1), np.zeros(60), np.ones(60)
    for _ in range(9):
        middle = (low + high) / 2
        inside = is_inside(law, middle[:, None] * rays)
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    assert np.pi * np.mean(((low + high) / 2) ** 2) == pytest.approx(0.15 * area, rel=error)


def test_the_forward_model_has_it_at_the_same_place():
    extent = effect_laws.Extent(40.0, (3.0, 4.0))
    shape = {"x": 0.1, "y": -0.2, "radius": 0.25, "e1": 0.0, "e2": 0.4, "q1": 0.0, "q2": 0.0}
    law = effect_laws.ADDITIONS["inclusion"]({"a": 0.3}, shape, extent)
    assert (law.height, law.x, law.y) == pytest.approx((0.3, 7.0, -4.0))
    assert (law.long, law.short, law.angle) == pytest.approx((10 * np.exp(0.4), 10 * np.exp(-0.4), np.pi / 4))


def test_an_ellipse_of_equal_axes_is_a_circle():
    place = ufl.as_vector([ufl.as_ufl(1.2), ufl.as_ufl(0.4)])
    values = []
    for short, angle in ((1.5, 0.0), (0.3, 0.0), (0.3, np.arctan2(0.4, 1.2))):
        p = tuple(map(ufl.as_ufl, (0.5, 0.0, 0.0, 1.5, short, angle, 0.0, 0.0)))
        values.append(float(SquircularInclusion(0.5, 0.0, 0.0, 1.5, short, angle).field(place, p)))
    assert values == [1.5, 1.0, 1.5]  # within the circle; beside a flat ellipse; within one that is turned to it
