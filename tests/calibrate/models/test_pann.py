"""What makes the network physical, over random draws of its parameters and of the deformation."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from synthetic import random_gradients, rotation

from calibrate import errors
from calibrate.equations import kinematics
from calibrate.equations.inputs import INPUT_SETS, REFERENCE
from calibrate.models import pann
from calibrate.models.network_model import Model

DRAWS = 60
CASES = [("I1", (1,)), ("I2", (2, 2)), ("I1I2", (4, 4))]


@pytest.fixture(scope="module", params=CASES, ids=lambda case: f"{case[0]}-{'x'.join(map(str, case[1]))}")
def network(request):
    """An architecture and DRAWS random parameter vectors (DRAWS, n_parameters) that keep the bounds."""
    architecture = pann.Architecture(*request.param, scales=(0.2, 0.05), energy_scale=0.7)
    keys = jax.random.split(jax.random.key(1), DRAWS)
    return architecture, jnp.stack([architecture.random_start(key) for key in keys])


@partial(jax.jit, static_argnums=0)
def _stress(architecture, parameters, F):
    def P(theta, f):
        return jax.grad(lambda g: pann.energy(architecture, theta, kinematics.invariants(g)))(f)

    return jax.vmap(jax.vmap(P, (None, 0)), (0, None))(parameters, F)


def stress(architecture, parameters, F):
    """P (draws, n, 2, 2) of all parameter vectors (draws, p) at F (n, 2, 2), by differentiating the energy in F."""
    return np.asarray(_stress(architecture, parameters, jnp.asarray(F)))


def test_parameter_vector_has_the_stated_layout(network):
    architecture, parameters = network
    hidden, w, v = architecture.unpack(parameters[0])
    assert parameters.shape[1] == architecture.n_parameters == architecture.nonnegative.size
    assert [W.shape for W, _ in hidden] == architecture.shapes
    assert w.shape == (architecture.layers[-1],)
    assert v.shape == (architecture.n_inputs,)
    assert (np.asarray(parameters)[:, architecture.nonnegative] >= 0).all()


def test_no_energy_and_no_stress_at_rest(network):
    architecture, parameters = network
    rest = jnp.array([3.0, 3.0])
    values = jax.jit(jax.vmap(lambda p: pann.energy(architecture, p, rest)))(parameters)
    np.testing.assert_allclose(values, 0.0, atol=1e-14)
    rotations = np.stack([rotation(angle) for angle in np.linspace(0, 6, 20)])
    np.testing.assert_allclose(stress(architecture, parameters[:10], rotations), 0.0, atol=1e-13)


def test_objectivity_and_isotropy(network):
    architecture, parameters = network
    F, few = random_gradients(20, spread=0.25), parameters[:10]
    P = stress(architecture, few, F)
    scale = np.abs(P).max()
    for angle in (0.3, 2.1, -1.2):
        Q = rotation(angle)
        np.testing.assert_allclose(stress(architecture, few, Q @ F), Q @ P, atol=1e-11 * scale)
        np.testing.assert_allclose(stress(architecture, few, F @ Q), P @ Q, atol=1e-11 * scale)


def test_energy_is_convex_and_non_decreasing_in_its_inputs(network):
    architecture, parameters = network
    rng = np.random.default_rng(0)
    J = REFERENCE + rng.uniform(0, 1, (DRAWS, 2)) * [20.0, 100.0]

    def psi(inputs, theta):
        return pann.energy(architecture, theta, jnp.stack([inputs[0], inputs[1] ** (2 / 3)]))

    slope = np.asarray(jax.jit(jax.vmap(jax.grad(psi)))(jnp.asarray(J), parameters))
    hessian = np.asarray(jax.jit(jax.vmap(jax.hessian(psi)))(jnp.asarray(J), parameters))
    assert slope.min() >= -1e-14
    assert np.linalg.eigvalsh(hessian).min() >= -1e-12 * np.abs(hessian).max()


def test_an_unused_invariant_has_no_influence(network):
    architecture, parameters = network
    derivative = jax.jit(pann.energy_derivatives, static_argnums=0)
    slope = derivative(architecture, parameters[0], jnp.array([[5.0, 4.0], [9.0, 6.0]]))
    unused = np.setdiff1d([0, 1], INPUT_SETS[architecture.inputs])
    assert (np.asarray(slope)[:, unused] == 0).all()


def test_stress_is_the_derivative_of_the_energy(network):
    architecture, parameters = network
    model, F, h = Model(architecture, np.asarray(parameters[3])), random_gradients(20, spread=0.2), 1e-6
    energy = jax.jit(jax.vmap(lambda f: model.energy(kinematics.invariants(f))))
    P = model.nominal_stress(F)
    np.testing.assert_allclose(P, stress(architecture, parameters[:10], F)[3], atol=1e-12 * np.abs(P).max())
    for i, j in np.ndindex(2, 2):
        step = np.zeros((2, 2))
        step[i, j] = h
        difference = np.asarray(energy(jnp.asarray(F + step)) - energy(jnp.asarray(F - step))) / (2 * h)
        np.testing.assert_allclose(P[:, i, j], difference, rtol=1e-6, atol=1e-7 * np.abs(P).max())


@pytest.mark.parametrize("arguments", [("I3", (4,)), ("", (4,)), ("I1", ()), ("I1", (4, 0)), ("I1", (2.5,))])
def test_impossible_architectures_are_refused(arguments):
    with pytest.raises(errors.ConfigError):
        pann.Architecture(*arguments)
