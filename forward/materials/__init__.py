"""Materials, one law a file: invariants of an incompressible solid in, strain energy in MPa out; all else is derived."""

from forward.materials.arruda_boyce import ArrudaBoyce
from forward.materials.carroll import Carroll
from forward.materials.gent import Gent
from forward.materials.known_materials import MATERIALS, material_from_dict
from forward.materials.mooney_rivlin import MooneyRivlin
from forward.materials.neo_hooke import NeoHooke
from forward.materials.network_energy import Pann
from forward.materials.ogden import Ogden
from forward.materials.strain_energy import Material
from forward.materials.yeoh import Yeoh

__all__ = [
    "MATERIALS",
    "ArrudaBoyce",
    "Carroll",
    "Gent",
    "Material",
    "MooneyRivlin",
    "NeoHooke",
    "Ogden",
    "Pann",
    "Yeoh",
    "material_from_dict",
]
