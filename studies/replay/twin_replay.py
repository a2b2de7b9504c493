"""The replay that tells a diagnosis the discretisation error of a test, see `calibrate.diagnosis.twin`.

In: an Experiment and the model of its base. Out: the same Experiment with the displacements and forces of its replay, and as a camera with points at
all nodes of the replay would see it.

The grips move as measured, noise included, and the mesh is the coarsest of a replay: both change the residual of the twin by much less than
noise (docs/discover_method.md, "Weights").
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.data.triangulation import boundary_nodes
from calibrate.diagnosis.twin import Replayed
from calibrate.effects.support.digest import digest
from calibrate.effects.support.finite_element_field import FieldMesh, FiniteElementField
from calibrate.errors import EquigapError, NoTwinError
from calibrate.models.extended_model import ExtendedModel
from forward.errors import ForwardError
from forward.interpolation import in_triangles, locate, shape_slopes
from forward.sheet.sheet_run import Options
from meshes.errors import MeshError
from studies.errors import StudyError
from studies.replay.model_law import law_of
from studies.replay.replayed_experiment import RIM, TOLERANCE, Replay, replay

Array = NDArray[np.float64]
OPTIONS = Options(TOLERANCE, max_bisections=3)  # a model that fails is not worth more
MOST_TRIANGLES = 12_000
PARTS = ([0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5])  # of a triangle of six nodes


def twin_replay(experiment: Experiment, model: ExtendedModel) -> Replayed:
    """Raises `NoTwinError` with the reason where the test cannot be replayed, or is seen so finely that this takes longer than the diagnosis."""
    if len(experiment.triangles) > MOST_TRIANGLES:
        raise NoTwinError(
            f"{experiment.name}: {len(experiment.triangles)} triangles are more than the {MOST_TRIANGLES} of which a replay is affordable; "
            "of so fine a camera the discretisation error is small"
        )
    pictures = experiment if experiment.record is None else replace(experiment, record=None)
    try:
        found = replay(pictures, law_of(model, experiment), check_mesh=False, options=OPTIONS)
        seen = replayed_test(experiment, found)
        finer = None if experiment.thickness is None else at_all_nodes(seen, found)
        return Replayed(seen, field_of(found), finer)
    except (ForwardError, MeshError, StudyError, EquigapError) as error:
        raise NoTwinError(f"{experiment.name}: {str(error).removeprefix(f'{experiment.name}: ')}") from error


def field_of(found: Replay) -> FiniteElementField:
    """Displacements of a replay at any place."""
    mesh = found.solution.mesh

    def shares(points: Array) -> tuple[NDArray[np.int64], Array, NDArray[np.bool_]]:
        places = in_triangles(mesh, points)
        return mesh.cells[places.cells], mesh.element.shapes(places.local), places.excess == 0

    def slopes(points: Array) -> tuple[NDArray[np.int64], Array]:
        places = locate(mesh, points)
        return mesh.cells[places.cells], shape_slopes(mesh, places)

    own = FieldMesh(digest(mesh.points, mesh.cells), len(mesh.points), shares, slopes)
    return FiniteElementField(found.solution.displacements, own)


def replayed_test(experiment: Experiment, found: Replay) -> Experiment:
    """The test with displacements and forces of its replay."""
    loaded = tuple(replace(b, force=found.forces[b.name]) for b in experiment.loaded)
    return replace(experiment, displacements=experiment.as_seen(found.displacements), loaded=loaded)


def at_all_nodes(seen: Experiment, found: Replay) -> Experiment:
    """A replayed test on triangles between all nodes of the replay, the first of which are its points."""
    mesh, u = found.solution.mesh, found.solution.displacements
    cells = np.concatenate([mesh.cells[:, part] for part in PARTS])
    loaded = tuple(replace(b, nodes=np.unique(mesh.boundaries[b.name])) for b in seen.loaded)
    gripped = np.concatenate([np.unique(mesh.boundaries[name]) for name in (*(b.name for b in loaded), RIM)])
    free = np.setdiff1d(boundary_nodes(cells), gripped)
    bare = replace(seen, heights=None, record=None, interpolated=None, noise=None, continued=None)
    return replace(bare, points=mesh.points, triangles=cells, displacements=u, loaded=loaded, free_nodes=free)
