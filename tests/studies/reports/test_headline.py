"""The verdict that stands first in a calibration."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from synthetic import ArrudaBoyce, plate_experiment, with_noise

from calibrate.data.experiment import LoadedBoundary, Noise
from calibrate.data.strain_signal import strain_signal
from calibrate.equations.basis import basis_for
from calibrate.equations.equilibrium import equilibrium
from calibrate.equations.reduction import assemble
from calibrate.fitting import network_fit
from calibrate.fitting.calibration import Options, calibrate
from calibrate.models.fitness import Use
from studies.reports.calibration.calibration_quality import calibration_quality
from studies.reports.calibration.fit_review import review
from studies.reports.headline import LIMITS, Reason
from studies.reports.headline import headline as headline_of

FAST = Options(layers=(2,), starts=3)


def headline(view):
    return headline_of(calibration_quality(view))


@cache
def clean(pull=18.0):
    return plate_experiment(ArrudaBoyce(), pull, n_increments=3)


@cache
def view():
    return review(calibrate(with_noise(clean(), Noise(0.01, 3.0, 1e-3, 1e-3), 1), FAST))


@cache
def noisy_view():
    """Twin of skin: a mean strain of 3 % that scatters by 5 % between neighbours."""
    return review(calibrate(with_noise(clean(1.0), Noise(0.12, 0.4, 1e-3, 1e-3), 1), FAST))


def codes(found):
    return {finding.code for finding in (*found.against, *found.reservations)}


def test_good_data_are_usable_without_reservation():
    found = headline(view())
    assert (found.verdict, codes(found)) == (Use.USABLE, set())
    assert found.to_dict()["verdict"] == "usable"


@pytest.mark.parametrize(("share", "verdict"), [(0.1, Use.RESERVATIONS), (0.64, Use.NOT)])
def test_forces_that_are_missed_outweigh_a_chi_square_of_one(share, verdict):
    wrong = {name: (1 + share) * force for name, force in view().forces.items()}
    found = headline(replace(view(), forces=wrong))
    assert view().calibration.reduced_chi_square < 2
    assert found.verdict is verdict
    assert Reason.FORCES_MISSED in codes(found)


def test_strain_below_its_noise_is_never_usable_without_saying_so():
    noisy = noisy_view()
    signal = noisy.experiment.strain_signal
    assert signal.ratio < LIMITS.strain
    assert noisy.calibration.attenuation > LIMITS.attenuation[0]
    found = headline(noisy)
    assert found.verdict is not Use.USABLE
    assert {Reason.WEAK_STRAIN, Reason.ATTENUATED} <= codes(found)


def test_reduced_chi_square_is_that_of_the_corrected_stiffness():
    """Where noise attenuates the stiffness, the loss of the attenuated model is no chi-square of the one that is written."""
    noisy = noisy_view().calibration
    assert noisy.reduced_chi_square * noisy.system.loads.size > 1.05 * noisy.loss


def test_signal_to_noise_of_the_strain():
    """Exact for a homogeneous stretch with independent noise of the triangles; halved by twice the noise."""
    x, y = np.meshgrid(np.linspace(0, 30, 61), np.linspace(0, 10, 21))
    points = np.column_stack([x.ravel(), y.ravel()])
    cells = np.arange(61 * 21).reshape(21, 61)
    a, b, c, d = (cells[i, j].ravel() for i, j in [(slice(-1), slice(-1)), (slice(-1), slice(1, None)), (slice(1, None), slice(1, None)), (slice(1, None), slice(-1))])  # fmt: skip
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    u = points * [0.1, -0.05]
    exact = strain_signal(points, triangles, u[None])
    assert exact.strain == pytest.approx(np.hypot(0.1, 0.05))
    assert exact.scatter < 1e-12
    rng = np.random.default_rng(0)
    noise = rng.standard_normal(u.shape)
    one, two = (strain_signal(points, triangles, (u + s * noise)[None]) for s in (0.004, 0.008))
    assert two.scatter == pytest.approx(2 * one.scatter, rel=1e-6)
    assert one.strain == pytest.approx(exact.strain, rel=0.1)
    spoilt = (u + 0.004 * noise).copy()
    spoilt[rng.choice(len(u), 12, replace=False)] += 3.0  # a few spurious points do not count
    assert strain_signal(points, triangles, spoilt[None]).ratio == pytest.approx(one.ratio, rel=0.2)


def test_where_no_force_judges_the_model_the_residual_does():
    """A stiff inclusion in a window of precise data: equilibrium inside is plainly wrong, and nothing else could say so."""
    quality = replace(calibration_quality(view()), reduced_chi_square=2000.0)
    assert headline_of(quality).verdict is Use.RESERVATIONS
    window = headline_of(replace(quality, level_is_nominal=True))
    assert window.verdict is Use.NOT and Reason.ABOVE_NOISE in codes(window)


def test_of_a_window_in_a_larger_body_only_ratios_are_claimed():
    """The level is nominal: forces that are missed are no reason; with a strain near its noise nothing is left."""
    wrong = {name: 2 * force for name, force in view().forces.items()}
    for one, verdict in ((view(), Use.RESERVATIONS), (noisy_view(), Use.NOT)):
        window = replace(
            one,
            forces=wrong if one is view() else one.forces,
            experiment=replace(one.experiment, provenance={"rim": True}),
        )
        found = headline(window)
        assert found.verdict is verdict
        assert Reason.RIM in codes(found) and Reason.FORCES_MISSED not in codes(found)


def test_a_turned_force_is_told():
    experiment = view().experiment
    loaded = tuple(
        LoadedBoundary(b.name, b.nodes, b.force * (1.3 if i else 1.0)) for i, b in enumerate(experiment.loaded)
    )
    found = headline(replace(view(), experiment=replace(experiment, loaded=loaded)))
    assert Reason.IMBALANCE in codes(found) or experiment.force_imbalance is None


def test_a_network_that_died_is_started_again(monkeypatch):
    """All starts of the first run are straight lines: a second run from the convex spline bends as the data do."""
    system = equilibrium(with_noise(clean(), Noise(0.01, 3.0, 1e-3, 1e-3), 1))
    assembled = assemble(system, basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2)))
    quadratic = assembled.quadratic(assembled.weights(assembled.first_guess()))
    spline = network_fit.convex_spline(quadratic, "I1")
    straight = assembled.first_guess()
    whole, calls = network_fit._fit_network, []

    def dying(quadratic, inputs, layers, spline, n_starts, seed, limit):
        calls.append(seed)
        architecture, found = whole(quadratic, inputs, layers, spline, n_starts, seed, limit)
        if len(calls) > 1:
            return architecture, found
        return architecture, replace(found, coefficients=straight, loss=quadratic.loss(straight))

    monkeypatch.setattr(network_fit, "_fit_network", dying)
    assert network_fit.is_straight(quadratic.basis, straight)
    _, found = network_fit.fit_network(quadratic, "I1", (2,), spline, 2)
    assert len(calls) == 2
    assert not found.dead and not network_fit.is_straight(quadratic.basis, found.coefficients)
    monkeypatch.setattr(network_fit, "_fit_network", lambda *a: (None, replace(found, coefficients=straight, loss=1e9)))
    assert network_fit.fit_network(quadratic, "I1", (2,), spline, 2)[1].dead
