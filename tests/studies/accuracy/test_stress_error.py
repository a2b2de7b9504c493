"""Signed errors of calibrated models against closed forms: nothing for the truth, +10 % for a model 10 % too stiff."""

from dataclasses import asdict

import jax.numpy as jnp
import numpy as np
import pytest

from calibrate.equations.kinematics import invariants_and_derivatives
from calibrate.models import pann
from calibrate.models.network_model import Model
from forward.materials import ArrudaBoyce
from studies.accuracy.metrics import ArrudaBoyceTruth
from studies.accuracy.stress_error import (
    Reference,
    StateErrors,
    States,
    energy_errors,
    energy_of,
    stiffness_errors,
    stress_errors,
)


def neo_hooke(mu: float) -> Model:
    """A PANN that is neo-Hookean: only the skip connection acts, psi = mu / 2 (I1 - 3)."""
    return Model(pann.Architecture("I1", (1,)), np.array([0.0, 0.0, 0.0, mu / 2]))


def neo_hooke_truth(invariants):
    """d psi / d(I1, I2) for mu = 1 MPa."""
    return np.stack([np.full(invariants.shape[:-1], 0.5), np.zeros(invariants.shape[:-1])], axis=-1)


def states(F, weights=None, count=50) -> States:
    """States at F (k, 2, 2), repeated up to `count`, so that all tests share what JAX compiles."""
    F = np.resize(np.asarray(F, float), (count, 2, 2))
    invariants = np.asarray(invariants_and_derivatives(jnp.asarray(F))[0])
    return States(F, np.ones(len(F)) if weights is None else weights, invariants)


@pytest.fixture
def some():
    """Random states with shear of both signs, and weights."""
    rng = np.random.default_rng(3)
    return states(np.eye(2) * 1.3 + 0.2 * rng.standard_normal((50, 2, 2)), rng.random(50))


def test_the_truth_itself_has_no_error(some):
    reference = Reference.at(some, neo_hooke_truth)
    np.testing.assert_allclose(stress_errors(neo_hooke(1.0), reference), 0, atol=1e-10)
    np.testing.assert_allclose(
        energy_errors(neo_hooke(1.0), reference.states.invariants, reference.energy), 0, atol=1e-10
    )
    found = StateErrors.of(neo_hooke(1.0), reference)
    assert max(abs(v) for part in found.stress.values() for v in asdict(part).values()) < 1e-10


def test_ten_percent_too_stiff_is_plus_ten_percent_whichever_way_the_stress_points(some):
    uniaxial = states([np.diag([x, x**-0.5]) for x in (0.8, 1.1, 2.0)])
    found = stress_errors(neo_hooke(1.1), Reference.at(uniaxial, neo_hooke_truth))
    np.testing.assert_allclose(found, [[10, 0, 0]] * 50, atol=1e-10)
    reference = Reference.at(some, neo_hooke_truth)
    errors = stress_errors(neo_hooke(1.1), reference)
    assert (errors >= 0).all() and (reference.stress[:, 0, 1] < 0).any()
    share = np.abs(reference.stress) / np.linalg.norm(reference.stress, axis=(1, 2))[:, None, None]
    expected = 10 * np.stack([share[:, 0, 0], share[:, 1, 1], share[:, 0, 1]], axis=1)
    np.testing.assert_allclose(errors, expected, rtol=1e-10)
    assert (stress_errors(neo_hooke(0.9), reference) <= 0).all()
    np.testing.assert_allclose(stiffness_errors(neo_hooke(1.1), reference), 10, rtol=1e-9)
    np.testing.assert_allclose(energy_errors(neo_hooke(1.1), some.invariants, reference.energy), 10, rtol=1e-9)


def test_statistics_are_weighted_by_area(some):
    reference = Reference.at(some, neo_hooke_truth)
    found = StateErrors.of(neo_hooke(1.1), reference)
    errors = stress_errors(neo_hooke(1.1), reference)[:, 2]
    expected = (errors * some.weights).sum() / some.weights.sum()
    assert found.stress["P12"].mean == pytest.approx(expected)
    assert found.stress["P11"].p05 <= found.stress["P11"].median
    assert found.stiffness.p95 == pytest.approx(10)
    assert StateErrors.from_dict(found.to_dict()) == found
    assert asdict(found.energy) == pytest.approx({"median_abs": 10, "p95_abs": 10, "mean": 10})


def test_the_energy_of_the_truth_has_the_closed_form(some):
    expected = ArrudaBoyce().energy(some.invariants[:, 0], some.invariants[:, 1])
    np.testing.assert_allclose(energy_of(ArrudaBoyceTruth(), some.invariants), expected, rtol=1e-12)


def test_only_deformed_states_within_the_range_are_judged():
    stretched = [np.diag([1.5, 1.5**-0.5])] * 50
    chosen = states([np.eye(2), *stretched, np.diag([3.0, 1.0])], np.array([1.0, *[2.0] * 50, 4.0]), 52)
    inside = chosen.within(5.0)
    np.testing.assert_array_equal(inside.weights, [2.0] * 50)


def test_states_of_a_solution_hold_every_increment(tmp_path):
    from forward.solution import SurfaceSolution
    from meshes import Cross, quads

    mesh = quads(Cross(), quarter=True, size_factor=4)
    F = np.diag([1.4, 0.9])
    u = np.array([0 * mesh.points, mesh.points @ (F - np.eye(2)).T])
    solution = SurfaceSolution(mesh, u, {}, np.array([0.5, 1.0]), np.zeros(2), np.zeros(2, np.int64), 1.0)
    found = States.of(solution)
    assert found.weights.sum() == pytest.approx(2 * mesh.area())
    I1 = 1.4**2 + 0.9**2 + (1.4 * 0.9) ** -2
    half = len(found.F) // 2
    np.testing.assert_allclose(found.invariants[half:, 0], I1, rtol=1e-12)
    assert len(found.within(100).F) == half
    found.save(tmp_path / "states.npz")
    np.testing.assert_array_equal(States.load(tmp_path / "states.npz").F, found.F)
