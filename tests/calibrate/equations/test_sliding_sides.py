"""Sides that slide: held one way, free of traction the other, with corners that belong to two of them."""

from dataclasses import replace

import numpy as np
import pytest

from calibrate.data.experiment import Experiment, LoadedBoundary
from calibrate.data.triangulation import boundary_nodes
from calibrate.equations.basis import basis_for
from calibrate.equations.equilibrium import Equilibrium, equilibrium, neo_hooke
from calibrate.equations.virtual_fields import nodal_fields, virtual_fields
from calibrate.errors import ExperimentError
from studies.importers.printed_sheets import grid_triangles

SHEAR, BULK = 0.4, 1.5
SIDES = {"left": (0, -1), "right": (0, 1), "bottom": (1, -1), "top": (1, 1)}


def nominal_stress(F):
    """P (2, 2) of mu / 2 (J^(-2/3) I1 - 3) + kappa / 2 (J - 1)^2 in plane strain, closed form."""
    J, inverse = np.linalg.det(F), np.linalg.inv(F).T
    I1 = np.sum(F**2) + 1
    return SHEAR * J ** (-2 / 3) * (F - I1 / 3 * inverse) + BULK * (J - 1) * J * inverse


def stretched_square(stretches=((1.1, 1.0), (1.05, 1.2), (1.3, 1.25)), n=9):
    """A square of 10 mm on four sliding sides, stretched homogeneously; forces in closed form."""
    x, y = np.meshgrid(np.linspace(0, 10, n), np.linspace(0, 10, n))
    points = np.column_stack([x.ravel(), y.ravel()])
    stress = [nominal_stress(np.diag(s)) for s in stretches]
    loaded = []
    for name, (k, sign) in SIDES.items():
        nodes = np.flatnonzero(points[:, k] == (10 if sign > 0 else 0))
        force = np.zeros((len(stretches), 2))
        force[:, k] = [sign * 10 * P[k, k] for P in stress]
        loaded.append(LoadedBoundary(name, nodes, force, (k == 0, k == 1)))
    u = np.stack([points * (np.array(s) - 1) for s in stretches])
    return Experiment(
        "square", points, grid_triangles(n, n), u, tuple(loaded), np.zeros(0, int), thickness=1.0, plane="strain"
    )


@pytest.mark.parametrize("fields", [virtual_fields, nodal_fields])
def test_every_equation_of_a_homogeneous_state_is_met_exactly(fields):
    experiment = stretched_square()
    system = Equilibrium(experiment, fields(experiment))
    basis = basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2), plane="strain")
    c = neo_hooke(basis, SHEAR, BULK)
    residual = np.array([system.matrix(basis, F) @ c for F in system.deformation_gradients]) - system.loads
    assert np.isfinite(residual).any()
    assert np.nanmax(np.abs(residual)) < 1e-10 * np.nanmax(np.abs(system.loads))


@pytest.mark.parametrize("fields", [virtual_fields, nodal_fields])
def test_virtual_fields_move_along_a_sliding_side_and_not_across_it(fields):
    experiment = stretched_square()
    found = fields(experiment)
    assert (found.admissible.sum(axis=0) == 1).all()
    bottom, left = experiment.loaded[2].nodes, experiment.loaded[0].nodes
    inner = found.boundary < 0
    along = found.values[bottom][:, found.admissible[0] & inner].toarray()
    across = found.values[left][:, found.admissible[0] & inner].toarray()
    assert (along > 0).any()
    assert not across.any()
    for index, boundary in enumerate(experiment.loaded):
        edge = found.values[:, found.boundary == index].toarray()[:, 0]
        assert (edge[boundary.nodes] == 1).all()
        other = experiment.loaded[{0: 1, 1: 0, 2: 3, 3: 2}[index]]
        assert not edge[other.nodes].any()


def test_sides_that_are_held_both_ways_have_the_fields_they_had():
    experiment = stretched_square()
    gripped = tuple(replace(b, held=(True, True)) for b in experiment.loaded[:2])
    clamped = replace(experiment, loaded=gripped)
    found = virtual_fields(clamped)
    assert found.admissible is None
    rim = np.setdiff1d(boundary_nodes(clamped.triangles), np.concatenate([b.nodes for b in gripped]))
    assert not found.values[rim][:, found.boundary < 0].toarray().any()


def test_a_sliding_side_that_pulls_the_wrong_way_is_found_out():
    experiment = stretched_square()
    forces = [b.force * [1, 1.4] for b in experiment.loaded]
    wrong = replace(
        experiment, loaded=tuple(replace(b, force=f) for b, f in zip(experiment.loaded, forces, strict=True))
    )
    system = equilibrium(wrong)
    basis = basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2), plane="strain")
    c = neo_hooke(basis, SHEAR, BULK)
    residual = np.array([system.matrix(basis, F) @ c for F in system.deformation_gradients]) - system.loads
    assert np.nanmax(np.abs(residual)) > 0.1 * np.nanmax(np.abs(system.loads))


def test_held_components_survive_the_file_and_a_selection(tmp_path):
    experiment = stretched_square()
    experiment.save(tmp_path / "square.npz")
    read = Experiment.load(tmp_path / "square.npz").select([0, 2])
    assert [b.held for b in read.loaded] == [b.held for b in experiment.loaded]
    assert read.force_imbalance == pytest.approx((0, 0), abs=1e-12)


def test_corners_belong_to_two_sides_only_where_these_hold_different_components():
    experiment = stretched_square()
    left, *rest = experiment.loaded
    with pytest.raises(ExperimentError, match="shares nodes"):
        replace(experiment, loaded=(replace(left, held=(True, True)), *rest))
    with pytest.raises(ExperimentError, match="slides along y"):
        replace(experiment, loaded=(replace(left, force=left.force + 1.0), *rest))
    with pytest.raises(ExperimentError, match="holds nothing"):
        replace(experiment, loaded=(replace(left, held=(False, False), force=0 * left.force), *rest))
