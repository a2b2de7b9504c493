"""Effects: nothing changes at their null value, their signature is a derivative, each does what its formula says."""

import dataclasses
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_up import made_up_chain
from scipy.optimize import brentq, fsolve
from viscous_states import LATERAL, nominal_stress

from calibrate import errors
from calibrate.data.experiment import Experiment, LoadedBoundary
from calibrate.diagnosis.score_tests import Status, untestable
from calibrate.effects import CATALOGUE, Data
from calibrate.effects.camera_tilt import CameraTilt
from calibrate.effects.chain import Addition, links_of_motion, links_of_stress
from calibrate.effects.chain.readings import at_pictures, picture_weights, reading_weights
from calibrate.effects.chain.stages import SWEEPS
from calibrate.effects.compressibility import Compressibility
from calibrate.effects.fibres import TwoFibreFamilies, first_stiffening, reinforcement
from calibrate.effects.finite_thickness import Thickness
from calibrate.effects.force_drift import ForceDrift
from calibrate.effects.force_offset import ForceOffset
from calibrate.effects.lag import Lag
from calibrate.effects.lens_distortion import LensDistortion, undistorted
from calibrate.effects.magnification_drift import MagnificationDrift
from calibrate.effects.out_of_plane import OutOfPlane
from calibrate.effects.permanent_set import PermanentSet
from calibrate.effects.stiffness_drift import StiffnessDrift
from calibrate.effects.support.borders import nearest_lines, subset_moments
from calibrate.effects.support.branches import motion, sign_of_motion
from calibrate.effects.support.nodal_derivatives import gradients, law_gradients, second_derivatives
from calibrate.effects.unmeasured_strip import UnmeasuredStrip
from calibrate.effects.upturn import Upturn
from calibrate.effects.viscosity import Viscosity, convolved
from calibrate.effects.warp import FLAT, InitialWarp, regained_strain

EVERY = CATALOGUE
NAMES = [effect.name for effect in EVERY]


@pytest.fixture(scope="module")
def chain():
    return made_up_chain()


@pytest.fixture(scope="module")
def c(chain):
    return jnp.asarray(0.1 + 0.05 * np.linspace(0, 1, chain.basis.n_functions) ** 2)


def residual(chain, c, effect, amplitudes, shape):
    return chain.residual(c, (Addition(effect, tuple(map(float, amplitudes)), tuple(shape)),))


def test_the_chain_is_the_linear_system(chain, c):
    """The same residual as G c - load, which is assembled without JAX."""
    system = chain.system
    expected = [system.matrix(chain.basis, F) @ np.asarray(c) - np.nan_to_num(load)
                for F, load in zip(system.deformation_gradients, system.loads, strict=True)]  # fmt: skip
    np.testing.assert_allclose(np.asarray(chain.residual(c)), expected, atol=1e-13)


@pytest.mark.parametrize("effect", EVERY, ids=NAMES)
def test_null_changes_nothing(chain, c, effect):
    """To round-off: with and without the effect, the residual is compiled differently."""
    base = np.asarray(chain.residual(c))
    null = [p.null for p in effect.amplitudes]
    for shape in effect.shape_values(chain.data):
        np.testing.assert_allclose(
            residual(chain, c, effect, null, shape), base, rtol=0, atol=1e-13 * np.abs(base).max()
        )


@pytest.mark.parametrize("effect", EVERY, ids=NAMES)
def test_signature_is_the_derivative(chain, c, effect):
    """Against central differences, in every amplitude, each of which does something."""
    shape = effect.shape_values(chain.data)[-1]
    found = chain.signature(c, effect, shape)
    assert np.isfinite(found).all()
    assert all(np.abs(one).max() > 0 for one in found)
    for i, parameter in enumerate(effect.amplitudes):
        step = 3e-6 * parameter.typical  # what depends on the sign of an amplitude is of second order
        a = np.array([p.null for p in effect.amplitudes])
        up, down = a.copy(), a.copy()
        up[i] += step
        down[i] -= step
        slope = (residual(chain, c, effect, up, shape) - residual(chain, c, effect, down, shape)) / (2 * step)
        np.testing.assert_allclose(found[i], slope, atol=1e-6 * np.abs(slope).max())


TOGETHER = ("second invariant", "stiffness gradient", "Mullins softening", "viscoelasticity", "permanent set",
            "3D effect of thickness", "compressibility", "initial warp", "camera tilt", "lens distortion", "force offset",
            "lag between force and image", "unmeasured strip")  # fmt: skip


def strong(effect, chain):
    shape = effect.shape_values(chain.data)[0]
    return Addition(effect, tuple(p.null + 0.1 * p.typical for p in effect.amplitudes), shape)


def test_order_of_finding_is_not_that_of_acting(chain, c):
    """A stiffness gradient multiplies the stress of fibres too, if they were found after it."""
    additions = [strong(e, chain) for e in EVERY if e.name in TOGETHER]
    assert len(additions) == len(TOGETHER)
    expected = chain.residual(c, tuple(additions))
    np.testing.assert_array_equal(chain.residual(c, tuple(additions[::-1])), expected)
    fibres, graded = (strong(e, chain) for e in EVERY if e.name in ("one fibre family", "stiffness gradient"))
    stress, with_fibres = (np.asarray(chain.stress(c, found)) for found in ((graded, fibres), (fibres,)))
    factor = np.asarray(chain.stress(c, (graded,)) / chain.stress(c))
    np.testing.assert_allclose(stress, factor * with_fibres, rtol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("name", TOGETHER)
def test_derivative_between_other_effects(chain, c, name):
    """Of an effect that others act before and after, against central differences."""
    additions = [strong(e, chain) for e in EVERY if e.name in TOGETHER]
    own = next(a for a in additions if a.effect.name == name)
    others = tuple(a for a in additions if a is not own)
    found = chain.derivative(c, (*others, own))
    for i, parameter in enumerate(own.effect.amplitudes):
        step = 1e-4 * parameter.typical
        ends = []
        for sign in (1, -1):
            a = np.array(own.amplitudes)
            a[i] += sign * step
            ends.append(chain.residual(c, (Addition(own.effect, tuple(a), own.shape), *others)))
        slope = (ends[0] - ends[1]) / (2 * step)
        np.testing.assert_allclose(found[i], slope, atol=2e-6 * np.abs(slope).max())


def test_an_effect_beside_itself_is_told_apart(chain, c):
    """The slope by a second one of the same effect is that by the first, not by both."""
    effect = next(e for e in EVERY if e.name == "second invariant")
    twice = chain.signature(c, effect, (), (Addition(effect, (0.02,)),))
    np.testing.assert_allclose(twice, chain.signature(c, effect, ()), rtol=1e-12, atol=1e-12)


def test_names_and_units_are_stated():
    assert len(set(NAMES)) == len(EVERY)
    for effect in CATALOGUE:
        assert effect.formula and effect.source
        assert effect.confounded_with or effect.decided_by
        assert all(p.unit and p.lower <= p.null <= p.upper for p in effect.amplitudes)


def test_what_the_data_lack_is_named(chain):
    experiment = chain.system.experiment
    ramp = Data.of(experiment.select([0, 1, 2]))
    lacking = {effect.name: effect.missing(ramp) for effect in CATALOGUE}
    assert {name: what for name, what in lacking.items() if what} == {
        **dict.fromkeys(("Mullins softening", "Payne softening", "permanent set"), "unloading"),
        **dict.fromkeys(("force drift", "magnification drift", "stiffness or gain drift"), "a pause or a way back"),
        "friction in the load train": "a way back",
        "axis gain": "forces along two axes",
    }
    timeless = Data.of(dataclasses.replace(experiment, time=None))
    assert {e.name for e in CATALOGUE if e.missing(timeless) == "time"} == {
        "viscoelasticity",
        "second relaxation time",
        "finite viscoelasticity",
        "second finite relaxation time",
        "force drift",
        "magnification drift",
        "stiffness or gain drift",
        "lag between force and image",
    }


@pytest.mark.parametrize("name", ["another", "upturn"])
def test_a_file_in_the_folder_is_a_candidate(tmp_path, name):
    """Nothing else names it; in a process of its own, since the catalogue is made once. A name that is taken is refused."""
    import calibrate

    copy = tmp_path / "calibrate"
    shutil.copytree(Path(calibrate.__file__).parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
    (copy / "effects" / "another.py").write_text(
        "from dataclasses import dataclass\n"
        "from calibrate.effects.effect import Effect, Parameter\n"
        "@dataclass(frozen=True)\n"
        "class Another(Effect):\n"
        "    name, stage, formula, amplitudes = 'NAME', 'load', 'f', (Parameter('a', '1', typical=1.0),)\n".replace(
            "NAME", name
        )
    )
    code = "from calibrate.effects import CATALOGUE; print(len(CATALOGUE), CATALOGUE[-1].name)"
    found = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    if name == "upturn":
        assert (
            "ConfigError: two effects are named 'upturn': calibrate.effects.upturn.Upturn and calibrate.effects.another.Another"
            in found.stderr
        )
        return
    assert found.stdout.split() == [str(len(CATALOGUE) + 1), "another"]


def test_a_first_picture_at_time_zero_is_loaded_at_once(chain):
    """The overstress is there in full, and falls off from then on."""
    F = jnp.broadcast_to(jnp.eye(2), (3, 1, 2, 2))
    data = dataclasses.replace(chain.data, time=np.array([0.0, 1.0, 3.0]))
    found = Viscosity().stress(data, F, F, jnp.array([0.3]), jnp.array([2.0])) - F
    np.testing.assert_allclose(found[:, 0, 0, 0], 0.3 * np.exp(-data.time / 2.0), rtol=1e-12)


def test_the_time_of_a_clock_is_not_that_of_a_loading(chain):
    late = dataclasses.replace(chain.data, time=1.7e9 + chain.data.time)
    assert Viscosity().missing(late) == "time counted from the start of loading"
    assert Viscosity().missing(chain.data) is None


def test_viscous_overstress_of_a_ramp(chain):
    """Under S = rate t the branch carries g rate tau (1 - exp(-t / tau)); the recursion is exact for it."""
    F = jnp.broadcast_to(jnp.eye(2), (4, 1, 2, 2))
    time = chain.data.time
    P = F * jnp.asarray(time)[:, None, None, None]
    found = Viscosity().stress(chain.data, F, P, jnp.array([0.3]), jnp.array([2.0])) - P
    np.testing.assert_allclose(found[:, 0, 0, 0], 0.3 * 2.0 * (1 - np.exp(-time / 2.0)), rtol=1e-12)


@pytest.mark.parametrize(
    ("mode", "stretch", "too_small"),
    [("uniaxial", 1.1, 0.06), ("uniaxial", 1.4, 0.23), ("uniaxial", 2.0, 0.48), ("pure_shear", 1.1, 0.11), ("pure_shear", 1.4, 0.38),
     ("pure_shear", 2.0, 0.66), ("equibiaxial", 1.4, None)],
)  # fmt: skip
def test_relaxation_is_three_dimensional(chain, mode, stretch, too_small):
    """A ramp of five relaxation times, by quadrature of the three-dimensional stress; and by how much the overstress of the condensed stress is too
    small, as docs/forward.md states it."""
    t, g, tau, steps = 5.0, 0.5, 1.0, 100
    time = t * np.arange(1, steps + 1) / steps
    a = 1 + (stretch - 1) * time / t
    F = jax.vmap(jnp.diag)(jnp.stack([a, a ** LATERAL[mode]], axis=1))[:, None]
    P = jax.vmap(jax.vmap(neo_hooke_law))(F)
    data = dataclasses.replace(chain.data, time=jnp.asarray(time))
    found = np.diag(np.asarray(Viscosity().stress(data, F, P, jnp.array([g]), jnp.array([tau])) - P)[-1, 0])
    whole, elastic = (nominal_stress(mode, 1.0, part, tau, (stretch - 1) / t, t) for part in (g, 0.0))
    np.testing.assert_allclose(found, whole - elastic, rtol=1e-3, atol=1e-6)
    if too_small is not None:
        condensed = g * np.asarray(F @ convolved(jnp.linalg.inv(F) @ P, data.time, tau))[-1, 0, 0, 0]
        assert 1 - condensed / found[0] == pytest.approx(too_small, abs=0.006)


def test_the_program_of_a_history_does_not_grow_with_its_increments():
    """Unrolled, 119 increments took two minutes and 10 GB to compile."""
    sizes = [len(jax.make_jaxpr(convolved)(np.ones((t, 3, 2, 2)), np.linspace(0.1, 1, t), 0.5).eqns) for t in (5, 100)]
    assert sizes[0] == sizes[1]


def test_an_offset_points_along_the_largest_force(chain):
    """Not along the last one, which after unloading may be anything."""
    loads = jnp.array([[[2.0], [0.0]], [[4.0], [3.0]], [[-0.1], [0.0]]])
    found = ForceOffset().loads(chain.data, loads, jnp.array([0.5]), ())
    np.testing.assert_allclose(loads - found, np.broadcast_to([[[0.4], [0.3]]], (3, 2, 1)))


def neo_hooke_law(f):
    """P (2, 2) in plane stress, mu = 1."""
    return f - jnp.linalg.inv(f).T / jnp.linalg.det(f) ** 2


def strip_with_a_set(stretches, a, data):
    """Nominal stress (t,) of a uniaxial strip; every network is free across, as the strip is."""
    F = jnp.array([jnp.diag(jnp.array([s, s**-0.5])) for s in stretches])[:, None]
    P = jax.vmap(jax.vmap(neo_hooke_law))(F)

    def law(F, formed):
        back = jnp.linalg.inv(formed)
        return jax.vmap(jax.vmap(neo_hooke_law))(F @ back) @ jnp.swapaxes(back, -1, -2)

    return np.asarray(PermanentSet().reformed(F, P, jnp.array([a]), law))[:, 0, 0, 0]


def test_permanent_set_leaves_a_longer_strip(chain):
    """Free of force at (left + int w s)^(1/3) / (left + int w / s^2)^(1/3), w: broken at stretch s (Green and Tobolsky 1946)."""
    a, made = 0.2, np.linspace(1, 2, 2001)
    left = np.exp(-a * (made**2 + 2 / made - 3))
    slope = -np.gradient(left, made)
    free = ((left[-1] + np.trapezoid(slope * made, made)) / (left[-1] + np.trapezoid(slope / made**2, made))) ** (1 / 3)
    assert free > 1.05
    P = strip_with_a_set([*np.linspace(1, 2, 201)[1:], free], a, chain.data)
    assert abs(P[-1]) < 1e-4 * P[-2]


def test_permanent_set_hardly_depends_on_the_increments(chain):
    """Ten increments a cycle against four hundred."""
    path = np.concatenate([np.linspace(0, 0.6, 6)[1:], np.linspace(0.6, 0.15, 5)[1:]])
    fine = np.interp(np.linspace(0, 9, 361), np.arange(10), np.concatenate([[0.0], path]))[1:]
    coarse, exact = (strip_with_a_set(1 + p, 0.05, chain.data) for p in (path, fine))
    plain = strip_with_a_set(1 + path, 0.0, chain.data)
    change = exact[39::40] - plain
    assert np.abs(coarse - plain - change).max() < 0.03 * np.abs(change).max()


def test_upturn_is_the_third_term_of_yeoh(chain):
    """P = 2 W' (F - F^-T / det(F)^2) with W = c30 (I1 - 3)^3."""
    f = np.array([[1.4, 0.1], [0.2, 0.9]])
    F, det = jnp.asarray(f)[None, None], np.linalg.det(f)
    found = Upturn().stress(chain.data, F, jnp.zeros_like(F), jnp.array([0.02]), ())
    slope = 3 * 0.02 * ((f**2).sum() + det**-2 - 3) ** 2
    np.testing.assert_allclose(found[0, 0], 2 * slope * (f - np.linalg.inv(f).T / det**2), rtol=1e-12)


@pytest.mark.parametrize("formed", [None, np.array([[1.1, 0.2], [-0.1, 0.9]])])
@pytest.mark.parametrize("kappa", [0.0, 0.2])
def test_fibre_stress_is_the_slope_of_its_energy(kappa, formed):
    """That of Gasser, Ogden and Holzapfel, with their k1 and k2 and their structure tensor kappa I + (1 - 3 kappa) M x M."""
    rng = np.random.default_rng(0)
    F, H = np.eye(2) + 0.2 * rng.standard_normal((2, 2)), rng.standard_normal((2, 2))
    formed_at = np.eye(2) if formed is None else formed
    M = formed_at @ [np.cos(0.4), np.sin(0.4)]
    M, k2, level = M / np.linalg.norm(M), 0.7, (1 - 3 * kappa) ** 2

    def energy(f):
        elastic = f @ np.linalg.inv(formed_at)
        C = np.diag([0, 0, np.linalg.det(elastic) ** -2])
        C[:2, :2] = elastic.T @ elastic
        A = kappa * np.eye(3) + (1 - 3 * kappa) * np.outer([*M, 0], [*M, 0])
        return (np.exp(k2 / level * (np.sum(A * C) - 1) ** 2) - 1) / (2 * k2)

    slope = (energy(F + 1e-6 * H) - energy(F - 1e-6 * H)) / 2e-6
    found = reinforcement(jnp.asarray(F), None if formed is None else jnp.asarray(formed), 0.4, k2, kappa)
    assert float((found * H).sum()) == pytest.approx(slope, rel=1e-8)


@pytest.mark.parametrize("half", [0.0, np.pi / 2])
def test_two_families_in_one_direction_are_one_of_twice_the_stiffness(chain, c, half):
    """Along the axis, or along the one across."""
    one = Addition(TwoFibreFamilies(), (0.02,), (0.4, half, 0.3, 0.1))
    assert one.effect.is_degenerate(one.shape)
    simpler = Addition(*one.effect.as_simpler(one.amplitudes, one.shape))
    np.testing.assert_allclose(chain.stress(c, (simpler,)), chain.stress(c, (one,)), rtol=1e-10)


def test_fibres_are_tried_with_little_stiffening_where_the_sheet_is_stretched_most(chain):
    """By the mean stretch of a sheet with holes, most of the signature would be that of the triangles at their tips."""
    nodes = jnp.arange(len(chain.data.points))[None, :, None] < 0.1 * len(chain.data.points)
    local = dataclasses.replace(chain.data, u=chain.data.u + jnp.where(nodes, 0.3 * (chain.data.points - 5.0), 0.0))
    stretches = np.linalg.svd(np.asarray(law_gradients(local, local.u)), compute_uv=False)[..., 0]
    mean = np.linalg.svd(np.asarray(law_gradients(local, local.u)).mean(axis=1), compute_uv=False).max()
    assert np.quantile(stretches, 0.99) ** 2 - 1 > 2 * (mean**2 - 1)
    assert first_stiffening(local) * (np.quantile(stretches, 0.99) ** 2 - 1) ** 2 == pytest.approx(0.1, rel=1e-4)


@pytest.mark.parametrize("stretch", [1.1, 1.6])
def test_compressible_sheet_is_exact(chain, c, stretch):
    """Uniaxial sheet of mu / 2 (I1bar - 3) + kappa / 2 (J - 1)^2 with free sides and faces, solved exactly:
    the correction is exact, the error of the incompressible sheet of first order in mu / kappa."""
    mu = 0.3

    def energy(l, kappa):
        J = l[0] * l[1] * l[2]
        return mu / 2 * (J ** (-2 / 3) * (l @ l) - 3) + kappa / 2 * (J - 1) ** 2

    def exact(kappa):
        slope = jax.grad(lambda l: energy(l, kappa))
        sides = fsolve(lambda x: np.asarray(slope(jnp.array([stretch, *x])))[1:] / mu, [stretch**-0.5] * 2, xtol=1e-10)
        return sides[0], float(slope(jnp.array([stretch, *sides]))[0])

    def law(f):
        det = f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]
        inverse = jnp.linalg.inv(f).T
        return mu * (f - inverse / det**2)

    def error(kappa):
        l2, P_exact = exact(kappa)
        F = jnp.diag(jnp.array([stretch, l2]))[None, None]
        P = law(F[0, 0])[None, None]
        corrected = compressed(law, F, 1 / kappa, mu)
        return abs(float(corrected[0, 0, 0, 0]) - P_exact) / P_exact, abs(float(P[0, 0, 0, 0]) - P_exact) / P_exact

    (fine, plain_fine), (coarse, plain_coarse) = error(100 * mu), error(25 * mu)
    assert plain_coarse / plain_fine == pytest.approx(4, rel=0.2)
    assert fine < 1e-6
    assert coarse < 1e-6


def compressed(law, F, beta, mu):
    """P (1, 1, 2, 2) of an incompressible law at F (1, 1, 2, 2), which may change its volume, by the links of the chain."""
    ratio = links_of_stress.VolumeRatio(Compressibility(), SimpleNamespace(modulus=lambda constants: mu))
    volume = links_of_motion.Incompressible()((F,), None, ())
    for _ in range(SWEEPS):
        free = links_of_motion.FreeOfVolume()((F, volume), None, ())
        volume = ratio((free, law(free[0, 0])[None, None], volume), None, (((beta,), ()),))
    free = links_of_motion.FreeOfVolume()((F, volume), None, ())
    return links_of_stress.StressAtVolume()((law(free[0, 0])[None, None], volume), None, ())


@pytest.mark.parametrize(("k2", "beta", "stretch", "error"), [(2, 0.05, 1.3, 1e-9), (2, 0.1, 1.4, 5e-5), (5, 0.05, 1.3, 1e-3), (5, 0.1, 1.4, 1e-4), (5, 0.1, 1.6, None)])  # fmt: skip
def test_a_stiff_fibre_is_as_compressible_as_it_is(k2, beta, stretch, error):
    """One that is as stiff as the rubber and stiffens: the slope of neo-Hooke alone had left 0.6 % at a stretch of 1.3 and 45 % at 1.4. Where the volume is not found, there is no stress."""
    mu = 0.4

    def law(f):
        det = f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]
        excess = f[0, 0] ** 2 - 1
        fibre = 2 * mu * excess * jnp.exp(k2 * excess**2) * jnp.zeros((2, 2)).at[0, 0].set(f[0, 0])
        return mu * (f - jnp.linalg.inv(f).T / det**2) + fibre

    F = np.diag([stretch, stretch**-0.5])

    def excess(J):
        f = F / np.cbrt(J)
        return 1 + beta / mu * float(np.sum(f * np.asarray(law(jnp.array(f))))) / 3 / J - J

    J = brentq(excess, 1.0, 3.0, xtol=1e-12)
    exact = float(law(jnp.array(F / np.cbrt(J)))[0, 0]) / np.cbrt(J)
    found = float(compressed(law, jnp.array(F)[None, None], beta / mu, mu)[0, 0, 0, 0])
    assert np.isnan(found) if error is None else abs(found / exact - 1) < error


def test_thickness_of_a_linear_sheet():
    """Small strains, u = (x^2 / 2 - y^2 / 2, x y) e: div u = 2 e x, so F33 - 1 = -2 e x and the mean is off by
    h^2 / 12 (-2 e, 0) everywhere (four cells inside: means at edge nodes are one-sided, and a slope reads three cells
    around)."""
    e = 1e-6
    x, y = np.meshgrid(np.linspace(0, 10, 11), np.linspace(0, 10, 11), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel()])
    corner = (np.arange(10)[:, None] * 11 + np.arange(10)).ravel()
    triangles = np.concatenate([np.column_stack([corner, corner + 11, corner + 12]),
                                np.column_stack([corner, corner + 12, corner + 1])])  # fmt: skip
    u = e * np.stack([(points[:, 0] ** 2 - points[:, 1] ** 2) / 2, points.prod(axis=1)], axis=-1)[None]
    right = np.flatnonzero(points[:, 0] == 10)
    experiment = Experiment(
        "parabola", points, triangles, u, (LoadedBoundary("right", right, np.ones((1, 2))),), np.array([], int)
    )
    data = Data.of(experiment)
    moved = np.asarray(Thickness().of_the_mean(data, data.u, data.points, jnp.array([3.0])) - data.u)[0]
    inside = (np.abs(points - 5) < 1.5).all(axis=1)
    np.testing.assert_allclose(moved[inside, 0], 3.0 * -2 * e, rtol=1e-4)
    np.testing.assert_allclose(moved[inside, 1], 0.0, atol=1e-4 * e)


def test_second_derivatives_of_parabolas_are_exact(chain):
    data = chain.data
    x, y = np.asarray(data.points).T
    u = jnp.asarray(np.stack([x**2 - 3 * x * y, 2 * y**2 + x], axis=-1)[None])
    found = np.asarray(second_derivatives(data, u))[0]
    np.testing.assert_allclose(found[:, 0], np.broadcast_to([[2, -3], [-3, 0]], (len(x), 2, 2)), atol=1e-8)
    np.testing.assert_allclose(found[:, 1], np.broadcast_to([[0, 0], [0, 4]], (len(x), 2, 2)), atol=1e-8)


def test_motion_follows_each_branch():
    """Parabolas in time, up to 2 s and back: exact on either side of the turning point, at rest at t = 0."""
    t, way = np.array([0.5, 1.0, 2.0, 2.5, 3.5]), np.array([1.0, -2.0])

    def up(t):
        return t + 0.2 * t**2

    def down(t):
        return up(2.0) - 1.1 * (t - 2) + 0.1 * (t - 2) ** 2

    u = np.where(t < 2, up(t), down(t))[:, None, None] * way
    M = motion(t, u)
    for s in (0.3, -0.3):
        branch = 0 if s > 0 else 1
        found = u + np.einsum("ij,jnc->inc", s * M[branch, 0] + s**2 * M[branch, 1], u)
        on_first = t + s < 2 if s < 0 else t < 2
        expected = np.where(on_first, up(t + s), down(t + s))
        np.testing.assert_allclose(found[:, 0], expected[:, None] * way, atol=1e-12)


def test_lag_at_a_turning_point(chain):
    """After the third picture the sheet goes back, before it it came: either sign of dt lowers the displacement."""
    u = chain.data.u
    for dt in (0.1, -0.1):
        M = Lag().readings(chain.data, jnp.array([dt]), (0.0,))
        assert float(jnp.abs(jnp.tensordot(M, u, 1)[2]).sum()) < float(jnp.abs(u[2]).sum())
        np.testing.assert_allclose(M @ chain.data.time, chain.data.time + dt, rtol=1e-12)


class SecondClock(Lag):
    """Of a user, say."""

    name = "second lag"


@pytest.mark.parametrize("dt", [0.1, 0.3, 0.6, -0.45])
def test_a_lag_finds_the_forces_at_the_pictures(dt):
    """From readings of a history up and down, whose turning point no reading shows; to a thousandth of what the lag changes, whatever the material."""
    t = np.arange(1.0, 13.0)
    way = np.where(t <= 7, t, 14 - t)
    data = dataclasses.replace(made_up_chain().data, motion=jnp.asarray(motion(t, way[:, None, None] * np.ones(2))))
    data = dataclasses.replace(data, u=jnp.zeros((12, 1, 2)), time=jnp.asarray(t))
    later = np.where(dt > 0, np.where(t < 7, way + dt, way - dt), np.where(t <= 7, way + dt, way - dt))
    lag = (Addition(Lag(), (dt,), (0.0,)),)
    forces, read = ((w + 0.1 * w**2)[:, None, None] for w in (way, later))
    np.testing.assert_allclose(reading_weights(data, lag) @ forces[:, 0], read[:, 0], atol=1e-9)
    found = at_pictures(picture_weights(data, lag), read, read, data)
    assert np.abs(found - forces).max() < (1e-3 if abs(dt) < 0.5 else 5e-3) * np.abs(read - forces).max()


def test_a_lag_changes_forces_alone(chain, c):
    """By what was read, so that neither the material nor the noise of the displacements is in it."""
    lag = Addition(Lag(), (0.1,), (0.0,))
    change = chain.residual(c, (lag,)) - chain.residual(c)
    np.testing.assert_array_equal(change[:, np.tile(chain.system.fields.boundary < 0, 2)], 0.0)
    assert np.abs(change).max() > 0.01 * np.abs(chain.external()).max()
    noisy = chain.disturbed(1e-3 * np.random.default_rng(0).standard_normal(chain.data.u.shape))
    same = noisy.residual(2 * c, (lag,)) - noisy.residual(2 * c)
    np.testing.assert_allclose(same, change, atol=1e-12 * np.abs(chain.external()).max())


def test_the_derivative_of_a_lag_beside_another_clock(chain, c):
    lag, other = Addition(Lag(), (0.1,), (0.0,)), Addition(SecondClock(), (-0.05,), (0.0,))
    offset = Addition(ForceOffset(), (0.05,))
    for beside in ((), (other,), (offset,)):
        ends = [chain.residual(c, (*beside, dataclasses.replace(lag, amplitudes=(dt,)))) for dt in (0.099, 0.101)]
        slope = (ends[1] - ends[0]) / 0.002
        np.testing.assert_allclose(chain.derivative(c, (*beside, lag))[0], slope, rtol=1e-5, atol=1e-8)


def test_a_missing_reading_is_interpolated_in_time():
    time = np.array([1.0, 2.0, 4.0, 5.0, 6.0])
    loads = time[:, None, None] * np.ones((5, 2, 3))
    read = loads.copy()
    read[2, 0, 1] = read[4, 1, 2] = np.nan
    found = at_pictures(np.eye(5), np.nan_to_num(read), read, SimpleNamespace(time=time))
    expected = loads.copy()
    expected[4, 1, 2] = 5.0  # the last one known
    np.testing.assert_allclose(found, expected)


def test_distorted_places_are_found_back(chain):
    x = jnp.asarray(np.random.default_rng(0).uniform(-15, 15, (50, 2)))
    for k in (-0.03, 0.0, 0.03):
        seen = x * (1 + k * (x**2).sum(-1, keepdims=True) / 10.0**2)
        np.testing.assert_allclose(undistorted(seen, k, 10.0), x, atol=1e-6)


@pytest.mark.parametrize("middle", [(0.0, 0.0), (0.1, -0.2)])
def test_a_lens_is_undone_about_its_centre(chain, middle):
    data, k, R = chain.data, 0.02, 10.0
    X = data.points
    place = X + data.u
    centre = jnp.array([10.0, 5.0]) + 20 * jnp.array(middle)
    bent = [centre + (x - centre) * (1 + k * ((x - centre) ** 2).sum(-1, keepdims=True) / R**2) for x in (X, place)]
    size = jnp.ptp(bent[0], axis=0).max()
    seen = dataclasses.replace(data, points=bent[0], size=size)
    low, high = bent[0].min(axis=0), bent[0].max(axis=0)
    shape = tuple((centre - 0.5 * (low + high)) / size)
    true = LensDistortion().displacements(seen, bent[1] - bent[0], jnp.array([k]), shape)
    np.testing.assert_allclose(bent[0] + true, place, atol=1e-6)


def test_a_tilt_is_undone(chain):
    """Rays through a pinhole: the picture of a plane whose depth grows along t; middle and half the extent are those in the picture."""
    data, t = chain.data, jnp.array([0.02, -0.03])
    X, seen = data.points, data

    def pinhole(x):
        x = x - seen.centre
        return seen.centre + x / (1 + x @ t / (0.5 * seen.size))[..., None]

    for _ in range(30):
        points = pinhole(X)
        seen = dataclasses.replace(data, points=points, size=jnp.ptp(points, axis=0).max())
    u = pinhole(X + data.u) - seen.points
    assert jnp.abs(u - data.u).max() > 0.1
    true = CameraTilt().displacements(seen, u, t, ())
    np.testing.assert_allclose(seen.points + true, X + data.u, atol=1e-12)
    np.testing.assert_allclose(CameraTilt().places(seen, seen.points, t, ()), X, atol=1e-12)


def test_out_of_plane_motion_is_undone(chain):
    """Exactly, but for the share of the loading, which is read from magnified displacements."""
    data, m = chain.data, 0.01
    X = data.points - jnp.array([10.0, 5.0])
    share = jnp.sqrt((data.u**2).mean(axis=(1, 2)))
    share = (share / share.max())[:, None, None]
    from dataclasses import replace

    seen = replace(data, u=(X + data.u) * (1 + m * share) - X)
    true = OutOfPlane().displacements(seen, seen.u, jnp.array([m]), ())
    np.testing.assert_allclose(true, data.u, atol=0.02 * m * float(jnp.abs(X).max()))


def test_magnification_drift_is_undone(chain):
    """Exactly; on a ramp at constant speed it is an out-of-plane motion, as a drift of the force is a gain, and no candidate."""
    data, m = chain.data, 0.01
    X = data.points - data.centre
    growth = (m * data.time / data.time[-1])[:, None, None]
    seen = (X + data.u) * (1 + growth) - X
    found = MagnificationDrift().displacements(data, seen, jnp.array([m]), ())
    np.testing.assert_allclose(found, data.u, atol=1e-12)
    share = jnp.linspace(0.25, 1.0, len(data.time))
    ramp = dataclasses.replace(data, u=share[:, None, None] * data.u[-1], time=60 * share)
    for drift in (MagnificationDrift(), ForceDrift(), StiffnessDrift()):
        assert drift.missing(ramp) == "a pause or a way back"
        assert drift.missing(dataclasses.replace(ramp, time=60 * share**3)) is None


@pytest.mark.parametrize(
    ("sizes", "signs"),
    [
        ([0.5, 1.0, 1.0, 0.6, 0.6, 0.9], "+++--+"),  # at rest as before
        ([1.0, 0.999, 0.9985, 0.9975, 0.997], "+++--"),  # slowly back
        ([0.5, 1.0, 0.9995, 1.0, 0.9991], "+++++"),  # noise
        (np.concatenate([np.linspace(0, 1, 1001)[1:], np.linspace(1, 0.5, 1001)[1:]]), "+" * 1003 + "-" * 997),
    ],
)
def test_sign_of_motion(sizes, signs):
    """A way back counts once it is a five hundredth of the largest displacement, in however many pictures it was made."""
    found = sign_of_motion(np.array(sizes)[:, None, None] * np.ones((1, 3, 2)))
    assert "".join("+" if one > 0 else "-" for one in found) == signs


def test_subset_moments(chain):
    """Of a whole square 1; at a straight edge -1/2 along the normal (a plane through x^2 on half of the square reads
    -side^2 / 24 at its edge, where the whole square reads side^2 / 12), 1 along the edge; both in a corner."""
    points, triangles = chain.system.experiment.points, chain.system.experiment.triangles
    lines = nearest_lines(points, triangles)
    np.testing.assert_allclose(lines[:, 0, 0], np.minimum.reduce([*points.T, 20 - points[:, 0], 10 - points[:, 1]]))
    found = np.asarray(subset_moments(jnp.asarray(lines), 1.2))
    at = {tuple(p): m for p, m in zip(points, found, strict=True)}
    np.testing.assert_allclose(at[10, 5], np.eye(2), atol=1e-12)
    np.testing.assert_allclose(at[10, 10], np.diag([1, -0.5]), atol=0.01)
    np.testing.assert_allclose(at[0, 5], np.diag([-0.5, 1]), atol=0.01)
    np.testing.assert_allclose(np.diag(at[20, 0]), [-0.5, -0.5], atol=0.01)


def test_a_strip_continues_the_stress(chain):
    """In a homogeneous field the strip carries the stress of its neighbours: forces rise by its share of the width."""
    data = chain.data
    H = jnp.array([[0.2, 0.0], [0.0, -0.1]])
    u = jnp.broadcast_to(data.points @ H.T, data.u.shape)
    F = jnp.broadcast_to(jnp.eye(2) + H, (len(u), len(data.areas), 2, 2))
    strip = UnmeasuredStrip()
    beyond = strip.beyond(data, F, F, u, data.points, (0.5,))
    np.testing.assert_allclose(beyond, F, atol=1e-12)
    found = F[0] + strip.share(data, (0.5,))[:, None, None] * beyond[0]
    total = np.asarray((found * data.areas[:, None, None]).sum(axis=0))
    np.testing.assert_allclose(total, np.asarray(F[0, 0]) * (200 + 0.5 * 40), atol=1e-8)


def test_a_strip_widens_the_sheet(chain):
    """The areas gained are strip width times length of the free edges."""
    data = chain.data
    gained = float((np.asarray(data.edges) * data.areas).sum())
    assert gained == pytest.approx(40.0)


def test_gradients(chain):
    np.testing.assert_allclose(gradients(chain.data, chain.data.u), chain.system.deformation_gradients, atol=1e-14)


def test_a_measured_reference_tells_its_warp():
    """A reference bent to a cylinder of slope q regains q^2 / 2; one that is flat within noise regains nothing that matters."""
    x, y = (v.ravel() for v in np.meshgrid(np.linspace(0, 40, 41), np.linspace(0, 20, 21)))
    points, rng = np.column_stack([x, y]), np.random.default_rng(0)
    bent = 0.25 * (1 - ((x - 20) / 20) ** 2)  # slope 0.025 at the ends
    assert regained_strain(points, bent) == pytest.approx(0.5 * 0.025**2, rel=1e-6)
    assert regained_strain(points, rng.normal(0, 0.003, x.size)) < FLAT


def test_stereo_data_exclude_what_they_measure(tmp_path):
    plain = made_up_chain().system.experiment
    bent = 0.01 * (plain.points[:, 0] - 10) ** 2
    moved = np.concatenate([np.zeros((1, len(plain.points))), 0.1 * np.arange(1, 5)[:, None] + 0 * bent[None]])
    stereo = dataclasses.replace(plain, heights=moved)
    assert not OutOfPlane().excluded(Data.of(plain))
    assert not InitialWarp().excluded(Data.of(plain))
    assert OutOfPlane().excluded(Data.of(stereo))
    assert InitialWarp().excluded(Data.of(stereo))
    assert not InitialWarp().excluded(Data.of(dataclasses.replace(plain, heights=moved + bent)))
    parts = [SimpleNamespace(chain=SimpleNamespace(data=Data.of(one))) for one in (stereo, plain)]
    found = [untestable(SimpleNamespace(trained=[part], level_is_nominal=False), OutOfPlane()) for part in parts]
    assert found[0].status is Status.EXCLUDED
    assert found[1] is None
    stereo.save(tmp_path / "stereo.npz")
    np.testing.assert_array_equal(Experiment.load(tmp_path / "stereo.npz").heights, moved)
    np.testing.assert_array_equal(stereo.select([1, 3]).heights, moved[[0, 2, 4]])
    with pytest.raises(errors.MeshMismatchError, match="the reference and every increment"):
        dataclasses.replace(plain, heights=moved[1:])


def test_a_field_of_stiffness_that_is_negative_somewhere_is_none():
    """Every amplitude within its bounds."""
    effect, data = next(one for one in CATALOGUE if one.name == "stiffness field"), made_up_chain().data
    a = np.zeros(len(effect.amplitudes))
    assert effect.is_possible(data, a, ())
    a[:2] = 0.4
    assert effect.is_possible(data, a, ())
    a[:2] = -0.7
    assert all(p.lower < v < p.upper for p, v in zip(effect.amplitudes, a, strict=True))
    assert not effect.is_possible(data, a, ())


def test_a_relaxation_much_longer_than_the_test_is_not_told():
    """The test sees a slope over time, as of any spring and time with the same ratio."""
    data, relaxing = made_up_chain().data, [one for one in CATALOGUE if one.stage == "relaxation"]
    end = float(data.time[-1])
    assert len(relaxing) == 4
    for effect in relaxing:
        assert effect.is_told(data, (9.9 * end,)) and not effect.is_told(data, (10.1 * end,))


def test_what_a_test_cannot_have_is_not_put_into_it():
    """A load cell that was zeroed has no offset, whatever another test beside it has; where no thickness is known, nothing is known of what it does; and a picture that a lens folds has no place for the outermost points."""
    data = made_up_chain().data
    loads = jnp.ones((4, 2, 2))
    zeroed = dataclasses.replace(data, zeroed=True)
    assert (ForceOffset().loads(zeroed, loads, (0.5,), ()) == loads).all()
    assert (ForceOffset().loads(data, loads, (0.5,), ()) != loads).any()
    assert Thickness().missing(dataclasses.replace(data, thickness_is_known=False)) == "thickness"
    assert Thickness().missing(data) is None
    far = float(jnp.sum((data.points - data.centre) ** 2, axis=-1).max()) / (0.5 * float(data.size)) ** 2
    folds = -4 / 27 / far
    assert LensDistortion().is_possible(data, (0.9 * folds,), (0.0, 0.0))
    assert not LensDistortion().is_possible(data, (1.1 * folds,), (0.0, 0.0))


def test_amplitudes_follow_the_stiffness():
    second = Addition(next(e for e in CATALOGUE if e.name == "second invariant"), (0.2,))
    assert second.stiffer(1.5).amplitudes == (pytest.approx(0.3),)
    assert Addition(Compressibility(), (0.2,)).stiffer(2.0).amplitudes == (pytest.approx(0.1),)
    assert Addition(Viscosity(), (0.2,), (1.0,)).stiffer(2.0).amplitudes == (0.2,)
