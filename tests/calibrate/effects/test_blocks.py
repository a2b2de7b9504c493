"""A chain run in many small blocks, of triangles or of increments, gives what it gives in one."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from made_up import made_up_chain

from calibrate.data.experiment import Noise
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition, linearisation
from calibrate.effects.chain.blocks import OF_ONE_SIZE, blocks
from calibrate.effects.chain.links_of_motion import DeformationGradients
from calibrate.effects.chain.links_of_stress import BaseStress
from calibrate.equations import kinematics, noise_covariance

EFFECTS = {effect.name: effect for effect in CATALOGUE}
CASES = {
    "of triangles": ("viscoelasticity", "lens distortion"),
    "of increments": ("3D effect of thickness", "second invariant"),
    "one block": ("3D effect of thickness", "viscoelasticity"),
}


def added(chain, *names):
    found = []
    for effect in map(EFFECTS.get, names):
        shape = tuple(effect.shape_values(chain.data)[0])
        found.append(Addition(effect, tuple(p.null + 0.3 * p.typical for p in effect.amplitudes), shape))
    return tuple(found)


@pytest.fixture(scope="module")
def both():
    chain = made_up_chain()
    small = blocks(chain.data, chain.system.virtual_gradients, 32 * len(chain.data.u) * 60, 1)
    assert len(small) > 3 and small[-1].used < len(small[-1].places)
    return chain, replace(chain, divided=small)


def test_blocks_are_of_few_sizes_and_no_triangle_is_twice_in_the_whole():
    """What looks at its neighbours would see it twice: the 3D effect of thickness takes means over the triangles around a node."""
    chain = made_up_chain()
    (block,), (every,) = chain.blocks, chain.whole
    m = len(chain.data.triangles)
    assert len(block.places) % OF_ONE_SIZE == 0 and block.used == m < len(block.places)
    np.testing.assert_array_equal(every.places, np.arange(m))


@pytest.mark.parametrize("m", [1, 2, 3, 10, 200])
def test_a_homogeneous_test_of_few_triangles_is_not_filled_up_to_hundreds(m):
    """Two triangles in a block of 256 made a weight of a long history a hundred times dearer."""
    chain = made_up_chain()
    (block,) = blocks(chain.data, chain.system.virtual_gradients[:, : 2 * m])
    assert block.used == m <= len(block.places) < 2 * m


@pytest.mark.parametrize("names", CASES.values(), ids=CASES)
def test_residual_stress_and_derivatives(both, names):
    whole, parts = both
    c = 0.1 + 0.05 * np.linspace(0, 1, whole.basis.n_functions) ** 2
    additions = added(whole, *names)
    np.testing.assert_allclose(parts.residual(c, additions), whole.residual(c, additions), atol=1e-11)
    np.testing.assert_allclose(parts.stress(c, additions), whole.stress(c, additions), atol=1e-12)
    expected = whole.jacobian(c, additions)
    np.testing.assert_allclose(parts.jacobian(c, additions), expected, atol=1e-9 * np.abs(expected).max())


def test_noise_and_forces_pulled_back(both):
    whole, parts = both
    c = 0.1 + 0.05 * np.linspace(0, 1, whole.basis.n_functions) ** 2
    additions = added(whole, "viscoelasticity")
    factor = noise_covariance.noise_factor(whole.system.experiment, Noise(1e-3, 2.0))
    axes = kinematics.gradient_axes(whole.system.gradient, factor)
    np.testing.assert_allclose(parts.noise_shift(c, axes), whole.noise_shift(c, axes), rtol=1e-9, atol=1e-15)
    forces = np.random.default_rng(0).standard_normal(whole.system.loads.shape)
    np.testing.assert_allclose(
        parts.pulled_back(c, additions, forces), whole.pulled_back(c, additions, forces), atol=1e-10
    )
    some = np.arange(whole.system.experiment.n_increments)
    for found, expected in zip(
        *(one.spread_of_noise(c, additions, factor, some) for one in (parts, whole)), strict=True
    ):
        np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_what_a_chain_remembers_changes_nothing(both):
    """Whatever was asked before, of other coefficients and beside effects that move the points; and once it was written to a file and read again."""
    _, plain = both
    remembering = plain.remembering()
    assert remembering.remembering() is remembering
    first = 0.1 + 0.05 * np.linspace(0, 1, plain.basis.n_functions) ** 2
    for chain in (remembering, pickle.loads(pickle.dumps(remembering))):
        for c in (first, 2 * first, first):
            for names in ((), ("lens distortion",), ("second invariant",), ("viscoelasticity", "lens distortion")):
                additions = added(plain, *names)
                np.testing.assert_array_equal(chain.residual(c, additions), plain.residual(c, additions))
                if additions:
                    np.testing.assert_array_equal(chain.derivative(c, additions), plain.derivative(c, additions))


def test_a_remembering_chain_works_out_deformations_once(both, monkeypatch):
    chain, times = both[0].remembering(), []
    original = linearisation.apply
    monkeypatch.setattr(linearisation, "apply", lambda link, *given: times.append(link) or original(link, *given))
    c = 0.1 + 0.05 * np.linspace(0, 1, chain.basis.n_functions) ** 2
    for _ in range(3):
        chain.derivative(c, added(chain, "second invariant"))
    assert times == [DeformationGradients(), BaseStress(chain.base)]
