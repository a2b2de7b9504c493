"""Experiment in, a file for ParaView (.vtu) beside it out: displacements of every increment as point data."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from studies.output.writing import atomic_path


def write_viewer_file(
    experiment: Experiment, path: str | Path, more: Mapping[str, NDArray[np.float64]] = MappingProxyType({})
) -> Path:
    """Write reference triangles with point data ``displacement_001``... (mm) and ``boundary`` (0 inside, 1 free edge,
    2... loaded boundaries in their order). more: further fields (t, n, 2), mm, by name. Raises `OutputWriteError`."""
    import pyvista

    n = len(experiment.points)
    cells = np.column_stack([np.full(len(experiment.triangles), 3), experiment.triangles]).ravel()
    grid = pyvista.UnstructuredGrid(
        cells,
        np.full(len(experiment.triangles), pyvista.CellType.TRIANGLE),
        np.column_stack([experiment.points, np.zeros(n)]),
    )
    for name, field in {"displacement": experiment.displacements, **more}.items():
        for i, u in enumerate(field, start=1):
            grid.point_data[f"{name}_{i:03d}"] = np.column_stack([u, np.zeros(n)])
    boundary = np.zeros(n, np.int64)
    boundary[experiment.free_nodes] = 1
    for i, loaded in enumerate(experiment.loaded, start=2):
        boundary[loaded.nodes] = i
    grid.point_data["boundary"] = boundary
    path = Path(path)
    with atomic_path(path) as temporary:
        grid.save(temporary)
    return path
