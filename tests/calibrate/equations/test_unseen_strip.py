"""Equations of a region of interest that ends before the free edges: exact for affine fields, and what is lost without the strip."""

from dataclasses import replace

import numpy as np
import pytest

from calibrate.data.experiment import Experiment, LoadedBoundary
from calibrate.data.outline import Outline
from calibrate.equations.basis import basis_for
from calibrate.equations.equilibrium import neo_hooke
from calibrate.equations.unseen_strip import (
    WindowEquilibrium,
    quadratic_gradients,
    section_fields,
    window_equilibrium,
)
from calibrate.errors import ConfigError
from meshes import Strip, triangles

MU, THICKNESS, WIDTH, MARGIN = 0.4, 2.0, 30.0, 2.5
STRETCHES = np.array([1.3, 2.0])


@pytest.fixture(scope="module")
def uniaxial():
    """The middle 25 mm of a strip 30 mm wide in uniaxial tension; forces are those of 30 mm."""
    mesh = triangles(Strip(half_length=20.0, half_width=WIDTH / 2 - MARGIN, far_size=2.0))
    x, y = mesh.points.T
    u = np.array([np.column_stack([(s - 1) * x, (s**-0.5 - 1) * y]) for s in STRETCHES])
    force = WIDTH * THICKNESS * MU * (STRETCHES - STRETCHES**-2)
    zero = np.zeros(len(force))
    loaded = tuple(
        LoadedBoundary(name, mesh.boundary_nodes(name), np.column_stack([sign * force, zero]))
        for name, sign in (("left", -1.0), ("right", 1.0))
    )
    return Experiment("strip", mesh.points, mesh.cells, u, loaded, np.zeros(0, int), thickness=THICKNESS)


def residual(system):
    basis = basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2))
    c = neo_hooke(basis, MU)
    return np.array([system.matrix(basis, F) @ c for F in system.deformation_gradients]) - system.loads, basis, c


def test_every_equation_holds_in_uniaxial_tension(uniaxial):
    """The whole section carries the force, and nothing else is assumed: all residuals vanish, sections among them."""
    system = window_equilibrium(uniaxial, MARGIN, 5.0)
    found, basis, c = residual(system)
    size = np.abs(system.loads).max()
    assert np.abs(found).max() < 1e-9 * size
    assert np.abs(system.strip_error(basis, c, 1)).max() < 1e-9 * size


def test_without_the_strip_a_sixth_of_the_force_is_missing(uniaxial):
    system = window_equilibrium(uniaxial, 0.0, 5.0)
    held = np.concatenate([b.nodes for b in uniaxial.loaded])
    free = replace(uniaxial, free_nodes=np.setdiff1d(Outline.of(uniaxial).rim, held))
    assert not isinstance(system, WindowEquilibrium)
    found, _, _ = residual(window_equilibrium(free, 0.0, 5.0))
    assert np.abs(found).max() == pytest.approx(np.abs(system.loads).max() * 2 * MARGIN / WIDTH, rel=0.05)


def test_the_rim_is_where_the_region_ends_beside_a_free_side(uniaxial):
    edges = Outline.of(uniaxial).rim
    np.testing.assert_allclose(np.abs(uniaxial.points[edges][:, :, 1]), WIDTH / 2 - MARGIN)
    assert np.ptp(uniaxial.points[edges], axis=1)[:, 0].sum() == pytest.approx(2 * 40.0)


def test_no_field_works_on_an_unknown_traction(uniaxial):
    """Fields inside vanish on the rim; those that do not are 1 on one grip, or 0 on both, so that only resultants do work."""
    fields = section_fields(uniaxial, 5.0)
    values = fields.values.toarray()
    sections = np.abs(values[np.unique(Outline.of(uniaxial).rim)]).max(axis=0) > 0
    assert (fields.boundary[~sections] == -1).all()
    assert sorted(fields.boundary[sections])[-2:] == [0, 1]
    assert sections.sum() > 4
    for i, grip in enumerate(uniaxial.loaded):
        expected = np.where(fields.boundary == i, 1.0, 0.0)
        np.testing.assert_allclose(values[grip.nodes], np.broadcast_to(expected, values[grip.nodes].shape), atol=1e-12)


def test_quadratic_displacements_are_continued_exactly():
    rng = np.random.default_rng(0)
    points = rng.uniform(-5, 5, (200, 2))
    x, y = points.T
    u = 1 + 0.3 * x - 0.2 * y + 0.05 * x**2 - 0.02 * x * y + 0.04 * y**2
    centres, places = np.array([[5.0, 0.0], [0.0, -5.0]]), np.array([[6.5, 0.0], [0.3, -7.0]])
    for operator, where in zip(quadratic_gradients(points, centres, places, 4.0), (places, centres), strict=True):
        a, b = where.T
        expected = np.column_stack([0.3 + 0.1 * a - 0.02 * b, -0.2 - 0.02 * a + 0.08 * b])
        np.testing.assert_allclose((operator @ u).reshape(-1, 2), expected, atol=1e-10)


def test_a_negative_margin_is_refused(uniaxial):
    with pytest.raises(ConfigError, match="margin of -1"):
        window_equilibrium(uniaxial, -1.0)
