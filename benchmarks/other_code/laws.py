"""Laws of sheets that hide something, as functions of F in the plane (plane stress, incompressible): what is hidden is in no case written as in the catalogue."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import erf

from benchmarks.other_code.felupe_sheet import Law

TAU, STRENGTH = (3.0, 60.0), (0.25, 0.2)  # s; of the shear modulus: Maxwell branches
DAMAGE = (0.45, 0.02, 0.15)  # 1 / r, m in MPa, beta


def _right_cauchy_green(F):
    """C (2, 2), C33 and I1."""
    C = F.T @ F
    C33 = 1 / jnp.linalg.det(C)
    return C, C33, jnp.trace(C) + C33


def gent(F, mu=0.5, limit=30.0):
    """Energy, MPa (Gent 1996)."""
    return -mu * limit / 2 * jnp.log(1 - (_right_cauchy_green(F)[2] - 3) / limit)


def ogden(F, terms=((0.63, 1.3), (0.0012, 5.0), (-0.01, -2.0))):
    """Energy, MPa, with Ogden's terms for Treloar's rubber (Ogden 1972)."""
    C, C33, _ = _right_cauchy_green(F)
    mean, root = jnp.trace(C) / 2, jnp.sqrt(jnp.maximum(jnp.trace(C) ** 2 / 4 - jnp.linalg.det(C), 1e-14))
    squares = jnp.array([mean + root, mean - root, C33])
    return sum(mu / a * (jnp.sum(squares ** (a / 2)) - 3) for mu, a in terms)


def reinforced(F, angle=np.deg2rad(30.0), k=0.06, k2=0.4):
    """Gent's energy with fibres that carry tension alone (Holzapfel, Gasser and Ogden 2000)."""
    stretch = jnp.sum((F @ jnp.array([np.cos(angle), np.sin(angle)])) ** 2)
    return gent(F) + k / (2 * k2) * (jnp.exp(k2 * jnp.maximum(stretch - 1, 0.0) ** 2) - 1)


def elastic(energy: Callable, factor: Callable = lambda X, t: 1.0) -> Law:
    """Of an energy, with a factor on the stress by place X, mm, and time, s."""
    slope = jax.grad(energy)
    return Law(lambda F, S, X, t, dt: slope(F) * factor(X, t), lambda F, S, X, t, dt: S, np.zeros(1))


def damaged() -> Law:
    """Gent's energy with damage by its largest value (Ogden and Roxburgh 1999; beta: Mars 2004)."""
    r, m, beta = DAMAGE

    def stress(F, S, X, t, dt):
        W = gent(F)
        most = jnp.maximum(S[0], W)
        return jax.grad(gent)(F) * (1 - r * erf((most - W) / (m + beta * most)))

    return Law(stress, lambda F, S, X, t, dt: jnp.maximum(S, gent(F)), np.zeros(1))


def relaxing(mu: float = 0.35) -> Law:
    """Gent's energy beside two Maxwell branches with internal variables C_v that follow C (finite viscoelasticity; Simo and Hughes 1998, 10.4)."""

    def three_dimensional(F):
        C, C33, _ = _right_cauchy_green(F)
        return jnp.zeros((3, 3)).at[:2, :2].set(C).at[2, 2].set(C33)

    def later(F, S, dt, k):
        C = S[9 * k : 9 * k + 9].reshape(3, 3) + dt / TAU[k] * three_dimensional(F)
        return C / jnp.cbrt(jnp.linalg.det(C))

    def stress(F, S, X, t, dt):
        inverse = [jnp.linalg.inv(later(F, S, dt, k)) for k in range(2)]

        def energy(G):
            traces = (jnp.trace(three_dimensional(G) @ one) for one in inverse)
            return gent(G, mu) + 0.5 * mu * sum(g * one for g, one in zip(STRENGTH, traces, strict=True))

        return jax.grad(energy)(F)

    def update(F, S, X, t, dt):
        return jnp.concatenate([later(F, S, dt, k).ravel() for k in range(2)])

    return Law(stress, update, np.tile(np.eye(3).ravel(), 2))


def step(X, t):
    """A sheet that is 15 % thicker right of a line."""
    return 1 + 0.15 * 0.5 * (1 + jnp.tanh(X[0] - 0.4 * X[1] - 12))


def ellipse(X, t):
    """A softer ellipse, 14 by 6 mm."""
    r = jnp.sqrt(((X[0] - 18) / 14) ** 2 + ((X[1] + 10) / 6) ** 2)
    return 1 - 0.25 * 0.5 * (1 - jnp.tanh(6 * (r - 1)))


def warming(X, t):
    """Softer by 10 % after 40 s."""
    return 1 - 0.1 * t / 40
