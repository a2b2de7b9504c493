"""The only import of gmsh: a session around it, and a named error where a library is missing."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

from meshes.errors import MeshQualityError, MissingLibraryError

DEBIAN_PACKAGES = (
    "libglu1-mesa libgl1 libgomp1 libfontconfig1 libx11-6 libxcursor1 libxext6 libxfixes3 libxft2 "
    "libxinerama1 libxrender1"
)


def load() -> ModuleType:
    """The gmsh module. Raises `MissingLibraryError` naming what to install."""
    try:
        return importlib.import_module("gmsh")
    except ImportError as error:
        raise MissingLibraryError("gmsh is not installed; run `make setup`") from error
    except OSError as error:
        raise MissingLibraryError(
            f"gmsh cannot start: {error}. It needs some X and GL libraries, but no screen; on Debian or Ubuntu: "
            f"apt-get install -y {DEBIAN_PACKAGES}"
        ) from error


@contextmanager
def session(name: str) -> Iterator[ModuleType]:
    """A quiet gmsh with an empty model, the same mesh on every run. gmsh's errors become `MeshQualityError`."""
    gmsh = load()
    gmsh.initialize(argv=[], readConfigFiles=False, run=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        gmsh.option.setNumber("Mesh.RandomSeed", 1)
        gmsh.model.add(name)
        yield gmsh
    except MeshQualityError:
        raise
    except Exception as error:
        if type(error) is not Exception:  # gmsh raises bare Exceptions
            raise
        raise MeshQualityError(f"{name}: gmsh failed ({error}); choose other sizes or dimensions") from error
    finally:
        gmsh.finalize()
