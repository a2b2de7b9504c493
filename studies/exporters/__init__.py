"""Exporters: a calibrated model in, a file for another program out. One target a file; a new one is found by itself."""

from __future__ import annotations

from studies.commandline.subclasses import concrete
from studies.errors import ExportError
from studies.exporters.target import Target

__all__ = ["Target", "target_named", "targets"]


def targets() -> dict[str, Target]:
    """Every target by its name: those in modules of this folder, and those that were defined elsewhere."""
    return {kind.name: kind() for kind in sorted(concrete(Target, __path__, __name__), key=lambda kind: kind.name)}


def target_named(name: str) -> Target:
    """In any case, with or without underscores. Raises `ExportError` for an unknown name."""
    known = targets()
    spelled = {_plain(one): one for one in known}
    if _plain(name) not in spelled:
        raise ExportError(f"--to {name}: unknown; choose from {', '.join(known)}")
    return known[spelled[_plain(name)]]


def _plain(name: str) -> str:
    """'mat181' of MAT_181."""
    return name.casefold().replace("_", "").replace("-", "")
