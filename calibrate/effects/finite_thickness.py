"""What is left of three dimensions in a thick sheet: the leading-order correction of plane stress.

Let f be the in-plane deformation gradient, a = 1 / det f = F33, C = f^T f, S(C) the second Piola-Kirchhoff stress of
plane stress, Z the height above the mid-plane of a sheet of thickness h, incompressible and isotropic, its faces free of
traction. To second order in h over the lengths on which a changes:

- u_3 = a Z, so that F_3b = Z da/dX_b. The shear stress S_a3 vanishes to O(h^3): it does at the faces, and its slope over Z
  is the imbalance of plane stress. Hence C_a3 = 0, and the in-plane displacement bends over the thickness,
  u = mean + (Z^2 - h^2 / 12) w with w = -a f^-T grad a / 2. A camera sees Z = h / 2:

      mean = surface + h^2 / 12 a f^-T grad a.                                                                    (1)

- the in-plane C gains Z^2 grad a (x) grad a, and P_33, whose slope over Z is -div(Z S grad a), becomes
  (h^2 / 8 - Z^2 / 2) div(S grad a). Both change the mean stress that is in equilibrium with the forces:

      P = P(f of the mean) + h^2 / 12 [f dS/dC : (grad a (x) grad a) + a div(S grad a) f^-T].                     (2)

(2) is the derivative of the energy psi + h^2 / 24 grad a . S grad a. For small strains S vanishes, and (1) is the
parabola of generalised plane stress (Michell 1899; Timoshenko and Goodier, section 98), exact there.

Next to edges a layer of about h / 2 departs from (1). At a free edge the parabola of the stress over the thickness cannot
be, and less bends: grad a would see that layer's own curvature and double the error. At a grip, which holds the
displacement over the thickness, nothing bends. Both are taken into account by

    B - (RELAXATION h)^2 laplace B = a f^-T grad a,     no flux of B at free edges, B = 0 at grips,

which leaves B as it is inside, where a is nearly harmonic. RELAXATION was found with the Q2-P1 model (docs/thickness.md).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from calibrate.data.experiment import Experiment
from calibrate.effects.effect import Effect, Parameter, lacks_plane_stress
from calibrate.effects.support.effect_data import Data
from calibrate.effects.support.nodal_derivatives import gradient, slopes, to_nodes
from calibrate.equations.tensors import det, inverse
from calibrate.errors import ConfigError

RELAXATION = 0.2  # length of the layer at free edges over the thickness


@dataclass(frozen=True)
class Thickness(Effect):
    """Displacements of the mean from those of the surface, and the stress of curved F33; b = h^2 / 12 is expected."""

    name = "3D effect of thickness"
    stage = "kinematics"
    truncated = True
    formula = "u + b F33 F^-T grad F33, b = h^2 / 12"
    source = "derived in docs/thickness.md"
    amplitudes = (Parameter("b", "mm^2", lower=0.0, typical=10.0),)
    decided_by = "a thinner specimen of the same shape"
    rough = True

    def missing(self, data):
        return lacks_plane_stress(data)

    def displacements(self, data, u, a, shape):
        return u + a[0] * bend(data, jnp.eye(2) + gradient(data, u))

    def stress(self, data, F, P, a, shape, law):
        return P + a[0] * stress_of_bend(data, F, law)


def of_the_mean(experiment: Experiment) -> Experiment:
    """The Experiment with displacements of the mean over its thickness, by (1) with b = h^2 / 12, instead of the surface's.

    Raises `ConfigError` where the thickness is unknown.
    """
    if experiment.thickness is None:
        raise ConfigError(f"{experiment.name}: thickness unknown; the correction for it needs it, in mm")
    data = Data.of(experiment)
    return replace(experiment, displacements=np.asarray(_mean(data, experiment.thickness**2 / 12)))


@jax.jit
def _mean(data: Any, b: Any) -> Any:
    return Thickness().displacements(data, data.u, (b,), ())


def bend(data: Any, F: Any) -> Any:
    """B (t, n, 2), 1/mm, of F (t, n, 2, 2) at the nodes: mean = surface + h^2 / 12 B."""
    thinning = 1.0 / det(F)
    raw = thinning[..., None] * jnp.einsum("tnji,tnj->tni", inverse(F), gradient(data, thinning))
    return data.membrane.smoothed(raw, RELAXATION * data.thickness)


def stress_of_bend(data: Any, F: Any, law: Any) -> Any:
    """(t, m, 2, 2): what (2) adds to the stress for h^2 / 12 = 1 mm^2, at the centroids as F (t, m, 2, 2) is.

    law: P (2, 2) of plane stress at F (2, 2).
    """
    nodal = jnp.stack([jnp.stack([to_nodes(data, F[..., i, j]) for j in range(2)], axis=-1) for i in range(2)], axis=-2)
    steep = jnp.einsum("tnji,tnj->tni", nodal, bend(data, nodal)) * det(nodal)[..., None]

    def second(f):
        return inverse(f) @ law(f)

    S = jax.vmap(second)(nodal.reshape(-1, 2, 2)).reshape(nodal.shape)
    flow = slopes(data, jnp.moveaxis(jnp.einsum("tnij,tnj->tni", S, steep), -1, 0))

    def change(f, g, divergence):
        dual = inverse(f).T
        df = 0.5 * jnp.outer(dual @ g, g)  # changes C by g (x) g
        return f @ jax.jvp(second, (f,), (df,))[1] + divergence * dual

    divergence = (flow[0, ..., 0] + flow[1, ..., 1]) / det(F)
    inside = steep[:, data.triangles].mean(axis=2)
    found = jax.vmap(change)(F.reshape(-1, 2, 2), inside.reshape(-1, 2), divergence.ravel())
    return found.reshape(F.shape)
