"""Recovered kinematics: exact for what they can represent, rates of convergence, areas between curved edges."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import norm
from synthetic import ArrudaBoyce, derivatives, plate, rotation

from calibrate.data.experiment import Noise
from calibrate.data.triangulation import boundary_nodes
from calibrate.equations import recovery, reduction
from calibrate.equations.basis import basis_for
from calibrate.equations.equilibrium import Equilibrium
from calibrate.equations.kinematics import gradient_operator, shape_gradients
from calibrate.equations.virtual_fields import virtual_fields
from calibrate.fitting import network_fit
from studies.accuracy.pulls import clean_cross


def grid(n: int, m: int | None = None, jitter: float = 0.2, seed: int = 0):
    """Unit square (or n cells by m) whose inner nodes are moved at random by `jitter` cells, straight diagonals."""
    m = m or n
    x, y = np.meshgrid(np.arange(n + 1.0), np.arange(m + 1.0), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel()])
    corner = (np.arange(n)[:, None] * (m + 1) + np.arange(m)).ravel()
    triangles = np.concatenate([np.column_stack([corner, corner + m + 1, corner + m + 2]),
                                np.column_stack([corner, corner + m + 2, corner + 1])])  # fmt: skip
    inner = np.setdiff1d(np.arange(len(points)), boundary_nodes(triangles))
    points[inner] += np.random.default_rng(seed).uniform(-jitter, jitter, (len(inner), 2))
    return points / n, triangles


def annulus(n: int, inner: float = 1.0, outer: float = 2.0, squeeze: float = 1.0):
    """Ring of n edges around, its y coordinates times `squeeze`, and its area."""
    theta = 2 * np.pi * np.arange(n) / n
    radii = np.linspace(inner, outer, max(n // 6, 1) + 1)
    points = (radii[:, None, None] * np.stack([np.cos(theta), np.sin(theta)], axis=1)).reshape(-1, 2) * [1, squeeze]
    i, j = np.meshgrid(np.arange(len(radii) - 1), np.arange(n), indexing="ij")
    a, b = (i * n + j).ravel(), (i * n + (j + 1) % n).ravel()
    triangles = np.concatenate([np.column_stack([a, a + n, b + n]), np.column_stack([a, b + n, b])])
    return points, triangles, np.pi * (outer**2 - inner**2) * squeeze


def kept(points, triangles, keep):
    """Mesh of some of the triangles."""
    nodes, inverse = np.unique(triangles[keep], return_inverse=True)
    return points[nodes], inverse.reshape(-1, 3)


def ragged(seed: int = 1):
    """A region that lost a seventh of its triangles: jagged edges, holes, nodes where two of them meet."""
    points, triangles = grid(16, seed=seed)
    return kept(points, triangles, np.random.default_rng(seed).random(len(triangles)) > 1 / 7)


def quadratics(x):
    """Quadratic fields (n, 6) and their gradients (n, 6, 2)."""
    X, Y = x.T
    one, zero = np.ones_like(X), np.zeros_like(X)
    slope_x, slope_y = [zero, one, zero, 2 * X, Y, zero], [zero, zero, one, zero, X, 2 * Y]
    return np.column_stack([one, X, Y, X**2, X * Y, Y**2]), np.stack([slope_x, slope_y]).transpose(2, 1, 0)


def centroid_values(operator, nodal):
    """Gradients (m, fields, 2) of nodal fields (n, fields)."""
    return (operator @ nodal).reshape(-1, 2, nodal.shape[1]).swapaxes(1, 2)


TWO = np.array([[0.0, 0.0], [1.0, 0.1], [1.2, 1.0], [0.1, 0.9]]), np.array([[0, 1, 2], [0, 2, 3]])
MESHES = {
    "one triangle": (TWO[0][:3], TWO[1][:1]),
    "two triangles": TWO,
    "row of squares": grid(12, 1),
    "square": grid(8),
    "plate": plate()[:2],
    "ragged": ragged(),
}
RICH = ["square", "plate"]


# gradients


@pytest.mark.parametrize("name", MESHES)
def test_gradients_of_linear_fields_are_exact(name):
    points, triangles = MESHES[name]
    nodal = quadratics(points)[0][:, :3]
    found = centroid_values(recovery.centroid_gradients(points, triangles), nodal)
    exact = quadratics(points[triangles].mean(axis=1))[1][:, :3]
    np.testing.assert_allclose(found, exact, atol=1e-10)


@pytest.mark.parametrize("name", RICH)
def test_gradients_of_quadratic_fields_are_exact(name):
    """Everywhere, corners and holes included, where two rings determine a quadratic."""
    points, triangles = MESHES[name]
    points = points / np.abs(points).max()
    nodal, slopes = quadratics(points)
    found = np.stack([D @ nodal for D in recovery.nodal_gradients(points, triangles)], axis=-1)
    np.testing.assert_allclose(found, slopes, atol=1e-11)
    found = centroid_values(recovery.centroid_gradients(points, triangles), nodal)
    np.testing.assert_allclose(found, quadratics(points[triangles].mean(axis=1))[1], atol=1e-11)


def smooth_field(x):
    """A field (n, 1) and its gradient (n, 1, 2)."""
    a, b = 2 * x[:, 0] + 0.3, 1.5 * x[:, 1] - 0.2
    slopes = np.column_stack([2 * np.cos(a) * np.exp(b), 1.5 * np.sin(a) * np.exp(b)])
    return (np.sin(a) * np.exp(b))[:, None], slopes[:, None]


def gradient_error(operator, points, triangles):
    found = centroid_values(operator, smooth_field(points)[0])
    return np.sqrt(np.mean((found - smooth_field(points[triangles].mean(axis=1))[1]) ** 2))


def rate(coarse, fine, refinement):
    return np.log(np.divide(coarse, fine)) / np.log(refinement)


@pytest.mark.parametrize("mesh", [grid, lambda n: (plate(5 * n, n)[0] / 30, plate(5 * n, n)[1])], ids=["grid", "plate"])
def test_gradients_gain_an_order(mesh):
    """At least second order, corners and holes included, where linear triangles have the first."""
    errors = []
    for n in (8, 32):
        points, triangles = mesh(n)
        operators = [f(points, triangles) for f in (recovery.centroid_gradients, gradient_operator)]
        errors.append([gradient_error(operator, points, triangles) for operator in operators])
    recovered, linear = rate(*errors, 4)
    assert linear == pytest.approx(1, abs=0.1)
    assert recovered > 2
    assert errors[0][0] < 0.15 * errors[0][1]


def test_virtual_work_around_a_hole_gains_an_order():
    """u = x (1 + R^2 / r^2) is harmonic, and no flux enters the hole: int grad u . grad v = 0 for v = 0 at the sides.

    It takes both, gradients and areas: with the area of the polygon the second order remains.
    """
    errors = []
    for n in (8, 32):
        points, triangles, ring = plate(6 * n, n)
        x, y = points.T
        u = x * (1 + 8.0**2 / (x**2 + y**2))
        v = np.cos(np.pi * x / 60) * np.cos(np.pi * y / 60) * (1 + x / 20)
        linear, recovered = gradient_operator(points, triangles), recovery.centroid_gradients(points, triangles)
        polygon = shape_gradients(points, triangles)[1]
        curved = recovery.areas(points, triangles, np.flatnonzero(ring == 0))
        work = [np.repeat(areas, 2) * (operator @ u) @ (linear @ v)
                for operator, areas in ((linear, polygon), (recovered, polygon), (recovered, curved))]  # fmt: skip
        errors.append(np.abs(work))
    of_linear, of_polygon, of_both = rate(*errors, 4)
    assert of_linear == pytest.approx(2, abs=0.1)
    assert of_polygon < 2
    assert of_both > 3
    assert errors[0][2] < 0.05 * errors[0][0]


@pytest.mark.parametrize("name", MESHES)
def test_noise_is_that_of_linear_triangles(name):
    """White noise of displacements makes gradients no noisier in the mean, and nowhere a quarter more."""
    points, triangles = MESHES[name]
    recovered, linear = (norm(f(points, triangles), axis=1) for f in (recovery.centroid_gradients, gradient_operator))
    assert np.mean(recovered**2) <= (1 + 1e-12) * np.mean(linear**2)
    assert (recovered / linear).max() < 1.25


@pytest.mark.parametrize("offset", [0.0, 1e-6, 1e-4, 1e-2])
def test_a_row_of_squares_is_left_linear(offset):
    """Two lines of nodes determine no quadratic; a little off them they would, and multiply the noise 100 times."""
    points, triangles = MESHES["row of squares"]
    points = points + offset / 12 * np.random.default_rng(0).standard_normal(points.shape)
    noise = [norm(D, axis=1).max() for D in recovery.nodal_gradients(points, triangles)]
    assert max(noise) < 2 * 12


def test_a_node_without_triangle_has_no_gradient():
    points, triangles = MESHES["square"]
    with_one_more = recovery.nodal_gradients(np.vstack([points, [0.5, 0.5]]), triangles)
    for D, plain in zip(with_one_more, recovery.nodal_gradients(points, triangles), strict=True):
        assert D[-1:].nnz == 0
        np.testing.assert_array_equal(D[:-1, :-1].toarray(), plain.toarray())


# areas


@pytest.mark.parametrize("squeeze", [1.0, 0.6], ids=["circles", "ellipses"])
def test_areas_between_curved_edges_gain_two_orders(squeeze):
    errors = []
    for n in (24, 96):
        points, triangles, exact = annulus(n, squeeze=squeeze)
        found = recovery.areas(points, triangles, boundary_nodes(triangles))
        errors.append([abs(found.sum() - exact), abs(shape_gradients(points, triangles)[1].sum() - exact)])
    curved, polygon = rate(*errors, 4)
    assert polygon == pytest.approx(2, abs=0.01)
    assert curved == pytest.approx(4, abs=0.1)
    assert errors[0][0] < 0.01 * errors[0][1]


def test_bulges_lie_on_the_circle():
    """The middle of a chord is moved to the circle, outwards on the rim, inwards into the specimen at the hole, but for the fourth order."""
    for n in (24, 96):
        points, triangles, _ = annulus(n)
        found = recovery.segments(points, triangles, boundary_nodes(triangles))
        middle = points[found.edges].mean(axis=1) + found.bulges(points)
        radius = np.linalg.norm(points[found.edges[:, 0]], axis=1)
        np.testing.assert_allclose(np.linalg.norm(middle, axis=1), radius, atol=2 * (2 * np.pi / n) ** 4 / 100)


def test_a_hole_takes_area_away_and_a_rim_adds_it():
    points, triangles, _ = annulus(24)
    radius = np.linalg.norm(points, axis=1)
    plain = shape_gradients(points, triangles)[1]
    for at, sign in ((1.0, -1), (2.0, 1)):
        gain = recovery.areas(points, triangles, np.flatnonzero(np.isclose(radius, at))) - plain
        assert np.count_nonzero(gain) == 24
        theta = 2 * np.pi / 24
        np.testing.assert_allclose(gain.sum(), sign * 12 * at**2 * (theta - np.sin(theta)), rtol=0.01)


def test_holes_do_not_disturb_each_other():
    """Two rings in one mesh, and what lies between free and other nodes stays straight."""
    points, triangles, exact = annulus(48)
    both = np.vstack([points, points + [5.0, 0.0]]), np.vstack([triangles, triangles + len(points)])
    nodes = boundary_nodes(both[1])
    assert recovery.areas(*both, nodes).sum() == pytest.approx(2 * exact, rel=1e-5)
    upper = nodes[both[0][nodes, 1] > 0]
    plain = shape_gradients(*both)[1]
    gained = recovery.areas(*both, upper) - plain
    assert (gained[(both[0][both[1], 1] <= 0).any(axis=1)] == 0).all()
    # a circle gives the same curvature at every node, so that its ends are no exception
    full = recovery.areas(*both, nodes) - plain
    np.testing.assert_allclose(gained[gained != 0], full[gained != 0], rtol=1e-9)


@pytest.mark.parametrize("name", ["one triangle", "two triangles", "row of squares", "square"])
def test_straight_edges_and_corners_stay(name):
    points, triangles = MESHES[name]
    plain = shape_gradients(points, triangles)[1]
    found = recovery.areas(points, triangles, boundary_nodes(triangles))
    np.testing.assert_allclose(found, plain, rtol=1e-14)
    np.testing.assert_array_equal(recovery.areas(points, triangles, np.array([], np.int64)), plain)


def test_a_straight_edge_stays_beside_an_edge_that_is_not_free():
    """Of the bent line of the lower edge only the straight half is free."""
    points, triangles = grid(8)
    x, y = points.T
    bent = np.column_stack([x, y - np.where(x > 0.5, 0.4 * (x - 0.5), 0.0) * (1 - y)])
    free = np.flatnonzero((y == 0) & (x <= 0.5))
    plain = shape_gradients(bent, triangles)[1]
    np.testing.assert_array_equal(recovery.areas(bent, triangles, free), plain)


def test_jagged_edges_keep_the_area():
    """Steps of 45 degrees in and out: what each segment adds, another takes away."""
    points, triangles = grid(32, 4, jitter=0.0)
    points *= 32.0
    teeth = np.repeat([0.0, 1.0], 3)[np.arange(33) % 6]
    top = np.flatnonzero(points[:, 1] == 4)
    points[top, 1] += teeth
    plain = shape_gradients(points, triangles)[1]
    gain = recovery.areas(points, triangles, top) - plain
    assert np.count_nonzero(gain) > 15
    assert abs(gain.sum()) < 1e-12


def test_regions_that_meet_in_a_node_have_no_curve_there():
    """Two squares joined at a corner: its two pairs of free edges are told apart by no rule, so that both end there."""
    square, cells = grid(2, jitter=0.0)
    both = np.vstack([square, square + [1.0, 1.0]])
    triangles = np.vstack([cells, cells + len(square)])
    triangles[triangles == len(square)] = len(square) - 1
    points, triangles = kept(both, triangles, slice(None))
    nodes = boundary_nodes(triangles)
    np.testing.assert_allclose(recovery.areas(points, triangles, nodes), shape_gradients(points, triangles)[1])


@pytest.mark.parametrize("seed", range(3))
def test_no_segment_outgrows_its_triangle(seed):
    points, triangles = ragged(seed)
    share = recovery.areas(points, triangles, boundary_nodes(triangles)) / shape_gradients(points, triangles)[1]
    assert (np.abs(share - 1) <= 3 * recovery.SEGMENT + 1e-12).all()
    assert abs(np.mean(share) - 1) < 0.02


# what it is worth


@pytest.mark.slow
@pytest.mark.parametrize(
    ("nodes", "chi_square", "bias"),
    [
        (1300, (1.66, 0.117), ((-0.70, -0.33, -1.18), (-0.13, 0.00, -0.61))),
        (2484, (0.28, 0.011), ((-0.27, -0.09, -0.76), (-0.05, -0.02, -0.14))),
    ],
)
def test_the_perforated_cross(nodes, chi_square, bias):
    """The table of docs/method.md: biquadratic data at the nodes, exact but weighed as if they had noise.

    Chi-square a row of the residual of the true material, linear and recovered, and the bias of psi_1 at I1 = 3.5, 4, 5
    of the convex spline, %.
    """
    experiment = replace(clean_cross(nodes, 10), noise=Noise(0.1, 4.0, 0.0, 0.005))
    fields, I1 = virtual_fields(experiment), np.array([3.5, 4.0, 5.0])
    for linear in (True, False):
        system = Equilibrium(experiment, fields, linear)
        basis = basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2))
        truth = np.zeros((len(basis.site_inputs), 2))
        truth[:, 0] = slope_of_arruda_boyce(3 + basis.site_inputs[:, 0])
        assembled = reduction.assemble(system, basis)
        quadratic = assembled.quadratic(assembled.weights(basis.interpolation @ truth.ravel()))
        loss = quadratic.loss(basis.interpolation @ truth.ravel()) / quadratic.n_rows
        assert loss == pytest.approx(chi_square[0 if linear else 1], rel=0.05)
        c = network_fit.convex_spline(quadratic, "I1")
        found = basis.spline.matrix(np.sqrt((I1 - 3) / basis.top)) @ (quadratic.stiffness_factor(c) * c)
        error = 100 * (found / slope_of_arruda_boyce(I1) - 1)
        np.testing.assert_allclose(error, bias[0 if linear else 1], atol=0.03)


def slope_of_arruda_boyce(I1):
    return derivatives(ArrudaBoyce(), np.stack([I1, I1], axis=-1))[:, 0]


# invariances


@pytest.mark.parametrize("name", MESHES)
def test_numbering_does_not_matter(name):
    points, triangles = MESHES[name]
    rng = np.random.default_rng(0)
    order, elements = rng.permutation(len(points)), rng.permutation(len(triangles))
    new = np.argsort(order)
    other = points[order], np.roll(new[triangles], 1, axis=1)[elements]
    for found, expected in zip(both_of(*other), both_of(points, triangles), strict=True):
        expected = expected[elements][..., order] if expected.ndim == 3 else expected[elements]
        np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("name", MESHES)
def test_axes_do_not_matter(name):
    """After a rotation gradients turn with it; a shift and another unit of length change nothing else."""
    points, triangles = MESHES[name]
    Q = rotation(0.7)
    gradient, areas = both_of(points, triangles)
    turned, areas_turned = both_of(points @ Q.T * 25.4 + [100.0, -3.0], triangles)
    np.testing.assert_allclose(turned * 25.4, np.einsum("ij,mjn->min", Q, gradient), atol=1e-8 * np.abs(gradient).max())
    np.testing.assert_allclose(areas_turned, areas * 25.4**2, rtol=1e-9)


def both_of(points, triangles):
    """Gradient operator (m, 2, n) and areas (m,), all edges free."""
    operator = recovery.centroid_gradients(points, triangles).toarray().reshape(len(triangles), 2, -1)
    return operator, recovery.areas(points, triangles, boundary_nodes(triangles))
