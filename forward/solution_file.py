"""What the files of all solutions share: a plane mesh, reactions, and the fields of each increment. An .npz, written whole.

In: a solution and what its kind alone has. Out: the arguments to make it again.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Protocol

from forward.errors import SolutionError
from meshes import Mesh
from meshes.elements import ELEMENTS
from meshes.errors import MeshDataError
from meshes.files import read_npz, with_prefix, write_npz

FIELDS = ("displacements", "time", "energy", "iterations")
REQUIRED = ("points", "cells", *FIELDS, "description")
CELL_TYPES = {len(element.nodes): name for name, element in ELEMENTS.items()}


class Solved(Protocol):
    """A solution. reactions: side to (n_inc, dimension), N; description: content for JSON."""

    @property
    def reactions(self) -> dict[str, Any]:
        """Forces of the grips."""

    @property
    def description(self) -> dict[str, Any]:
        """Material, loading, program versions."""


def write_solution(path: str | Path, format_name: str, solution: Solved, plane: Mesh, **own: Any) -> None:
    """Write a .npz atomically; own: arrays that solutions of this kind alone have. Raises `MeshDataError` where it cannot be written."""
    write_npz(
        path,
        format_name,
        points=plane.points,
        cells=plane.cells,
        description=json.dumps(solution.description),
        **{name: getattr(solution, name) for name in FIELDS},
        **own,
        **{f"reaction_{name}": force for name, force in solution.reactions.items()},
        **{f"boundary_{name}": edges for name, edges in plane.boundaries.items()},
    )


def read_solution[M](
    path: str | Path, format_name: str, own: Iterable[str], make: Callable[[Mesh, dict[str, Any]], M]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arguments that every solution takes, its mesh made by `make(plane, content)`, and the content of the file. Raises `SolutionError`."""
    try:
        content = read_npz(path, format_name, (*REQUIRED, *own))
        plane = Mesh(
            content["points"],
            content["cells"],
            CELL_TYPES.get(content["cells"].shape[-1], "quad"),
            with_prefix(content, "boundary_"),
        )
        mesh = make(plane, content)
        description = json.loads(str(content["description"]))
    except (MeshDataError, json.JSONDecodeError) as error:
        raise SolutionError(str(error)) from error
    arguments = {name: content[name] for name in FIELDS}
    return {
        "mesh": mesh,
        "reactions": with_prefix(content, "reaction_"),
        "description": description,
        **arguments,
    }, content
