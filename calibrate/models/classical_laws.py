r"""Classical hyperelastic laws with free parameters: what people know beside a network.

In: in-plane F (..., 2, 2) of an incompressible sheet and parameters (q,). Out: P (..., 2, 2) and its derivatives by the parameters, in the
unit of the moduli. With T = tr C and D = det C in the plane, P = 2 psi_T F + 2 psi_D D F^-T; a law states psi_T and psi_D in closed
form. Sources: Mooney 1940 and Rivlin 1948; Yeoh 1993; Ogden 1972, with mu the initial shear modulus; Arruda and Boyce 1993,
five terms; Gent 1996. Limits of extension N and Jm enter a fit by their reciprocals, which are 0 for a chain without a limit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Slopes = Callable[[Array, Array, Array], Array]  # of T (n,), D (n,), parameters (q,)
EQUAL = 1e-10  # added to the square of half the difference of squared stretches: keeps quotients where both are equal; error as small
NO_LIMIT = 1e-6  # least reciprocal of a limit of extension
EIGHT_CHAINS = (1 / 2, 1 / 20, 11 / 1050, 19 / 7000, 519 / 673750)
STATES, STEP = 25, 1e-5  # of each principal logarithmic strain, at which stability is checked; of its differences


@dataclass(frozen=True)
class Parameter:
    """start: of a fit, in initial shear moduli where it is a modulus. reciprocal: a fit works with 1 / value."""

    name: str
    start: float
    modulus: bool = True
    reciprocal: bool = False

    def value(self, fitted: float) -> float:
        """As it is reported; infinite for a limit that was not seen."""
        if not self.reciprocal:
            return fitted
        return 1 / fitted if fitted > 1.001 * NO_LIMIT else np.inf


@dataclass(frozen=True)
class Law:
    """slopes(T, D, p): (1 + q, 2, n), psi_T and psi_D, then their derivatives by each parameter."""

    name: str
    slopes: Slopes
    parameters: tuple[Parameter, ...]

    @property
    def moduli(self) -> NDArray[np.bool_]:
        """Which parameters (q,) the stress is proportional to, taken together."""
        return np.array([p.modulus for p in self.parameters])

    @property
    def lower(self) -> Array:
        """Bounds (q,) of a fit."""
        return np.array([NO_LIMIT if p.reciprocal else -np.inf for p in self.parameters])

    def start(self, shear_modulus: float, largest: float) -> Array:
        """Start (q,) of a fit. shear_modulus: a guess, MPa; largest: I1 - 3 of the data, within which no limit lies."""
        scale = [
            shear_modulus * p.start if p.modulus else min(p.start, 0.3 / largest) if p.reciprocal else p.start
            for p in self.parameters
        ]
        return np.array(scale)

    def stress(self, F: Array, parameters: Array) -> Array:
        """P (..., 2, 2) at F (..., 2, 2)."""
        return self.stress_and_sensitivity(F, parameters)[0]

    def stress_and_sensitivity(self, F: Array, parameters: Array) -> tuple[Array, Array]:
        """P (..., 2, 2) and dP / d parameters (q, ..., 2, 2) at F (..., 2, 2)."""
        (a, b), (c, d) = np.moveaxis(F, (-2, -1), (0, 1))
        J = a * d - b * c
        cofactor = np.stack([np.stack([d, -c], -1), np.stack([-b, a], -1)], -2)  # J F^-T
        psi = self.slopes((F**2).sum((-2, -1)).ravel(), J.ravel() ** 2, np.asarray(parameters))
        psi_T, psi_D = np.moveaxis(psi, 1, 0).reshape(2, len(psi), *J.shape)[..., None, None]
        all_of_them = 2 * psi_T * F + 2 * psi_D * (J[..., None, None] * cofactor)
        return all_of_them[0], all_of_them[1:]

    def stability(self, parameters: Array, tops: tuple[float, float]) -> float:
        """Least eigenvalue of d2 psi / d(ln stretch)2, MPa, at plane states with invariants up to `tops`; positive: stable
        in the sense of Drucker (Hill 1958), as finite-element programs check it. By differences, to about 1e-9."""
        line = np.linspace(-1.0, 1.0, STATES) * np.log(max(tops)) / 2
        e = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
        squares = np.exp(2 * np.column_stack([e, -e.sum(axis=1)]))
        e = e[(squares.sum(axis=1) <= tops[0]) & ((1 / squares).sum(axis=1) <= tops[1])]
        columns = [self._forces(e + h, parameters) - self._forces(e - h, parameters) for h in STEP * np.eye(2)]
        hessians = np.stack(columns, axis=-1) / (2 * STEP)
        return float(np.linalg.eigvalsh((hessians + np.swapaxes(hessians, 1, 2)) / 2)[:, 0].min())

    def _forces(self, e: Array, parameters: Array) -> Array:
        """d psi / d(ln stretch) (n, 2) at logarithmic strains (n, 2)."""
        s = np.exp(2 * e)
        T, D = s.sum(axis=1), s.prod(axis=1)
        psi_T, psi_D = self.slopes(T, D, np.asarray(parameters))[0]
        return 2 * psi_T[:, None] * s + 2 * (psi_D * D)[:, None]


def _of_invariants(T: Array, D: Array, slopes: list[tuple[Array | float, Array | float]]) -> Array:
    """psi_T and psi_D of psi_1 and psi_2: I1 = T + 1 / D, I2 = D + T / D."""
    one = np.ones_like(T)
    return np.array([[(p1 + p2 / D) * one, p2 * (1 - T / D**2) - p1 / D**2] for p1, p2 in slopes])


def neo_hooke(T: Array, D: Array, p: Array) -> Array:
    """mu/2 (I1 - 3), p = (mu,)."""
    return _of_invariants(T, D, [(p[0] / 2, 0.0), (0.5, 0.0)])


def mooney_rivlin(T: Array, D: Array, p: Array) -> Array:
    """c10 (I1 - 3) + c01 (I2 - 3), p = (c10, c01)."""
    return _of_invariants(T, D, [(p[0], p[1]), (1.0, 0.0), (0.0, 1.0)])


def yeoh(T: Array, D: Array, p: Array) -> Array:
    """c10 (I1 - 3) + c20 (I1 - 3)^2 + c30 (I1 - 3)^3, p = (c10, c20, c30)."""
    x = T + 1 / D - 3
    each = [np.ones_like(x), 2 * x, 3 * x**2]
    return _of_invariants(T, D, [(p @ np.array(each), 0.0), *((s, 0.0) for s in each)])


def arruda_boyce(T: Array, D: Array, p: Array) -> Array:
    """mu sum c_k / N^(k-1) (I1^k - 3^k), p = (mu, 1 / N)."""
    I1, (mu, q) = T + 1 / D, p
    terms = list(enumerate(EIGHT_CHAINS, 1))
    one = sum(k * c * (q * I1) ** (k - 1) for k, c in terms)
    by_q = mu * sum(k * (k - 1) * c * q ** (k - 2) * I1 ** (k - 1) for k, c in terms[1:])
    return _of_invariants(T, D, [(mu * one, 0.0), (one, 0.0), (by_q, 0.0)])


def gent(T: Array, D: Array, p: Array) -> Array:
    """-mu Jm / 2 ln(1 - (I1 - 3) / Jm), p = (mu, 1 / Jm); not a number beyond the limit."""
    x, (mu, q) = T + 1 / D - 3, p
    left = np.where(q * x < 1, 1 - q * x, np.nan)
    return _of_invariants(T, D, [(mu / 2 / left, 0.0), (0.5 / left, 0.0), (mu / 2 * x / left**2, 0.0)])


def ogden(T: Array, D: Array, p: Array) -> Array:
    """sum over terms of 2 mu / alpha^2 sum (stretch^alpha - 1), p = (mu, alpha) of every term in turn."""
    parts = []
    for mu, alpha in p.reshape(-1, 2):
        parts += [
            _of_stretches(T, D, partial(_ogden_slope, alpha)),
            mu * _of_stretches(T, D, partial(_ogden_slope_by_alpha, alpha)),
        ]
    return np.array([sum(mu * part for mu, part in zip(p[::2], parts[::2], strict=True)), *parts])


def _ogden_slope(alpha: float, s: Array) -> Array:
    return np.asarray(s ** (alpha / 2 - 1) / alpha)


def _ogden_slope_by_alpha(alpha: float, s: Array) -> Array:
    return np.asarray(s ** (alpha / 2 - 1) * (np.log(s) / (2 * alpha) - 1 / alpha**2))


def _of_stretches(T: Array, D: Array, slope: Callable[[Array], Array]) -> Array:
    """psi_T and psi_D (2, n) of a sum over squared principal stretches s with slope(s): quotients of differences in the plane."""
    root = np.sqrt(np.maximum(T**2 / 4 - D, 0.0) + EQUAL)
    s1, s2, g3 = T / 2 + root, T / 2 - root, slope(1 / D)
    g1, g2 = slope(s1), slope(s2)
    return np.array([(s1 * g1 - s2 * g2) / (2 * root), (g2 - g1) / (2 * root) - g3 / D**2])


CLASSICAL_LAWS = (
    Law("neo-Hooke", neo_hooke, (Parameter("mu", 1.0),)),
    Law("Mooney-Rivlin", mooney_rivlin, (Parameter("c10", 0.4), Parameter("c01", 0.1))),
    Law("Yeoh", yeoh, (Parameter("c10", 0.5), Parameter("c20", 0.0), Parameter("c30", 0.0))),
    Law("one-term Ogden", ogden, (Parameter("mu", 1.0), Parameter("alpha", 2.2, False))),
    Law(
        "two-term Ogden", ogden,
        (Parameter("mu1", 0.8), Parameter("alpha1", 2.2, False), Parameter("mu2", 0.2), Parameter("alpha2", -2.0, False)),
    ),
    Law("Arruda-Boyce", arruda_boyce, (Parameter("mu", 1.0), Parameter("N", 0.05, False, True))),
    Law("Gent", gent, (Parameter("mu", 1.0), Parameter("Jm", 0.02, False, True))),
)  # fmt: skip
