"""Fibres: one family about a direction, or two mirrored about an axis, that stiffen by an exponential (Holzapfel, Gasser and Ogden 2000) and
are dispersed (Gasser, Ogden and Holzapfel 2006); without both (k2 = kappa = 0) the standard reinforcement (Qiu and Pence 1997).

They act in tension and in compression. With d = kappa / (1 - 3 kappa), E = I4 - 1 + d (I1 - 3) is the strain of Gasser, Ogden and Holzapfel over
1 - 3 kappa, so that k = k1 (1 - 3 kappa)^2 and k2 is theirs times (1 - 3 kappa)^2: k is the stiffness along the fibres at small strain, however
dispersed they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from calibrate.effects.effect import Effect, Parameter
from calibrate.effects.support.nodal_derivatives import law_gradients
from calibrate.equations.tensors import Tensors, det

ANGLES = 12
CLOSED = 0.1  # rad between a family and the axis, below which two are one
ANGLE = Parameter("angle", "rad", lower=-np.pi, upper=np.pi)
STIFFENING = Parameter("k2", "1", lower=0.0, upper=50.0)
DISPERSION = Parameter("kappa", "1", lower=0.0, upper=0.3, typical=0.1, may_be_zero=True)  # 1/3: isotropic
WITHOUT = (0.0, 0.0)  # stiffening and dispersion
START = 0.1  # of k2 E^2 at the largest strain E of the test, from which a fit goes on
MOST = 0.99  # share of the triangles and pictures with less; noise may make single ones large
SOURCE = "Qiu and Pence 1997; Holzapfel, Gasser and Ogden 2000; Gasser, Ogden and Holzapfel 2006"
STRAIN = "E = I4 - 1 + kappa / (1 - 3 kappa) (I1 - 3)"


@dataclass(frozen=True)
class OneFibreFamily(Effect):
    """P gains k E exp(k2 E^2) dE/dF with I4 = |F M|^2 and M at `angle` to x."""

    name = "one fibre family"
    stage = "energy"
    of_material = True
    formula = f"psi + k / (2 k2) (exp(k2 E^2) - 1), {STRAIN}, I4 = |F M|^2"
    source = SOURCE
    amplitudes = (Parameter("k", "MPa", lower=0.0, typical=0.02),)
    shapes = (ANGLE, STIFFENING, DISPERSION)
    former_shape = WITHOUT
    nested_in = "two fibre families"
    decided_by = "the same sheet cut and pulled in another direction"

    def shape_values(self, data):
        k2 = first_stiffening(data)
        return [(float(angle), k2, 0.0) for angle in np.arange(ANGLES) * np.pi / ANGLES]

    def angles(self, shape):
        """Of its families to x, rad."""
        return (shape[0],)

    def stress(self, data, F, P, a, shape):
        return P + self.stress_formed(data, F, None, a, shape)

    def stress_formed(self, data, F, formed, a, shape):
        return a[0] * reinforcement(F, formed, *shape)


@dataclass(frozen=True)
class TwoFibreFamilies(Effect):
    """Two families at `axis` +- `half`, of equal stiffness. Those about the axis across, at pi / 2 - `half`, are the same: a fit may go on beyond pi / 4, up to where the
    families are one along that axis."""

    name = "two fibre families"
    stage = "energy"
    of_material = True
    formula = f"psi + k / (2 k2) sum (exp(k2 E^2) - 1) of two directions, {STRAIN}"
    source = SOURCE
    amplitudes = (Parameter("k", "MPa", lower=0.0, typical=0.02),)
    shapes = (Parameter("axis", "rad"), Parameter("half", "rad", lower=0.0, upper=np.pi / 2), STIFFENING, DISPERSION)
    former_shape = WITHOUT
    decided_by = "the same sheet cut and pulled in two other directions"

    def shape_values(self, data):
        k2 = first_stiffening(data)
        return [
            (float(axis), float(half), k2, 0.0)
            for axis in np.arange(-4, 4) * np.pi / 8
            for half in np.arange(1, 5) * np.pi / 16
        ]

    def angles(self, shape):
        """Of its families to x, rad."""
        return shape[0] + shape[1], shape[0] - shape[1]

    def is_degenerate(self, shape):
        return min(shape[1], np.pi / 2 - shape[1]) < CLOSED

    def as_simpler(self, a, shape):
        axis, half, *of_each = shape
        return OneFibreFamily(), (2 * a[0],), (axis if half < np.pi / 4 else axis + np.pi / 2, *of_each)

    def stress(self, data, F, P, a, shape):
        return P + self.stress_formed(data, F, None, a, shape)

    def stress_formed(self, data, F, formed, a, shape):
        axis, half, *of_each = shape
        return a[0] * sum(reinforcement(F, formed, axis + sign * half, *of_each) for sign in (1, -1))


def fibre_angles(additions) -> dict[str, float]:
    """{"I4": angle to x, rad, "I4, 2": ...} of the fibres among additions, in their order."""
    fibres = (a for a in additions if isinstance(a.effect, OneFibreFamily | TwoFibreFamilies))
    angles = [float(angle) for a in fibres for angle in a.effect.angles(a.shape)]
    return {"I4" if k == 1 else f"I4, {k}": angle for k, angle in enumerate(angles, 1)}


def first_stiffening(data) -> float:
    """k2 that is tried: little even where the sheet is stretched most, or the signature is that of a few triangles at the tips of holes."""
    F = np.asarray(law_gradients(data, data.u))
    half = 0.5 * (F**2).sum(axis=(-2, -1))
    squares = half + np.sqrt(np.maximum(half**2 - np.asarray(det(F)) ** 2, 0.0))  # of the largest stretches
    largest = float(np.quantile(squares, MOST)) - 1
    return float(np.clip(START / largest**2, 1e-4, 10.0)) if largest > 0 else START


def reinforcement(F, formed, angle, k2, kappa):
    """d/dF of (exp(k2 E^2) - 1) / (2 k2) for fibres about `angle`, rad, to x: (..., 2, 2) at F (..., 2, 2).

    formed (..., 2, 2): deformation at which they are straight and free of stress, along the same lines of the material; None: the reference.
    """
    d = kappa / (1.0 - 3.0 * kappa)
    M = jnp.cos(angle), jnp.sin(angle)
    now = Tensors.of(F)
    x, y = now.applied(*M)
    if formed is None:
        rest, elastic = 1.0, now
    else:
        at_rest = Tensors.of(formed)
        back, (x0, y0) = at_rest.inverse, at_rest.applied(*M)
        rest, elastic = x0 * x0 + y0 * y0, now @ back
    J = elastic.det
    I1 = elastic.dot(elastic) + J**-2
    E = (x * x + y * y) / rest - 1.0 + d * (I1 - 3.0)
    along = Tensors.dyad((x, y), M) * (2.0 / rest)
    across = (elastic - elastic.cofactor * J**-3) * 2.0
    across = across if formed is None else across @ back.T
    return ((along + across * d) * (E * jnp.exp(k2 * E**2))).array
