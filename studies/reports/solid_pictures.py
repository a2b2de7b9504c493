"""Pictures of a deformed solid: a `SolidSolution` in; its skin, coloured by contraction or pressure, out.

pyvista draws off-screen, without a light from a screen or a server; matplotlib adds titles and the scale of colours.
Only an eighth is solved: the whole is made of its mirror images, the close-up is a cut through a hole.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from forward.solid.solid_solution import CENTRE, SolidSolution
from studies.output import style

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
# four flat quads of a nine-node face: of the surface (corners, middles, centre) and of a side (ends, middle, by level)
SURFACE_QUADS = [[0, 4, 8, 7], [4, 1, 5, 8], [8, 5, 2, 6], [7, 8, 6, 3]]
SIDE_QUADS = [[0, 2, 5, 3], [2, 1, 4, 5], [3, 5, 8, 6], [5, 4, 7, 8]]
WHOLE = [(x, y, z) for x in (1, -1) for y in (1, -1) for z in (1, -1)]
QUARTER = [(1, 1, 1), (1, 1, -1)]
WINDOW = (1000, 700)
SHADING: dict[str, Any] = {
    "scalars": "field", "cmap": style.SEQUENTIAL, "clim": (0.0, 1.0), "show_scalar_bar": False,
    "ambient": 0.65, "diffuse": 0.4, "specular": 0.0,
}  # fmt: skip
ABOVE, BESIDE = (0.35, -1.0, 0.75), (0.25, -1.0, 0.35)  # from where the whole and the cut are seen


@dataclass(frozen=True)
class Skin:
    """Faces (f, 9) of an eighth, the hex (f,) each belongs to, and whether it is a cut by a symmetry plane."""

    faces: Indices
    owners: Indices
    quads: Indices  # (f, 4, 4), into the nine nodes of its face
    cut: NDArray[np.bool_]


def contraction(solids: Mapping[str, SolidSolution]) -> Figure:
    """Deformed specimens at the last increment, whole and cut, coloured by thickness over original thickness."""
    fields = {name: contraction_of(solid)[skin(solid).faces] for name, solid in solids.items()}
    return _sheet(solids, fields, Normalize(*colour_range(fields)), "thickness / original thickness (-)", True)


def contraction_of(solid: SolidSolution) -> Array:
    """Thickness over original thickness at the last increment, (n,): that of the surface above or below each node."""
    n = len(solid.mesh.plane.points)
    ratio = 1 + solid.displacements[-1, -n:, 2] / solid.mesh.levels[-1]
    return np.tile(ratio, len(solid.mesh.levels))


def pressure(solids: Mapping[str, SolidSolution]) -> Figure:
    """The same views, coloured by the pressure of each hex as it is solved for: not averaged, not smoothed."""
    fields = {}
    for name, solid in solids.items():
        parts = skin(solid)
        fields[name] = pressure_at(solid, parts.owners, solid.mesh.points[parts.faces])
    return _sheet(
        solids, fields, PowerNorm(0.5, *colour_range(fields)), "mean stress, the negative pressure (MPa)", False
    )


def colour_range(fields: dict[str, Array]) -> tuple[float, float]:
    """Colours from the 1st to the 99th percentile of what is seen."""
    ends = np.array([np.quantile(values, (0.01, 0.99)) for values in fields.values()])
    return float(ends[:, 0].min()), float(ends[:, 1].max())


def pressure_at(solid: SolidSolution, cells: Indices, points: Array) -> Array:
    """Pressure (k, j), MPa, at the last increment, of hexes (k,) at reference points (k, j, 3) within them."""
    centres = solid.mesh.points[solid.mesh.cells[cells, CENTRE]]
    coefficients = solid.pressure[-1, cells]
    return coefficients[:, :1] + np.einsum("kji,ki->kj", points - centres[:, None], coefficients[:, 1:])


def pressure_jumps(solid: SolidSolution) -> Array:
    """|jump| of the pressure at the middle of every face between two hexes, over the range of the pressure (k,).

    Range: between the 1st and 99th percentile of the values at the middles of hexes. A checkerboard would make
    jumps as large as the range.
    """
    mesh = solid.mesh
    quads, n = mesh.plane.cells, len(mesh.plane.points)
    first, second, middles = _neighbours(quads)
    pairs = []
    for layer in range(mesh.layers):
        down = layer * len(quads)
        pairs.append((first + down, second + down, middles + (2 * layer + 1) * n))
        if layer + 1 < mesh.layers:
            below = np.arange(len(quads)) + down
            pairs.append((below, below + len(quads), quads[:, 8] + (2 * layer + 2) * n))
    one, other, nodes = (np.concatenate(column) for column in zip(*pairs, strict=True))
    points = mesh.points[nodes][:, None]
    jumps = np.abs(pressure_at(solid, one, points) - pressure_at(solid, other, points))[:, 0]
    low, high = np.quantile(solid.pressure[-1, :, 0], (0.01, 0.99))
    return jumps / (high - low)


def skin(solid: SolidSolution) -> Skin:
    """Outer faces and cuts x = 0 and y = 0 of an eighth; the cut through the mid-plane is left out."""
    mesh = solid.mesh
    plane, n = mesh.plane, len(mesh.plane.points)
    owner = _edge_owners(plane.cells)
    top = plane.cells + 2 * mesh.layers * n
    last = (mesh.layers - 1) * len(plane.cells)
    faces, owners = [top], [np.arange(len(top)) + last]
    quads, cuts = [np.tile(SURFACE_QUADS, (len(top), 1, 1))], [np.zeros(len(top), bool)]
    names = [b for b in plane.boundaries if b in ("free", "right", "top", "symmetry_x", "symmetry_y")]
    for name in names:
        edges = plane.boundaries[name]
        base = np.array([owner[tuple(sorted(edge[:2].tolist()))] for edge in edges], np.int64)
        faces.append(mesh.boundaries[name])
        owners.append(np.concatenate([base + layer * len(plane.cells) for layer in range(mesh.layers)]))
        quads.append(np.tile(SIDE_QUADS, (len(faces[-1]), 1, 1)))
        cuts.append(np.full(len(faces[-1]), name.startswith("symmetry")))
    return Skin(*(np.concatenate(part) for part in (faces, owners, quads, cuts)))


def _edge_owners(quads: Indices) -> dict[tuple[int, int], int]:
    """The quad of every edge, by its two ends in order; of edges between two quads, one of them."""
    owner = {}
    for i in range(4):
        for cell, (a, b) in enumerate(np.sort(quads[:, [i, (i + 1) % 4]], axis=1).tolist()):
            owner[a, b] = cell
    return owner


def _neighbours(quads: Indices) -> tuple[Indices, Indices, Indices]:
    """Two quads (e,), (e,) and the middle node (e,) of every inner edge."""
    cells = np.tile(np.arange(len(quads)), 4)
    middles = quads[:, 4:8].T.ravel()
    order = np.argsort(middles, kind="stable")
    same = np.flatnonzero(np.diff(middles[order]) == 0)
    return cells[order[same]], cells[order[same + 1]], middles[order[same]]


def _sheet(solids: Mapping[str, SolidSolution], fields: dict[str, Array], norm: Normalize, label: str, frame: bool) -> Figure:  # fmt: skip
    """A column a solid: the whole above, a cut through the outer hole below."""
    with style.figure(5.0 * len(solids) + 0.8, 7.6) as figure:
        axes = figure.subplots(2, len(solids), squeeze=False)
        for column, (name, solid) in zip(axes.T, solids.items(), strict=True):
            for ax, picture in zip(column, (_whole, _close_up), strict=True):
                ax.imshow(picture(solid, fields[name], norm, frame), interpolation="lanczos")
                ax.set_axis_off()
            pull = f"{name} mm thick"
            column[0].set_title(pull)
            column[1].set_title(f"{name} mm thick: cut through the hole at the outer end of an arm", fontsize=8.5)
        scale = ScalarMappable(norm, style.SEQUENTIAL)
        figure.colorbar(scale, ax=list(axes.ravel()), label=label, shrink=0.75, extend="both")
    return figure


def _whole(solid: SolidSolution, field: Array, norm: Normalize, frame: bool) -> Any:
    """Screenshot of all eight mirror images, seen from above and the front."""
    plotter = _plotter()
    for signs in WHOLE:
        plotter.add_mesh(_surface(solid, norm(field), signs, cuts=False), **SHADING)
    _look(plotter, np.zeros(3), direction=ABOVE, size=0.8 * np.abs(_deformed(solid)[:, :2]).max())
    return _shot(plotter)


def _close_up(solid: SolidSolution, field: Array, norm: Normalize, frame: bool) -> Any:
    """Screenshot of both halves of the quarter x > 0, y > 0, cut at y = 0, near the hole furthest along x."""
    plotter = _plotter()
    deformed = _deformed(solid)
    rim = _outer_rim(solid)
    size = 0.7 * np.ptp(deformed[rim, 0]) + 0.4 * solid.mesh.thickness
    centre = np.array([deformed[rim, 0].mean(), 0.0, 0.2 * size])
    for signs in QUARTER:
        plotter.add_mesh(_surface(solid, norm(field), signs, cuts=True), **SHADING)
        plotter.add_mesh(_edges(solid, signs, 0.002 * size), color="black", line_width=1.0, opacity=0.4)
        if frame:
            z = signs[2] * solid.mesh.levels[-1]
            ends = np.array([[centre[0] - 3 * size, 0, z], [centre[0] + 3 * size, 0, z]])
            plotter.add_lines(ends, color=style.COLOURS["vermilion"], width=3)
    _look(plotter, centre, direction=BESIDE, size=size)
    return _shot(plotter)


def _outer_rim(solid: SolidSolution) -> Indices:
    """Nodes of the surface on the rim of the hole furthest along x that the plane y = 0 cuts."""
    plane = solid.mesh.plane
    first = 2 * solid.mesh.layers * len(plane.points)
    rims = [plane.boundary_nodes(b) for b in plane.boundaries if b.startswith("hole_")]
    rims = [rim for rim in rims if np.abs(plane.points[rim, 1]).min() < 1e-9]
    return first + max(rims, key=lambda rim: plane.points[rim, 0].mean())


def _deformed(solid: SolidSolution) -> Array:
    return solid.mesh.points + solid.displacements[-1]


def _surface(solid: SolidSolution, field: Array, signs: tuple[int, int, int], cuts: bool) -> Any:
    """pyvista surface of one mirror image with `field` (f, 9) on its faces; a face has its own nine points."""
    import pyvista

    parts = skin(solid)
    chosen = np.ones(len(parts.faces), bool) if cuts else ~parts.cut
    faces, quads = parts.faces[chosen], parts.quads[chosen]
    points = (_deformed(solid) * signs)[faces.ravel()]
    cells = (quads + 9 * np.arange(len(faces))[:, None, None]).reshape(-1, 4)
    surface = pyvista.PolyData(points, np.column_stack([np.full(len(cells), 4), cells]).ravel())
    surface.point_data["field"] = field[chosen].ravel()
    return surface


def _edges(solid: SolidSolution, signs: tuple[int, int, int], lift: float) -> Any:
    """Edges of the hexes on the skin of one mirror image, `lift` mm nearer to the eye, or the skin hides them."""
    import pyvista

    parts = skin(solid)
    surface = (parts.quads[:, 0] == SURFACE_QUADS[0]).all(axis=1)
    loops = [(parts.faces[surface], [0, 4, 1, 5, 2, 6, 3, 7, 0]), (parts.faces[~surface], [0, 2, 1, 4, 7, 8, 6, 3, 0])]
    rows = np.concatenate([faces[:, order] for faces, order in loops])
    lines = np.column_stack([np.full(len(rows), 9), rows])
    return pyvista.PolyData(_deformed(solid) * signs + lift * np.array(BESIDE), lines=lines.ravel())


def _plotter() -> Any:
    import pyvista
    import vtk

    vtk.vtkLogger.SetStderrVerbosity(vtk.vtkLogger.VERBOSITY_OFF)  # VTK tells of every display it does not find
    plotter = pyvista.Plotter(off_screen=True, window_size=list(WINDOW))
    plotter.set_background("white")
    plotter.enable_anti_aliasing("ssaa")
    return plotter


def _look(plotter: Any, centre: Array, direction: tuple[float, float, float], size: float) -> None:
    """Parallel view of what lies within `size`, mm, of the centre's height."""
    toward = np.array(direction) / np.linalg.norm(direction)
    plotter.camera_position = [centre + 1000 * toward, centre, (0, 0, 1)]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = size
    plotter.reset_camera_clipping_range()


def _shot(plotter: Any) -> Any:
    picture = plotter.screenshot(return_img=True)
    plotter.close()
    return picture
