"""UMAT: Cauchy stress and consistent tangent for Abaqus-type codes, with fibres, relaxation, softening and compressibility."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, sin
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from studies.exporters.certificate import STATES, Errors, expected, relative
from studies.exporters.fortran_code import compiled, compiler
from studies.exporters.material_law import MaterialLaw
from studies.exporters.target import Target, Volume, render

Array = NDArray[np.float64]
ROWS, COLUMNS = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]  # Abaqus: 11 22 33 12 13 23
STEP = 1e-6  # of the differences
INELASTIC = frozenset({"viscoelasticity", "finite viscoelasticity", "Mullins softening", "Payne softening"})
Update = Callable[[Array, Array, float], tuple[Array, Array, Array, float]]


class Umat(Target):
    """Solid elements; history variables are listed in the file."""

    name = "umat"
    file_name = "umat.f"
    summary = "Fortran UMAT (Abaqus, CalculiX): with fibres, relaxation, softening, compressibility"
    comment = "!"
    carries: ClassVar[frozenset[str]] = frozenset({"fibres", *INELASTIC})

    def body(self, law: MaterialLaw, volume: Volume) -> str:
        return render(
            "exported_umat.f", law=law, terms=law.terms, volume=volume, depvar=history_size(law),
            cosines=[(cos(f.angle), sin(f.angle)) for f in law.fibres], unsymmetric=is_unsymmetric(law),
        )  # fmt: skip

    def errors(self, law: MaterialLaw, volume: Volume, body: str) -> Errors | None:
        if compiler() is None:
            return None
        update = material_point(body, history_size(law))
        F, W, Q, _ = expected(law, STATES)
        P, tangents, energies = [], [], []
        for f in F:
            stress, tangent, _, energy = update(solid(f), np.zeros(history_size(law)), 1.0)
            P.append(sheet_stress(stress, f))
            energies.append(energy)
            tangents.append((tangent, differences(update, solid(f), np.zeros(history_size(law)), 1.0)))
        # relaxation and softening have no energy
        elastic = not INELASTIC & set(law.beside)
        return Errors(
            relative(np.array(energies), W) if elastic else None,
            relative(np.array(P), Q),
            max(relative(a, b) for a, b in tangents),
            len(F),
            "compiled with gfortran (tangent: against differences of its stress)",
        )


def is_unsymmetric(law: MaterialLaw) -> bool:
    """Whether the tangent is: softening has no potential, nor has a dashpot at finite strain, or the deviator of what is no function of the isochoric part."""
    return bool(law.mullins or law.payne or law.maxwell or (law.prony and law.fibres))


def history_size(law: MaterialLaw) -> int:
    """Number of history variables."""
    return 1 + 12 * (len(law.prony) + len(law.maxwell))


def material_point(source: str, n_history: int) -> Update:
    """The compiled UMAT: (F (3, 3), history (n,), time step, s) to Cauchy stress (6,), DDSDDE (6, 6), history, energy."""
    call = compiled(source, "umat")

    def update(F: Array, history: Array, step: float) -> tuple[Array, Array, Array, float]:
        stress, tangent, state, energy = np.zeros(6), np.zeros((6, 6), order="F"), history.copy(), np.zeros(1)
        z, i = np.zeros(9), [np.array([k], np.int32) for k in (3, 3, 6, n_history, 0)]
        none, name = np.zeros(1, np.int32), np.frombuffer(b"LAW".ljust(80), np.uint8).copy()
        call(
            stress, state, tangent, energy, z, z, z, z, z, z, z, z, z, np.array([step]), z, z, z, z, name,
            *i[:4], z, none, z, np.eye(3), z, z, np.eye(3), np.asfortranarray(F), *[none] * 6, 80,
        )  # fmt: skip
        return stress, np.array(tangent), state, float(energy[0])

    return update


def differences(update: Update, F: Array, history: Array, step: float) -> Array:
    """DDSDDE (6, 6) by central differences of the Kirchhoff stress for symmetric increments of strain."""
    J, found = np.linalg.det(F), np.zeros((6, 6))
    for b, (k, m) in enumerate(zip(ROWS, COLUMNS, strict=True)):
        e = np.zeros((3, 3))
        e[k, m] += 0.5
        e[m, k] += 0.5
        tau = []
        for sign in (1, -1):
            moved = (np.eye(3) + sign * STEP * e) @ F
            tau.append(update(moved, history, step)[0] * np.linalg.det(moved))
        found[:, b] = (tau[0] - tau[1]) / (2 * STEP * J)
    return found


def solid(f: Array) -> Array:
    """F (3, 3) of an incompressible sheet with in-plane f (2, 2)."""
    F = np.zeros((3, 3))
    F[:2, :2], F[2, 2] = f, 1 / np.linalg.det(f)
    return F


def sheet_stress(stress: Array, f: Array) -> Array:
    """In-plane P (2, 2) of a Cauchy stress (6,) whose pressure is so changed that sigma33 vanishes; det F = 1."""
    sigma = np.array([[stress[0], stress[3]], [stress[3], stress[1]]]) - stress[2] * np.eye(2)
    return sigma @ np.linalg.inv(f).T
