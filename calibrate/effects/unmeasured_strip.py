"""The strip between the measured region and the edge of the specimen, which carries load."""

from __future__ import annotations

from dataclasses import dataclass

import jax.numpy as jnp

from calibrate.effects.effect import Effect, Parameter, lacks_plane_stress
from calibrate.effects.support.nodal_derivatives import gradient
from calibrate.equations.tensors import inverse, product


@dataclass(frozen=True)
class UnmeasuredStrip(Effect):
    """A strip of width w between the measured region and the true free edge carries load, too.

    Its deformation gradient is continued in a straight line from that at the centroid and at the edge of the triangle
    beside it, which a twin of the test corrects, to the middle of the strip, where the whole material acts; a strip around a hole of radius 1 / q is shorter than the edge by w q / 2.
    """

    name = "unmeasured strip"
    stage = "measurement"
    truncated = True
    reads_twin = True
    formula = "area + w (1 - w q / 2) edge length at free edges"
    amplitudes = (Parameter("w", "mm", lower=0.0, typical=0.5),)
    decided_by = "the true edges, given to the import"

    def missing(self, data):
        return lacks_plane_stress(data)

    def beyond(self, data, mean, F, u, places, a):
        ends = data.edge_nodes.ravel()
        at_ends = product(gradient(data, data.points + u, ends), inverse(gradient(data, places[None], ends)))
        at_edge = at_ends.reshape(len(u), -1, 2, 2, 2).mean(axis=2)
        if data.twin is not None:
            at_centroid, of_edge = jnp.where((data.edges > 0)[:, None, None], data.twin.missed[:, :, data.beside], 0.0)
            mean, F, at_edge = mean + at_centroid, F + at_centroid, at_edge + of_edge
        beyond = 0.75 * a[0] * data.edges * (1.0 + data.doubt * self.next_order(data, a))
        steep = (at_edge - F) * (1.0 + beyond)[:, None, None]
        return mean + jnp.where((data.edges > 0)[:, None, None], steep, 0.0)

    def next_order(self, data, a):
        """Of what a straight line continues by (m,), the next order of a field that falls as 1 / r^2 from a hole, as it does around a round one."""
        curvature = jnp.abs(data.lines[data.edge_nodes, 0, 3].mean(axis=1))
        from_centroid = jnp.where(data.edges > 0, 2.0 / (3.0 * jnp.where(data.edges > 0, data.edges, 1.0)), 0.0)
        return 1.5 * curvature * (0.5 * a[0] + from_centroid)

    def share(self, data, a):
        """Volume (m,) of the strip beside each triangle over that of the triangle."""
        return a[0] * data.edges * (1.0 - 0.5 * a[0] * data.lines[data.edge_nodes, 0, 3].mean(axis=1))
