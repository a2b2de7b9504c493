"""Weights of a model: noise of the displacements makes errors of the equations in proportion to the stiffness, so that no law is likelier because it is softer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import synthetic

from calibrate.data.experiment import Noise
from calibrate.diagnosis import base_fit, effect_fit, model_weights
from calibrate.diagnosis.problem import all_rows
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from calibrate.equations.basis import SingleBasis
from calibrate.equations.reduction import coefficients_of_weights
from calibrate.equations.weights import weights_of

EFFECTS = {effect.name: effect for effect in CATALOGUE}
NOISE = Noise(0.01, 3.0)


def inside(problem, c, additions=()):
    """Chi-square of the equations of virtual fields that vanish where forces act, which hold for every stiffness."""
    (part,) = problem.parts
    noise = model_weights.noise_of(part, problem.weights_c, ())
    white = weights_of(noise, part.train.rows & part.inside)(part.chain.residual(c, additions))
    return float(white @ white)


def work(problem, c):
    """Of the measured loads: how stiff a base is."""
    total = 0.0
    for part in problem.parts:
        total += work_with(part, c, ())
    return total


def work_with(part, c, additions):
    """The same with effects."""
    load = part.chain.external()
    return float((load * (part.chain.residual(c, additions) + load)).sum())


@pytest.fixture(scope="module")
def prepared():
    e = synthetic.with_noise(synthetic.plate_experiment(n_increments=4), NOISE, 1)
    return base_fit.prepare([replace(e, time=np.arange(1.0, 5.0))], [all_rows], with_discrepancy=False)


def test_a_stiffer_law_with_the_same_shape_of_errors_is_as_likely(prepared):
    """All stresses times 1.2, and the noise that they make."""
    problem, base = prepared
    softer, stiffer = (model_weights.as_stiff(problem, s * base.c, ()) for s in (1.0, 1.2))
    assert work(problem, stiffer.weights_c) == pytest.approx(1.2 * work(problem, softer.weights_c), rel=1e-12)
    chi = [inside(one, s * base.c) for one, s in ((softer, 1.0), (stiffer, 1.2))]
    assert chi[1] == pytest.approx(chi[0], rel=0.01)  # the shape of the weights follows the misfit
    assert inside(softer, 1.2 * base.c) == pytest.approx(1.44 * chi[0], rel=1e-6)


@pytest.mark.parametrize(
    ("name", "amplitude"), [("force offset", 0.5), ("lag between force and image", 0.2), ("lens distortion", 0.01)]
)
def test_what_belongs_to_the_measurement_makes_no_law_stiffer(prepared, name, amplitude):
    problem, base = prepared
    addition = Addition(EFFECTS[name], (amplitude,), tuple(p.lower for p in EFFECTS[name].shapes))
    found = model_weights.reweighted(problem, base.c, (addition,))
    assert work(problem, found.weights_c) == pytest.approx(work(problem, base.c), rel=2e-3)  # weights of another shape


def test_what_belongs_to_the_law_does(prepared):
    """By as much as the work of the loads rises."""
    problem, base = prepared
    found = model_weights.reweighted(problem, base.c, (Addition(EFFECTS["second invariant"], (0.2 * base.c[0],)),))
    assert (found.weights_c > 1.05 * base.c).all()


def test_weights_of_a_softened_law_are_those_of_its_tangent():
    """Whichever they were before: of a sheet that is loaded, unloaded and loaded again, when the law is met, and met again. A stiffness that was measured in the weights of the equations was another one each time."""
    ramp = synthetic.with_noise(synthetic.plate_experiment(n_increments=4), NOISE, 1)
    way = [1, 3, 2, 1, 0, 1, 2, 3]
    loaded = tuple(replace(b, force=b.force[way]) for b in ramp.loaded)
    cycle = replace(ramp, displacements=ramp.displacements[way], loaded=loaded, time=np.arange(1.0, 9.0))
    problem, base = base_fit.prepare([cycle], [all_rows], with_discrepancy=False, base="neo-Hooke")
    softening = Addition(EFFECTS["Mullins softening"], (0.6,), (0.01, 0.05))
    part, found, variances = problem.parts[0], problem, []
    each = part.chain.spread_of_noise(base.c, (softening,), part.assembled.fewest_sources, part.assembled.samples[0])
    tangents = model_weights.stacked(each, len(part.assembled.samples[0]))
    exact = model_weights.EquationNoise.of(part.system, part.assembled.noise, tangents, part.assembled.samples[1])
    wanted = weights_of(exact, part.train.rows).log_determinant / part.train.size
    for _ in range(3):
        found = model_weights.reweighted(found, base.c, (softening,))
        variances.append(found.trained[0].train.log_determinant / found.trained[0].train.size)
    np.testing.assert_allclose(variances, wanted, atol=1e-9)


def test_a_window_beside_a_measured_test_takes_its_stiffness_from_that():
    """It has no load that tells by how much effects of the material make it stiffer: its noise is that beside the loads of the other."""
    e = synthetic.with_noise(synthetic.plate_experiment(n_increments=3), NOISE, 1)
    window = replace(e, name="window", provenance={**e.provenance, "rim": True})
    problem, base = base_fit.prepare([window, e], [all_rows, all_rows], with_discrepancy=False)
    second = Addition(EFFECTS["second invariant"], (0.2 * base.c[0],))
    assert not problem.parts[0].chain.external().any()
    of_window, of_test = model_weights.reweighted(problem, base.c, (second,)).trained
    inside = np.broadcast_to(of_test.inside, of_test.train.rows.shape)
    both = inside & of_window.train.rows & of_test.train.rows
    assert of_window.train.variance[both] == pytest.approx(of_test.train.variance[both], rel=0.01) and both.any()


def test_an_explanation_keeps_what_the_best_one_does_to_noise(prepared):
    problem, base = prepared
    rough = Addition(EFFECTS["subset smoothing"], (0.5,), (1.0,))
    lag = Addition(EFFECTS["lag between force and image"], (0.2,), (1.0,))
    best = model_weights.reweighted(problem, base.c, (rough,))
    assert best.amplifying == (rough,)
    assert model_weights.as_stiff(best, base.c, (lag,)).amplifying == (rough,)
    assert model_weights.reweighted(problem, base.c, (lag,)).amplifying == ()


def test_weights_are_those_of_the_base_where_it_leaves_noise_alone_and_of_neo_hooke_where_it_leaves_much():
    c, neo_hooke = np.array([1.0, 2.0, 3.0]), np.full(3, 2.0)
    for dispersion, share in ((0.7, 1.0), (1.0, 1.0), (4.0, 0.25), (1e12, 0.0)):
        found = coefficients_of_weights(SingleBasis(0, 1.0), c, neo_hooke, dispersion)
        np.testing.assert_allclose(found, neo_hooke + share * (c - neo_hooke), atol=1e-11)


def test_a_base_that_bends_leaves_no_more_than_one_that_cannot_of_fields_that_are_wrong():
    """Each in its own weights. Fields are off by 5 % of the largest displacement in two half waves, some thirty times the noise. With weights that followed
    the base, it left twice as much as neo-Hooke."""
    clean, noise = synthetic.plate_experiment(n_increments=6), Noise(0.004, 3.0, 3e-4, 2e-3)
    places = (clean.points - clean.points.min(axis=0)) / np.ptp(clean.points, axis=0)
    growth = np.linalg.norm(clean.displacements, axis=(1, 2))
    wrong = 0.05 * np.abs(clean.displacements).max() * (growth / growth[-1])[:, None, None] * np.cos(2 * np.pi * places)
    seen = synthetic.with_noise(clean, noise, 1)
    seen = replace(seen, noise=noise, displacements=seen.displacements + wrong)
    bends, neo_hooke = (base_fit.prepare([seen], [all_rows], base=base)[1] for base in ("positive", "neo-Hooke"))
    assert neo_hooke.reduced_chi_square > 100
    assert bends.reduced_chi_square < neo_hooke.reduced_chi_square
    assert bends.c.min() > 0.5 * neo_hooke.c.min()


def test_noise_in_the_weights_shifts_no_amplitude():
    """A force offset where there is none, over its deviation, in 16 tests with 10 % of noise in the strain: two deviations and more with weights at the measured displacements."""
    sheet, noise = synthetic.plate_experiment(synthetic.MooneyRivlin(0.15, 0.0), n_increments=6), Noise(0.3, 3.0, 1e-4)
    offset, pulls = Addition(EFFECTS["force offset"], (0.0,)), []
    for seed in range(16):
        tests = [synthetic.with_noise(sheet, noise, seed)]
        problem, base = base_fit.prepare(tests, [all_rows], with_discrepancy=False, base="neo-Hooke")
        measured = replace(problem, parts=(replace(problem.parts[0], denoised=None),))
        both = (model_weights.reweighted(measured, base.c, ()), problem)
        fits = [effect_fit.refit(one, base.c, (offset,)) for one in both]
        pulls.append([fit.additions[0].amplitudes[0] / fit.errors[0][0] for fit in fits])
    at_measured, at_true = np.mean(pulls, axis=0)
    assert at_measured < -1.5
    assert abs(at_true) < 0.6  # its deviation is 0.25
