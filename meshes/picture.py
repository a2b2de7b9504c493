"""A mesh in, a picture of it out: cells, outline coloured by the names of its boundaries."""

from __future__ import annotations

from pathlib import Path

from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

from meshes.mesh import Mesh

COLOURS = {"free": "black", "symmetry_x": "#CC79A7", "symmetry_y": "#CC79A7"}
LOADED, LOADED_WIDTH = "#D55E00", 3.5  # thick as well, for grey print


def draw(mesh: Mesh, path: str | Path, title: str = "") -> None:
    """Write a picture (the suffix of `path` chooses the format); needs no screen."""
    width, height = mesh.points.max(axis=0) - mesh.points.min(axis=0)
    figure = Figure(figsize=(7, min(7.5, max(2.5, 7 * height / width))), layout="constrained")
    axes = figure.subplots()
    outline = mesh.points[mesh.corners]
    axes.add_collection(PolyCollection(list(outline), facecolors="#eef3f7", edgecolors="0.6", linewidths=0.3))
    free = {tuple(edge) for edge in mesh.boundaries["free"][:, :2].tolist()}
    for name, edges in mesh.boundaries.items():
        if name.startswith("hole_"):
            continue
        own = [e for e in edges if name == "free" or tuple(e[:2].tolist()) not in free]
        if own:
            lines = [mesh.points[e[[0, 2, 1]] if len(e) == 3 else e] for e in own]
            colour, thick = (COLOURS[name], 1.2) if name in COLOURS else (LOADED, LOADED_WIDTH)
            axes.add_collection(LineCollection(lines, colors=colour, linewidths=thick, label=name))
    axes.set(aspect="equal", xlabel="x, mm", ylabel="y, mm", title=title or _summary(mesh))
    axes.autoscale_view()
    figure.savefig(path, dpi=150)


def _summary(mesh: Mesh) -> str:
    return f"{len(mesh.cells)} {mesh.cell_type}s, {len(mesh.points)} nodes, quality >= {mesh.quality.min():.2f}"
