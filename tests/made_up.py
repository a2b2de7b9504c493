"""A made-up sheet: deformation and forces that are smooth, in no equilibrium, and turn back; for derivatives of the chain."""

from dataclasses import replace

import numpy as np

from calibrate.basis import PlaneStrainBasis, SingleBasis
from calibrate.chain import Chain
from calibrate.equilibrium import Equilibrium
from calibrate.experiment import Experiment, LoadedBoundary
from calibrate.virtual_fields import virtual_fields


def made_up_chain(plane="stress"):
    """A sheet of 20 x 10 mm, pulled, sheared and let back a little, with made-up forces."""
    x, y = np.meshgrid(np.linspace(0, 20, 21), np.linspace(0, 10, 11), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel()])
    corner = (np.arange(20)[:, None] * 11 + np.arange(10)).ravel()
    triangles = np.concatenate([np.column_stack([corner, corner + 11, corner + 12]),
                                np.column_stack([corner, corner + 12, corner + 1])])  # fmt: skip
    s = np.array([0.2, 0.5, 1.0, 0.7])[:, None]
    X, Y = points[:, 0] / 20, points[:, 1] / 10
    u = np.stack([s * (6 * X + np.sin(2 * X) * Y), s * (-1.5 * Y + 0.6 * X * Y**2 + 0.3 * X)], axis=-1)
    left, right = np.flatnonzero(points[:, 0] == 0), np.flatnonzero(points[:, 0] == 20)
    force = np.column_stack([2.0 * s[:, 0] ** 0.8, 0.1 * s[:, 0]])
    free = np.flatnonzero(((points[:, 1] == 0) | (points[:, 1] == 10)) & (points[:, 0] > 0) & (points[:, 0] < 20))
    loaded = (LoadedBoundary("left", left, -force), LoadedBoundary("right", right, force))
    experiment = Experiment("made up", points, triangles, u, loaded, free, 1.0, np.array([1.0, 2.5, 5.0, 6.0]))
    basis = SingleBasis(0, 1.5) if plane == "stress" else PlaneStrainBasis(SingleBasis(0, 1.5))
    experiment = replace(experiment, plane=plane)
    return Chain(Equilibrium(experiment, virtual_fields(experiment, 4.0)), basis)
