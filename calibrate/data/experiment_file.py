"""The file of an Experiment: one ``.npz`` of plain arrays, no pickles.

Its arrays: ``format`` = "equigap-experiment", ``version`` = 1, ``name``, ``points``, ``triangles``, ``displacements``,
``free_nodes``, ``time`` and ``thickness`` (absent = unknown), ``loaded_names`` and per loaded boundary ``i``:
``loaded_i_nodes``, ``loaded_i_force``; ``noise`` (4 numbers: displacement std mm, correlation length mm, relative force
std, force std N; absent = unknown); ``provenance`` (JSON text). In plane strain ``plane`` = "strain", and ``version`` = 2,
which older programs refuse. Of stereo data, ``heights``. Where an edge slides, ``loaded_i_held`` (2,) says which components it holds, and ``version`` = 3.
Where part of the noise is common to the increments, ``noise`` has 6 numbers (pattern std mm, reference std mm), and ``version`` = 4; where it drifts, 7
(correlation time, s, or increments without ``time``), and ``version`` = 5.
Where points are continued (`Experiment.continued`), ``continued_data``, ``continued_indices``, ``continued_indptr`` of that sparse matrix (CSR), and ``version`` = 7.
Of a machine record ``record_time`` (r,), ``record_force`` (b, r, 2) and, where it was recorded, ``record_crosshead`` (r,); older programs pass over it.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping
from dataclasses import astuple
from dataclasses import fields as field_names
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from calibrate import errors
from calibrate.data.load_record import LoadRecord
from calibrate.data.measurement import LoadedBoundary, Noise
from meshes.files import write_atomically

FORMAT, VERSION, WITH_PLANE, WITH_SLIDING = "equigap-experiment", 1, 2, 3
WITH_COMMON_NOISE, WITH_DRIFT, WITH_TWO_LENGTHS, WITH_CONTINUED = 4, 5, 6, 7
SPARSE = ("data", "indices", "indptr")  # of a matrix of compressed rows
SAME = ("name", "points", "triangles", "displacements", "free_nodes")


def write_fields(path: str | Path, fields: Mapping[str, Any]) -> None:
    """Write the fields of an Experiment atomically. Raises `OSError`."""
    arrays: dict[str, Any] = {
        "format": FORMAT,
        "version": _version(fields),
        **{key: fields[key] for key in SAME},
        "loaded_names": np.array([b.name for b in fields["loaded"]], dtype=np.str_),
        "provenance": json.dumps(fields["provenance"], sort_keys=True),
    }
    for i, boundary in enumerate(fields["loaded"]):
        arrays[f"loaded_{i}_nodes"] = boundary.nodes
        arrays[f"loaded_{i}_force"] = boundary.force
        if not all(boundary.held):
            arrays[f"loaded_{i}_held"] = np.array(boundary.held)
    arrays |= {key: fields[key] for key in ("time", "thickness", "heights") if fields[key] is not None}
    if fields["plane"] != "stress":
        arrays["plane"] = fields["plane"]
    if fields["noise"] is not None:
        arrays["noise"] = np.array(astuple(fields["noise"])[: _numbers(fields["noise"])])
    if fields["record"] is not None:
        parts = {f"record_{item.name}": getattr(fields["record"], item.name) for item in field_names(LoadRecord)}
        arrays |= {name: values for name, values in parts.items() if values is not None}
    if fields["continued"] is not None:
        arrays |= {f"continued_{part}": getattr(fields["continued"], part) for part in SPARSE}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    write_atomically(path, buffer.getvalue())


def _numbers(noise: Noise) -> int:
    """As many as say all."""
    if noise.second_share > 0:
        return 9
    if noise.correlation_time > 0:
        return 7
    return 6 if noise.is_common else 4


def _version(fields: Mapping[str, Any]) -> int:
    """The least version that says all."""
    if fields["continued"] is not None:
        return WITH_CONTINUED
    if fields["noise"] is not None and _numbers(fields["noise"]) > 4:
        return {6: WITH_COMMON_NOISE, 7: WITH_DRIFT, 9: WITH_TWO_LENGTHS}[_numbers(fields["noise"])]
    if not all(all(boundary.held) for boundary in fields["loaded"]):
        return WITH_SLIDING
    return VERSION if fields["plane"] == "stress" else WITH_PLANE


def read_fields[T](path: str | Path, build: Callable[..., T]) -> T:
    """What `build` makes of the fields of an Experiment in a file of `write_fields`.

    Raises `DataNotFoundError`, `FileFormatError`, and what `build` raises, with the path before its message.
    """
    path = Path(path)
    content = _read_arrays(path)
    try:
        return build(**_fields(content))
    except KeyError as error:
        raise errors.FileFormatError(f"{path}: array {error} is missing; import the test again") from error
    except errors.EquigapError as error:
        raise type(error)(f"{path}: {error}") from error
    except (ValueError, TypeError) as error:
        raise errors.FileFormatError(f"{path}: an array is garbled ({error}); write the file again") from error


def _read_arrays(path: Path) -> dict[str, Any]:
    """All arrays of a file of this format and version."""
    if not path.exists():
        raise errors.DataNotFoundError(f"{path}: no such file; give the path of an Experiment .npz")
    if path.is_dir():
        inside = path / "experiment.npz"
        raise errors.FileFormatError(
            f"{path}: a folder; give {inside if inside.exists() else 'the Experiment .npz in it'}"
        )
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as data:
            content = {key: data[key] for key in data.files}
    except Exception as error:
        reason = "" if "pickle" in str(error) else f" ({error})"
        raise errors.FileFormatError(
            f"{path}: not a readable Experiment .npz{reason}; write it with `equigap import`"
        ) from error
    if str(content.get("format")) != FORMAT:
        raise errors.FileFormatError(
            f"{path}: an .npz, but not an Experiment (its 'format' is {content.get('format')}); "
            "raw measurements are read with `equigap import`"
        )
    if "version" not in content:
        raise errors.FileFormatError(f"{path}: array 'version' is missing; import the test again")
    if str(content.get("version")) not in map(str, range(VERSION, WITH_CONTINUED + 1)):
        raise errors.FileFormatError(
            f"{path}: Experiment version {content['version']}, this program reads {VERSION} to {WITH_CONTINUED}; "
            "update equigap"
        )
    return content


def _fields(content: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of an Experiment. Raises KeyError for what is missing."""
    loaded = tuple(
        LoadedBoundary(str(name), content[f"loaded_{i}_nodes"], content[f"loaded_{i}_force"], _held(content, i))
        for i, name in enumerate(content["loaded_names"])
    )
    return {
        **{key: content[key] for key in SAME},
        "name": str(content["name"]),
        "loaded": loaded,
        "thickness": float(content["thickness"]) if "thickness" in content else None,
        "time": content.get("time"),
        "heights": content.get("heights"),
        "noise": Noise(*map(float, content["noise"])) if "noise" in content else None,
        "provenance": json.loads(str(content["provenance"])),
        "plane": str(content.get("plane", "stress")),
        "record": _record(content),
        "continued": _continued(content),
    }


def _continued(content: Mapping[str, Any]) -> sp.csr_array | None:
    """Raises KeyError for a matrix without one of its parts."""
    if "continued_data" not in content:
        return None
    k = len(content["continued_indptr"]) - 1
    return sp.csr_array(tuple(content[f"continued_{part}"] for part in SPARSE), shape=(k, len(content["points"]) - k))


def _record(content: Mapping[str, Any]) -> LoadRecord | None:
    """Raises KeyError for a record without its forces."""
    if "record_time" not in content:
        return None
    return LoadRecord(content["record_time"], content["record_force"], content.get("record_crosshead"))


def _held(content: Mapping[str, Any], i: int) -> tuple[bool, bool]:
    x, y = content.get(f"loaded_{i}_held", (True, True))
    return bool(x), bool(y)
