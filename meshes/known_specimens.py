"""Which specimens there are, by name: plain data in, specimen out."""

from __future__ import annotations

from typing import Any

from meshes.errors import SpecimenError
from meshes.perforated_sheets import SHEETS, PerforatedSheet
from meshes.specimens import Cross, PlateWithHole, PureShearSheet, Specimen, SquareSheet, Strip

SPECIMENS: dict[str, type[Specimen]] = {
    kind.name: kind for kind in (Cross, Strip, PureShearSheet, SquareSheet, PlateWithHole, PerforatedSheet, *SHEETS)
}


def specimen_from_dict(content: dict[str, Any]) -> Specimen:
    """Specimen from `Specimen.to_dict()`. Raises `SpecimenError` naming an unknown specimen or dimension."""
    dimensions = dict(content)
    name = dimensions.pop("specimen", None)
    if name not in SPECIMENS:
        raise SpecimenError(f"specimen '{name}' is unknown; choose one of {', '.join(SPECIMENS)}")
    try:
        return SPECIMENS[name](**dimensions)
    except TypeError as error:
        raise SpecimenError(f"{name}: {error}") from error
