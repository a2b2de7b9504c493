"""The strip between the measured region and the edge of the specimen, which carries load."""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter, lacks_plane_stress
from calibrate.effects.support.nodal_derivatives import gradient


@dataclass(frozen=True)
class UnmeasuredStrip(Effect):
    """A strip of width w between the measured region and the true free edge carries load, too.

    Its deformation gradient is continued in a straight line from that at the centroid and at the edge of the triangle
    beside it to the middle of the strip; a strip around a hole of radius 1 / q is shorter than the edge by w q / 2.
    """

    name = "unmeasured strip"
    stage = "measurement"
    truncated = True
    formula = "area + w (1 - w q / 2) edge length at free edges"
    amplitudes = (Parameter("w", "mm", lower=0.0, typical=0.5),)
    decided_by = "a picture that shows the edge"

    def missing(self, data):
        return lacks_plane_stress(data)

    def stress(self, data, F, P, a, shape, law):
        w, there = a[0], (data.edges > 0)[:, None, None]
        at_nodes = gradient(data, data.u)
        at_edge = jnp.eye(2) + at_nodes[:, data.edge_nodes].mean(axis=2)
        beyond = jnp.where(there, F + (at_edge - F) * (1.0 + 0.75 * w * data.edges)[:, None, None], F)
        both = [jax.vmap(law)(f.reshape(-1, 2, 2)).reshape(F.shape) for f in (beyond, F)]
        share = w * data.edges * (1.0 - 0.5 * w * data.lines[data.edge_nodes, 0, 3].mean(axis=1))
        return P + share[:, None, None] * (P + both[0] - both[1])
