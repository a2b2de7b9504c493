"""Specimen in, checked mesh out: biquadratic quads for the forward model, triangles for the camera.

The first quadrant is meshed with gmsh, graded towards holes and fillets, and mirrored for the full specimen.
What gmsh was asked for is not taken on trust: cell types, quality and area are checked.
"""

from __future__ import annotations

import math
from types import ModuleType

import numpy as np

from meshes import _gmsh
from meshes.elements import ELEMENTS
from meshes.errors import MeshDataError, MeshQualityError
from meshes.mesh import Array, Indices, Mesh, boundary_edges
from meshes.shapes import fillet_arc, triples
from meshes.specimens import Specimen

MIN_QUALITY = 0.3
AREA_TOLERANCE = 1e-3
NODE_TOLERANCE = 0.05
RETRIES = (1.0, 0.97, 1.04, 0.93, 0.9, 0.86)  # a bad cell is often gone when all sizes change a little
GROWTH = 0.3
EDGES_PER_FILLET_RADIUS = 6
EDGE_PER_TIP_RADIUS = 1.0  # of quads; longer edges around the tip of an ellipse bend the cells beyond use
GMSH_TYPES = {2: "triangle", 10: "quad"}


def quads(specimen: Specimen, quarter: bool = False, size_factor: float = 1.0) -> Mesh:
    """Biquadratic quads; `size_factor` scales the specimen's mesh sizes.

    Edges on fillets and holes are curved. Raises `MeshQualityError` unless all cells are quads with a quality
    of at least 0.3 and the area is within 0.1 % of the exact one, `MeshDataError` for a
    `size_factor` that is not positive, `MissingLibraryError` without gmsh.
    """
    for retry in RETRIES:
        try:
            mesh = _quadrant(specimen, "quad", retry * size_factor)
            _check(mesh, specimen.name, specimen.exact_area() / 4)
        except MeshQualityError:
            if retry == RETRIES[-1]:
                raise
        else:
            break
    return mesh if quarter else _full(mesh, specimen)


def triangles(specimen: Specimen, n_nodes: int | None = None, quarter: bool = False, size_factor: float = 1.0) -> Mesh:
    """Straight triangles, `n_nodes` of them within 5 % if given, else with sizes scaled by `size_factor`.

    `n_nodes` counts the nodes of the mesh that is returned. Straight edges cut across the holes; `area_excess`
    tells how much is added. Raises `MeshQualityError` for a quality below 0.3 or a target out of reach,
    `MeshDataError` for less than 20 nodes or a `size_factor` that is not positive, `MissingLibraryError` without gmsh.
    """
    if n_nodes is None:
        mesh = _quadrant(specimen, "triangle", size_factor)
        return _checked_triangles(mesh if quarter else _full(mesh, specimen), specimen)
    if n_nodes < 20:
        raise MeshDataError(f"n_nodes = {n_nodes}; at least 20 are needed for a mesh of the {specimen.name}")
    for _ in range(12):
        mesh = _quadrant(specimen, "triangle", size_factor)
        mesh = mesh if quarter else _full(mesh, specimen)
        if abs(len(mesh.points) / n_nodes - 1) < NODE_TOLERANCE:
            return _checked_triangles(mesh, specimen)
        size_factor *= math.sqrt(len(mesh.points) / n_nodes)
    raise MeshQualityError(
        f"{specimen.name}: {n_nodes} nodes cannot be met within 5 % (the nearest mesh has {len(mesh.points)}); "
        "ask for more nodes"
    )


def area_excess(mesh: Mesh, specimen: Specimen) -> float:
    """area / exact area - 1 of a full mesh; positive where straight edges cut across the holes."""
    return mesh.area() / specimen.exact_area() - 1


def _checked_triangles(mesh: Mesh, specimen: Specimen) -> Mesh:
    _check(mesh, specimen.name)
    return mesh


def _check(mesh: Mesh, name: str, exact_area: float | None = None) -> None:
    worst = mesh.quality.min()
    if worst < MIN_QUALITY:
        raise MeshQualityError(
            f"{name}: the worst cell has quality {worst:.2f}, at least {MIN_QUALITY} is needed; "
            "make the mesh sizes smaller or closer to one another"
        )
    if exact_area is not None and abs(mesh.area() / exact_area - 1) > AREA_TOLERANCE:
        raise MeshQualityError(
            f"{name}: the area is off by {abs(mesh.area() / exact_area - 1):.2%}, at most {AREA_TOLERANCE:.1%} is "
            "allowed; make hole_size smaller"
        )


def _full(quadrant: Mesh, specimen: Specimen) -> Mesh:
    mesh, _, _ = quadrant.mirrored()
    return Mesh(mesh.points, mesh.cells, mesh.cell_type, _label(mesh.points, mesh.cells, mesh.cell_type, specimen))


def _quadrant(specimen: Specimen, cell_type: str, size_factor: float) -> Mesh:
    if not (math.isfinite(size_factor) and size_factor > 0):
        raise MeshDataError(f"size_factor = {size_factor}; give a positive number")
    with _gmsh.session(specimen.name) as gmsh:
        _draw_quadrant(gmsh, specimen)
        _set_sizes(gmsh, specimen, size_factor, curved=cell_type == "quad")
        if cell_type == "quad":
            gmsh.option.setNumber("Mesh.Algorithm", 8)
            gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 3)
            gmsh.option.setNumber("Mesh.RecombineAll", 1)
        else:
            gmsh.option.setNumber("Mesh.Algorithm", 6)
        gmsh.model.mesh.generate(2)
        if cell_type == "quad":
            gmsh.model.mesh.setOrder(2)
        points, cells = _extract(gmsh, specimen, cell_type)
    return Mesh(points, cells, cell_type, _label(points, cells, cell_type, specimen, quarter=True))


def _draw_quadrant(gmsh: ModuleType, specimen: Specimen) -> None:
    """Outline with fillets, minus holes, cut down to the first quadrant."""
    occ = gmsh.model.occ
    surface = occ.addPlaneSurface([occ.addCurveLoop(_draw_outline(occ, specimen))])
    holes = []
    for hole in specimen.holes():
        disk = occ.addDisk(hole.x, hole.y, 0, hole.a, hole.b)
        occ.rotate([(2, disk)], hole.x, hole.y, 0, 0, 0, 1, hole.angle)
        holes.append((2, disk))
    width, height = specimen.half_extent
    window = occ.addRectangle(0, 0, 0, width, height)
    shape, _ = occ.intersect([(2, surface)], [(2, window)])
    if holes:
        occ.cut(shape, holes)
    occ.synchronize()


def _draw_outline(occ: ModuleType, specimen: Specimen) -> list[int]:
    """Curves in order around the outline: at each corner its arc, if any, then the line to the next corner."""
    ends, arcs = [], []
    for before, corner, after in triples(specimen.corners()):
        if corner.radius:
            start, centre, end = (occ.addPoint(x, y, 0) for x, y in fillet_arc(before, corner, after))
            arcs.append([occ.addCircleArc(start, centre, end)])
            ends.append((start, end))
        else:
            point = occ.addPoint(corner.x, corner.y, 0)
            arcs.append([])
            ends.append((point, point))
    lines = [occ.addLine(a[1], b[0]) for a, b in zip(ends, ends[1:] + ends[:1], strict=True)]
    return [curve for arc, line in zip(arcs, lines, strict=True) for curve in (*arc, line)]


def _set_sizes(gmsh: ModuleType, specimen: Specimen, size_factor: float, curved: bool) -> None:
    """Small at holes and fillets, growing with the distance to them."""
    near, far = (size_factor * size for size in specimen.sizes)
    if curved:
        far = min(far, *specimen.half_extent)
        near = min([near, *(EDGE_PER_TIP_RADIUS * hole.tip_radius for hole in specimen.holes()), far])
    radii = [c.radius for c in specimen.corners() if c.radius]
    fillet = min([far, *(max(near, size_factor * r / EDGES_PER_FILLET_RADIUS) for r in radii)])
    rims: list[int] = []
    arcs: list[int] = []
    for _, curve in gmsh.model.getEntities(1):
        if gmsh.model.getType(1, curve) == "Line":
            continue
        (low,), (high,) = gmsh.model.getParametrizationBounds(1, curve)
        middle = np.array(gmsh.model.getValue(1, curve, [(low + high) / 2]))[None, :2]
        on_rim = any(abs(hole.level(middle)[0] - 1) < 1e-6 for hole in specimen.holes())
        (rims if on_rim else arcs).append(curve)
    fields = [_threshold(gmsh, rims, near, far), _threshold(gmsh, arcs, fillet, far)]
    minimum = gmsh.model.mesh.field.add("Min")
    gmsh.model.mesh.field.setNumbers(minimum, "FieldsList", fields)
    gmsh.model.mesh.field.setAsBackgroundMesh(minimum)
    for option in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints", "MeshSizeFromCurvature"):
        gmsh.option.setNumber(f"Mesh.{option}", 0)


def _threshold(gmsh: ModuleType, curves: list[int], near: float, far: float) -> int:
    """Field that grows from `near` on the curves to `far`, or `far` everywhere without curves."""
    field = gmsh.model.mesh.field
    if not curves:
        constant = field.add("MathEval")
        field.setString(constant, "F", str(far))
        return constant
    distance, threshold = field.add("Distance"), field.add("Threshold")
    field.setNumbers(distance, "CurvesList", curves)
    field.setNumber(distance, "Sampling", 200)
    field.setNumber(threshold, "InField", distance)
    field.setNumber(threshold, "SizeMin", near)
    field.setNumber(threshold, "SizeMax", far)
    field.setNumber(threshold, "DistMin", 0)
    field.setNumber(threshold, "DistMax", max((far - near) / GROWTH, 1e-6))
    return threshold


def _extract(gmsh: ModuleType, specimen: Specimen, cell_type: str) -> tuple[Array, Indices]:
    types, _, nodes = gmsh.model.mesh.getElements(2)
    found = {GMSH_TYPES.get(t, f"gmsh type {t}") for t in types}
    if found != {cell_type}:
        raise MeshQualityError(
            f"{specimen.name}: asked for {cell_type}s, got {', '.join(sorted(found)) or 'nothing'}; "
            "change the mesh sizes a little"
        )
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    used, cells = np.unique(nodes[0], return_inverse=True)
    order = np.argsort(tags)
    points = coordinates.reshape(-1, 3)[order[np.searchsorted(tags, used, sorter=order)], :2].copy()
    points[np.abs(points) < 1e-9] = 0.0
    cells = cells.reshape(-1, len(ELEMENTS[cell_type].nodes)).astype(np.int64)
    a, b, c = (points[cells[:, i]] for i in range(3))
    if ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]).sum() < 0:
        raise MeshQualityError(f"{specimen.name}: the mesh is upside down; this is an error of the program")
    return points, cells


def _label(
    points: Array, cells: Indices, cell_type: str, specimen: Specimen, quarter: bool = False
) -> dict[str, Indices]:
    """Boundary edges by name, recognised by where they lie."""
    edges, _ = boundary_edges(cells, cell_type)
    ends = points[edges[:, :2]]
    x_max, y_max = specimen.half_extent

    def on_line(axis: int, value: float) -> np.ndarray:
        return (np.abs(ends[:, :, axis] - value) < 1e-8 * max(x_max, y_max)).all(axis=1)

    sides = {"right": on_line(0, x_max), "top": on_line(1, y_max)}
    if quarter:
        cuts = {"symmetry_x": on_line(0, 0.0), "symmetry_y": on_line(1, 0.0)}
    else:
        cuts = {}
        sides |= {"left": on_line(0, -x_max), "bottom": on_line(1, -y_max)}
    free = np.ones(len(edges), bool)
    for name, member in {**sides, **cuts}.items():
        if name in specimen.loaded or name in cuts:
            free &= ~member
    named = {**sides, **cuts, "free": free}
    for i, hole in enumerate(specimen.holes()):
        levels = hole.level(ends.reshape(-1, 2)).reshape(-1, 2)
        named[f"hole_{i}"] = (np.abs(levels - 1) < 1e-6).all(axis=1)
    return {name: edges[member] for name, member in named.items() if member.any() or name == "free"}
