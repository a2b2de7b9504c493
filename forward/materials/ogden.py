r"""The solid by Ogden: powers of the principal stretches, written in the invariants.

With :math:`k = \alpha / 2` a term needs the sum of the powers :math:`m_i^k` of the eigenvalues of C, the roots of
:math:`m^3 - I_1 m^2 + I_2 m - 1`. It is analytic in :math:`I_1, I_2` although the roots are not where two or three of them meet,
as in uniaxial and equi-biaxial tension and at rest. So it is evaluated without that singularity:

- near rest by Lagrange's series, with x = I1 - 3 and y = I2 - 3,
  :math:`\sum m_i^k - 3 = \sum_{n \ge 1} \frac{k}{n} \sum_{j=0}^n \binom{n}{j} x^j (-y)^{n-j} \binom{k - 1 + n + j}{3n - 1}`;
- elsewhere by the root m that is alone, and the other two, whose product is 1 / m and sum :math:`I_1 - m`:
  :math:`m^k + 2 m^{-k/2} T_k\big((I_1 - m) \sqrt m / 2\big)`. Vieta: the largest root is :math:`I_1 / 3 + 2 \sqrt p\, T_{1/3}(q)`,
  :math:`p = (I_1^2 - 3 I_2) / 9, q = (2 I_1^3 - 9 I_1 I_2 + 27) / (54 p^{3/2})`; where the smallest is alone (q < 0), 1 / m is the largest
  with I1 and I2 exchanged, and alone, too.

:math:`T_k` is Chebyshev's function :math:`\cos(k \arccos y) = \cosh(k \operatorname{arcosh} y)`, analytic at y = 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb, factorial, prod
from typing import Any, ClassVar

from forward.errors import MaterialError
from forward.materials.elementary import arc_cosine, at_least, cosine, piecewise
from forward.materials.strain_energy import Material

NEAR_REST, TERMS = 2e-3, 3  # I1 - 3 up to which the series is used, and its length: stresses to 1e-10
NEAR_ONE, POWERS = 5e-3, 5  # |y - 1| up to which T_k is a power series, and its length: to 1e-15


@dataclass(frozen=True)
class Ogden(Material):
    r"""One to three terms in the principal stretches.

    .. math:: \psi = \sum_{p=1}^3 \frac{\mu_p}{\alpha_p} (\lambda_1^{\alpha_p} + \lambda_2^{\alpha_p} + \lambda_3^{\alpha_p} - 3)

    mu1, mu2, mu3: MPa; a term with 0 is left out. alpha1, alpha2, alpha3: not 0. The initial shear modulus is half the sum of
    mu_p alpha_p.

    Ogden 1972 (Proc. R. Soc. Lond. A 326), whose fit to Treloar's rubber are the default values. Raises `MaterialError` for an exponent 0.
    """

    mu1: float = 0.63
    alpha1: float = 1.3
    mu2: float = 0.0012
    alpha2: float = 5.0
    mu3: float = -0.01
    alpha3: float = -2.0
    name: ClassVar[str] = "ogden"

    def __post_init__(self) -> None:
        super().__post_init__()
        if 0 in (self.alpha1, self.alpha2, self.alpha3):
            raise MaterialError("ogden: an exponent alpha is 0; give another number, and mu = 0 to leave a term out")

    @property
    def shear_modulus(self) -> float:
        return (self.mu1 * self.alpha1 + self.mu2 * self.alpha2 + self.mu3 * self.alpha3) / 2

    def energy(self, I1: Any, I2: Any, parameters: Sequence[Any] | None = None) -> Any:
        mu1, alpha1, mu2, alpha2, mu3, alpha3 = self.parameters if parameters is None else parameters
        terms = ((mu1, alpha1), (mu2, alpha2), (mu3, alpha3))
        root = _single_root(I1, I2)
        return sum(mu / alpha * sum_of_powers(I1, I2, root, alpha / 2) for mu, alpha in terms)


def sum_of_powers(I1: Any, I2: Any, root: Any, k: Any) -> Any:
    """Sum of the k-th powers of the eigenvalues of C, less 3; root: the one that is alone."""
    two = 2 * root ** (-k / 2) * _chebyshev_above_one((I1 - root) * root**0.5 / 2, k)
    return piecewise(I1 - 3, NEAR_REST, _near_rest(I1 - 3, I2 - 3, k), root**k + two - 3)


def _near_rest(x: Any, y: Any, k: Any) -> Any:
    """Lagrange's series of the sum, less 3."""
    return sum(
        k / n * comb(n, j) * x**j * (-y) ** (n - j) * _binomial(k - 1 + n + j, 3 * n - 1)
        for n in range(1, TERMS + 1)
        for j in range(n + 1)
    )


def _binomial(top: Any, r: int) -> Any:
    """Binomial coefficient of any upper number."""
    return prod((top - i for i in range(r)), start=1.0) / factorial(r)


def _single_root(I1: Any, I2: Any) -> Any:
    """The largest eigenvalue of C where the other two are nearer to each other, else the smallest; near rest any number that is finite."""
    side = 2 * I1**3 - 9 * I1 * I2 + 27  # positive where the largest is alone
    A, B = piecewise(side, 0.0, I2, I1), piecewise(side, 0.0, I1, I2)
    p = at_least((A**2 - 3 * B) / 9, NEAR_REST / 10)
    largest = A / 3 + 2 * p**0.5 * _chebyshev_third((2 * A**3 - 9 * A * B + 27) / 54 / p**1.5)
    return piecewise(side, 0.0, 1 / largest, largest)


def _chebyshev_third(y: Any) -> Any:
    """T_1/3(y) for y from 0 to 1, or beyond 1 by rounding."""
    inside = 1 - at_least(1 - y, NEAR_ONE)
    return piecewise(1 - y, NEAR_ONE, _near_one(y - 1, 1 / 3), cosine(arc_cosine(inside) / 3))


def _chebyshev_above_one(y: Any, k: Any) -> Any:
    """T_k(y) for y from 1 on, or below by rounding."""
    above = at_least(y, 1 + NEAR_ONE)
    power = (above + (above**2 - 1) ** 0.5) ** k
    return piecewise(y - 1, NEAR_ONE, _near_one(y - 1, k), (power + 1 / power) / 2)


def _near_one(z: Any, k: Any) -> Any:
    """T_k(1 + z) = sum over n of (2 z)^n / (2n)! times the product of k^2 - j^2, j < n."""
    return sum(
        (2 * z) ** n / factorial(2 * n) * prod((k**2 - j**2 for j in range(n)), start=1.0) for n in range(POWERS + 1)
    )
