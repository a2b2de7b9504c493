"""The twin of a test: its residual is that of the discretisation, of another mesh as of its own, and what cannot be replayed is named."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import synthetic

from calibrate.data.experiment import Experiment, Noise
from calibrate.data.load_path import turning_points
from calibrate.data.triangulation import signed_areas
from calibrate.diagnosis import base_fit, twin
from calibrate.diagnosis import problem as equations
from calibrate.diagnosis.discovery import discover
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.problem import Part, all_rows
from calibrate.effects import CATALOGUE, Thickness
from calibrate.effects.chain import Addition, Chain
from calibrate.effects.support.effect_data import edge_means
from calibrate.equations import noise_covariance
from calibrate.equations.discretisation_error import REMAINDER
from calibrate.equations.equilibrium import neo_hooke
from calibrate.errors import NoTwinError
from calibrate.models.extended_model import ExtendedModel
from forward.loading import Loading
from forward.materials import ArrudaBoyce, NeoHooke
from forward.sheet.plane_stress import solve
from meshes import PlateWithHole, quads, triangles
from studies.replay.twin_replay import twin_replay
from studies.synthetic import camera
from studies.synthetic.correlation_disturbances import SubsetSmoothing
from studies.trials import blind_data, blind_solution
from studies.trials.blind_effects import SOLID, Hidden

PLATE = PlateWithHole(half_length=30, half_width=15, far_size=1.5, hole_radius=5, hole_size=0.8)
EXACT = Noise(1e-3, 2.0, 1e-4)  # mm: little beside the discretisation error
SPACING = 6.0  # mm


@cache
def solution():
    return solve(quads(PLATE, quarter=True), ArrudaBoyce(), Loading.clamped(PLATE.loaded, 12.0), 2).mirrored()


def in_steps():
    """The same in eight increments, on a coarser mesh."""
    return solve(
        quads(PLATE, quarter=True, size_factor=2.0), ArrudaBoyce(), Loading.clamped(PLATE.loaded, 12.0), 8
    ).mirrored()


@cache
def test_of(nodes: int) -> Experiment:
    """Biquadratic quads that share no node with the camera."""
    return replace(camera.observe(solution(), triangles(PLATE, n_nodes=nodes), name="plate"), noise=EXACT)


test_of.__test__ = False


@cache
def fitted(nodes: int):
    return base_fit.prepare([test_of(nodes)], [all_rows], SPACING)


@cache
def with_twin(nodes: int):
    problem, fit = fitted(nodes)
    return *twin.with_twins(problem, fit, twin_replay), fit


def size(values) -> float:
    return float(np.linalg.norm(values))


def part_and_twin(nodes: int) -> tuple[Part, np.ndarray]:
    part = with_twin(nodes)[0].parts[0]
    return part, part.twin


def test_the_residual_of_a_twin_falls_with_the_distance_of_the_points():
    """By more than the second order, that of the recovered gradients; it is less than four, as stresses are singular at the ends of the grips."""
    coarse, fine = (size(part_and_twin(n)[1]) for n in (200, 800))
    assert 2 < np.log2(coarse / fine) < 4


@pytest.mark.parametrize("nodes", [200, 800])
def test_a_test_of_another_mesh_has_the_residual_of_its_twin(nodes):
    """What is left is within two standard deviations of what is allowed for."""
    problem, base = fitted(nodes)
    part, found = part_and_twin(nodes)
    r = problem.parts[0].residual(base.c)
    whiten = base_fit.prepare([test_of(nodes)], [all_rows], SPACING, with_discrepancy=False)[0].parts[0].train
    assert size(whiten(r)) ** 2 > whiten.size
    assert size(whiten(r - found)) < 2 * REMAINDER * size(whiten(r))
    assert size(part.train(r - found)) ** 2 < part.train.size


def test_noise_of_the_grips_hardly_changes_the_residual_of_a_twin():
    """Replayed as measured: less than a fiftieth of what the noise does to the equations themselves."""
    e = replace(test_of(200), noise=Noise(0.02, 2.0, 1e-4))
    problem, fit = base_fit.prepare([e], [all_rows], SPACING, with_discrepancy=False)
    part = problem.parts[0]
    noise = noise_covariance.sample(part.assembled.noise_factor, np.random.default_rng(0), e.n_increments)
    model = ExtendedModel(problem.basis, fit.c, (), (), "MPa")
    exact, moved = (
        twin.residual(part, fit.c, twin_replay(replace(e, displacements=e.displacements + u), model).test)
        for u in (0.0, noise)
    )
    assert 0 < size(part.train(moved - exact)) ** 2 < 0.02 * part.train.size


def test_a_replay_is_seen_at_all_its_nodes_too():
    """The first of which are the points of the camera; grips are whole, and the triangles cover the same region."""
    e = test_of(200)
    problem, fit = fitted(200)
    found = twin_replay(e, ExtendedModel(problem.basis, fit.c, (), (), "MPa"))
    n = len(e.points)
    np.testing.assert_array_equal(found.finer.points[:n], e.points)
    np.testing.assert_array_equal(found.finer.displacements[:, :n], found.test.displacements)
    for one, other in zip(e.loaded, found.finer.loaded, strict=True):
        assert set(one.nodes) < set(other.nodes)
        assert np.ptp(found.finer.points[other.nodes, 0]) < 1e-9
    whole, fine = (signed_areas(one.points, one.triangles) for one in (e, found.finer))
    assert fine.min() > 0 and fine.sum() == pytest.approx(whole.sum(), rel=2e-3)
    assert not np.isin(found.finer.free_nodes, np.concatenate([b.nodes for b in found.finer.loaded])).any()


@pytest.mark.slow
def test_a_twin_tells_what_the_triangles_miss_of_the_bend_at_sharp_holes():
    """A cross twice as thick as its holes are wide, of a material that is known, without noise: only with the twin does the effect of the thickness
    explain the residual, to a twentieth."""
    trial = replace(blind_data.draw(3, None), specimen="cross", material=NeoHooke(0.4), thickness=4.0, stretch=1.4)
    hidden = Hidden(SOLID, {"b": 4 / 3}, {}, {"thickness": 4.0})
    trial = replace(trial, effects=(hidden,), factors=(0.5, 1.0), times=(1.0, 2.0))
    e = replace(blind_solution.clean_experiment(trial), noise=Noise(0.004, 1.2, 3e-4, 1e-3))
    problem, _, reasons = twin.with_twins(*base_fit.prepare([e], [all_rows], with_discrepancy=False), twin_replay)
    assert reasons == ()
    (part,), c = problem.parts, neo_hooke(problem.basis, 0.4)
    thick = (Addition(Thickness(), (4 / 3,)),)
    unaware = Chain(part.system, problem.basis)
    before, without, after = (
        size(part.train(one - part.twin)) ** 2
        for one in (part.chain.residual(c), unaware.residual(c, thick), part.chain.residual(c, thick))
    )
    assert without > 0.5 * before
    assert after < 0.05 * before


def test_between_replayed_increments_the_residual_is_interpolated():
    """In the steps of a quarter that are replayed, and between: to a twentieth of the largest."""
    e = replace(camera.observe(in_steps(), triangles(PLATE, n_nodes=200), name="plate"), noise=EXACT)
    problem, fit = base_fit.prepare([e], [all_rows], SPACING)
    part = problem.parts[0]
    assert len(turning_points(e.displacements)[0]) < e.n_increments
    found = twin.with_twins(problem, fit, twin_replay)[0].parts[0].twin
    c = twin.stiffening_base(problem, fit)
    every = twin.residual(part, c, twin_replay(e, ExtendedModel(problem.basis, c, (), (), "MPa")).test)
    assert size(found - every) < 0.05 * size(every)


def test_a_model_with_an_effect_of_the_material_has_a_twin_of_its_own():
    """An effect of the camera is not replayed; with one of the material the replay gets the whole model, and its residual is that of the chain with it."""
    asked = []

    def replay(experiment, model):
        asked.append(model)
        return twin.Replayed(experiment)

    e = replace(synthetic.plate_experiment(n_increments=2), noise=Noise(0.01, 3.0, 1e-4))
    problem, fit, _ = twin.with_twins(*base_fit.prepare([e], [all_rows]), replay)
    camera_effect, mooney = (Addition(next(o for o in CATALOGUE if o.name == name), (value,))
                             for name, value in (("image rotation", 0.001), ("second invariant", 0.02)))  # fmt: skip
    assert twin.with_own_twins(problem, replace(fit, additions=(camera_effect,)))[0] is problem
    found, _ = twin.with_own_twins(problem, replace(fit, additions=(camera_effect, mooney)))
    assert [one.additions for one in asked] == [(), (mooney,)]
    expected = problem.parts[0].chain.residual(fit.c, (mooney,))
    np.testing.assert_allclose(found.parts[0].twin, expected, atol=1e-12)
    left, _ = twin.with_own_twins(
        found, replace(fit, additions=(camera_effect,))
    )  # without the effect again, without its twin
    assert [one.additions for one in asked] == [(), (mooney,), ()]
    assert twin.with_own_twins(left, replace(fit, additions=(camera_effect,)))[0] is left


def test_what_a_twin_tells_is_subtracted_and_no_misfit():
    """A replay that is the test itself: nothing is left but the mean that noise brings."""
    e = replace(synthetic.plate_experiment(n_increments=2), noise=Noise(0.01, 3.0, 1e-4))
    problem, fit = base_fit.prepare([e], [all_rows])
    found, refitted, reasons = twin.with_twins(problem, fit, lambda experiment, model: twin.Replayed(experiment))
    (part,) = found.parts
    c = twin.stiffening_base(problem, fit)
    np.testing.assert_allclose(part.twin, problem.parts[0].chain.residual(c), atol=1e-12)
    np.testing.assert_allclose(part.residual(c), -part.shift, atol=1e-12)
    np.testing.assert_allclose(found.parts[0].own_residual(fit.c), problem.parts[0].own_residual(fit.c) - part.twin)
    assert reasons == ()
    assert refitted.additions == ()


def fields_of(nodes: int):
    """Data of the chain with its twin, and the exact deformation gradients (k, 2, 2) in the middle of every free edge, by their triangles (k,)."""
    data = part_and_twin(nodes)[0].chain.data
    beside = np.flatnonzero(np.asarray(data.edges))
    ends = np.asarray(data.points)[np.asarray(data.edge_nodes)[beside]]
    middles = ends.mean(axis=1) + 1e-3 * (np.asarray(data.centroids)[beside] - ends.mean(axis=1))
    return data, beside, solution().deformation_gradient(middles)[-1]


def test_at_free_edges_a_twin_knows_the_deformation_better_than_the_camera():
    """Than means over the ends of an edge: by more than three times."""
    data, beside, exact = fields_of(800)
    seen = (np.eye(2) + np.asarray(edge_means(data, data.u)))[-1, beside]
    known = seen + np.asarray(data.twin.missed)[1, -1]
    assert size(known - exact) < size(seen - exact) / 3


@pytest.mark.parametrize("side", [1.0, 2.5])
def test_subset_smoothing_is_known_by_a_twin_where_the_cameras_derivatives_are_not(side):
    """What squares cut by the specimen's edges read of the exact field: right to 15 %, which derivatives on the camera's triangles are not."""
    effect = next(e for e in CATALOGUE if e.name == "subset smoothing")
    e, data = test_of(800), fields_of(800)[0]
    exact = SubsetSmoothing(side).displacements(solution(), PLATE, e.points)[-1] - e.displacements[-1]
    a = np.array([side**2 / 12]), np.array([side])
    own, without = (size(np.asarray(data.u - effect.displacements(one, data.u, *a))[-1] - exact) / size(exact)
                    for one in (data, replace(data, twin=None)))  # fmt: skip
    assert own < 0.15
    assert own < without / 2


def test_the_base_that_is_replayed_does_not_soften():
    """And is that of the fit where that stiffens; of one that softens it is the nearest, so that it meets the loads."""
    problem, fit = fitted(200)
    splines = problem.basis.spline.matrix(np.linspace(0, 1, 200))
    softening = replace(fit, c=fit.c * np.linspace(1.3, 0.7, len(fit.c)))
    for one in (fit, replace(softening, residual=effect_residual(problem, softening.c))):
        c = twin.stiffening_base(problem, one)
        psi_1 = splines @ c
        assert (np.maximum.accumulate(psi_1) - psi_1).max() < 1e-3 * psi_1.max()  # the basis interpolates
        work, loads = effect_residual(problem, c) + equations.loads(problem), equations.loads(problem)
        assert size(work - loads) < 0.05 * size(loads)


def test_the_base_that_is_replayed_has_a_stiffness_at_rest():
    """Of data that ask for none, 5 % of the mean."""
    problem, fit = fitted(200)
    c = fit.c * np.linspace(0.0, 2.0, len(fit.c)) ** 3
    found = twin.stiffening_base(problem, replace(fit, c=c, residual=effect_residual(problem, c)))
    assert found[0] >= 0.999 * twin.LEAST * c.mean()


def effect_residual(problem, c):
    return equations.residual(problem, c, ())


def test_the_weights_allow_for_less_where_there_is_a_twin():
    problem, _ = fitted(200)
    part, _ = part_and_twin(200)
    assert part.train.log_determinant < problem.parts[0].train.log_determinant
    assert len(part.common) == len(problem.parts[0].common) + 1


def test_a_test_that_cannot_be_replayed_keeps_its_weights_and_says_why():
    e = replace(synthetic.plate_experiment(n_increments=3), noise=Noise(0.01, 3.0, 1e-4))
    effects = [one for one in CATALOGUE if one.name == "force offset"]

    def fails(experiment, model):
        raise NoTwinError(f"{experiment.name}: no equilibrium")

    given = [e], HoldOut("none", None), (), effects, 12.0
    plain, found = (discover(*given, fitted=False, replay=one) for one in (None, fails))
    assert found.without_twin == ("plate: no equilibrium",) and plain.without_twin == ()
    assert found.problem.parts[0].twin is None
    np.testing.assert_array_equal(found.base.residual, plain.base.residual)


def test_why_a_test_has_no_twin():
    e = test_of(200)
    problem, fit = fitted(200)
    model = ExtendedModel(problem.basis, fit.c, (), (), "MPa")
    with pytest.raises(NoTwinError, match="^plate: a replay solves thin sheets in plane stress, not plane strain$"):
        twin_replay(replace(e, plane="strain"), model)
    with pytest.raises(NoTwinError, match="^plate: .*shear modulus"):
        twin_replay(e, replace(model, c=-fit.c))
