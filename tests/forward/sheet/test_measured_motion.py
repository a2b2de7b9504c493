"""Nodes that move as measured: the same as a proportional loading where they do the same, and affine inside an affine boundary."""

from __future__ import annotations

import numpy as np
import pytest

from forward import Loading, NeoHooke
from forward.errors import LoadingError
from forward.loading import MeasuredMotion, moved
from forward.sheet.additions import CosineField, CubicPart
from forward.sheet.inelastic import solve_history
from forward.sheet.plane_stress import solve
from forward.sheet.thin_sheet import Sheet
from meshes import SquareSheet, quads

MESH = quads(SquareSheet(half_length=5.0, half_width=5.0, far_size=3.0))
EDGE = np.unique(np.concatenate([*MESH.boundaries.values()]))
STRETCH = np.diag([0.5, -0.2])


def boundary_motion(factors):
    """The whole boundary moved by factors (k,) of a homogeneous deformation."""
    held = np.zeros(MESH.points.shape, bool)
    held[EDGE] = True
    return MeasuredMotion(("left", "right"), held, np.asarray(factors)[:, None, None] * (MESH.points @ STRETCH))


def test_values_between_increments_lie_on_straight_lines():
    values = np.array([[1.0], [3.0], [2.0], [0.0]])
    for factor, expected in {
        0.0: 0.0,
        0.125: 0.5,
        0.25: 1.0,
        0.375: 2.0,
        0.5: 3.0,
        0.75: 2.0,
        0.9: 0.8,
        1.0: 0.0,
    }.items():
        assert moved(values, factor) == pytest.approx([expected])
    assert moved(np.array([2.0]), 0.3) == pytest.approx([0.6])


def test_an_affine_boundary_gives_an_affine_field_up_and_down():
    factors = [0.4, 1.0, 0.5, 0.05]
    found = solve_history(
        MESH, Sheet(NeoHooke(0.3)), boundary_motion(factors), np.arange(1, 5) / 4, [1.0, 2.0, 3.0, 4.0]
    )
    expected = np.asarray(factors)[:, None, None] * (MESH.points @ STRETCH)
    np.testing.assert_allclose(found.displacements, expected, atol=1e-9)
    F = np.eye(2) + STRETCH
    P11 = 0.3 * (F[0, 0] - 1 / (F[0, 0] ** 3 * F[1, 1] ** 2))
    assert found.reactions["right"][1, 0] == pytest.approx(10.0 * P11, rel=1e-8)


def test_it_is_the_proportional_loading_where_both_move_alike():
    loading = Loading.clamped(("left", "right"), 2.0)
    held, values = loading.on(MESH).prescribed(MESH)
    motion = MeasuredMotion(loading.sides, held, np.arange(1, 4)[:, None, None] / 3 * values)
    one, other = (solve(MESH, NeoHooke(0.3), way, 3) for way in (loading, motion))
    np.testing.assert_allclose(one.displacements, other.displacements, atol=1e-11)
    np.testing.assert_allclose(one.reactions["left"], other.reactions["left"], rtol=1e-10)


@pytest.mark.parametrize(
    ("held", "values", "message"),
    [
        (np.zeros(MESH.points.shape, bool), np.zeros((2, *MESH.points.shape)), "rigid body"),
        (np.ones((3, 2), bool), np.zeros((2, 3, 2)), "3 nodes"),
        (np.ones(MESH.points.shape, bool), np.full((2, *MESH.points.shape), np.nan), "finite"),
        (np.ones(MESH.points.shape, bool), np.zeros((2, 3, 2)), "do not fit"),
    ],
)
def test_motions_that_cannot_be(held, values, message):
    with pytest.raises(LoadingError, match=message):
        MeasuredMotion(("left",), held, values).on(MESH).prescribed(MESH)


def test_energy_of_a_cosine_field_and_of_a_cubic_part():
    """Homogeneous state: the field's mean over the left half of its box, 2 / pi a_10, and (I1 - 3)^3."""
    motion = boundary_motion([1.0])
    held = np.ones(MESH.points.shape, bool)
    motion = MeasuredMotion(motion.sides, held, (MESH.points @ STRETCH)[None])
    box = (-5.0, -5.0, 20.0, 10.0)  # the sheet is its left half
    plain, field, cubic = (
        solve_history(MESH, sheet, motion, [1.0], [1.0]).energy[0]
        for sheet in (
            Sheet(NeoHooke(0.3)),
            Sheet(NeoHooke(0.3), 1.0, (CosineField(box, (0.1, 0.4, 0.2)),)),
            Sheet(NeoHooke(0.3), 1.0, (CubicPart(0.07),)),
        )
    )
    # a_01 cos(pi y) and a_11 cos(pi x) cos(pi y) have mean zero over the height
    assert field / plain == pytest.approx(1 + 0.4 * 2 / np.pi, rel=1e-4)
    F = np.eye(2) + STRETCH
    I1 = F[0, 0] ** 2 + F[1, 1] ** 2 + 1 / (F[0, 0] * F[1, 1]) ** 2
    assert cubic - plain == pytest.approx(100.0 * 0.07 * (I1 - 3) ** 3, rel=1e-9)
