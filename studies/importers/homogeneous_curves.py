"""Classical homogeneous tests of rubber: nominal stress against stretch.

In: the name of a collection. Out: {mode: (stretch (k,), nominal stress (k,) MPa)}, sorted by stretch; or, for
general biaxial tests, principal stretches and nominal stresses (n, 4).

The files are those of docs/import.md; the transcriptions of Treloar (1944) by two groups are both here, and they
differ in number and place of points.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from studies.importers import measured_data
from studies.importers.text_tables import Layout, read_table

Array = NDArray[np.float64]
Curves = dict[str, tuple[Array, Array]]
MODE_FOLDERS = {"uniaxial": "UT", "equibiaxial": "ET", "pure_shear": "PS"}


def _sorted(stretch: Array, stress: Array) -> tuple[Array, Array]:
    order = np.argsort(stretch, kind="stable")
    return stretch[order], stress[order]


def _collection(folder: str) -> Curves:
    """Blank-separated columns nominal stress (MPa), stretch: stress first."""
    layout = Layout(delimiter=" ", header_line=0)
    curves = {}
    for mode, short in MODE_FOLDERS.items():
        table = read_table(
            measured_data.find(f"chongran_zhao_homogeneous/{folder}/{short}/stress_stretch.txt"), None, layout
        )
        curves[mode] = _sorted(table["2"], table["1"])
    return curves


def _treloar_tables() -> Curves:
    """Comma-separated columns stretch, nominal stress (MPa); file 0 uniaxial, 1 equi-biaxial, 2 pure shear."""
    curves = {}
    for k, mode in enumerate(MODE_FOLDERS):
        path = measured_data.find(f"dammass_kalina_treloar_brain/treloarData/treloar_{k}.csv")
        table = read_table(path, None, Layout(header_line=0))
        curves[mode] = _sorted(table["1"], table["2"])
    return curves


COLLECTIONS: Mapping[str, Callable[[], Curves]] = {
    "treloar-a": _treloar_tables,
    "treloar-b": lambda: _collection("Treloar_1944"),
    "kawabata": lambda: _collection("Kawabata_1981"),
    "meunier": lambda: _collection("Meunier_2008"),
}
SOURCES = {
    "treloar-a": "Treloar 1944, Trans. Faraday Soc., natural rubber at 20 C; tables of Dammass, Kalina, Kaestner 2025",
    "treloar-b": "Treloar 1944, Trans. Faraday Soc., natural rubber; collected by Zhao 2026",
    "kawabata": "Kawabata, Matsuda, Tei, Kawai 1981, Macromolecules 14; collected by Zhao 2026",
    "meunier": "Meunier et al. 2008, silicone rubber; collected by Zhao 2026",
}


def load(name: str) -> Curves:
    """{mode: (stretch (k,), nominal stress (k,) MPa)} of a collection, sorted by stretch.

    Raises `ConfigError` for an unknown collection, `DataNotFoundError`, `FileFormatError`.
    """
    if name not in COLLECTIONS:
        raise errors.ConfigError(f"collection '{name}' unknown; choose one of {', '.join(COLLECTIONS)}")
    return COLLECTIONS[name]()


def kawabata_biaxial() -> Array:
    """Kawabata et al. 1981, general biaxial (117, 4): stretches 1 and 2, nominal stresses 1 and 2 in MPa.

    Raises `DataNotFoundError`, `FileFormatError`.
    """
    columns = ("lambda1", "lambda2", "P1_MPa", "P2_MPa")
    table = read_table(measured_data.find("kawabata_jl/kawabata1981_biaxial.csv"), columns)
    return np.stack([table[c] for c in columns], axis=1)
