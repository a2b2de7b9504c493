"""Classical laws beside the network: identities between them, parameters found again, and what the data can tell."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from synthetic import ArrudaBoyce, plate_experiment, with_noise

from calibrate.data.experiment import Noise
from calibrate.equations.kinematics import nominal_stress
from calibrate.errors import FitError
from calibrate.fitting import classical_fit
from calibrate.fitting.calibration import Options, calibrate
from calibrate.fitting.classical_fit import Verdict, compare, fit_law
from calibrate.fitting.stopping import Stop
from calibrate.models.classical_laws import CLASSICAL_LAWS, NO_LIMIT
from forward.materials import ArrudaBoyce as ForwardArrudaBoyce

LAWS = {law.name: law for law in CLASSICAL_LAWS}
PARAMETERS = {
    "neo-Hooke": [0.3], "Mooney-Rivlin": [0.1, 0.03], "Yeoh": [0.15, -2e-3, 3e-4], "one-term Ogden": [0.3, 1.3],
    "two-term Ogden": [0.2, 2.5, 0.1, -1.5], "Arruda-Boyce": [0.27, 0.05], "Gent": [0.3, 0.02],
}  # fmt: skip
NOISE = Noise(0.01, 3.0, 1e-3, 1e-3)
FAST = Options(layers=(2,), starts=3)


def gradients():
    """Random F (6, 2, 2), and one of equal stretches."""
    rng = np.random.default_rng(0)
    return np.concatenate(
        [np.eye(2) * rng.uniform(0.9, 1.4, (6, 1, 2)) + rng.normal(0, 0.1, (6, 2, 2)), 1.2 * np.eye(2)[None]]
    )


def test_laws_pass_into_one_another_and_into_those_of_the_forward_models():
    F = gradients()
    stress = lambda name, *p: LAWS[name].stress(F, np.array(p))  # noqa: E731
    np.testing.assert_allclose(stress("one-term Ogden", 0.3, 2.0), stress("neo-Hooke", 0.3), atol=1e-9)
    mooney = stress("Mooney-Rivlin", 0.1, 0.03)
    np.testing.assert_allclose(stress("two-term Ogden", 0.2, 2.0, 0.06, -2.0), mooney, atol=1e-9)
    np.testing.assert_allclose(stress("Gent", 0.3, NO_LIMIT), stress("neo-Hooke", 0.3), rtol=1e-5, atol=1e-9)
    chains = ForwardArrudaBoyce(0.27, 20.0)
    expected = nominal_stress(lambda pair: chains.energy(pair[0], pair[1]), jnp.asarray(F))
    np.testing.assert_allclose(stress("Arruda-Boyce", 0.27, 0.05), expected, atol=1e-12)


def test_ogden_is_the_derivative_of_its_energy():
    def energy(f, mu=0.3, alpha=1.3):
        stretches = jnp.linalg.svd(f, compute_uv=False)
        third = 1 / (stretches[0] * stretches[1])
        return 2 * mu / alpha**2 * (jnp.sum(stretches**alpha) + third**alpha - 3)

    F = gradients()[:-1]  # svd has no derivative where stretches are equal
    expected = jax.vmap(jax.grad(energy))(jnp.asarray(F))
    np.testing.assert_allclose(LAWS["one-term Ogden"].stress(F, np.array([0.3, 1.3])), expected, atol=1e-9)


@pytest.mark.parametrize("law", CLASSICAL_LAWS, ids=lambda law: law.name)
def test_derivatives_by_parameters_equal_differences_and_stress_turns_with_the_body(law):
    F, p = gradients()[:-1], np.array(PARAMETERS[law.name])  # differences at equal stretches amplify rounding
    stress, slopes = law.stress_and_sensitivity(F, p)
    for k, slope in enumerate(slopes):
        h = 1e-5 * np.eye(len(p))[k] * abs(p[k])
        difference = (law.stress(F, p + h) - law.stress(F, p - h)) / (2 * h[k])
        np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-8)
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    np.testing.assert_allclose(law.stress(turn @ F, p), turn @ stress, atol=1e-12)


def test_stability_is_that_of_the_hessian_at_rest_and_falls_where_a_law_softens():
    assert LAWS["neo-Hooke"].stability(np.array([0.3]), (3.001, 3.001)) == pytest.approx(0.6, rel=0.05)  # 2 mu
    softening = np.array([0.15, -0.05, 0.0])
    assert LAWS["Yeoh"].stability(softening, (3.2, 3.2)) > 0 > LAWS["Yeoh"].stability(softening, (5.0, 5.0))


def test_parameters_are_found_again_without_noise():
    found = calibrate(plate_experiment(ArrudaBoyce(), n_increments=5), FAST)
    weights, law = found.weights, LAWS["Arruda-Boyce"]
    fit = fit_law(law, found.system, weights, law.start(0.2, 3.0), law.lower)
    np.testing.assert_allclose(fit.parameters, [0.2698, 1 / 21.49], rtol=1e-6)


def test_what_the_data_can_tell_and_what_did_not_converge(monkeypatch):
    found = calibrate(with_noise(plate_experiment(ArrudaBoyce(), n_increments=5), NOISE, 1), FAST)
    laws = [LAWS[name] for name in ("neo-Hooke", "Arruda-Boyce", "two-term Ogden")]
    seen = compare(found, laws)
    assert (seen.verdict, seen.converged[0].name, seen.laws[0].criterion > 100) == (
        Verdict.ENOUGH,
        "Arruda-Boyce",
        True,
    )
    chains = seen.laws[1].fit
    assert abs(chains.values["N"] - 21.49) < 3 * chains.deviations(seen.scale)[1]
    missing = seen.laws[0].fit  # neo-Hooke: its deviation grows with what it leaves, and is not that of noise alone
    left = missing.found.chi_square / (seen.equations - 1)
    assert left > 1.5 * seen.scale
    assert missing.deviations(seen.scale)[0] == pytest.approx(np.sqrt(left * missing.found.covariance[0, 0]))
    monkeypatch.setattr(classical_fit, "EVALUATIONS", 1)
    short = compare(found, laws)
    assert [c.fit.reason for c in short.laws] == 3 * [Stop.ITERATION_LIMIT] and short.verdict == Verdict.NONE_FITTED


@pytest.mark.slow
def test_over_noise_seeds_the_true_law_is_enough_and_its_pulls_are_normal():
    """Twelve seeds of Arruda-Boyce: never told apart from the network; pulls of mu and N of unit spread."""
    pulls = []
    for seed in range(12):
        found = calibrate(with_noise(plate_experiment(ArrudaBoyce(), n_increments=5), NOISE, seed), FAST)
        seen = compare(found, [LAWS["neo-Hooke"], LAWS["Arruda-Boyce"]])
        assert seen.verdict == Verdict.ENOUGH and seen.converged[0].name == "Arruda-Boyce"
        fit = seen.laws[1].fit
        pulls.append((np.array([fit.values["mu"], fit.values["N"]]) - [0.2698, 21.49]) / fit.deviations(seen.scale))
    assert np.all(np.std(pulls, axis=0) < 1.6) and np.all(np.std(pulls, axis=0) > 0.5)
    assert np.all(np.abs(np.mean(pulls, axis=0)) < 1.0)


def test_parameters_of_which_the_data_see_a_sum_alone_have_no_deviation():
    """As two terms of a law that are one; what is seen beside them keeps the deviation of its own."""
    x = np.linspace(0.1, 1.0, 20)
    J = np.stack([x, x, x**2], axis=1)
    found = classical_fit.least_squares_fit(lambda p: (J @ p - 3 * x - x**2, J), len(x), np.array([1.0, 0.5, 0.0]))
    deviations = np.sqrt(np.diag(found.covariance))
    assert np.isinf(deviations[:2]).all()
    expected = np.linalg.inv(J[:, 1:].T @ J[:, 1:])[1, 1]
    assert deviations[2] == pytest.approx(np.sqrt(expected), rel=1e-9)
    full = np.stack([x, x**3, x**2], axis=1)
    found = classical_fit.least_squares_fit(lambda p: (full @ p - 3 * x, full), len(x), np.ones(3))
    np.testing.assert_allclose(found.covariance, np.linalg.inv(full.T @ full), rtol=1e-8)


def test_stresses_that_are_not_finite_are_named():
    with pytest.raises(FitError, match="no finite stress at the largest strains"):
        classical_fit.least_squares_fit(lambda p: (np.full(3, np.inf), np.ones((3, 1))), 3, np.ones(1))
