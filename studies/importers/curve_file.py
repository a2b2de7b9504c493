"""Stress-stretch curves of homogeneous tests from a text table: a column that names the mode, one of stretch or strain, one of stress.

In: a path such as ``curves.csv`` with ``mode,stretch,stress_MPa``. Out: {mode: (stretch (k,), nominal stress (k,) MPa)}, sorted by stretch.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.fitting.homogeneous.sobolev_fit import Curves, check_curves
from studies.importers.exports.text_files import TextFile, plain, text_file
from studies.importers.text_tables import read_table, read_words

Array = NDArray[np.float64]
MODES = {
    "uniaxial": ("uniaxial", "ut", "tension", "uniaxial tension", "simple tension"),
    "equibiaxial": ("equibiaxial", "equi biaxial", "et", "eb", "equibiaxial tension"),
    "pure_shear": ("pure shear", "ps", "planar", "planar tension"),
}
STRESS_UNITS = {"MPa": 1.0, "kPa": 1e-3, "Pa": 1e-6, "N/mm2": 1.0, "N/mm^2": 1.0, "psi": 6.894757293168e-3}
SUFFIX = re.compile(r"[_ ](MPa|kPa|Pa|psi)$", re.IGNORECASE)
OTHERS = (
    "true",
    "cauchy",
    "kirchhoff",
    "log",
    "hencky",
    "green",
    "second",
    "pk2",
)  # in names of measures that are not nominal
NOISE = 0.02  # of the largest stress, and of a stretch: smaller ones have any sign, and any order
NEAR_REST = 0.2  # of the strains of a mode, above the least: a row that falls back to there begins another pull
NEEDED = "columns mode, stretch (or strain), stress_MPa; mode is uniaxial, equibiaxial or pure_shear"


def read_curves(path: str | Path) -> Curves:
    """Raises `DataNotFoundError`, `FileFormatError` with file and row, `UnitsError`, and what `check_curves` raises."""
    path = Path(path)
    if not path.is_file():
        raise errors.DataNotFoundError(f"{path}: no such file; give a table with {NEEDED}")
    file = text_file(path)
    if file is None or file.is_matrix:
        raise errors.FileFormatError(_no_table(path))
    mode, stretch, stress = (_column(file, *names) for names in (("mode", "test"), ("stretch", "strain"), ("stress",)))
    table = read_table(path, [stretch, stress], file.layout)
    modes = [_mode(path, row, word) for row, word in enumerate(read_words(path, mode, file.layout), 1)]
    x = table[stretch] * (0.01 if file.unit(stretch) == "%" else 1.0)
    x = x + 1 if "strain" in stretch.casefold() else x
    P = table[stress] * _unit(path, file, stress)
    bad = np.flatnonzero(~(np.isfinite(x) & np.isfinite(P)))
    if bad.size:
        raise errors.FileFormatError(
            f"{path}, row {bad[0] + 1} below the header: no number in '{stretch}' or '{stress}'"
        )
    _check_signs(path, x, P)
    curves = {}
    for name in dict.fromkeys(modes):
        own = np.array([one == name for one in modes])
        _check_order(path, np.flatnonzero(own), x[own])
        order = np.argsort(x[own], kind="stable")
        curves[name] = (x[own][order], P[own][order])
    check_curves(curves)
    return curves


def _check_signs(path: Path, stretch: Array, stress: Array) -> None:
    """Raises `FileFormatError` for a pull with a negative stress, or a push with a positive one, that is more than noise."""
    wrong = np.flatnonzero(
        ((stretch - 1) * stress < 0) & (np.abs(stress) > NOISE * np.abs(stress).max()) & (np.abs(stretch - 1) > NOISE)
    )
    if wrong.size:
        k = int(wrong[0])
        raise errors.FileFormatError(
            f"{path}, row {k + 1} below the header: a stress of {stress[k]:.4g} MPa at a stretch of {stretch[k]:.4g} has the wrong sign; "
            "a pull is positive, and a stretch 1 at rest. Correct the sign, name strain in its column, or leave the row out"
        )


def _check_order(path: Path, rows: NDArray[np.int64], stretch: Array) -> None:
    """Raises `FileFormatError` where the stretch (k,) of one mode, at rows (k,) of the file, turns back by more than noise.

    One step back, after rows that rise, to the least strains of the mode, or from tension to compression, begins a pull of its own; each pull rises, or falls, throughout.
    """
    noise, strain = NOISE * float(np.ptp(stretch)), np.abs(stretch - 1)
    step, low = np.diff(strain), strain.min() + NEAR_REST * float(np.ptp(strain))
    anew = (step < -noise) & (np.append(-np.inf, step)[:-1] > -noise) & (strain[1:] <= low)
    begins = anew | ((stretch[1:] - 1) * (stretch[:-1] - 1) < 0)
    for pull, numbers in zip(*(np.split(v, np.flatnonzero(begins) + 1) for v in (stretch, rows)), strict=True):
        falls = np.maximum.accumulate(pull) - pull > noise
        rises = pull - np.minimum.accumulate(pull) > noise
        if falls.any() and rises.any():
            k = max(int(falls.argmax()), int(rises.argmax()))
            raise errors.FileFormatError(
                f"{path}, row {numbers[k] + 1} below the header: the stretch turns back, from {pull[k - 1]:.4g} to {pull[k]:.4g}. A curve is one way: what is lost between loading and "
                "unloading would be averaged. Leave out the way back; rows of one way that are out of order, sort by stretch"
            )


def _no_table(path: Path) -> str:
    """Which cell is no number, where the first line is a header; else what is needed."""
    rows = [line.split(",") for line in path.read_text(errors="replace").splitlines() if line.strip()]
    head = [name.strip() for name in rows[0]] if rows else []
    for number, row in enumerate(rows[1:], 1):
        for name, cell in zip(head, row, strict=False):
            if plain(name).casefold() not in ("mode", "test") and not _is_number(cell):
                return (
                    f"{path}, row {number} below the header, column '{name}': '{cell.strip()}' is no number; {NEEDED}"
                )
    if len(rows) == 2 and not any(map(_is_number, head)):
        return f"{path}: one row is no curve; {NEEDED}"
    first = f"; the first line has {', '.join(head)}" if head else ""
    return f"{path}: no table with a header{first}; {NEEDED}"


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _column(file: TextFile, *wanted: str) -> str:
    found = [name for name in file.names if any(w in SUFFIX.sub("", plain(name)).casefold() for w in wanted)]
    for name in found:
        if any(word in plain(name).casefold() for word in OTHERS):
            raise errors.FileFormatError(
                f"{file.path}, column '{name}': nominal ones are needed, change of length over the first length and force over the first area; convert it, and name it without that word"
            )
    if len(found) != 1:
        several = f"several columns of {wanted[0]}: {', '.join(found)}" if found else f"no column of {wanted[0]}"
        raise errors.FileFormatError(f"{file.path}: {several} (columns: {', '.join(file.names)}); {NEEDED}")
    return found[0]


def _mode(path: Path, row: int, word: str) -> str:
    spelled = word.casefold().replace("_", " ").replace("-", " ").strip()
    for mode, names in MODES.items():
        if spelled in names:
            return mode
    if spelled == "biaxial":
        raise errors.FileFormatError(
            f"{path}, row {row} below the header: mode '{word}' does not say whether both stretches are the same; name it equibiaxial where they are, "
            "other biaxial tests need a full field"
        )
    raise errors.FileFormatError(
        f"{path}, row {row} below the header: mode '{word}' is none of {', '.join(MODES)}; other tests need a full field"
    )


def _unit(path: Path, file: TextFile, column: str) -> float:
    suffix = SUFFIX.search(column)
    unit = file.unit(column) or (suffix.group(1) if suffix else None)
    known = {name.casefold(): size for name, size in STRESS_UNITS.items()}
    if unit is None or unit.casefold() not in known:
        raise errors.UnitsError(
            f"{path}: unit of '{column}' is {unit or 'not stated'}; name the column stress_MPa, stress_kPa, stress_Pa or stress_psi"
        )
    return known[unit.casefold()]
