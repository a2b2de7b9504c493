"""The measured sheets of Abbasi et al. (2026), or any tests laid out like them: a folder in, an Experiment for each specimen out.

The folder is ``EQUIGAP_DATA/abbasi2026``. It holds a column map (docs/import.md) for each specimen, ``UT.toml``, ``PS.toml``, ``TTa.toml`` to
``TTf.toml``, as many as there are, beside the tables that they name, and ``margins.toml``: for each specimen how far, in mm, its region of interest
ends before the free sides, such as ``UT = 2.5``. Sides that are gripped are ``loaded`` in the maps, rims of holes are ``free``; the sides beside
which something is not seen are neither.
"""

from __future__ import annotations

import os
import tomllib
from dataclasses import replace
from pathlib import Path

from calibrate import errors
from calibrate.data.experiment import Experiment
from studies.importers.column_import import ColumnMapped
from studies.importers.measured_data import VARIABLE
from studies.importers.recording.importer import SheetOptions

FOLDER = "abbasi2026"
NAMES = ("UT", "PS", "TTa", "TTb", "TTc", "TTd", "TTe", "TTf")
MARGINS = "margins.toml"


def folder() -> Path:
    """Where the sheets are. Raises `DataNotFoundError` that says how they are to be laid out."""
    place = Path(os.environ.get(VARIABLE, "")) / FOLDER
    if VARIABLE not in os.environ or not place.is_dir():
        raise errors.DataNotFoundError(
            f"{FOLDER}: no such folder in {os.environ.get(VARIABLE) or VARIABLE}; put a column map for each specimen there (UT.toml, "
            f"PS.toml, ...) and {MARGINS}, as docs/generalise.md says"
        )
    return place


def names() -> tuple[str, ...]:
    """Specimens that are there. Raises `DataNotFoundError` where there are fewer than two."""
    place = folder()
    found = tuple(name for name in NAMES if (place / f"{name}.toml").is_file())
    if len(found) < 2:
        raise errors.DataNotFoundError(
            f"{place}: {len(found)} of the column maps {', '.join(f'{name}.toml' for name in NAMES)}; at least two specimens are needed"
        )
    return found


def sheet(name: str) -> Experiment:
    """One specimen; its provenance holds `margin_mm`. Raises `DataNotFoundError`, `ConfigError` and the errors of the tables."""
    place = folder()
    path = place / f"{name}.toml"
    if not path.is_file():
        raise errors.DataNotFoundError(f"{path}: no such column map; the specimens there are {', '.join(names())}")
    width = margin(place / MARGINS, name)
    recording = ColumnMapped().read(str(path), SheetOptions(), None, None)
    experiment = recording.experiment()
    return replace(experiment, provenance={**experiment.provenance, "margin_mm": width})


def margin(path: Path, name: str) -> float:
    """Of a specimen, mm. Raises `DataNotFoundError`, `ConfigError`."""
    if not path.is_file():
        raise errors.DataNotFoundError(
            f"{path}: no such file; write for each specimen how far its region of interest ends before the free sides, such as {name} = 2.5 (mm)"
        )
    try:
        value = tomllib.loads(path.read_text()).get(name)
    except tomllib.TOMLDecodeError as error:
        raise errors.ConfigError(f"{path}: no TOML ({error}); write lines such as {name} = 2.5") from error
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 <= value < float("inf"):
        raise errors.ConfigError(
            f"{path}: {name} = {value}; give 0 or the width in mm that is not seen, such as {name} = 2.5"
        )
    return float(value)
