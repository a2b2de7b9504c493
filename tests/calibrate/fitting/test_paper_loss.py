"""The seed paper's loss: gradient, reduction, and what does not change it."""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from synthetic import ArrudaBoyce, moved, plate_experiment, renumbered

from calibrate import errors
from calibrate.equations import basis as bases
from calibrate.equations.equilibrium import best_shear_modulus
from calibrate.equations.inputs import REFERENCE
from calibrate.equations.kinematics import invariants_and_derivatives, shape_gradients
from calibrate.fitting import paper_loss
from calibrate.models import pann

ARCHITECTURES = [
    pann.Architecture("I1", (4, 4), (0.2, 0.05), 0.5),
    pann.Architecture("I2", (2,), (0.2, 0.05), 0.5),
    pann.Architecture("I1I2", (2, 2), (0.2, 0.05), 0.5),
]
IDS = [a.inputs for a in ARCHITECTURES]


@pytest.fixture(scope="module")
def experiment():
    return plate_experiment(linear=True)


@pytest.fixture(scope="module")
def system(experiment):
    return paper_loss.nodal_system(experiment)


SYSTEMS = {}


@cache
def loss_by_id(system_id, architecture, scaling):
    return paper_loss.full_loss(SYSTEMS[system_id], architecture, scaling)


def loss_of(system, architecture, scaling):
    """`full_loss`, compiled once for each system, architecture and scaling."""
    SYSTEMS[id(system)] = system
    return loss_by_id(id(system), architecture, scaling)


def parameters(architecture, seed=0):
    return architecture.random_start(jax.random.key(seed))


@pytest.mark.parametrize(
    ("architecture", "scaling"),
    [*((a, "frozen") for a in ARCHITECTURES), (ARCHITECTURES[2], "dependent")],
    ids=[*IDS, "I1I2-dependent"],
)
def test_gradient_against_finite_differences(system, architecture, scaling):
    loss = loss_of(system, architecture, scaling)
    theta, h = np.asarray(parameters(architecture)), 1e-6
    gradient = np.asarray(loss(jnp.asarray(theta))[1])
    for k in range(theta.size):
        step = h * np.eye(theta.size)[k]
        difference = (loss(jnp.asarray(theta + step))[0] - loss(jnp.asarray(theta - step))[0]) / (2 * h)
        np.testing.assert_allclose(gradient[k], difference, rtol=1e-5, atol=1e-7 * np.abs(gradient).max())


@pytest.mark.parametrize("architecture", ARCHITECTURES, ids=IDS)
def test_reduced_loss_is_the_full_loss(system, architecture):
    """The reduction replaces psi by its spline interpolant: 1e-6 for one input, 1e-4 for the tensor basis."""
    F = system.deformation_gradients.reshape(-1, 2, 2)
    basis = bases.basis_for(architecture.inputs, F)
    quadratic = paper_loss.reduced(system, basis)
    loss = loss_of(system, architecture, "frozen")
    J = np.nan_to_num(basis.site_inputs) + REFERENCE
    sites = jnp.asarray(np.stack([J[:, 0], J[:, 1] ** (2 / 3)], axis=1))
    derivative = jax.jit(pann.energy_derivatives, static_argnums=0)
    for seed in range(3):
        theta = parameters(architecture, seed)
        psi = np.array(derivative(architecture, theta, sites))
        psi[:, 1] /= 1.5 * np.sqrt(np.asarray(sites)[:, 1])
        reduced = quadratic.loss(basis.interpolation @ psi.ravel())
        tolerance = 1e-4 if architecture.inputs == "I1I2" else 1e-6
        assert reduced == pytest.approx(float(loss(theta)[0]), rel=tolerance)


def test_loss_is_the_stated_formula(system, experiment):
    """Node by node, as in the module's docstring, without scatter or sparse matrices."""
    architecture = ARCHITECTURES[0]
    theta = parameters(architecture)
    modulus = best_shear_modulus(system)[0]
    values, first = map(np.asarray, invariants_and_derivatives(jnp.asarray(system.deformation_gradients)))
    gradients, areas = shape_gradients(experiment.points, experiment.triangles)
    psi = np.asarray(pann.energy_derivatives(architecture, theta, jnp.asarray(values)))
    loaded = np.concatenate([b.nodes for b in experiment.loaded])
    total, largest = 0.0, 0.0
    c_l = max((b.force**2).sum(axis=1).max() for b in experiment.loaded)
    imbalance = 0.0
    for t in range(experiment.n_increments):
        nodal = np.zeros_like(experiment.points)
        for e, nodes in enumerate(experiment.triangles):
            P = psi[t, e, 0] * first[t, e, 0] + psi[t, e, 1] * first[t, e, 1]
            nodal[nodes] += areas[e] * gradients[e] @ P.T
            start = 0.5 * modulus * areas[e] * gradients[e] @ first[t, e, 0].T
            largest = max(largest, (start**2).sum(axis=1).max())
        total += sum(((nodal[b.nodes].sum(axis=0) - b.force[t]) ** 2).sum() for b in experiment.loaded) / c_l
        imbalance += (np.delete(nodal, loaded, axis=0) ** 2).sum()
    expected = (total + imbalance / largest) / experiment.n_increments
    value = loss_of(system, architecture, "frozen")(theta)[0]
    assert float(value) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("change", [moved, renumbered], ids=["rigid motion", "renumbering"])
@pytest.mark.parametrize("scaling", paper_loss.SCALINGS)
def test_loss_ignores_rigid_motion_and_numbering(system, experiment, change, scaling):
    architecture = ARCHITECTURES[2]
    theta = parameters(architecture)
    other = paper_loss.nodal_system(change(experiment))
    before, after = (loss_of(s, architecture, scaling)(theta) for s in (system, other))
    assert float(after[0]) == pytest.approx(float(before[0]), rel=1e-10)
    np.testing.assert_allclose(after[1], before[1], rtol=1e-8, atol=1e-10 * np.abs(before[1]).max())


def test_true_spline_has_no_loss(system):
    basis = bases.basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2))
    J1 = basis.site_inputs[:, 0] + 3
    psi = np.asarray(jax.vmap(jax.grad(lambda i: ArrudaBoyce()(jnp.stack([i, 3.0]))))(jnp.asarray(J1)))
    c = basis.interpolation @ np.stack([psi, 0 * psi], axis=1).ravel()
    quadratic = paper_loss.reduced(system, basis)
    assert abs(quadratic.loss(c)) < 1e-10 * quadratic.constant


def test_slsqp_decreases_the_loss_within_its_bounds(system):
    architecture = pann.Architecture("I1", (1,), (0.2, 0.05), 0.5)
    loss = paper_loss.full_loss(system, architecture, "frozen")
    start = np.asarray(parameters(architecture))
    result = paper_loss.slsqp(loss, architecture, start, limit=60)
    assert result.loss < 1e-2 * float(loss(jnp.asarray(start))[0])
    assert (result.parameters[architecture.nonnegative] >= 0).all()
    assert result.evaluations > 1
    assert result.message


def test_unknown_scaling_and_missing_components_are_refused(system, experiment):
    with pytest.raises(errors.ConfigError, match="scaling"):
        paper_loss.full_loss(system, ARCHITECTURES[0], "thawed")
    force = experiment.loaded[0].force * [1.0, np.nan]
    half = replace(experiment, loaded=(replace(experiment.loaded[0], force=force), experiment.loaded[1]))
    with pytest.raises(errors.MissingForceError):
        paper_loss.full_loss(paper_loss.nodal_system(half), ARCHITECTURES[0], "frozen")
