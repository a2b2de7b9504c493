"""Readings of subsets on a field that is known: exact inside, as by the moments of a square at an edge, and between two sides."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from calibrate.effects.support.borders import subset_moments
from calibrate.effects.support.finite_element_field import FieldMesh, FiniteElementField
from calibrate.effects.support.twin_kinematics import Subsets, edge_gradients, sides_of_subsets, subset_readings

H = np.array([[[0.3, -0.2], [-0.2, 0.5]], [[-0.1, 0.4], [0.4, 0.2]]])  # 1/mm, second derivatives of both components
BASIS = np.array([[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]])


def quadratic() -> FiniteElementField:
    """A field of second derivatives H and gradient 0 at the origin on x < 0: six "nodes" that are its monomials, behind the point in the origin."""
    values = np.array([[h[0, 0] / 2, h[0, 1], h[1, 1] / 2] for h in H]).T
    nodal = np.concatenate([np.zeros((4, 2)), values])[None]

    def shares(places):
        monomials = np.stack([places[:, 0] ** i * places[:, 1] ** j for i, j in BASIS], axis=1)
        nodes = np.broadcast_to(np.arange(1, 7), monomials.shape)
        return nodes, monomials, places[:, 0] < 1e-12

    def slopes(places):
        x, y = places.T
        o, i = np.zeros_like(x), np.ones_like(x)
        along = np.stack([o, i, o, 2 * x, y, o], axis=1), np.stack([o, o, i, o, x, 2 * y], axis=1)
        return np.broadcast_to(np.arange(1, 7), (len(places), 6)), np.stack(along, axis=-1)

    return FiniteElementField(nodal, FieldMesh(b"quadratic", 7, shares, slopes))


def where(name, inside) -> FiniteElementField:
    """The same field in another specimen."""
    field = quadratic()
    shares = lambda p: (*field.mesh.shares(p)[:2], inside(p))  # noqa: E731
    return FiniteElementField(field.displacements, FieldMesh(name, 7, shares, field.mesh.slopes))


def test_what_is_kept_of_a_mesh_serves_other_fields_on_it_and_no_other_place():
    """Readings are linear in the field; of another side, or another distance from the edges, they are others."""
    field, at = quadratic(), np.zeros((1, 2))
    found = subset_readings(field, at, np.array([0.0]), 0.7)
    twice = FiniteElementField(2 * field.displacements, field.mesh)
    np.testing.assert_allclose(subset_readings(twice, at, np.array([0.0]), 0.7), 2 * found, rtol=1e-12)
    assert not np.allclose(subset_readings(field, at, np.array([9.0]), 0.7), found)
    assert not np.allclose(
        subset_readings(where(b"everywhere", lambda p: np.ones(len(p), bool)), at, np.array([0.0]), 0.7), found
    )


def test_a_whole_square_reads_half_the_laplacian():
    """Summed over Gauss points where no edge is near, and over cells else."""
    inside = where(b"everywhere", lambda p: np.ones(len(p), bool))
    for distance in (9.0, 0.0):
        found = subset_readings(inside, np.zeros((1, 2)), np.array([distance]), 0.7)
        np.testing.assert_allclose(found[0, 0], 0.5 * np.trace(H, axis1=1, axis2=2), rtol=1e-9)


@pytest.mark.parametrize("side", [0.3, 2.0])
def test_a_square_at_an_edge_reads_what_its_moments_say(side):
    found = subset_readings(quadratic(), np.zeros((1, 2)), np.array([0.0]), side)
    far = [1e6, 1.0, 0.0, 0.0]
    moments = np.asarray(subset_moments(jnp.array([[[0.0, 1.0, 0.0, 0.0], far]]), side))[0]
    np.testing.assert_allclose(found[0, 0], 0.5 * np.einsum("ij,cij->c", moments, H), rtol=0.02, atol=0.002)


def test_where_too_little_of_a_square_is_inside_for_a_plane_nothing_is_read():
    one = where(b"in little", lambda p: p[:, 0] < -0.64)
    found = subset_readings(one, np.zeros((1, 2)), np.array([0.0]), 1.4)  # one column of cells
    np.testing.assert_array_equal(found, 0.0)


def test_between_two_sides_readings_are_linear_in_the_logarithm_and_beyond_those_of_the_end():
    sides = sides_of_subsets(1.0)
    readings = np.arange(float(len(sides)))[:, None, None, None] * np.ones((1, 1, 2))
    subsets = Subsets(jnp.asarray(sides), jnp.asarray(readings), jnp.asarray(0.1 * readings))
    for side, expected in ((sides[3], 3.0), (np.sqrt(sides[3] * sides[4]), 3.5), (0.01, 0.0), (1e3, len(sides) - 1)):
        np.testing.assert_allclose(subsets.at(side), expected, atol=1e-9)
        np.testing.assert_allclose(subsets.doubted().at(side), 1.1 * expected, atol=1e-9)


def test_gradients_at_an_edge_are_means_over_it():
    """Of a linear gradient: that in its middle; and at the centroid."""
    points = np.array([[0.0, -1.0], [0.0, 2.0], [-1.0, 0.5]])
    centroids = points.mean(axis=0)[None]
    found = edge_gradients(quadratic(), points, centroids, np.array([[0, 1]]))
    for place, F in zip((centroids[0], [0.0, 0.5]), found[:, 0, 0], strict=True):
        np.testing.assert_allclose(F, np.eye(2) + H @ place, atol=2e-3)
