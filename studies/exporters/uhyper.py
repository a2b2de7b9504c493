"""UHYPER: an isotropic hyperelastic energy for Abaqus, in Fortran that is valid in fixed form."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from studies.exporters.certificate import Derivatives, Errors, errors_of_derivatives
from studies.exporters.fortran_code import compiled, compiler
from studies.exporters.material_law import MaterialLaw
from studies.exporters.target import Target, Volume, render

Array = NDArray[np.float64]


class Uhyper(Target):
    """U(I1bar, I2bar, J) with first and second derivatives."""

    name = "uhyper"
    file_name = "uhyper.f"
    summary = "Fortran UHYPER (Abaqus): isotropic energy of I1 and I2, hybrid elements or a bulk modulus"
    comment = "!"
    carries: ClassVar[frozenset[str]] = frozenset()

    def body(self, law: MaterialLaw, volume: Volume) -> str:
        return render("exported_uhyper.f", terms=law.terms, volume=volume)

    def errors(self, law: MaterialLaw, volume: Volume, body: str) -> Errors | None:
        if compiler() is None:
            return None
        return errors_of_derivatives(law, derivatives(body), "compiled with gfortran")


def derivatives(source: str) -> Derivatives:
    """(W, W1, W2, W11, W12, W22) (6, n) of compiled source, as a function of invariants (n,), (n,)."""
    call = compiled(source, "uhyper")

    def found(I1: Array, I2: Array) -> Array:
        rows = [point(a, b, 1.0, True) for a, b in zip(I1, I2, strict=True)]
        return np.array([[U[0], U1[0], U1[1], U2[0], U2[3], U2[1]] for U, U1, U2 in rows]).T

    def point(a: float, b: float, J: float, incompressible: bool) -> tuple[Array, Array, Array]:
        U, U1, U2, U3 = np.zeros(2), np.zeros(3), np.zeros(6), np.zeros(6)
        zero, none, flag = np.zeros(1), np.zeros(1, np.int32), np.array([int(incompressible)], np.int32)
        name = np.frombuffer(b"LAW".ljust(80), np.uint8).copy()
        scalars = (np.array([float(a)]), np.array([float(b)]), np.array([J]))
        call(*scalars, U, U1, U2, U3, zero, none, name, flag, none, zero, none, zero, zero, none, zero, 80)
        return U, U1, U2

    return found
