"""The only place that imports DOLFINx. The binary wheel wants `dolfinx_solver` before `dolfinx`."""

from __future__ import annotations

import contextlib
import hashlib
import platform
from collections.abc import Iterator
from pathlib import Path
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

# Quadrature must be stated: the energy is a high power, for which FFCx would take thousands of points.
QUADRATURE_DEGREE = 5
FLAGS = ["-O3", "-march=native", "-ffast-math", "-fno-finite-math-only"]

PETSC_VERSION = ".".join(str(n) for n in PETSc.Sys.getVersion())


def _processor() -> str:
    """Hash of what this processor can do; forms compiled for another one are then not taken from a shared cache."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.machine()
    return hashlib.sha256(next((line for line in lines if line.startswith("flags")), "").encode()).hexdigest()[:12]


JIT_OPTIONS = {"cffi_extra_compile_args": [*FLAGS, f"-DEQUIGAP_PROCESSOR={_processor()}"]}


def versions() -> dict[str, Any]:
    """Program versions and the quadrature, for a manifest."""
    return {"dolfinx": dolfinx.__version__, "petsc": PETSC_VERSION, "quadrature_degree": QUADRATURE_DEGREE}


@contextlib.contextmanager
def compiler_needed() -> Iterator[None]:
    """Around the compilation of forms. Raises `MissingSolverError` where there is no working C compiler."""
    try:
        yield
    except cffi.VerificationError as error:
        raise MissingSolverError(
            f"the forms cannot be compiled ({str(error).splitlines()[0]}); a C compiler is needed, on Debian or "
            "Ubuntu: apt-get install -y gcc libc6-dev"
        ) from error


__all__ = [
    "JIT_OPTIONS",
    "MPI",
    "PETSC_VERSION",
    "QUADRATURE_DEGREE",
    "PETSc",
    "basix",
    "compiler_needed",
    "dolfinx",
    "ufl",
    "versions",
]
