"""Kinds of a thing that are found by themselves: a new one is a module in their folder.

In: a base class and the package of its kinds. Out: its concrete subclasses.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Iterable, Iterator
from typing import Any


def concrete(parent: Any, path: Iterable[str], package: str) -> list[Any]:
    """Subclasses of a base that can be made: those in modules of a package (its ``__path__`` and name), and those that were defined elsewhere."""
    for module in pkgutil.iter_modules(path, f"{package}."):
        importlib.import_module(module.name)
    return list(_below(parent))


def _below(parent: Any) -> Iterator[Any]:
    for kind in parent.__subclasses__():
        if not inspect.isabstract(kind):
            yield kind
        yield from _below(kind)
