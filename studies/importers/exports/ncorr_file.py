"""ncorr: one ``.mat`` for a whole test. Names and layout from ncorr's manual 1.2.2 and published scripts that read its files.

`data_dic_save.displacements(k).plot_u_ref_formatted` (rows, columns): displacement at the points of the reference, in the unit of `dispinfo`,
0 where nothing was matched; points are `spacing` + 1 pixels apart, the first at pixel 1; `pixtounits`: unit per pixel. v counts downwards.
MATLAB's version 7.3 is HDF5: matrices are transposed, texts are numbers, and a field of several structures is a list of references.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat, whosmat

from calibrate import errors
from studies.importers.exports.text_files import TextFile

Array = NDArray[np.float64]
VARIABLE = "data_dic_save"
COLUMNS = ("plot_u_ref_formatted", "plot_v_ref_formatted")
STATED = ("units", "pixtounits", "spacing", "radius", "lenscoef")


@dataclass(frozen=True, eq=False)
class NcorrContent:
    """fields: displacement (rows, columns, 2) of every frame, NaN or 0 = not matched; info: `dispinfo`, as far as it is there."""

    fields: list[Array]
    info: dict[str, Any]


def ncorr_file(path: Path) -> TextFile | None:
    """A file of ncorr, with what it says of the matching as lines; None for another one."""
    try:
        held = _is_held(path)
    except (NotImplementedError, ValueError, OSError):
        return None
    if not held:
        return None
    before = tuple(f"{key}: {value}" for key, value in _content(path).info.items())
    return TextFile(path, COLUMNS, before, ",", ".", "", 1, len(COLUMNS))


def read_ncorr(path: Path) -> tuple[Array, list[Array]]:
    """Positions (n, 2), and displacements (n, 2) of every frame, in the unit of the file, y down; NaN where nothing was matched.

    Raises `FileFormatError` where something is missing.
    """
    content = _content(path)
    try:
        pixel, skipped = float(content.info["pixtounits"]), float(content.info["spacing"])
    except (KeyError, TypeError, ValueError) as error:
        raise _not_whole(path, error) from error
    rows, columns = np.indices(content.fields[0].shape[:2])
    points = pixel * ((skipped + 1.0) * np.column_stack([columns.ravel(), rows.ravel()]).astype(np.float64) + 1.0)
    matched = [np.any(field != 0.0, axis=-1, keepdims=True) for field in content.fields]
    moved = [np.where(good, field, np.nan).reshape(-1, 2) for good, field in zip(matched, content.fields, strict=True)]
    inside = np.isfinite(moved[0]).all(axis=1)  # of the region of interest
    return points[inside], [u[inside] for u in moved]


def _is_held(path: Path) -> bool:
    if h5py.is_hdf5(path):
        with h5py.File(path, "r") as content:
            return VARIABLE in content
    return VARIABLE in [name for name, _, _ in whosmat(str(path))]


def _content(path: Path) -> NcorrContent:
    """Of either version. Raises `FileFormatError` where displacements or `dispinfo` are missing."""
    try:
        found = _content_73(path) if h5py.is_hdf5(path) else _content_7(path)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise _not_whole(path, error) from error
    if not found.fields or not found.fields[0].size:
        raise _not_whole(path, ValueError("no displacements"))
    return found


def _not_whole(path: Path, error: Exception) -> errors.FileFormatError:
    return errors.FileFormatError(f"{path}: no whole file of ncorr ({error}); format the displacements and save again")


def _content_7(path: Path) -> NcorrContent:
    held = loadmat(str(path), squeeze_me=True, struct_as_record=False, variable_names=[VARIABLE])[VARIABLE]
    fields = [
        np.stack([np.asarray(getattr(frame, name), float) for name in COLUMNS], axis=-1)
        for frame in np.atleast_1d(held.displacements)
    ]
    return NcorrContent(fields, {key: getattr(held.dispinfo, key) for key in STATED if hasattr(held.dispinfo, key)})


def _content_73(path: Path) -> NcorrContent:
    with h5py.File(path, "r") as content:
        held = content[VARIABLE]
        u, v = (_matrices(content, held["displacements"][name]) for name in COLUMNS)
        fields = [np.stack(both, axis=-1) for both in zip(u, v, strict=True)]
        return NcorrContent(fields, {key: _plain(held["dispinfo"][key]) for key in STATED if key in held["dispinfo"]})


def _matrices(content: h5py.File, field: h5py.Dataset) -> list[Array]:
    """A field of one structure, or of an array of them."""
    if field.dtype == h5py.ref_dtype:
        return [_matrix(content[reference]) for reference in field[()].ravel()]
    return [_matrix(field)]


def _matrix(field: h5py.Dataset) -> Array:
    """Rows and columns as in MATLAB; an empty one is stored as its size."""
    return np.zeros((0, 0)) if "MATLAB_empty" in field.attrs else np.asarray(field[()], np.float64).T


def _plain(field: h5py.Dataset) -> str | float | list[float]:
    """A text, a number or numbers."""
    values = field[()].ravel()
    if field.attrs.get("MATLAB_class") == b"char":
        return "".join(map(chr, values))
    return float(values[0]) if values.size == 1 else values.tolist()
