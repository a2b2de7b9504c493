"""Importers: measured data of one vendor or layout in, a `Recording` out. One file each; a new one is found by itself."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from calibrate import errors
from studies.importers.recording.importer import Importer, Processing, Recording, SheetOptions

__all__ = ["Importer", "Processing", "Recording", "SheetOptions", "importer_of", "importers"]


def importers() -> list[Importer]:
    """An importer of every kind: those in modules of this folder, and those that were defined elsewhere."""
    for module in pkgutil.iter_modules(__path__, f"{__name__}."):
        importlib.import_module(module.name)
    return sorted((kind() for kind in _kinds(Importer)), key=lambda importer: importer.fallback)


def importer_of(source: str) -> Importer:
    """The importer that reads a source. Raises `FileFormatError`, `DataNotFoundError`."""
    known = importers()
    for importer in known:
        if importer.reads(source):
            return importer
    kinds = " or ".join(importer.source for importer in known)
    if Path(source).is_file():
        raise errors.FileFormatError(f"{source}: no importer reads this; give {kinds}")
    raise errors.DataNotFoundError(f"{source}: no such file or folder; give {kinds}")


def _kinds(parent: Any) -> Iterator[Any]:
    for kind in parent.__subclasses__():
        if not inspect.isabstract(kind):
            yield kind
        yield from _kinds(kind)
