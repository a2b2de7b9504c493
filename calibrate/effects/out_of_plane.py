"""Motion of the specimen towards the camera, which magnifies the picture."""

from __future__ import annotations

from dataclasses import dataclass

from calibrate.effects.effect import Effect, Parameter, share_of_loading


@dataclass(frozen=True)
class OutOfPlane(Effect):
    """The specimen comes nearer to the camera as it is loaded, so that the picture grows by m at the end."""

    name = "out-of-plane motion"
    stage = "measurement"
    of_rig = True
    formula = "x (1 + m s), s: share of the loading"
    source = "Sutton, Yan, Tiwari, Schreier and Orteu 2008"
    amplitudes = (Parameter("m", "1", lower=-0.05, upper=0.05, typical=0.003),)
    decided_by = "a second camera, or a telecentric lens"

    def excluded(self, data):
        return data.reference_height is not None  # two cameras measure it

    def displacements(self, data, u, a, shape):
        return brought_back(data, u, a[0] * share_of_loading(data.u))


def brought_back(data, u, growth):
    """True displacements (t, n, 2), mm, of those seen in pictures that are magnified by 1 + growth (t,) about the middle of the specimen."""
    growth = growth[:, None, None]
    return u - growth / (1.0 + growth) * (data.points - data.centre + u)
