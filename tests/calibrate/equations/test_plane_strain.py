"""Plane strain: energies written out in 3D, small strains, derivatives, closed forms, and a forward model of another kind."""

import json
from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_up import made_up_chain
from synthetic import plate_experiment, random_gradients

from calibrate.data.experiment import Experiment, LoadedBoundary, Noise
from calibrate.diagnosis.base_fit import prepare
from calibrate.diagnosis.discovery import discover
from calibrate.diagnosis.distillation import bulk_modulus
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from calibrate.equations import isochoric as plane_strain
from calibrate.equations.basis import PlaneStrainBasis, SingleBasis, basis_for, tangent_modulus
from calibrate.equations.equilibrium import best_neo_hooke, equilibrium, neo_hooke
from calibrate.errors import ConfigError, FitError, ModelFileError
from calibrate.fitting.calibration import Options, calibrate
from calibrate.models.extended_model import ExtendedModel
from calibrate.models.network_model import Model
from forward.errors import MaterialError
from forward.loading import Loading
from forward.materials import ArrudaBoyce, MooneyRivlin
from forward.sheet.plane_strain import PlaneStrainProblem
from forward.sheet.plane_stress import solve
from meshes import quads, triangles
from meshes.specimens import PlateWithHole
from studies.accuracy.metrics import ArrudaBoyceTruth, nominal_stress
from studies.synthetic.camera import Camera, GaussianField, observe

KAPPA = 2.0
BOTH = MooneyRivlin(0.1, 0.05)
TESTABLE = [e for e in CATALOGUE if e.missing(made_up_chain("strain").data) != "plane stress"]


def full_energy(F, c10, c01, kappa):
    """Mooney-Rivlin of the isochoric part and kappa (J - 1)^2 / 2, of diag(F, 1) written out in 3D."""
    full = jnp.eye(3).at[:2, :2].set(F)
    J, C = jnp.linalg.det(full), full.T @ full
    I1 = jnp.trace(C)
    I2 = 0.5 * (I1**2 - jnp.trace(C @ C))
    return c10 * (J ** (-2 / 3) * I1 - 3) + c01 * (J ** (-4 / 3) * I2 - 3) + 0.5 * kappa * (J - 1) ** 2


def sheet_law(f, c10, c01):
    """P0 of the same energy in incompressible plane stress, f (2, 2)."""

    def psi(f):
        C = f.T @ f
        det, trace = jnp.linalg.det(C), jnp.trace(C)
        return c10 * (trace + 1 / det) + c01 * (det + trace / det)

    return jax.grad(psi)(f)


def test_stress_is_that_of_the_energy_in_three_dimensions():
    F = jnp.asarray(random_gradients(50))
    expected = jax.vmap(lambda f: jax.grad(full_energy)(f, 0.1, 0.03, KAPPA))(F)
    P0 = jax.vmap(lambda f: sheet_law(f, 0.1, 0.03))(plane_strain.isochoric(F))
    np.testing.assert_allclose(plane_strain.stress(F, P0, KAPPA), expected, rtol=1e-12, atol=1e-12)


def test_small_strains_are_linear_elasticity():
    """Lame's lambda = kappa - 2 mu / 3."""
    basis, e = PlaneStrainBasis(SingleBasis(0, 1.0)), 1e-7 * np.array([[1.0, 0.4], [0.4, -0.3]])
    P, columns = basis.local((np.eye(2) + e)[None])
    found = np.einsum("qij,q->ij", P[0], neo_hooke(basis, 0.3, KAPPA)[columns[0]])
    np.testing.assert_allclose(found, (KAPPA - 0.2) * np.trace(e) * np.eye(2) + 0.6 * e, rtol=1e-5, atol=1e-13)


@pytest.mark.parametrize("inputs", ["I1", "I1I2"])
def test_the_tangent_is_the_derivative_of_the_stress(inputs):
    F = random_gradients(20, spread=0.15)
    basis = basis_for(inputs, F, plane="strain")
    c = neo_hooke(basis, 0.3, KAPPA)
    direction = np.random.default_rng(1).standard_normal(F.shape)

    def stress(F):
        P, columns = basis.local(F)
        return np.einsum("mqij,mq->mij", P, c[columns])

    step = 1e-6
    slope = (stress(F + step * direction) - stress(F - step * direction)) / (2 * step)
    found = np.einsum("miakb,mkb->mia", tangent_modulus(basis, F, c), direction)
    np.testing.assert_allclose(found, slope, atol=1e-7 * np.abs(slope).max())


@pytest.fixture(scope="module")
def chain():
    return made_up_chain("strain")


@pytest.fixture(scope="module")
def c(chain):
    return np.append(0.1 + 0.05 * np.linspace(0, 1, chain.basis.n_functions - 1) ** 2, KAPPA)


def test_the_chain_is_the_linear_system(chain, c):
    system = chain.system
    expected = [system.matrix(chain.basis, F) @ c - np.nan_to_num(load)
                for F, load in zip(system.deformation_gradients, system.loads, strict=True)]  # fmt: skip
    np.testing.assert_allclose(chain.residual(c), expected, atol=1e-12)


@pytest.mark.parametrize("effect", TESTABLE, ids=lambda e: e.name)
def test_signature_is_the_derivative(chain, c, effect):
    """Beside a second invariant that is in the model already; null changes nothing."""
    others = (Addition(CATALOGUE[0], (0.02,)),)
    shape, null = effect.shape_values(chain.data)[-1], np.array([p.null for p in effect.amplitudes])
    at = lambda a: chain.residual(c, (*others, Addition(effect, tuple(a), shape)))  # noqa: E731
    base = chain.residual(c, others)
    np.testing.assert_allclose(at(null), base, rtol=0, atol=1e-12 * np.abs(base).max())
    found = chain.signature(c, effect, shape, others)
    for i, parameter in enumerate(effect.amplitudes):
        # small, as what depends on the sign of an amplitude is of second order
        step = 3e-6 * parameter.typical * np.eye(len(null))[i]
        slope = (at(null + step) - at(null - step)) / (2 * step[i])
        np.testing.assert_allclose(found[i], slope, atol=1e-6 * np.abs(slope).max())


def test_the_transposed_tangent(chain, c):
    """<K^T f, du> = <f, K du> by a difference of residuals."""
    rng = np.random.default_rng(0)
    force, du = rng.standard_normal(chain.residual(c).shape), rng.standard_normal(chain.data.u.shape)
    step = 1e-6
    change = (chain.disturbed(step * du).residual(c) - chain.disturbed(-step * du).residual(c)) / (2 * step)
    expected = (force * change).sum()
    assert (chain.pulled_back(c, (), force) * du).sum() == pytest.approx(expected, rel=1e-6)


def test_sheet_effects_are_not_testable(chain):
    missing = {e.name for e in CATALOGUE} - {e.name for e in TESTABLE}
    assert missing == {"compressibility", "3D effect of thickness", "camera tilt", "lens distortion", "unmeasured strip",
                       "initial warp"}  # fmt: skip


@cache
def plate(material=ArrudaBoyce(), displacement=20.0, increments=6, kappa=KAPPA):
    """A plate with a hole in plane strain, Q2."""
    specimen = PlateWithHole()
    mesh = quads(specimen, quarter=True, size_factor=1.5)
    loading = Loading.clamped(specimen.loaded, displacement)
    return solve(mesh, material, loading, increments, bulk_modulus=kappa).mirrored()


def recorded(solution, seed=None, noise=1e-4):
    camera = Camera(GaussianField(4.0, resolution=512), relative_noise=noise)
    return observe(solution, triangles(PlateWithHole(), n_nodes=1500), camera, seed)


def test_uniform_deformation_gives_the_closed_form():
    """Every node moves with one F: stored energy, and work of the nodal forces on a virtual F."""
    mesh = quads(PlateWithHole(), quarter=True, size_factor=3.0)
    F, outer = np.array([[1.3, 0.1], [-0.05, 0.9]]), np.ones(len(mesh.points), bool)
    held = np.repeat(outer[:, None], 2, axis=1)
    problem = PlaneStrainProblem(mesh, BOTH, 2.0, held, mesh.points @ (F - np.eye(2)).T, 1e-10, 25, bulk_modulus=KAPPA)
    problem.unknowns = (mesh.points @ (F - np.eye(2)).T,)
    energy = full_energy(jnp.asarray(F), 0.1, 0.05, KAPPA)
    assert problem.energy() == pytest.approx(2.0 * float(energy) * mesh.area(), rel=1e-9)
    virtual = np.array([[0.7, -0.2], [0.4, 0.3]])
    P = jax.grad(full_energy)(jnp.asarray(F), 0.1, 0.05, KAPPA)
    work = (problem.nodal_forces() * (mesh.points @ virtual.T)).sum()
    assert work == pytest.approx(2.0 * mesh.area() * float((np.asarray(P) * virtual).sum()), rel=1e-9)


def test_stored_energy_is_the_work_of_the_grips():
    """To the error of the trapezoidal rule over six increments."""
    solution = plate()
    force = np.concatenate([[0.0], solution.reactions["right"][:, 0] - solution.reactions["left"][:, 0]])
    work = np.trapezoid(force, np.concatenate([[0.0], 20.0 * solution.time]))
    assert solution.energy[-1] == pytest.approx(work, rel=5e-3)


def test_a_bulk_modulus_that_locks_is_refused():
    with pytest.raises(MaterialError, match="locks"):
        solve(quads(PlateWithHole(), quarter=True, size_factor=3.0), ArrudaBoyce(),
              Loading.clamped(PlateWithHole.loaded, 1.0), 1, bulk_modulus=1e5)  # fmt: skip


def test_calibration_finds_energy_and_bulk_modulus():
    """From Q2 data, clean: another discretisation and another formula than those of the inverse model."""
    model = calibrate(recorded(plate()), Options(starts=5)).model
    assert model.bulk_modulus == pytest.approx(KAPPA, rel=2e-3)
    stretch = np.array([1.2, 1.5, 1.7])
    for mode in ("uniaxial", "pure_shear"):
        expected = nominal_stress(ArrudaBoyceTruth(), mode, stretch)
        np.testing.assert_allclose(model.homogeneous(mode, stretch), expected, rtol=5e-3)


@pytest.mark.slow
def test_deviation_of_the_bulk_modulus_holds():
    """Six seeds of noise: pulls of unit size, as far as six tell (chi-square, 0.1 to 99.9 %)."""
    found = [calibrate(recorded(plate(), seed), Options(starts=2)).model for seed in range(6)]
    pulls = np.array([(m.bulk_modulus - KAPPA) / m.bulk_modulus_deviation for m in found])
    assert 0.38 < (pulls**2).sum() < 22.5


@pytest.mark.slow
def test_noise_in_the_change_of_volume_does_not_bias_the_bulk_modulus():
    """36 shear moduli at 0.1 mm of noise: 8.2 MPa without the correction, which is five deviations away."""
    found = [calibrate(recorded(plate(kappa=10.0), seed, 5e-4), Options(starts=2)).model for seed in range(4)]
    mean = np.mean([m.bulk_modulus for m in found])
    assert abs(mean - 10.0) < 2 * found[0].bulk_modulus_deviation / np.sqrt(len(found)) < 0.6


def test_a_bulk_modulus_that_noise_hides_is_refused():
    with pytest.raises(FitError, match="noise"):
        calibrate(recorded(plate(kappa=50.0), 0, 5e-4), Options(starts=2))
    with pytest.raises(FitError, match="10%"):
        prepare([recorded(plate(kappa=10.0), 0, 5e-4)], [lambda s: np.isfinite(s.loads)])


def test_a_uniform_test_cannot_tell_the_moduli_apart():
    """One equation an increment, in which the stretch fixes both parts of the stress alike, if it is one stretch."""
    points = np.array([[0.0, 0], [10, 0], [20, 0], [0, 10], [10, 10], [20, 10]])
    cells = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])
    u = np.tile(points * [0.1, 0.0], (3, 1, 1))
    force = np.tile([[2.0, 0.0]], (3, 1))
    loaded = (LoadedBoundary("left", np.array([0, 3]), -force), LoadedBoundary("right", np.array([2, 5]), force))
    sheet = Experiment("uniform", points, cells, u, loaded, np.array([], int), 1.0, noise=Noise(1e-3), plane="strain")
    with pytest.raises(FitError, match="bulk modulus"):
        calibrate(sheet, Options(starts=2))


@pytest.mark.slow
def test_the_deviation_in_a_diagnosis_is_that_of_a_calibration():
    e = recorded(plate(), 0)
    problem, fit = prepare([e], [lambda s: np.isfinite(s.loads)])
    value, deviation = bulk_modulus(problem, fit)
    model = calibrate(e, Options(starts=2)).model
    assert value == pytest.approx(model.bulk_modulus, abs=2 * deviation)
    assert deviation == pytest.approx(model.bulk_modulus_deviation, rel=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_a_second_invariant_is_found(seed):
    found = discover([recorded(plate(BOTH, 30.0, 9), seed, 3e-5)])
    assert found.verdict == "explained"
    assert found.named == ("second invariant",)
    amplitude, deviation = found.final.additions[0].amplitudes[0], found.final.errors[0][0]
    assert abs(amplitude - 0.05) < 3 * deviation
    assert deviation < 0.003
    assert found.final.c[-1] == pytest.approx(KAPPA, rel=0.005)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_nothing_is_found_where_nothing_is(seed):
    found = discover([recorded(plate(ArrudaBoyce(), 30.0, 9), seed, 3e-5)])
    assert found.verdict == "nothing significant"


def test_planes_are_not_mixed():
    strain = recorded(plate())
    stress = plate_experiment()
    with pytest.raises(ConfigError, match="plane"):
        prepare([strain, stress], [lambda s: np.isfinite(s.loads)] * 2)
    with pytest.raises(ConfigError, match="loss"):
        calibrate(strain, Options(loss="paper"))
    sheet = calibrate(stress, Options(starts=2)).model
    with pytest.raises(ConfigError, match="bulk modulus"):
        sheet.nominal_stress(np.eye(2)[None], "strain")
    energy = SingleBasis(0, 20.0)
    with pytest.raises(ConfigError, match="plane strain"):
        ExtendedModel(energy, neo_hooke(energy, 0.2), (), (), "MPa").predict(strain)
    with pytest.raises(ConfigError, match="'bending'"):
        replace(stress, plane="bending")


def test_files_keep_the_plane(tmp_path):
    strain, path = recorded(plate()), tmp_path / "experiment.npz"
    strain.save(path)
    assert Experiment.load(path).plane == "strain"
    with np.load(path) as content:
        assert int(content["version"]) == 2  # a program that knows plane stress only must not read it
    model = Model.from_dict({**calibrate(strain, Options(starts=2)).model.to_dict()})
    model.save(tmp_path / "model.json")
    again = Model.load(tmp_path / "model.json")
    assert again.bulk_modulus == model.bulk_modulus
    assert again.bulk_modulus_deviation == model.bulk_modulus_deviation
    system = equilibrium(strain)
    basis = basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2), plane="strain")
    c = best_neo_hooke(system, basis)
    extended = ExtendedModel(basis, c, (), (), "MPa")
    extended.save(tmp_path / "extended.json")
    back = ExtendedModel.load(tmp_path / "extended.json")
    np.testing.assert_array_equal(back.c, c)
    assert back.plane == "strain"
    np.testing.assert_array_equal(back.predict(strain).residuals, extended.predict(strain).residuals)
    content = extended.to_dict()
    content["base"]["bulk_modulus"] = -1.0
    with pytest.raises(ValueError, match="positive"):
        ExtendedModel.from_dict(content)


def test_a_model_file_with_a_bad_bulk_modulus_is_refused(tmp_path):
    model = calibrate(plate_experiment(), Options(starts=2)).model
    for bad in (-1.0, "much"):
        path = tmp_path / "model.json"
        path.write_text(json.dumps({**model.to_dict(), "bulk_modulus": {"value": bad, "standard_deviation": None}}))
        with pytest.raises(ModelFileError):
            Model.load(path)
