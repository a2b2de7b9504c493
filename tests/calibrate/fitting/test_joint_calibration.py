"""Several tests calibrated together: losses add, a test weighs by its noise, every start says why it stopped."""

from dataclasses import replace

import jax
import numpy as np
import pytest
import scipy.sparse as sp
from synthetic import HartmannNeff, plate_experiment, with_noise

from calibrate.data.experiment import Noise
from calibrate.equations import noise_covariance
from calibrate.equations.basis import basis_for
from calibrate.equations.equilibrium import best_neo_hooke, equilibrium
from calibrate.fitting import network_fit
from calibrate.fitting.joint_calibration import LIKELY, fit, reduce, residual_covariance, weighted_test
from calibrate.fitting.network_fit import NetworkResidual
from calibrate.fitting.stopping import Stop
from calibrate.models import pann

NOISE = Noise(0.01, 3.0, 1e-3)
LAW = HartmannNeff()


@pytest.fixture(scope="module")
def tests():
    clean = plate_experiment(LAW)
    return [weighted_test(equilibrium(with_noise(part, NOISE, seed), 12.0))
            for seed, part in enumerate((clean.select([0, 1]), clean.select([0])))]  # fmt: skip


def test_the_covariance_is_that_of_independent_sources(tests):
    system = tests[0].system
    basis = basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2))
    factor = noise_covariance.noise_factor(system.experiment, NOISE)
    c = best_neo_hooke(system, basis)
    F, load = system.deformation_gradients[1], system.loads[1]
    spread = noise_covariance.spread(system, basis, c, F, factor)
    expected = noise_covariance.covariance_of(system, spread, load, NOISE)
    found = residual_covariance(system, basis, c, 1, sp.csr_array(factor @ factor.T), NOISE)
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


def test_losses_of_tests_add(tests):
    together = reduce(tests, "I1I2")
    alone = [test.quadratic(together.quadratic.basis) for test in tests]
    c = together.spline
    assert together.quadratic.loss(c) == pytest.approx(sum(one.loss(c) for one in alone))
    assert together.quadratic.n_rows == sum(one.n_rows for one in alone)


def test_a_test_weighs_by_the_inverse_square_of_its_noise(tests):
    experiment = tests[0].system.experiment
    noisier = Noise(2 * NOISE.displacement_std, NOISE.correlation_length, 2 * NOISE.force_std_relative)
    other = weighted_test(equilibrium(replace(experiment, noise=noisier), 12.0))
    for i, one in tests[0].lowers.items():
        np.testing.assert_allclose(
            np.diag(other.lowers[i]), 2 * np.diag(one), rtol=0.02
        )  # the law they are weighted at follows the noise a little


def test_two_tests_give_the_law_and_say_how(tests):
    found = fit(reduce(tests, "I1I2"), (4,), starts=4)
    assert found.loss_per_equation == pytest.approx(1.0, abs=0.3)
    assert len(found.reasons) == len(found.losses) == 4
    assert all(isinstance(reason, Stop) for reason in found.reasons)
    assert found.best in found.likely
    assert found.agreement == len(found.likely) / 4
    assert (found.losses[found.likely] <= found.losses.min() + LIKELY * max(1, found.loss_per_equation)).all()


@pytest.mark.parametrize("inputs", ["I1", "I2", "I1I2"])
@pytest.mark.parametrize("distil", [True, False])
def test_the_short_way_to_the_jacobian_is_the_long_one(tests, inputs, distil):
    reduced = reduce(tests[1:], inputs)
    problem = network_fit._scaled_problem(reduced.quadratic, inputs, reduced.spline)
    residual = NetworkResidual(pann.Architecture(inputs, (3, 2)), distil)
    theta = residual.architecture.random_start(jax.random.key(0))
    np.testing.assert_allclose(
        residual.jacobian(theta, problem.data), jax.jacfwd(residual)(theta, problem.data), atol=1e-12, rtol=1e-9
    )
