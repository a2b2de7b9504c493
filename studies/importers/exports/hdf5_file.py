"""HDF5 files whose datasets are the columns of a table, such as those of Istra4D: one file a frame.

In: a path and names of datasets, with slashes, as in `coordinates/coordinate_x`; `add_data/analog_channels[1]` is one element. Out: their
numbers in the order of memory, NaN kept.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from studies.importers.exports.text_files import TextFile
from studies.importers.text_tables import Layout, read_table

Array = NDArray[np.float64]
ELEMENT = re.compile(r"^(.*)\[(\d+)\]$")


def hdf5_file(path: Path) -> TextFile | None:
    """A file with its numeric datasets as names of columns; None for one that is no HDF5. Raises nothing for a damaged file: None."""
    try:
        with h5py.File(path, "r") as content:
            names = _numeric(content)
    except OSError:
        return None
    return TextFile(path, names, (), ",", ".", "", 1, len(names))


def read_columns(path: Path, columns: Sequence[str], layout: Layout) -> dict[str, Array]:
    """Columns of a text table (see `read_table`), or datasets of an HDF5 file, each (n,).

    Raises `FileFormatError` for a dataset that is missing, or that has another size than the first.
    """
    if not (path.is_file() and h5py.is_hdf5(path)):
        return read_table(path, columns, layout)
    with h5py.File(path, "r") as content:
        found = {name: _values(path, content, name) for name in columns}
    sizes = {name: values.size for name, values in found.items()}
    if len(set(sizes.values())) > 1:
        raise errors.FileFormatError(f"{path}: datasets of unlike size: {sizes}; name those of one grid")
    return found


def units(path: Path, name: str) -> str | None:
    """Attribute `unit` or `units` of a dataset or of its group, None where neither has one."""
    with h5py.File(path, "r") as content:
        for place in (content[name], content[name].parent):
            for key in ("unit", "units", "Unit", "Units"):
                if key in place.attrs:
                    stated = place.attrs[key]
                    return stated.decode() if isinstance(stated, bytes) else str(stated)
    return None


def _numeric(content: h5py.File) -> tuple[str, ...]:
    """Names of all datasets of numbers."""
    names: list[str] = []
    content.visititems(
        lambda name, one: names.append(name) if isinstance(one, h5py.Dataset) and one.dtype.kind in "fiub" else None
    )
    return tuple(names)


def _values(path: Path, content: h5py.File, name: str) -> Array:
    """A dataset or one element of it, flat."""
    element = ELEMENT.match(name)
    plain = element.group(1) if element else name
    if plain not in content or not isinstance(content[plain], h5py.Dataset):
        known = ", ".join(_numeric(content)[:12])
        raise errors.FileFormatError(f"{path}: no dataset named '{plain}' (datasets: {known})")
    values = np.asarray(content[plain][()], np.float64).ravel()
    if not element:
        return values
    index = int(element.group(2))
    if index >= values.size:
        raise errors.FileFormatError(f"{path}: '{plain}' has {values.size} elements, none of number {index}")
    return values[index : index + 1]
