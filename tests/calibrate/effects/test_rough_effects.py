"""Effects that amplify noise: their noise in the weights, in the score and in the fit, against samples and differences."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import synthetic
from made_up import made_up_chain

from calibrate.data.experiment import Noise
from calibrate.diagnosis import base_fit, effect_fit, model_weights, signature_noise, weighted_fit
from calibrate.diagnosis.problem import all_rows, signature
from calibrate.effects import CATALOGUE, Mullins, PermanentSet, SecondInvariant, SubsetSmoothing, Thickness, Viscosity
from calibrate.effects.chain import Addition, Chain
from calibrate.effects.support.effect_data import Data
from calibrate.equations import noise_covariance
from calibrate.equations.basis import SingleBasis
from calibrate.equations.equilibrium import equilibrium, neo_hooke
from calibrate.fitting import least_squares
from studies.trials import blind_data, blind_solution

NOISE = Noise(0.02, 1.5, 3e-4, 2e-3)
SMOOTHED = 1.0  # mm^2
SIDE = np.sqrt(12 * SMOOTHED)


@cache
def smoothed():
    """The plate as subsets of SIDE see it, to the order in the variance of a subset that the effect has."""
    clean = synthetic.plate_experiment(synthetic.MooneyRivlin(0.15, 0.0), n_increments=6, n_theta=56, n_radial=11)
    data = Data.of(clean)

    def corrected(a):
        return SubsetSmoothing().displacements(data, data.u, jnp.array([a]), (SIDE,))

    u = data.u - SMOOTHED * jax.jvp(corrected, (0.0,), (1.0,))[1]
    return replace(clean, displacements=np.asarray(u), noise=NOISE)


def addition(amplitude=SMOOTHED):
    return Addition(SubsetSmoothing(), (amplitude,), (SIDE,))


@cache
def noisy(seed):
    return replace(synthetic.with_noise(smoothed(), NOISE, seed), noise=NOISE)


@cache
def prepared(seed):
    return base_fit.prepare([noisy(seed)], [all_rows], with_discrepancy=False)


@pytest.mark.slow
def test_spread_of_noise_is_the_derivative_of_the_residual():
    """By finite differences, and its transpose by the adjoint identity; an effect of displacements alone, so exact."""
    system = equilibrium(noisy(0))
    basis = SingleBasis(0, 1.0, 8)
    chain, c = Chain(system, basis), neo_hooke(basis, 0.3)
    factor = noise_covariance.noise_factor(system.experiment, NOISE)
    rng = np.random.default_rng(1)
    white = rng.standard_normal((factor.shape[1], 2))
    u = np.broadcast_to(1e-4 * (factor @ white), chain.data.u.shape)
    ends = [chain.disturbed(sign * u).residual(c, (addition(),)) for sign in (1, -1)]
    slope = (ends[0] - ends[1]) / 2e-4
    spread = list(chain.spread_of_noise(c, (addition(),), factor, np.arange(chain.system.experiment.n_increments)))
    for i, K in enumerate(spread):
        np.testing.assert_allclose(K @ white.T.ravel(), slope[i], atol=1e-5 * np.abs(slope[i]).max())
    forces = rng.standard_normal(slope.shape)
    back = chain.pulled_back(c, (addition(),), forces)
    for i, K in enumerate(spread):
        expected = np.einsum("s,s", forces[i], K @ white.T.ravel())
        assert np.einsum("nk,nk", back[i], factor @ white) == pytest.approx(expected, rel=1e-9)


AMPLIFYING = {
    "viscoelasticity": Addition(Viscosity(), (0.4,), (1.5,)),
    "Mullins softening": Addition(Mullins(), (0.3,), (0.02, 0.2)),
    "permanent set": Addition(PermanentSet(), (0.1,)),
}


@pytest.mark.slow
@pytest.mark.parametrize("plane", ["stress", "strain"])
@pytest.mark.parametrize("name", AMPLIFYING)
def test_noise_that_an_effect_amplifies(name, plane):
    """K of an increment is the derivative by its own displacements, as much larger as those of others in a history ask for."""
    chain = made_up_chain(plane)
    c = neo_hooke(chain.basis, 0.3, *([2.0] if plane == "strain" else []))
    factor = noise_covariance.noise_factor(chain.system.experiment, NOISE)
    white = np.random.default_rng(2).standard_normal((factor.shape[1], 2))
    field = factor @ white
    additions = (AMPLIFYING[name], Addition(SecondInvariant(), (0.02,)))
    n = chain.system.experiment.n_increments

    def slope(u):
        ends = [chain.disturbed(sign * 1e-5 * u).residual(c, additions) for sign in (1, -1)]
        return (ends[0] - ends[1]) / 2e-5

    each = np.array([slope(np.eye(n)[j][:, None, None] * field) for j in range(n)])  # (j, t, 2 v)
    for i, K in enumerate(chain.spread_of_noise(c, additions, factor, np.arange(n))):
        found, own = K @ white.T.ravel(), each[i, i]
        larger = float(found @ own / (own @ own))
        np.testing.assert_allclose(found, larger * own, atol=1e-5 * np.abs(found).max())
        assert larger == pytest.approx(np.sqrt((each[:, i] ** 2).sum() / (own @ own)), rel=0.03)
    forces, u = np.random.default_rng(3).standard_normal((2, n, max(each.shape[2], 2 * len(field))))
    forces, u = forces[:, : each.shape[2]], u[:, : 2 * len(field)].reshape(n, -1, 2)
    back = chain.pulled_back(c, additions, forces)
    assert (back * u).sum() == pytest.approx(float((forces * slope(u)).sum()), rel=1e-5)


def test_weights_without_such_an_effect_stay_as_they_are():
    problem, _ = prepared(0)
    assert model_weights.amplified(problem, ()) is problem
    assert model_weights.amplified(problem, (Addition(Thickness(), (0.0,), ()),)) is problem
    assert model_weights.amplified(problem, (addition(0.5),)).amplifying == (addition(0.5),)


@pytest.mark.slow
def test_excess_is_what_noise_adds_to_a_signature():
    """Squared signatures of noisy displacements, less that of clean ones, mean over seeds against the estimate of each."""
    problem, base = prepared(0)
    chain = problem.parts[0].chain
    thick = (Addition(Thickness(), (0.0,), ()),)
    clean = chain.disturbed(smoothed().displacements - np.asarray(chain.data.u))
    exact = signature(problem, [clean], base.c, thick)
    exact = exact - base.columns @ (base.columns.T @ exact)
    factor = noise_covariance.noise_factor(smoothed(), NOISE)
    added, estimated = [], []
    for seed in range(40):
        noise = noise_covariance.sample(factor, np.random.default_rng(seed), smoothed().n_increments)
        moved = clean.disturbed(noise)
        r = problem.whiten([moved.residual(base.c)]) - problem.whiten([clean.residual(base.c)])
        seen = signature_noise.visible_noise(problem, base.c, (), r)[0]
        chains = [moved.disturbed(-seen)]
        plain = signature(problem, chains, base.c, thick)
        S = plain - base.columns @ (base.columns.T @ plain)
        added.append(float((S**2).sum() - (exact**2).sum()))
        if seed < 6:
            hidden = signature_noise.hidden_noise(problem, chains, base.c, ())
            N = signature_noise.excess(problem, chains, base.c, thick, base.columns, np.ones(1), plain, hidden)
            estimated.append(float(N[0, 0]))
    error = np.std(added) / np.sqrt(len(added))
    assert error < 0.1 * np.mean(estimated)
    assert np.mean(estimated) > 0.1 * float((exact**2).sum())
    assert abs(np.mean(added) - np.mean(estimated)) < 2.5 * error


def test_information_left_is_never_less_than_a_share():
    M, N = np.diag([4.0, 1.0]), np.diag([3.9, 0.25])
    np.testing.assert_allclose(least_squares.subtract(M, N), np.diag([4 * least_squares.LEAST, 0.75]), atol=1e-12)
    np.testing.assert_allclose(least_squares.subtract(M, np.zeros((2, 2))), M, atol=1e-12)


@pytest.mark.slow
def test_thickness_is_found_without_bias_in_noise():
    """A plate from the 3D model, five draws of noise: mean b, its spread, and the misfit of the true model."""
    trial = blind_data.draw(5043, Thickness.name)
    clean = blind_solution.clean_experiment(trial)
    b, errors, chi, plain = [], [], [], []
    for seed in range(5):
        problem, base = base_fit.prepare([blind_data.record(replace(trial, seed=seed), clean)], [all_rows])
        start = (Addition(Thickness(), (0.5,), ()),)
        _, fit = weighted_fit.fit_with_weights(problem, base.c, start)
        b.append(fit.additions[0].amplitudes[0])
        errors.append(fit.errors[0][0])
        chi.append(fit.reduced_chi_square)
        plain.append(effect_fit.refit(problem, base.c, fit.additions).reduced_chi_square)
    assert abs(np.mean(b) - trial.effects[0].amplitudes["b"]) < 3 * np.mean(errors) / np.sqrt(5)
    assert 0.3 < np.std(b, ddof=1) / np.mean(errors) < 2.0
    assert np.mean(chi) == pytest.approx(1.0, abs=0.08)
    assert np.mean(plain) > 1.1


@pytest.mark.parametrize("effect", [Thickness(), SubsetSmoothing()], ids=lambda one: one.name)
def test_the_adjoint_of_a_rough_effect_is_the_transpose_of_its_derivative(effect):
    """By automatic differentiation of what it does to displacements, also by corrected places of the reference."""
    data = Data.of(smoothed())
    places = data.points * (1 + 0.01 * jnp.sin(0.1 * data.points[:, ::-1]))
    a, shape = jnp.array([2.0]), jnp.array([SIDE] * len(effect.shapes))

    def corrected(u):
        rough = isinstance(effect, Thickness)
        return effect.of_the_mean(data, u, places, a) if rough else effect.displacements(data, u, a, shape)

    rows = np.random.default_rng(5).standard_normal((3, *data.u.shape[1:]))
    back = jax.vjp(corrected, data.u[-1:])[1]
    expected = np.array([np.asarray(back(jnp.asarray(row[None]))[0][0]) for row in rows])
    found = effect.adjoint(data, np.asarray(places), np.asarray(a), np.asarray(shape))(np.asarray(data.u[-1]), rows)
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


def test_what_a_formula_leaves_in_proportion_to_an_effect_is_no_reason_for_none(monkeypatch):
    """Its interval holds it, and that of an effect beside it; whether it is there does not depend on it: were there none, it would leave nothing."""
    problem, base = prepared(0)
    gain = Addition(next(effect for effect in CATALOGUE if effect.name == "load cell nonlinearity"), (0.01,))

    def errors(problem, chains, c, additions):
        """Of smoothing by all of it, and of nothing else."""
        own = [a for a in additions if a.effect.name == "subset smoothing"]
        return [signature(problem, chains, c, (a,))[:, 0] * a.amplitudes[0] for a in own]

    def none(problem, chains, c, additions):
        return []

    def fitted(errors):
        nothing = np.zeros(len(base.residual))
        monkeypatch.setattr(effect_fit.residual_tests, "formula_errors", errors)
        monkeypatch.setattr(effect_fit.residual_tests, "kinematic_errors", lambda *given: [nothing, *errors(*given)])
        return effect_fit.refit(problem, base.c, (addition(), gain))

    exact, found = fitted(none), fitted(errors)
    assert found.additions == exact.additions
    np.testing.assert_allclose([c[0, 0] ** 0.5 for c in exact.null_covariances], [d for (d,) in exact.errors])
    smoothing, of_gain = ((found.errors[i][0], found.null_covariances[i][0, 0] ** 0.5) for i in range(2))
    assert smoothing[0] > 0.9 * found.additions[0].amplitudes[0] > 3 * smoothing[1]
    assert smoothing[1] == pytest.approx(exact.errors[0][0], rel=1e-6)
    assert of_gain[0] == of_gain[1] > exact.errors[1][0]  # beside smoothing it may be what that leaves
    assert found.additions[0] in found.distinct
