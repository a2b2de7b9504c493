"""A sheet in plane stress by felupe: quadratic triangles, laws by JAX, state variables, an end that follows a path.

Shares no formula and no mesh with `forward`: the law is a function of F in the plane, F33 = 1 / det F, and JAX has its derivatives.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import felupe
import gmsh
import jax
import numpy as np
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

jax.config.update("jax_enable_x64", True)
WIDTH, HEIGHT = 100.0, 50.0  # mm
SIZE, NEAR_HOLES = 1.8, 0.8  # of the elements, mm
TOLERANCE, ITERATIONS = 1e-9, 15
QUADRATIC, LINEAR = 9, 2  # triangles of gmsh
NEAREST = 12  # elements that a point is looked for in
Hole = tuple[float, float, float]  # x, y, radius, mm


@dataclass(frozen=True)
class Law:
    """P (F, state, X, t, dt) -> (2, 2), MPa; update: the same -> state at the end of the step; state: at rest."""

    stress: Callable
    update: Callable
    state: np.ndarray


def mesh(holes: Sequence[Hole], size: float, near: float, order: int, slit: tuple[float, float] | None = None):
    """Nodes (n, 2), mm, and triangles (m, 3 or 6). slit: x and length of a notch of 20 um from the lower edge."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    cad = gmsh.model.occ
    sheet = [(2, cad.addRectangle(-WIDTH / 2, -HEIGHT / 2, 0, WIDTH, HEIGHT))]
    cut = [(2, cad.addDisk(x, y, 0, r, r)) for x, y, r in holes]
    if slit is not None:
        cut.append((2, cad.addRectangle(slit[0] - 0.01, -HEIGHT / 2 - 1, 0, 0.02, slit[1] + 1)))
    cad.cut(sheet, cut)
    cad.synchronize()
    gmsh.model.mesh.setSize(gmsh.model.getEntities(0), size)
    for dim, tag in gmsh.model.getEntities(1):
        x0, y0, _, x1, y1, _ = gmsh.model.getBoundingBox(dim, tag)
        outer = (abs(x1 - x0) < 0.1 and abs(abs(x0) - WIDTH / 2) < 0.1) or (
            abs(y1 - y0) < 0.1 and abs(abs(y0) - HEIGHT / 2) < 0.1
        )
        if not outer:
            gmsh.model.mesh.setSize(gmsh.model.getBoundary([(dim, tag)], recursive=True), near)
            if x1 - x0 > 0.5 and y1 - y0 > 0.5:
                gmsh.model.mesh.setTransfiniteCurve(tag, int(np.pi * (x1 - x0) / near) + 1)
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.setOrder(order)
    tags, places, _ = gmsh.model.mesh.getNodes()
    _, cells = gmsh.model.mesh.getElementsByType(QUADRATIC if order == 2 else LINEAR)
    gmsh.finalize()
    number = np.zeros(int(tags.max()) + 1, int)
    number[tags.astype(int)] = np.arange(len(tags))
    cells = number[cells.astype(int)].reshape(-1, 6 if order == 2 else 3)
    used, cells = np.unique(cells, return_inverse=True)
    return places.reshape(-1, 3)[used, :2], cells.reshape(-1, 6 if order == 2 else 3)


def solve(x: np.ndarray, cells: np.ndarray, path: np.ndarray, times: np.ndarray, law: Law):
    """Displacements (t, n, 2), mm, and forces (t,), N, of the end on the right at path (t,), mm, and times (t,), s, both from 0; 1 mm thick.

    Raises `SystemExit` where Newton's method finds no equilibrium.
    """
    region = felupe.RegionQuadraticTriangle(felupe.Mesh(x, cells, "triangle6"))
    displacement = felupe.Field(region, dim=2)
    field = felupe.FieldContainer([displacement])
    q, e = region.dV.shape
    shape = np.broadcast_to(region.h if region.h.ndim == 3 else region.h[..., None], (6, q, e))
    X = np.einsum("aqe,eai->qei", shape, x[cells]).reshape(-1, 2)
    left, right = np.isclose(x[:, 0], -WIDTH / 2), np.isclose(x[:, 0], WIDTH / 2)
    held = np.flatnonzero(np.repeat(left | right, 2))
    free = np.setdiff1d(np.arange(2 * len(x)), held)
    over = (0, 0, 0, None, None)
    stress, tangent, update = (jax.jit(jax.vmap(f, over)) for f in (law.stress, jax.jacfwd(law.stress), law.update))
    state, now, before = np.tile(law.state, (len(X), 1)), np.zeros_like(x), np.zeros_like(x)
    found, force = [now], [0.0]
    for k in range(1, len(path)):
        step, last = path[k] - path[k - 1], path[k - 1] - path[k - 2] if k > 1 else 0.0
        trial = now + (now - before) * (step / last) if abs(last) > 1e-9 else now * (path[k] / max(path[k - 1], 1e-9))
        if k == 1:
            trial[:, 0] = (x[:, 0] / WIDTH + 0.5) * path[1]
        trial[left], trial[right] = 0.0, (path[k], 0.0)
        for _ in range(ITERATIONS):
            displacement.values[:] = trial
            F = field.extract(grad=True, add_identity=True)[0].transpose(2, 3, 0, 1).reshape(-1, 2, 2)
            given = (F, state, X, times[k], times[k] - times[k - 1])
            P = np.asarray(stress(*given)).reshape(q, e, 2, 2).transpose(2, 3, 0, 1)
            r = felupe.IntegralForm([P], v=field, dV=region.dV).assemble().toarray().ravel()
            if np.linalg.norm(r[free]) < TOLERANCE * max(np.linalg.norm(r[held]), 1e-9):
                break
            A = np.asarray(tangent(*given)).reshape(q, e, 2, 2, 2, 2).transpose(2, 3, 4, 5, 0, 1)
            K = felupe.IntegralForm([A], v=field, dV=region.dV, u=field).assemble().tocsc()
            trial = trial.copy()
            trial.ravel()[free] -= splu(K[free][:, free]).solve(r[free])
        else:
            raise SystemExit(f"no equilibrium at {path[k]:g} mm")
        state, before, now = np.asarray(update(*given)), now, trial
        found.append(now)
        force.append(float(r.reshape(-1, 2)[right, 0].sum()))
    return np.array(found), np.array(force)


def at_points(x: np.ndarray, cells: np.ndarray, values: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Values (t, n, 2) of the nodes at points (p, 2): of the nearest element that holds the point best."""
    near = cKDTree(x[cells[:, :3]].mean(axis=1)).query(points, NEAREST)[1]
    best, weights, owner = np.full(len(points), -np.inf), np.zeros((len(points), 6)), np.zeros(len(points), int)
    for k in range(NEAREST):
        corners = x[cells[near[:, k]]]
        local = np.full((len(points), 2), 1 / 3)
        for _ in range(6):
            N, slopes = _shape(local)
            jacobian = np.einsum("pak,pai->pik", slopes, corners)
            local += np.linalg.solve(jacobian, (points - np.einsum("pa,pai->pi", N, corners))[..., None])[..., 0]
        inside = np.minimum(local.min(axis=1), 1 - local.sum(axis=1))
        better = inside > best
        best[better], weights[better], owner[better] = inside[better], _shape(local)[0][better], near[better, k]
    return np.einsum("pa,tpai->tpi", weights, values[:, cells[owner]])


def _shape(local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions (p, 6) of quadratic triangles and their slopes (p, 6, 2) at local places (p, 2)."""
    r, s = local.T
    t, zero = 1 - r - s, np.zeros(len(local))
    N = np.stack([t * (2 * t - 1), r * (2 * r - 1), s * (2 * s - 1), 4 * r * t, 4 * r * s, 4 * s * t], axis=1)
    by_r = np.stack([1 - 4 * t, 4 * r - 1, zero, 4 * (t - r), 4 * s, -4 * s], axis=1)
    by_s = np.stack([1 - 4 * t, zero, 4 * s - 1, -4 * r, 4 * r, 4 * (t - s)], axis=1)
    return N, np.stack([by_r, by_s], axis=-1)
