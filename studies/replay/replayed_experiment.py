"""A measured test solved by finite elements: its own outline, its own motion, a model's law.

In: an Experiment and a `Law`. Out: `Replay`, predicted fields and forces beside the measured ones.

Loaded edges move as measured, in the components that their grips hold, and so do the rims where the measurement ends: their traction is
unknown. Free edges are free, and curved where their points lie on a curve (`meshes.measured.curved_outline`). Each triangle of the camera becomes a
quadratic one, of six nodes, or four of them at the outline. How much the mesh matters is told by the last increment alone, solved on this mesh and on one with four times as many
triangles, without what depends on time.

Where the Experiment has a machine record, forces are predicted between the pictures, too: displacements go straight from one picture to the next, as
fast as the crosshead does (`calibrate.data.load_record`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.data.outline import Outline
from calibrate.data.triangulation import signed_areas
from calibrate.effects.chain.true_surface import true_surface
from calibrate.fitting.calibration import relative_force_error
from forward.loading import MeasuredMotion
from forward.sheet.inelastic import solve_history
from forward.sheet.sheet_run import Options
from forward.solution import SurfaceSolution
from meshes import Mesh
from meshes.measured.curved_outline import rises
from meshes.measured.quadratic_triangles import CurvedEdges, split
from meshes.measured.strip import with_strip
from studies.replay.model_law import Law
from studies.replay.replayed_record import ReplayedRecord, between_pictures

Array = NDArray[np.float64]
HIGHEST = 1 / 6  # rise of a curved edge over the height of its triangle, which a quarter would fold
SUBSTEPS = 3  # of an increment, where the law has a history
TOLERANCE = 1e-6  # imbalance over the reactions: displacements and forces are then right to 1e-7 of their size
SMALL = 1e-3  # of the largest displacement, which the mesh may matter where the noise is unknown


@dataclass(frozen=True)
class MeshEffect:
    """What four times as many triangles change at the last increment. field: root mean square at the camera's points, mm; force: relative."""

    field: float
    force: float


@dataclass(frozen=True, eq=False)
class Replay:
    """experiment: without what the law takes out of it. displacements (t, n, 2), mm, at its points; forces: {boundary: (t, 2)} N, of the grips on the specimen.

    judged (n,): points that are measured and were not prescribed; mesh_effect: None where it was not asked for; refined: how often the
    triangles were divided; record: forces between the pictures, None where the Experiment has no machine record; lost_record: that of the test is not
    compared, since its pictures, corrected, go beyond it.
    """

    experiment: Experiment
    law: Law
    displacements: Array
    forces: dict[str, Array]
    judged: NDArray[np.bool_]
    solution: SurfaceSolution
    mesh_effect: MeshEffect | None = None
    refined: int = 0
    record: ReplayedRecord | None = None
    lost_record: bool = False

    @property
    def measured(self) -> dict[str, Array]:
        """{boundary: (t, 2)} N."""
        return {b.name: b.force for b in self.experiment.loaded}

    @property
    def force_error(self) -> float:
        """Norm of the force errors over that of the measured forces."""
        return relative_force_error(self.forces, self.measured)

    @cached_property
    def residual(self) -> Array:
        """Measured minus replayed displacements (t, n, 2), mm."""
        return self.experiment.displacements - self.displacements

    @property
    def field_error(self) -> Array:
        """Root mean square residual of a component (t,), mm, over the points that were not prescribed."""
        return np.sqrt((self.residual[:, self.judged] ** 2).mean(axis=(1, 2)))

    @property
    def noise(self) -> float | None:
        """Standard deviation of a measured displacement at the largest deformation, mm, if it is known."""
        noise = self.experiment.noise
        return noise.total_std if noise is not None and noise.displacement_std > 0 else None


def replay(
    experiment: Experiment,
    law: Law,
    checkpoint: Path | None = None,
    check_mesh: bool = True,
    progress: bool = False,
    options: Options = Options(TOLERANCE),
) -> Replay:
    """Solve the test, less the effects of its measurement that the law takes out. `checkpoint`: as of `solve_history`, from which a killed run goes on; options: of the solution.

    Where the mesh matters more than the noise (or `SMALL` of the largest displacement), the whole test is solved on the finer one.
    Raises `LoadingError` where too little of the boundary is held, `MaterialError`, and `ConvergenceError`.
    """
    has_record = experiment.record is not None
    experiment = experiment if law.noise is None else replace(experiment, noise=law.noise)
    experiment = true_surface(experiment, law.taken_out)
    effect, level = None, 0
    if check_mesh:
        effect = mesh_effect(experiment, law)
        noise = experiment.noise.displacement_std if experiment.noise else 0.0
        level = int(effect.field > (noise or SMALL * np.abs(experiment.displacements).max()))
    problem = BoundaryValues.of(experiment, level, law.strip)
    times = experiment.time if experiment.time is not None else np.arange(1.0, experiment.n_increments + 1)
    factors = np.arange(1, experiment.n_increments + 1) / experiment.n_increments
    history = law.sheet.relaxes or law.sheet.softens
    solution = solve_history(problem.mesh, law.sheet, problem.motion(experiment.displacements), factors, times,
                             substeps=SUBSTEPS if history else 1, options=options, checkpoint=checkpoint, progress=progress,
                             readings=between_pictures(experiment, SUBSTEPS if history else 1))  # fmt: skip
    n = len(experiment.points)
    return Replay(
        experiment,
        law,
        solution.displacements[:, :n],
        _forces(experiment, solution),
        problem.judged,
        solution,
        effect,
        level,
        None if experiment.record is None else ReplayedRecord.of(experiment, solution),
        has_record and experiment.record is None,
    )


def mesh_effect(experiment: Experiment, law: Law) -> MeshEffect:
    """The last increment in one step, elastic, on two meshes."""
    sheet = replace(law.sheet, prony=(), branches=(), permanent_set=None)
    found = []
    for level in (0, 1):
        problem = BoundaryValues.of(experiment, level, law.strip)
        motion = problem.motion(experiment.displacements[-1:])
        found.append(solve_history(problem.mesh, sheet, motion, [1.0], [1.0]))
    n = len(experiment.points)
    coarse, fine = found
    inner = BoundaryValues.of(experiment).judged
    change = (coarse.displacements[-1, :n] - fine.displacements[-1, :n])[inner]
    forces = [np.concatenate([f[-1] for f in one.reactions.values()]) for one in found]
    return MeshEffect(
        float(np.sqrt((change**2).mean())), float(np.linalg.norm(forces[0] - forces[1]) / np.linalg.norm(forces[1]))
    )


def _forces(experiment: Experiment, solution: SurfaceSolution) -> dict[str, Array]:
    """Of every grip, zero in the components along which it slides."""
    return {b.name: solution.reactions[b.name] * b.held for b in experiment.loaded}


RIM = "rim"


@dataclass(frozen=True, eq=False)
class BoundaryValues:
    """The test as a boundary value problem. carried (nodes, n): from the camera's points to the nodes; held (nodes, 2); judged (n,): points that are measured, of which no
    component is prescribed."""

    mesh: Mesh
    carried: sp.csr_array
    held: NDArray[np.bool_]
    judged: NDArray[np.bool_]
    sides: tuple[str, ...]

    @classmethod
    def of(cls, experiment: Experiment, finer: int = 0, strip: float = 0.0) -> BoundaryValues:
        """The camera's triangles, quadratic, each divided in four `finer` times before; the first nodes are the camera's points. strip: width, mm, of what it does not see beside
        free edges; where that is gripped it moves as the point beside it. Raises `MeshDataError` where a strip so wide folds."""
        seen = Seen.of(experiment, strip)
        split_mesh = split(seen.points, seen.triangles, seen.edges, finer, seen.curved)
        held = np.zeros((len(split_mesh.mesh.points), 2), bool)
        held[np.unique(split_mesh.mesh.boundaries[RIM])] = True
        for boundary in experiment.loaded:
            held[np.unique(split_mesh.mesh.boundaries[boundary.name])] |= np.array(boundary.held)
        carried = sp.csr_array(split_mesh.interpolation @ seen.carried)
        judged = ~held[: len(experiment.points)].any(axis=1)
        judged[experiment.n_measured :] = False
        return cls(split_mesh.mesh, carried, held, judged, tuple(b.name for b in experiment.loaded))

    def motion(self, displacements: Array) -> MeasuredMotion:
        """The held nodes as measured: displacements (t, n, 2), mm, of the camera's points."""
        return MeasuredMotion(self.sides, self.held, np.stack([self.carried @ u for u in displacements]))


@dataclass(frozen=True, eq=False)
class Seen:
    """The camera's triangulation, with the strip that it does not see. carried (points, n): from the camera's points; edges: of each grip and of the rim; curved: free edges with the curve
    through their points, which rises by at most the share `HIGHEST` of the height of a triangle."""

    points: Array
    triangles: NDArray[np.int64]
    carried: sp.csr_array
    edges: dict[str, NDArray[np.int64]]
    curved: CurvedEdges

    @classmethod
    def of(cls, experiment: Experiment, strip: float = 0.0) -> Seen:
        """Of a test. strip: see `BoundaryValues.of`."""
        outline = Outline.of(experiment)
        is_free = outline.free & (outline.grip < 0)
        free, owners = outline.edges[is_free], experiment.triangles[outline.owners[is_free]]
        points, triangles, edges = experiment.points, experiment.triangles, named_edges(experiment)
        carried = sp.eye_array(len(points), format="csr")
        unseen = is_free & ~outline.given
        if strip > 0 and unseen.any():
            others, known = outline.edges[~unseen], outline.given[is_free]
            grown = with_strip(points, triangles, outline.edges[unseen], others, strip)
            points, triangles, k = grown.points, grown.triangles, len(grown.edges)
            free = np.concatenate([grown.edges, free[known]])
            owners = np.concatenate([triangles[-2 * k : -k], owners[known]])
            for name, some in edges.items():
                on = [(others[i] == some).all(axis=1).any() for i in grown.beside]
                edges[name] = np.concatenate([some, grown.ends[np.array(on, bool)]])
            carried = sp.csr_array(sp.vstack([carried, carried[grown.parents]]))
        length = np.linalg.norm(points[free[:, 1]] - points[free[:, 0]], axis=1)
        height = 2 * signed_areas(points, owners) / length
        return cls(points, triangles, carried, edges, CurvedEdges(free, rises(points, free, HIGHEST * height)))


def named_edges(experiment: Experiment) -> dict[str, NDArray[np.int64]]:
    """Edges (e, 2) of each grip, and of the rim."""
    outline = Outline.of(experiment)
    return {b.name: outline.edges[outline.grip == i] for i, b in enumerate(experiment.loaded)} | {RIM: outline.rim}
