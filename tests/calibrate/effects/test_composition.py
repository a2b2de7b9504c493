"""Effects compose: the signature of one beside another is that of an experiment made anew with both.

The experiment is made forwards and in three dimensions (`rebuilt_experiment`, `solid_history`), so that the order of the links and what passes
between them are not taken from the chain. What remains is the discretisation, of second order in the mesh.
"""

from functools import cache

import numpy as np
import pytest
from made_up import made_up_chain
from rebuilt_experiment import World, signature_by_rebuilding

from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition

TOLERANCE = 1e-3
STRONG = {
    "second invariant": (0.1,),  # as stiff as the base
    "viscoelasticity": (1.1,),
    "finite viscoelasticity": (0.3,),
    "stiffness or gain drift": (0.05,),
    "second relaxation time": (0.3,),
    "permanent set": (0.2,),
    "3D effect of thickness": (0.3,),
    "unmeasured strip": (0.25,),
    "subset smoothing": (0.1,),
}
SHAPES = {
    "one fibre family": (0.5, 0.4, 0.1),
    "two fibre families": (0.2, 0.5, 0.4, 0.05),
    "inclusion": (0.1, -0.1, 0.2, 0.3, -0.2, 0.5, 0.6),
    "viscoelasticity": (2.0,),
    "finite viscoelasticity": (2.0,),
    "second finite relaxation time": (0.4,),
    "second relaxation time": (0.4,),
    "Mullins softening": (0.05, 0.3),
    "Payne softening": (0.1,),
    "subset smoothing": (1.2**0.5,),
    "lag between force and image": (0.0,),
    "lens distortion": (0.12, -0.07),
}
EFFECTS = {effect.name: effect for effect in CATALOGUE}
THICK, WARP, LENS, STRIP = "3D effect of thickness", "initial warp", "lens distortion", "unmeasured strip"
TILT = "camera tilt"
COARSE = {
    THICK: 2e-3,
    (THICK, LENS): 0.015,
    (THICK, TILT): 4e-3,
    (THICK, WARP): 0.04,
    (WARP, THICK): 2e-3,
    (WARP, STRIP): 5e-3,
    (LENS, WARP): 1.5e-3,
}
"""Where second derivatives at edges, or those of fourth polynomials, converge slowly with the mesh. A lens bends the edges that the polynomials of a warp end at: the
outermost node, which is another on either side of no lens, has no derivative."""


@cache
def sheet(fine):
    chain = made_up_chain(fine=fine)
    return chain, 0.1 + 0.05 * np.linspace(0, 1, chain.basis.n_functions) ** 2


@cache
def strong(name):
    """The effect with an amplitude of a strong one, of either sign where it has several."""
    effect = EFFECTS[name]
    typical = [p.typical * (1 if i % 2 == 0 else -0.6) for i, p in enumerate(effect.amplitudes)]
    return Addition(effect, STRONG.get(name, tuple(typical)), SHAPES.get(name, ()))


def signature(name, beside, fine, index):
    """(t, 2 v) of an amplitude beside another effect: of the chain, and rebuilt."""
    (chain, c), effect = sheet(fine), EFFECTS[name]
    others = () if beside is None else (strong(beside),)
    own = Addition(effect, tuple(p.null for p in effect.amplitudes), SHAPES.get(name, ()))
    found = World(chain, c, others).experiment()[0].signature(c, effect, own.shape, others)[index]
    return found, signature_by_rebuilding(chain, c, own, others, index, 1e-3 * effect.amplitudes[index].typical)


def difference(found, expected):
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


def error_of_signature(name, beside, fine):
    """Largest relative error of the signature's first and last amplitude."""
    last = len(EFFECTS[name].amplitudes) - 1
    return max(difference(*signature(name, beside, fine, i)) for i in {0, last})


def test_an_experiment_made_anew_leaves_no_residual():
    """With seven effects at once, from the energy to the load cell."""
    chain, c = sheet(1)
    names = (
        "second invariant",
        "stiffness gradient",
        "viscoelasticity",
        "initial warp",
        "lens distortion",
        "image rotation",
        "force offset",
    )
    additions = tuple(strong(name) for name in names)
    made, inside = World(chain, c, additions).experiment()
    assert np.abs(made.residual(c, additions) - inside).max() < 2e-3 * np.abs(inside).max()
    assert np.abs(made.residual(c) - inside).max() > 0.2 * np.abs(inside).max()


@pytest.mark.parametrize(
    ("name", "beside"),
    [
        ("initial warp", "second invariant"),
        ("initial warp", "viscoelasticity"),
        ("lens distortion", "second invariant"),
    ],
)
def test_signature_beside_another(name, beside):
    """0.59, 0.37 and 0.57 where kinematics know the law of the base alone."""
    assert error_of_signature(name, beside, 1) < 1.5 * TOLERANCE


@pytest.mark.slow
@pytest.mark.parametrize("beside", [None, *EFFECTS])
def test_every_signature_beside_every_effect(beside):
    """On a mesh of half a millimetre."""
    errors = {name: error_of_signature(name, beside, 2) for name in EFFECTS if name != beside}
    allowed = {name: COARSE.get((name, beside), COARSE.get(name, TOLERANCE)) for name in errors}
    assert {name: error for name, error in errors.items() if not error < allowed[name]} == {}


@pytest.mark.slow
@pytest.mark.parametrize("beside", [LENS, WARP, TILT])
def test_thickness_beside_another_reference_converges(beside):
    """Of first order in the mesh, at whose edges its second derivatives are taken."""
    coarse, fine = (error_of_signature(THICK, beside, cells) for cells in (1, 4))
    assert fine < 0.35 * coarse


@pytest.mark.slow
def test_a_warp_of_fourth_order_beside_a_strip_converges():
    """What the strip changes of its signature, with the gradients at the edge, where the polynomial is steep."""

    def error(fine):
        beside, alone = signature(WARP, STRIP, fine, -1), signature(WARP, None, fine, -1)
        return difference(*(both - one for both, one in zip(beside, alone, strict=True)))

    assert error(4) < 0.4 * error(1)
