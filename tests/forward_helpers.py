"""Closed forms and small meshes for the tests of the forward model."""

import numpy as np

from forward import ArrudaBoyce, MooneyRivlin, NeoHooke, Yeoh
from meshes import Mesh
from meshes.mesh import QUAD_NODES

MATERIALS = {
    "arruda_boyce": ArrudaBoyce(),
    "neo_hooke": NeoHooke(0.3),
    "mooney_rivlin": MooneyRivlin(0.12, 0.03),
    "yeoh": Yeoh(0.15, -1e-3, 1e-4),
}
MODEL = {
    "format": "equigap-model",
    "version": 1,
    "kind": "pann",
    "inputs": "I1I2",
    "layers": [3, 2],
    "scales": [0.2, 0.05],
    "energy_scale": 0.7,
    "hidden": [
        {"weights": [[0.3, 0.1], [0.0, 0.8], [1.2, 0.0]], "biases": [-1.0, 0.2, 0.1]},
        {"weights": [[0.5, 0.1, 0.0], [0.0, 0.4, 0.6]], "biases": [0.0, -0.5]},
    ],
    "output": [0.9, 0.3],
    "skip": [0.5, 0.1],
    "unit": "MPa",
}


def energy_derivatives(material, I1):
    """psi_1 and psi_2 by hand, from the textbook formulas, MPa."""
    if isinstance(material, ArrudaBoyce):
        mu, N = material.mu, material.N
        series = 1 / 2 + I1 / (10 * N) + 11 * I1**2 / (350 * N**2)
        return mu * (series + 19 * I1**3 / (1750 * N**3) + 519 * I1**4 / (134750 * N**4)), 0.0
    if isinstance(material, NeoHooke):
        return material.mu / 2, 0.0
    if isinstance(material, MooneyRivlin):
        return material.c10, material.c01
    x = I1 - 3
    return material.c1 + 2 * material.c2 * x + 3 * material.c3 * x**2, 0.0


def nominal_stresses(material, a, b):
    """Nominal stresses of an incompressible sheet stretched by a and b in its plane (P33 = 0), MPa.

    P_a = 2 (psi_1 + b^2 psi_2) (a - 1 / (a^3 b^2)), Treloar 1975.
    """
    I1 = a**2 + b**2 + 1 / (a * b) ** 2
    p1, p2 = energy_derivatives(material, I1)
    return 2 * (p1 + b**2 * p2) * (a - 1 / (a**3 * b**2)), 2 * (p1 + a**2 * p2) * (b - 1 / (b**3 * a**2))


def annulus(n, inner=1.0, outer=2.0):
    """Quarter annulus of n x n biquadratic cells whose nodes lie on circles; all its boundary is 'rim'."""
    m = 2 * n + 1
    r, phi = np.meshgrid(np.linspace(inner, outer, m), np.linspace(0, np.pi / 2, m), indexing="ij")
    points = np.column_stack([(r * np.cos(phi)).ravel(), (r * np.sin(phi)).ravel()])
    first, second = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    steps = QUAD_NODES.astype(int) + 1
    cells = (2 * first.ravel()[:, None] + steps[:, 0]) * m + 2 * second.ravel()[:, None] + steps[:, 1]
    grid = np.arange(m * m).reshape(m, m)
    sides = [grid[0], grid[-1], grid[:, 0], grid[:, -1]]
    rim = np.concatenate([np.column_stack([s[:-2:2], s[2::2], s[1::2]]) for s in sides])
    return Mesh(points, cells, "quad", {"rim": rim})
