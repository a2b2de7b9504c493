"""The virtual-work equations: exact on their own mesh, linear in the coefficients, blind to numbering and rotation."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
import synthetic
from synthetic import ArrudaBoyce, HartmannNeff, derivatives, moved, plate_experiment, renumbered, rotation

from calibrate import errors
from calibrate.data.experiment import LoadedBoundary
from calibrate.data.triangulation import boundary_nodes
from calibrate.equations import basis as bases
from calibrate.equations import equilibrium as equations
from calibrate.equations import kinematics
from calibrate.equations.inputs import REFERENCE
from calibrate.equations.virtual_fields import default_spacing, nodal_fields, virtual_fields
from calibrate.fitting import paper_loss

SPACING = 12.0


@pytest.fixture(scope="module")
def experiment():
    return plate_experiment()


@pytest.fixture(scope="module")
def system(experiment):
    return equations.equilibrium(experiment, SPACING)


def stresses(system, energy=ArrudaBoyce()):
    return np.asarray(kinematics.nominal_stress(energy, jnp.asarray(system.deformation_gradients)))


def coefficients(basis, energy):
    J = np.nan_to_num(basis.site_inputs) + REFERENCE
    invariants = np.stack([J[:, 0], J[:, 1] ** (2 / 3)], axis=1)
    psi = derivatives(energy, invariants) / np.stack([np.ones(len(J)), 1.5 * np.sqrt(invariants[:, 1])], axis=1)
    return basis.interpolation @ psi.ravel()


def interior(experiment, system):
    """Every node that carries no load."""
    loaded = np.concatenate([b.nodes for b in experiment.loaded])
    return np.isin(np.arange(len(experiment.points)), loaded, invert=True)


# virtual fields


def test_virtual_fields_are_constant_on_the_grips(experiment):
    fields = virtual_fields(experiment, SPACING)
    values = fields.values.toarray()
    for index, boundary in enumerate(experiment.loaded):
        on_edge = values[boundary.nodes]
        np.testing.assert_array_equal(on_edge, np.broadcast_to(fields.boundary == index, on_edge.shape))


def test_virtual_fields_are_a_partition_of_unity_but_for_dropped_hats(experiment):
    total = virtual_fields(experiment, SPACING).values.sum(axis=1)
    assert total.max() <= 1 + 1e-12
    assert total.min() > 0.9
    assert np.mean(total > 1 - 1e-12) > 0.8


def test_virtual_fields_vanish_on_a_rim_with_unknown_traction(experiment):
    bottom = np.isclose(experiment.points[:, 1], experiment.points[:, 1].min())
    rim = np.setdiff1d(np.flatnonzero(bottom), np.concatenate([b.nodes for b in experiment.loaded]))
    cropped = replace(experiment, free_nodes=np.setdiff1d(experiment.free_nodes, rim))
    fields = virtual_fields(cropped, SPACING)
    assert abs(fields.values.toarray()[rim]).max() == 0
    assert abs(nodal_fields(cropped).values.toarray()[rim]).max() == 0
    for index, boundary in enumerate(cropped.loaded):
        assert (fields.values.toarray()[boundary.nodes, np.flatnonzero(fields.boundary == index)] == 1).all()


def test_virtual_fields_cross_holes_and_free_edges(experiment):
    fields = virtual_fields(experiment, SPACING)
    holes = np.intersect1d(experiment.free_nodes, np.flatnonzero(np.hypot(*experiment.points.T) < 9))
    assert holes.size
    assert (np.asarray(fields.values.sum(axis=1))[holes] > 0.99).all()


def test_nodal_fields_select_every_free_node(experiment):
    fields = nodal_fields(experiment)
    assert fields.n_fields == interior(experiment, None).sum() + 2
    assert set(np.unique(fields.values.data)) == {1.0}


def test_default_spacing_follows_the_noise(experiment):
    assert default_spacing(experiment) == pytest.approx(6.0)
    noise = synthetic.Noise(0.01, 1.6)
    assert default_spacing(replace(experiment, noise=noise)) == pytest.approx(8.0)


# equations


@pytest.mark.parametrize("energy", [ArrudaBoyce(), HartmannNeff()], ids=lambda e: type(e).__name__)
def test_exact_model_on_its_own_mesh_leaves_no_residual(energy):
    """Nodal forces and coarse virtual work vanish to 1e-10 of the reaction force."""
    for linear in (False, True):
        experiment = plate_experiment(energy, linear=linear)
        if linear:
            system = paper_loss.nodal_system(experiment)
        else:
            system = equations.equilibrium(experiment, SPACING)
        residual = system.internal_forces(stresses(system, energy)) - system.loads
        assert np.abs(residual).max() < 1e-10 * np.abs(system.loads).max()


@pytest.mark.parametrize("inputs", ["I1", "I2", "I1I2"])
def test_matrix_times_coefficients_is_the_work_of_the_same_energy(system, inputs):
    energy = {"I1": ArrudaBoyce(), "I2": HartmannNeff(0.0, 0.02), "I1I2": HartmannNeff()}[inputs]
    F = system.deformation_gradients
    basis = bases.basis_for(inputs, F.reshape(-1, 2, 2))
    work = np.array([system.matrix(basis, f) @ coefficients(basis, energy) for f in F])
    expected = system.internal_forces(stresses(system, energy))
    np.testing.assert_allclose(work, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_the_work_of_a_neo_hookean_solid_is_that_of_its_coefficients(experiment, plane):
    """In closed form, whatever the basis; in plane strain for a shear and a bulk modulus."""
    system = equations.equilibrium(replace(experiment, plane=plane), SPACING)
    F = system.deformation_gradients
    basis = bases.basis_for("I1I2", F.reshape(-1, 2, 2), plane=plane)
    moduli = (0.3,) if plane == "stress" else (0.3, 1.7)
    expected = np.array([system.matrix(basis, f) @ equations.neo_hooke(basis, *moduli) for f in F])
    work = np.tensordot(moduli, system.neo_hookean, 1)
    np.testing.assert_allclose(work, expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("inputs", ["I1", "I1I2"])
def test_tangent_against_finite_differences(system, experiment, inputs):
    basis = bases.basis_for(inputs, system.deformation_gradients.reshape(-1, 2, 2))
    c = coefficients(basis, ArrudaBoyce() if inputs == "I1" else HartmannNeff())
    rng, h = np.random.default_rng(0), 1e-5
    u, direction = experiment.displacements[-1], rng.standard_normal((len(experiment.points), 2))

    def work(displacements):
        F = kinematics.deformation_gradients(system.gradient, displacements)
        return system.matrix(basis, F) @ c

    blocks = system.tangent(basis, system.deformation_gradients[-1], c)
    predicted = np.concatenate([sum(block @ direction[:, k] for k, block in enumerate(row)) for row in blocks])
    difference = (work(u + h * direction) - work(u - h * direction)) / (2 * h)
    # the tensor basis differentiates a spline: its slope is good to the order of the interpolation less one
    tolerance = 1e-6 if inputs == "I1" else 1e-4
    np.testing.assert_allclose(predicted, difference, atol=tolerance * np.abs(difference).max())


def test_residual_norms_do_not_see_a_rigid_motion_of_the_data(experiment, system):
    other = equations.equilibrium(moved(experiment), SPACING)
    stiff = ArrudaBoyce(mu=0.4)
    before = system.internal_forces(stresses(system, stiff)) - system.loads
    after = other.internal_forces(stresses(other, stiff)) - other.loads
    as_vectors = lambda r: r.reshape(len(r), 2, -1)  # noqa: E731
    expected = np.einsum("ij,tjv->tiv", rotation(0.7), as_vectors(before))
    np.testing.assert_allclose(as_vectors(after), expected, atol=1e-11 * np.abs(before).max())


def test_residual_does_not_see_the_numbering(experiment, system):
    other = equations.equilibrium(renumbered(experiment), SPACING)
    stiff = ArrudaBoyce(mu=0.4)
    before, after = (s.internal_forces(stresses(s, stiff)) - s.loads for s in (system, other))
    np.testing.assert_allclose(after, before, atol=1e-11 * np.abs(before).max())


def test_thickness_scales_the_work(experiment, system):
    thick = equations.equilibrium(
        replace(experiment, thickness=2.0, loaded=tuple(replace(b, force=2 * b.force) for b in experiment.loaded)),
        SPACING,
    )
    P = stresses(system)
    np.testing.assert_allclose(thick.internal_forces(P), 2 * system.internal_forces(P), rtol=1e-14)
    unknown = equations.equilibrium(replace(experiment, thickness=None), SPACING)
    np.testing.assert_array_equal(unknown.internal_forces(P), system.internal_forces(P))


def test_unmeasured_components_are_marked(experiment):
    forces = [b.force.copy() for b in experiment.loaded]
    forces[1][:, 1] = np.nan
    loaded = tuple(LoadedBoundary(b.name, b.nodes, f) for b, f in zip(experiment.loaded, forces, strict=True))
    system = equations.equilibrium(replace(experiment, loaded=loaded), SPACING)
    row = system.fields.n_fields + int(np.flatnonzero(system.fields.boundary == 1)[0])
    expected = np.zeros(2 * system.fields.n_fields, bool)
    expected[row] = True
    np.testing.assert_array_equal(np.isnan(system.loads), np.broadcast_to(expected, system.loads.shape))


# signs


def with_forces(experiment, change):
    return replace(experiment, loaded=tuple(replace(b, force=change(b.force)) for b in experiment.loaded))


@pytest.mark.parametrize("change", [lambda f: -f, lambda f: f[:, ::-1]], ids=["reversed", "another direction"])
def test_forces_that_do_not_belong_to_the_field_are_refused(experiment, change):
    with pytest.raises(errors.ForceSignError):
        equations.equilibrium(with_forces(experiment, change), SPACING)


def test_a_specimen_that_does_not_move_or_is_not_pulled_is_named(experiment):
    still = replace(experiment, displacements=np.ones_like(experiment.displacements))
    with pytest.raises(errors.ExperimentError, match="deformed"):
        equations.equilibrium(still, SPACING)
    with pytest.raises(errors.MissingForceError):
        equations.equilibrium(with_forces(experiment, lambda f: 0 * f), SPACING)


def test_a_triangle_that_is_a_line_leaves_the_other_increments_as_they_are(system):
    """Its stress is not finite, and nothing is raised for it: gradients are recovered, so that no check of triangles sees it before."""
    flat = equations.Equilibrium(system.experiment, system.fields)
    vars(flat)["isochoric_gradients"] = F = system.deformation_gradients.copy()
    F[0, 0] = [[1.0, 0.0], [0.0, 0.0]]
    assert not np.isfinite(flat.neo_hookean[0, 0]).all()
    np.testing.assert_array_equal(flat.neo_hookean[0, 1:], system.neo_hookean[0, 1:])


def test_modulus_from_forces_of_a_neo_hookean_plate(experiment):
    neo_hooke = plate_experiment(synthetic.MooneyRivlin(0.15, 0.0))
    system = equations.equilibrium(neo_hooke, SPACING)
    modulus, correlation = equations.best_shear_modulus(system)
    assert modulus == pytest.approx(0.3, rel=1e-10)
    assert correlation == pytest.approx(1.0)


def test_boundary_nodes_of_the_plate(experiment):
    loaded = np.concatenate([b.nodes for b in experiment.loaded])
    rims = np.union1d(loaded, experiment.free_nodes)
    np.testing.assert_array_equal(boundary_nodes(experiment.triangles), rims)


@pytest.mark.parametrize("spacing", [0.0, 0.01, 200.0])
def test_virtual_fields_that_do_not_fit_are_refused(experiment, spacing):
    with pytest.raises(errors.ConfigError, match="--spacing"):
        virtual_fields(experiment, spacing)
