"""The only place that imports DOLFINx. The binary wheel wants `dolfinx_solver` before `dolfinx`."""

from __future__ import annotations

import contextlib
from typing import Any

from forward.errors import MissingSolverError

with contextlib.suppress(ModuleNotFoundError):  # absent where DOLFINx comes from conda-forge, Debian, a container
    import dolfinx_solver  # noqa: F401

try:
    import basix.ufl
    import cffi
    import dolfinx
    import dolfinx.fem.petsc
    import ufl
    from mpi4py import MPI
    from petsc4py import PETSc
except ImportError as error:
    raise MissingSolverError(
        f"DOLFINx 0.11 with PETSc is not installed ({error}); run `make setup` (Linux x86-64) or use the container"
    ) from error

PETSc.Sys.popSignalHandler()  # else a closed pipe (`equigap ... | head`) is an abort of all processes with a page of text

# Quadrature must be stated: the energy is a high power, for which FFCx would take thousands of points.
QUADRATURE_DEGREE = 5
PETSC_VERSION = ".".join(str(n) for n in PETSc.Sys.getVersion())


def versions() -> dict[str, Any]:
    """Program versions and the quadrature, for a manifest."""
    return {"dolfinx": dolfinx.__version__, "petsc": PETSC_VERSION, "quadrature_degree": QUADRATURE_DEGREE}


__all__ = [
    "MPI",
    "PETSC_VERSION",
    "QUADRATURE_DEGREE",
    "PETSc",
    "basix",
    "cffi",
    "dolfinx",
    "ufl",
    "versions",
]
