"""Compressibility: a finite bulk modulus in plane stress.

With the energy psi(I1bar) + kappa (J - 1)^2 / 2 and sigma33 = 0 the sheet relaxes its volume ratio J. The isochoric part
of a sheet with in-plane F and volume ratio J is the incompressible sheet with J^(-1/3) F, hence

    P = J^(-1/3) P0(J^(-1/3) F),    J = 1 + beta p / J,    p = P0(Fbar) : Fbar / 3,    beta = 1 / kappa,

with P0 the stress of the incompressible sheet, of all energies and with its history: exact, whatever these are (relaxation as in
Simo 1987). To first order psi falls by beta p^2 / 2. J is found by the secant
method, which begins with the slope of a neo-Hookean sheet (`calibrate.effects.chain.links_of_stress.VolumeRatio`).
"""

from __future__ import annotations

from dataclasses import dataclass

from calibrate.effects.effect import Effect, Parameter, lacks_plane_stress
from calibrate.equations.tensors import Tensors


@dataclass(frozen=True)
class Compressibility(Effect):
    """P0 at F gives way to the stress at the relaxed volume."""

    name = "compressibility"
    stage = "kinematics"
    of_material = True
    formula = "psi(I1bar) + kappa (J - 1)^2 / 2, sigma33 = 0, beta = 1 / kappa"
    source = "Flory 1961; Simo, Taylor and Pister 1985"
    amplitudes = (Parameter("beta", "1/MPa", lower=0.0, typical=0.5),)
    decided_by = "the change of thickness, measured from the side"

    def missing(self, data):
        return lacks_plane_stress(data)

    def excess(self, F, P, J, a):
        """By which the volume ratio J (t, m) should be larger at the stress P of F, which is that of an incompressible sheet; zero where the faces are free."""
        pressure = Tensors.of(F).dot(Tensors.of(P)) / 3.0
        return 1.0 + a[0] * pressure / J - J

    def slope(self, F, a, modulus):
        """Fall of the excess by J, of neo-Hooke at J = 1."""
        F = Tensors.of(F)
        inside, across = F.dot(F), 1.0 / F.det**2
        return 1.0 + a[0] * modulus * (2.0 / 9.0) * (inside + 4.0 * across)
