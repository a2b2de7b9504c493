"""Leading-order effect of thickness: closed forms, the energy it derives from, and the Q2-P1 model next to a hole."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from calibrate.data.experiment import Experiment, LoadedBoundary
from calibrate.effects import Data
from calibrate.effects.finite_thickness import Thickness, bend, bend_errors, of_the_mean
from calibrate.effects.support.nodal_derivatives import gradient, gradients
from calibrate.effects.support.twin_kinematics import Bend, Subsets, TwinKinematics
from calibrate.equations.equilibrium import equilibrium
from calibrate.errors import ConfigError

MU = 0.3
FLAT = jnp.eye(2)[None, None]


def law(f):
    """Neo-Hooke in plane stress."""
    det = f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]
    cofactor = jnp.array([[f[1, 1], -f[1, 0]], [-f[0, 1], f[0, 0]]])
    return MU * (f - cofactor / det**3)


@partial(jax.jit, static_argnums=2)
def stress_of_bend(data, F, law):
    """What the curved thickness adds to the stress for h^2 / 12 = 1 mm^2, to first order."""
    effect, thinning = Thickness(), Thickness().thinning(data, F, data.points)

    def stress(b):
        mean = effect.mean_deformation(data, F, thinning, (b,))
        P = jax.vmap(law)(mean.reshape(-1, 2, 2)).reshape(F.shape)
        return effect.mean_stress(data, P, F, mean, thinning, data.points, (b,))

    return jax.jvp(stress, (0.0,), (1.0,))[1]


def sheet(displacement, thickness=1.0, cells=(20, 10), size=(20.0, 10.0)):
    """A rectangle around the origin pulled at its right side, as an Experiment without forces."""
    x, y = (np.linspace(-s / 2, s / 2, n + 1) for s, n in zip(size, cells, strict=True))
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    i = (np.arange(cells[0])[:, None] * (cells[1] + 1) + np.arange(cells[1])).ravel()
    up = cells[1] + 1
    triangles = np.concatenate([np.column_stack([i, i + up, i + up + 1]), np.column_stack([i, i + up + 1, i + 1])])
    sides = [np.flatnonzero(points[:, 0] == s * size[0] / 2) for s in (-1, 1)]
    loaded = tuple(LoadedBoundary(n, at, np.zeros((1, 2))) for n, at in zip(("left", "right"), sides, strict=True))
    free = np.setdiff1d(np.flatnonzero(np.abs(points[:, 1]) == size[1] / 2), np.concatenate(sides))
    return Experiment("sheet", points, triangles, displacement(points)[None], loaded, free, thickness)


def smooth(points, amount=0.3):
    X, Y = points.T / 10
    return amount * np.stack([4 * X + np.sin(2 * X) * np.cos(Y), -2 * Y + 0.5 * np.sin(X + 2 * Y)], axis=-1)


def test_nothing_bends_where_the_strain_is_uniform():
    data = Data.of(sheet(lambda x: x @ np.array([[0.3, 0.05], [0.1, -0.1]])))
    F = gradients(data, data.u)
    np.testing.assert_allclose(bend(data, jnp.eye(2) + gradient(data, data.u), FLAT), 0.0, atol=1e-12)
    np.testing.assert_allclose(stress_of_bend(data, F, law), 0.0, atol=1e-12)


def test_small_strains_change_no_stress():
    """S grad a is of second order in the strain."""
    sizes = []
    for amount in (1e-3, 1e-4):
        data = Data.of(sheet(lambda x, amount=amount: smooth(x, amount)))
        sizes.append(np.abs(stress_of_bend(data, gradients(data, data.u), law)).max())
    assert sizes[0] / sizes[1] == pytest.approx(100, rel=0.05)


def test_stress_is_the_slope_of_the_energy_of_a_curved_thickness():
    """int P : grad v = d/du int grad a . S grad a / 2, a = 1 / det F, for a v that vanishes at the edges."""
    experiment = sheet(smooth, thickness=0.01, cells=(80, 40))
    data = Data.of(experiment)
    x = experiment.points
    v = jnp.asarray(((1 - (x[:, 0] / 8) ** 2).clip(0) * (1 - (x[:, 1] / 4) ** 2).clip(0))[:, None] ** 4 * [1.0, 0.5])

    def energy(s):
        F = jnp.eye(2) + gradient(data, data.u + s * v)
        a = 1 / (F[..., 0, 0] * F[..., 1, 1] - F[..., 0, 1] * F[..., 1, 0])
        g = gradient(data, a)
        turned = jnp.stack([g[..., 1], -g[..., 0]], axis=-1)  # g . C^-1 g = a^2 |F turned|^2
        stretched = jnp.einsum("tnij,tnj->tni", F, turned)
        density = MU * ((g**2).sum(axis=-1) - a**4 * (stretched**2).sum(axis=-1))  # g . S g
        return 0.5 * (data.membrane.mass * density).sum()

    P = stress_of_bend(data, gradients(data, data.u), law)
    work = float(jnp.einsum("m,mij,mij", data.areas, P[0], gradients(data, v[None])[0] - jnp.eye(2)))
    assert work == pytest.approx(float(jax.jit(jax.grad(energy))(0.0)), rel=0.02)


def test_relaxation_of_a_strip_held_at_both_ends():
    """A constant becomes 1 - cosh(x / l) / cosh(L / l)."""
    membrane = Data.of(sheet(lambda x: 0.1 * x * [1.0, 0.0], cells=(80, 4))).membrane
    x = sheet(smooth, cells=(80, 4)).points[:, 0]
    found = np.asarray(membrane.smoothed(jnp.ones((1, len(x), 2)), 2.0))[0]
    expected = 1 - np.cosh(x / 2) / np.cosh(10 / 2)
    np.testing.assert_allclose(found, expected[:, None] * [1.0, 1.0], atol=3e-3)


def test_an_edge_inside_the_rubber_is_no_grip():
    data = Data.of(sheet(lambda x: x * [0.1, -0.05]))
    assert not np.asarray(data.membrane.held).any()
    held = np.asarray(Data.of(sheet(lambda x: x * [0.1, 0.0])).membrane.held)
    assert held.sum() == 22


def test_a_correction_needs_a_thickness():
    with pytest.raises(ConfigError, match="thickness"):
        of_the_mean(sheet(smooth, thickness=None))


def test_the_mean_is_that_of_the_effect():
    experiment = sheet(smooth, thickness=2.0)
    data = Data.of(experiment)
    expected = Thickness().of_the_mean(data, data.u, data.points, jnp.array([1 / 3]))
    np.testing.assert_allclose(of_the_mean(experiment).displacements, expected, atol=1e-9)


def nested(cells):
    """A sheet, and the same field at twice as many points a side, the first of which are those of the sheet."""
    coarse, fine = (sheet(smooth, 2.0, (k * cells, k * cells // 2)) for k in (1, 2))
    where = [int(np.flatnonzero(np.isclose(fine.points, x).all(axis=1))[0]) for x in coarse.points]
    order = np.concatenate([where, np.setdiff1d(np.arange(len(fine.points)), where)])
    number = np.argsort(order)
    loaded = tuple(replace(b, nodes=number[b.nodes]) for b in fine.loaded)
    return coarse, replace(
        fine,
        points=fine.points[order],
        triangles=number[fine.triangles],
        displacements=fine.displacements[:, order],
        loaded=loaded,
        free_nodes=np.sort(number[fine.free_nodes]),
    )


def test_what_triangles_miss_of_the_bend_is_told_by_finer_ones():
    """With it the mean is that of the finer triangles, also where gradients are means of those around; it falls with the triangles."""
    sizes = []
    for cells in (10, 20, 40):
        coarse, fine = nested(cells)
        data, (error, of_means) = Data.of(coarse), bend_errors(coarse, fine)
        nothing = jnp.zeros((2, len(data.u), len(data.beside_edges), 2, 2))
        subsets = Subsets(jnp.ones(2), jnp.zeros((2, *data.u.shape)), jnp.zeros((2, *data.u.shape)))
        bend = Bend(jnp.asarray(error), jnp.asarray(of_means))
        informed = replace(data, twin=TwinKinematics(subsets, nothing, 0.0, bend))
        expected = of_the_mean(fine).displacements[:, : len(coarse.points)]
        for one in (informed, informed.with_mean_gradients()):
            found = Thickness().of_the_mean(one, one.u, one.points, jnp.array([1 / 3]))
            np.testing.assert_allclose(found, expected, atol=1e-6)
        sizes.append(np.sqrt((error**2).mean()))
    assert sizes[0] > 1.5 * sizes[1] > 2.25 * sizes[2]


@pytest.fixture(scope="module", params=[2.0, 5.0], ids=["2 mm", "5 mm"])
def thick(request):
    """A thick plate with a hole of 5 mm radius, 33 % longer: its surface, and its mean over the thickness."""
    from forward import Loading, NeoHooke
    from forward.solid.solid_model import Options, solve
    from meshes import PlateWithHole, extrude, quads, triangles
    from studies.synthetic.camera import observe

    plate = PlateWithHole(half_length=30, half_width=15, far_size=2, hole_radius=5, hole_size=1)
    mesh = extrude(quads(plate, quarter=True), request.param, 2)
    loading = Loading.clamped(plate.loaded, 10.0, dimension=3)
    solution = solve(mesh, NeoHooke(MU), loading, 3, options=Options(tolerance=1e-6, volume_tolerance=1e-6))
    levels = solution.displacements.reshape(3, 5, -1, 3)[..., :2]
    height = np.diff(mesh.levels[::2]) / mesh.levels[-1]
    mean = sum(
        w * (levels[:, 2 * k] + 4 * levels[:, 2 * k + 1] + levels[:, 2 * k + 2]) / 6 for k, w in enumerate(height)
    )
    surface, camera = solution.surface(), triangles(plate, n_nodes=3000)
    return [observe(s.mirrored(), camera) for s in (surface, replace(surface, displacements=mean))]


@pytest.mark.slow
def test_against_the_solid(thick):
    """The correction finds the mean to a quarter of its distance from the surface, next to the hole as well, and what is
    left of the imbalance is less than 0.4; with the stress of the curved thickness it is less still."""
    surface, mean = thick
    corrected = of_the_mean(surface)
    rim = surface.free_nodes[np.hypot(*surface.points[surface.free_nodes].T) < 6]
    off, left = (np.abs(e.displacements - mean.displacements)[-1, rim].mean() for e in (surface, corrected))
    assert left < 0.25 * off

    def imbalance(experiment, more=False):
        system = equilibrium(experiment, 4.0)
        P = np.asarray(jax.vmap(law)(jnp.asarray(system.deformation_gradients[-1])))
        if more:
            F = jnp.asarray(system.deformation_gradients[-1:])
            extra = stress_of_bend(Data.of(experiment.select([2])), F, law)[0]
            P = P + experiment.thickness**2 / 12 * np.asarray(extra)
        rows = np.tile(system.fields.boundary < 0, 2)
        return np.linalg.norm(system.internal_forces(P)[rows])

    before, after, last = imbalance(surface), imbalance(corrected), imbalance(corrected, more=True)
    assert after < 0.4 * before
    assert last < 0.9 * after
