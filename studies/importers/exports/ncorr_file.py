"""ncorr: one ``.mat`` for a whole test. Names and layout from ncorr's manual 1.2.2 and published scripts that read its files.

`data_dic_save.displacements(k).plot_u_ref_formatted` (rows, columns): displacement at the points of the reference, in the unit of `dispinfo`,
0 where nothing was matched; points are `spacing` + 1 pixels apart, the first at pixel 1; `pixtounits`: unit per pixel. v counts downwards.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat, whosmat

from calibrate import errors
from studies.importers.exports.text_files import TextFile

Array = NDArray[np.float64]
VARIABLE = "data_dic_save"
COLUMNS = ("plot_u_ref_formatted", "plot_v_ref_formatted")


def ncorr_file(path: Path) -> TextFile | None:
    """A file of ncorr, with what it says of the matching as lines; None for another one, and for MATLAB version 7.3 (HDF5)."""
    try:
        names = [name for name, _, _ in whosmat(str(path))]
    except (NotImplementedError, ValueError, OSError):
        return None
    if VARIABLE not in names:
        return None
    info = _content(path).dispinfo
    fields = ("units", "pixtounits", "spacing", "radius", "lenscoef")
    before = tuple(f"{key}: {getattr(info, key)}" for key in fields if hasattr(info, key))
    return TextFile(path, COLUMNS, before, ",", ".", "", 1, len(COLUMNS))


def read_ncorr(path: Path) -> tuple[Array, list[Array]]:
    """Positions (n, 2), and displacements (n, 2) of every frame, in the unit of the file, y down; NaN where nothing was matched.

    Raises `FileFormatError` where something is missing.
    """
    try:
        content = _content(path)
        frames = np.atleast_1d(content.displacements)
        fields = [np.stack([np.asarray(getattr(f, name), float) for name in COLUMNS], axis=-1) for f in frames]
        pitch = float(content.dispinfo.pixtounits) * (float(content.dispinfo.spacing) + 1.0)
    except (AttributeError, TypeError, ValueError) as error:
        raise errors.FileFormatError(
            f"{path}: no whole file of ncorr ({error}); format the displacements and save again"
        ) from error
    rows, columns = np.indices(fields[0].shape[:2])
    points = pitch * np.column_stack([columns.ravel(), rows.ravel()]).astype(np.float64) + float(
        content.dispinfo.pixtounits
    )
    matched = [np.any(field != 0.0, axis=-1, keepdims=True) for field in fields]
    moved = [np.where(good, field, np.nan).reshape(-1, 2) for good, field in zip(matched, fields, strict=True)]
    inside = np.isfinite(moved[0]).all(axis=1)  # of the region of interest
    return points[inside], [u[inside] for u in moved]


def _content(path: Path) -> Any:
    return loadmat(str(path), squeeze_me=True, struct_as_record=False, variable_names=[VARIABLE])[VARIABLE]
