"""Which materials there are, by name: plain data in, material out."""

from __future__ import annotations

from typing import Any

from forward.errors import MaterialError
from forward.materials.arruda_boyce import ArrudaBoyce
from forward.materials.carroll import Carroll
from forward.materials.gent import Gent
from forward.materials.mooney_rivlin import MooneyRivlin
from forward.materials.neo_hooke import NeoHooke
from forward.materials.network_energy import Pann
from forward.materials.ogden import Ogden
from forward.materials.spline_energy import SplineEnergy
from forward.materials.strain_energy import Material
from forward.materials.tabulated import Tabulated
from forward.materials.yeoh import Yeoh

MATERIALS: dict[str, type[Material]] = {
    kind.name: kind for kind in (ArrudaBoyce, NeoHooke, MooneyRivlin, Yeoh, Carroll, Gent, Ogden)
}
_ALL: dict[str, type[Material]] = {**MATERIALS, **{kind.name: kind for kind in (Pann, Tabulated, SplineEnergy)}}


def material_from_dict(content: dict[str, Any]) -> Material:
    """Material from `Material.to_dict()`. Raises `MaterialError` naming what is unknown."""
    parameters = dict(content)
    name = parameters.pop("material", None)
    if name not in _ALL:
        raise MaterialError(f"material '{name}' is unknown; choose one of {', '.join(_ALL)}")
    return _ALL[name].from_dict(parameters)
