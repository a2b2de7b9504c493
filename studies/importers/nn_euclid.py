"""Reader of NN-EUCLID's data: biaxial tension of a plate in plane strain on four sides that slide, simulated.

In: a folder of load steps, ``5``, ``10``, ..., each with ``output_nodes.csv`` (id, x, y, ux, uy, bcx, bcy and, where noise was
added, ux_orig, uy_orig), ``output_elements.csv`` (node1, node2, node3) and ``output_reactions.csv`` (forces); of
``output_integrator.csv``, which only repeats what follows from these, the check is that it exists. Out: a `Series`.

Source of the layout: Thakolkaran, Joshi, Zheng, Flaschel, De Lorenzis, Kumar 2022, "NN-EUCLID: Deep-learning hyperelasticity
without stress data", J. Mech. Phys. Solids 169, 105076, and its public data.

- A side has a number in ``bcx`` if it is held along x, in ``bcy`` if along y: row k - 1 of the reactions is the force on side k.
  It slides along the other direction. A corner belongs to two sides.
- Displacements are those with noise, but clean where they are prescribed (the controlled displacement of a machine is known).
- Reactions are those of the simulation, without noise.
- Quantities have no units. One length is read as 1 mm, one force as 1 N on a plate 1 mm thick, so that "MPa" is the unit of stress of
  the data. A load step is no time.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.data.triangulation import boundary_nodes, signed_areas
from studies.importers.recording.importer import Importer, Part, Recording, SheetOptions
from studies.importers.recording.series import Grip, Series
from studies.importers.recording.synchronise import ForceRecord
from studies.importers.text_tables import read_table
from studies.output.words import Words

WORDS = Words("experiment")
Array = NDArray[np.float64]
Index = NDArray[np.int64]
NODES, ELEMENTS, REACTIONS, INTEGRATOR = (
    f"output_{name}.csv" for name in ("nodes", "elements", "reactions", "integrator")
)
COLUMNS = ("x", "y", "ux", "uy", "bcx", "bcy")


class NNEuclid(Importer):
    """A folder of load steps, as NN-EUCLID publishes them."""

    source: ClassVar[str] = "a material folder of NN-EUCLID"
    looks_for: ClassVar[str] = f"{NODES} in folders with numbers as names, in a folder"
    takes: ClassVar[tuple[Part, ...]] = ("name", "frames", "noise")
    instead: ClassVar[str] = f"leave it out: forces are in {REACTIONS}, positions have no unit"

    def reads(self, source: str) -> bool:
        """A folder with numbered folders that hold nodes."""
        return any((step / NODES).is_file() for step in step_folders(Path(source)))

    def read(self, source: str, options: SheetOptions, name: str | None, record: Path | None) -> Recording:
        """Every load step. Raises `DataNotFoundError`, `FileFormatError`, `MeshMismatchError`."""
        folder = Path(source)
        series = read_series(folder, name or "-".join(folder.resolve().parts[-2:]))
        files = (NODES, ELEMENTS, REACTIONS)
        return Recording(series, tuple(step / file for step in step_folders(folder) for file in files))


def step_folders(folder: Path) -> list[Path]:
    """Folders of load steps in the order of their numbers."""
    if not folder.is_dir():
        return []
    return sorted((f for f in folder.iterdir() if f.is_dir() and f.name.isdecimal()), key=lambda f: int(f.name))


def read_series(folder: Path, name: str) -> Series:
    """All load steps of a material, behind a frame at rest."""
    steps = step_folders(folder)
    if not steps:
        raise errors.DataNotFoundError(f"{folder}: no load steps; give a folder with 5, 10, ... in it")
    nodes = [_nodes(step) for step in steps]
    points, sides = nodes[0][0], nodes[0][2]
    triangles = _triangles(steps[0], points)
    for step, (other, _, held) in zip(steps[1:], nodes[1:], strict=True):
        if not np.array_equal(points, other) or not np.array_equal(sides, held):
            raise errors.MeshMismatchError(
                f"{step / NODES}: positions or sides differ from {steps[0].name}; load steps of one test share a mesh"
            )
    reactions = np.stack([_reactions(step, int(sides.max())) for step in steps])
    time = np.array([0, *(int(step.name) for step in steps)], float)
    grips = _grips(points, sides, reactions, time)
    held = np.concatenate([grip.nodes for grip in grips])
    pulled = max((g.record for g in grips if g.record is not None), key=lambda r: float(r.force.max()))
    return Series(
        name=name,
        points=points,
        triangles=triangles,
        displacements=np.stack([np.zeros_like(points), *(u for _, u, _ in nodes)]),
        time=time,
        record=pulled,
        grips=grips,
        free_nodes=np.setdiff1d(boundary_nodes(triangles), held),
        thickness=1.0,
        plane="strain",
        has_clock=False,
        force_std=0.0,
        provenance={
            "reader": "NN-EUCLID",
            "load_steps": [int(step.name) for step in steps],
            "notes": [WORDS.note_without_units()],
        },
    )


def _nodes(step: Path) -> tuple[Array, Array, Index]:
    """Points (n, 2), displacements (n, 2) and number of the side that holds each component (n, 2), 0: none."""
    path = step / NODES
    if not (step / INTEGRATOR).is_file():
        raise errors.DataNotFoundError(f"{step / INTEGRATOR}: no such file; copy the whole load step")
    table = read_table(path)
    missing = [name for name in COLUMNS if name not in table]
    if missing:
        raise errors.FileFormatError(f"{path}: column {missing[0]} is missing; is this a load step of NN-EUCLID?")
    sides = np.stack([table["bcx"], table["bcy"]], axis=1).round().astype(np.int64)
    u = np.stack([table["ux"], table["uy"]], axis=1)
    if "ux_orig" in table and "uy_orig" in table:
        u = np.where(sides > 0, np.stack([table["ux_orig"], table["uy_orig"]], axis=1), u)
    return np.stack([table["x"], table["y"]], axis=1), u, sides


def _triangles(step: Path, points: Array) -> Index:
    """(m, 3), counter-clockwise."""
    path = step / ELEMENTS
    table = read_table(path, ("node1", "node2", "node3"))
    triangles = np.stack([table[f"node{k}"] for k in (1, 2, 3)], axis=1).round().astype(np.int64)
    if triangles.min() < 0 or triangles.max() >= len(points):
        raise errors.MeshMismatchError(
            f"{path}: nodes run from {triangles.min()} to {triangles.max()}, {NODES} has {len(points)} of them (from 0)"
        )
    turned = signed_areas(points, triangles) < 0
    triangles[turned] = triangles[turned][:, ::-1]
    return triangles


def _reactions(step: Path, count: int) -> Array:
    """Forces (k,) on sides 1 to k."""
    path = step / REACTIONS
    forces = read_table(path, ("forces",))["forces"]
    if len(forces) != count:
        raise errors.MeshMismatchError(f"{path}: {len(forces)} reactions for {count} sides; one row a side is needed")
    return forces


def _grips(points: Array, sides: Index, reactions: Array, time: Array) -> tuple[Grip, ...]:
    """The sides, each with its own force. reactions (n_steps, k), time (n_steps + 1,)."""
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    grips = []
    for k in range(1, int(sides.max()) + 1):
        nodes, component = (sides == k).any(axis=1).nonzero()[0], int((sides[:, 1] == k).any())
        if len(np.unique(np.flatnonzero((sides == k).any(axis=0)))) != 1:
            raise errors.FileFormatError(f"side {k} is held along x and y, or has no nodes; expected sides that slide")
        sign = 1.0 if points[nodes, component].mean() > middle[component] else -1.0
        direction = (sign, 0.0) if component == 0 else (0.0, sign)
        force = ForceRecord(time, np.concatenate([[0.0], sign * reactions[:, k - 1]]), f"reaction {k}")
        side = (("left", "right"), ("bottom", "top"))[component][sign > 0]
        grips.append(Grip(side, nodes, direction, force, slides=True))
    return tuple(grips)
