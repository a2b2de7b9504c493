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

The first of both is the change of S where C grows by h^2 / 12 grad a (x) grad a, whatever the material and its history. (2) is
the derivative of the energy psi + h^2 / 24 grad a . S grad a. For small strains S vanishes, and (1) is the
parabola of generalised plane stress (Michell 1899; Timoshenko and Goodier, section 98), exact there.

Next to edges a layer of about h / 2 departs from (1). At a free edge the parabola of the stress over the thickness cannot
be, and less bends: grad a would see that layer's own curvature and double the error. At a grip, which holds the
displacement over the thickness, nothing bends. Both are taken into account by

    B - (RELAXATION h)^2 laplace B = a f^-T grad a,     no flux of B at free edges, B = 0 at grips,

which leaves B as it is inside, where a is nearly harmonic. RELAXATION was found with the Q2-P1 model (docs/thickness.md).

At the tip of a narrow hole grad a changes over less than a triangle of the camera. What the triangles miss of B there is told by a field that is known
between their points, too, a replay of the test (`bend_errors`, `calibrate.diagnosis.twin`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.effects.effect import Effect, Parameter, lacks_plane_stress
from calibrate.effects.support.effect_data import Data, NodalData
from calibrate.effects.support.nodal_derivatives import (
    gradient,
    gradient_matrices,
    reference_gradients,
    slopes,
    to_nodes,
)
from calibrate.equations.tensors import Tensors, inverse, product
from calibrate.errors import ConfigError

Array = NDArray[np.float64]
RELAXATION = 0.2  # length of the layer at free edges over the thickness
NEXT_ORDER = 0.05  # of the bend, that the leading order misses: b of a cross 10 to 20 mm thick is found as 0.95 to 1.00 of h^2 / 12 (docs/thickness.md)


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
    reads_twin = True

    def missing(self, data):
        return lacks_plane_stress(data) or (None if data.thickness_is_known else "thickness")

    def of_the_mean(self, data, u, places, a):
        back = inverse(gradient(data, places[None]))
        bent = bend(data, product(gradient(data, data.points + u), back), back)
        if data.twin is not None and data.twin.bend is not None:
            bent = bent + data.twin.bend.error
        return u + a[0] * (1.0 + NEXT_ORDER * data.doubt) * bent

    def adjoint(self, data, places, a, shape):
        slopes = gradient_matrices(data)
        transposed = [sp.csr_array(one.T) for one in slopes]
        smoothed = data.membrane.adjoint(RELAXATION * float(data.thickness))
        true = np.stack([one @ places for one in slopes], axis=-1)
        back, points = np.linalg.inv(true), np.asarray(data.points)

        def seen(u, rows):
            return rows + float(a[0]) * _bend_transposed(slopes, transposed, smoothed, points + u, back, rows)

        return seen

    def thinning(self, data, F, places):
        """grad a (t, n, 2), 1/mm, at the nodes, of F (t, m, 2, 2) at the centroids."""
        nodal = at_nodes(data, F)
        B = bend(data, nodal, inverse(gradient(data, places[None])))
        F = Tensors.of(nodal)
        return jnp.stack(F.T.applied(B[..., 0], B[..., 1]), axis=-1) * F.det[..., None]

    def mean_deformation(self, data, F, thinning, a):
        """F (t, m, 2, 2) whose C has grown by b grad a (x) grad a."""
        g = inside(data, thinning)
        whole, steep = Tensors.of(F), (g[..., 0], g[..., 1])
        return (whole + Tensors.dyad(whole.inverse.T.applied(*steep), steep) * (0.5 * a[0])).array

    def mean_stress(self, data, P, F, mean, thinning, places, a):
        """(2) with P (t, m, 2, 2) at the mean deformation; S of a layer at Z is taken to F of the mid-plane."""
        S, whole = Tensors.of(mean).inverse @ Tensors.of(P), Tensors.of(F)
        steep = Tensors.of(at_nodes(data, S.array)).applied(thinning[..., 0], thinning[..., 1])
        slope = slopes(data, jnp.stack(steep))
        by_true = jnp.einsum("itmk,mki->tm", slope, inverse(reference_gradients(data, places)))
        return (whole @ S + whole.inverse.T * (a[0] * by_true / whole.det)).array


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
    return Thickness().of_the_mean(data, data.u, data.points, (b,))


def bend(data: Any, F: Any, back: Any) -> Any:
    """B (t, n, 2), 1/mm, of F (t, n, 2, 2) at the nodes: mean = surface + h^2 / 12 B.

    back (1, n, 2, 2): gradient of the measured by the true places of the reference.
    """
    whole = Tensors.of(F)
    thinning = 1.0 / whole.det
    slope = gradient(data, thinning)
    steep = Tensors.of(back).T.applied(slope[..., 0], slope[..., 1])
    raw = thinning[..., None] * jnp.stack(whole.inverse.T.applied(*steep), axis=-1)
    return data.membrane.smoothed(raw, RELAXATION * data.thickness)


def bend_errors(seen: Experiment, finer: Experiment) -> tuple[Array, Array]:
    """What the triangles of a field miss of its bend (t, n, 2), 1/mm, and what they do with gradients at the nodes that are means of those around.

    seen: the field at points (n, 2); finer: the same at more points, the first n of which are those.
    """
    data, n = Data.of(seen), len(seen.points)
    exact = _bend(NodalData.of(finer))[:, :n]
    found = [np.asarray(exact - _bend(one)) for one in (data, data.with_mean_gradients())]
    return found[0], found[1]


@jax.jit
def _bend(data: Any) -> Any:
    return bend(data, gradient(data, data.points + data.u), jnp.eye(2)[None, None])


def _bend_transposed(slopes, transposed, smoothed, x, back, rows):
    """Rows (r, n, 2) by u, of those by `bend`; x (n, 2): deformed places. slopes, transposed: `gradient_matrices`; smoothed: `Membrane.adjoint`."""
    n, r = len(x), len(rows)
    F = np.stack([one @ x for one in slopes], axis=-1) @ back
    a, inv = 1.0 / np.linalg.det(F), np.linalg.inv(F)
    steep = (np.stack([one @ a for one in slopes], axis=-1)[:, None] @ back)[:, 0]
    w = smoothed(np.moveaxis(rows, 0, 2).reshape(n, -1)).reshape(n, 2, r)
    bent = inv @ w  # F^-1 w: by the gradient of a, over a
    of_gradient = back @ bent
    of_thinning = (steep[:, None] @ bent)[:, 0]
    of_thinning += sum(transposed[k] @ (a[:, None] * of_gradient[:, k]) for k in range(2))
    lowered = (steep[:, None] @ inv)[:, 0]  # F^-T grad a
    total, stiffening = np.zeros((n, 2 * r)), back @ inv
    for k in range(2):  # by F_ck, with what the reference does to it
        of_F = stiffening[:, k, :, None] * of_thinning[:, None] + lowered[..., None] * of_gradient[:, k, None]
        total -= transposed[k] @ (a[:, None, None] * of_F).reshape(n, -1)
    return np.moveaxis(total.reshape(n, 2, r), 2, 0)


def at_nodes(data: Any, values: Any) -> Any:
    """Tensors (t, n, 2, 2) at the nodes of tensors (t, m, 2, 2) in the triangles."""
    return jnp.moveaxis(to_nodes(data, jnp.moveaxis(values, 1, -1)), -1, 1)


def inside(data: Any, nodal: Any) -> Any:
    """Means (t, m, 2) over the nodes of each triangle."""
    return nodal[:, data.triangles].mean(axis=2)
