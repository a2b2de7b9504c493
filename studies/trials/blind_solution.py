"""A blind trial solved and observed without noise: a `Trial` in, its exact solution and clean Experiment out.

The specimens and their meshes, of quads for the solution and of triangles for the camera, are the same in all trials.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from calibrate.data.experiment import Experiment
from forward.loading import Loading
from forward.sheet import additions as laws
from forward.sheet.inelastic import solve_history
from forward.sheet.thin_sheet import Sheet
from forward.solid.solid_model import Options
from forward.solid.solid_model import solve as solve_in_3d
from forward.solution import SurfaceSolution
from meshes import Mesh, quads, specimen_from_dict, triangles
from meshes.extrusion import extrude
from studies.synthetic import effect_laws
from studies.synthetic.camera_disturbances import LensDistortion, MagnificationDrift, OutOfPlane, Rotation, Scale, Tilt
from studies.synthetic.correlation_disturbances import SubsetSmoothing, UnmeasuredStrip, Warp
from studies.synthetic.disturbances import Disturbance, observe
from studies.synthetic.load_cell_disturbances import (
    AxisGain,
    ForceDrift,
    ForceGain,
    ForceOffset,
    Friction,
    Lag,
    LoadCellNonlinearity,
    StiffnessDrift,
)
from studies.trials import foreign
from studies.trials.blind_effects import SOLID
from studies.trials.blind_trial import SPECIMENS, Trial

Array = NDArray[np.float64]
SIZES = {  # of the quads at holes and far from them, mm: fine enough where grips and free edges meet
    "cross": {"hole_size": 0.36, "far_size": 1.8},
    "plate": {"hole_size": 0.7, "far_size": 1.1},
    "wide plate": {"hole_size": 0.7, "far_size": 1.1},
}
CAMERA_NODES = 1400
VISCOUS_SUBSTEPS = 3
SET_SUBSTEPS = 4
SOLID_LAYERS = 2  # of hexes in half the thickness


def clean_experiment(trial: Trial, size_factor: float = 1.0) -> Experiment:
    """The Experiment of a trial before noise. size_factor: of the quads."""
    mesh, specimen = camera_mesh(trial.specimen), SPECIMENS[trial.specimen]
    return observe(solve(trial, size_factor), specimen, mesh, disturbances(trial), shares(trial), f"blind {trial.seed}")


def shares(trial: Trial) -> Array:
    """Share (t,) of the largest load factor, which an out-of-plane motion follows."""
    return np.asarray(trial.factors) / max(trial.factors)


@lru_cache(maxsize=8)
def camera_mesh(specimen: str) -> Mesh:
    """The fixed triangulation of a specimen."""
    return triangles(SPECIMENS[specimen], n_nodes=CAMERA_NODES)


@lru_cache(maxsize=16)
def forward_mesh(specimen: str, size_factor: float = 1.0, quarter: bool = False) -> Mesh:
    """The quads of a specimen."""
    described = specimen_from_dict({**SPECIMENS[specimen].to_dict(), **SIZES[specimen]})
    return quads(described, quarter, size_factor)


def solve(trial: Trial, size_factor: float = 1.0) -> SurfaceSolution:
    """Exact surface displacements at the pictures and forces at the readings."""
    lag = next((d for d in disturbances(trial) if isinstance(d, Lag)), None)
    if any(hidden.name == SOLID for hidden in trial.effects):
        return _solve_solid(trial, size_factor, lag)
    factors, times = (trial.factors, trial.times) if lag is None else lag.schedule(trial.factors, trial.times)
    described = sheet(trial)
    solution = solve_history(
        forward_mesh(trial.specimen, size_factor),
        described,
        Loading.clamped(SPECIMENS[trial.specimen].loaded, trial.displacement),
        factors,
        times,
        substeps=VISCOUS_SUBSTEPS if described.relaxes else SET_SUBSTEPS if described.permanent_set else 1,
    )
    return solution if lag is None else lag.split(solution, trial.times)


def _solve_solid(trial: Trial, size_factor: float, lag: Lag | None) -> SurfaceSolution:
    """The surface of a thick specimen, an eighth of which is solved; forces at the readings by a spline."""
    sides = SPECIMENS[trial.specimen].loaded
    solution = solve_in_3d(
        extrude(forward_mesh(trial.specimen, size_factor, quarter=True), trial.thickness, SOLID_LAYERS),
        trial.material,
        Loading.clamped(sides, trial.displacement, dimension=3),
        len(trial.factors),
        options=Options(tolerance=1e-6, volume_tolerance=1e-6),
    )
    surface = replace(solution.surface().mirrored(), time=np.asarray(trial.times))
    if lag is None:
        return surface
    read = {
        side: CubicSpline([0.0, *trial.times], [np.zeros(2), *force])(surface.time + lag.dt)
        for side, force in surface.reactions.items()
    }
    return replace(surface, reactions=read)


def sheet(trial: Trial) -> Sheet:
    """The sheet with the effects that are in the material."""
    own = foreign.laws(trial)
    known = [e for e in trial.effects if e.name not in own.solved]
    effects = [(e.name, e.amplitudes, e.shape) for e in known if e.name in effect_laws.SOLVED]
    patches = [laws.Patch(e.more["height"], e.more["x"], e.more["y"], e.more["width"])
               for e in known if e.name == "stiffness field"]  # fmt: skip
    extent = effect_laws.Extent(2 * max(SPECIMENS[trial.specimen].half_extent))
    made = effect_laws.sheet(trial.material, trial.thickness, effects, extent, [*patches, *own.additions])
    return replace(made, branches=(*made.branches, *own.branches))


def warp(more: dict[str, float]) -> Warp:
    """The bent specimen of a trial."""
    return Warp(int(more["axis"]), more["slope"], more["place"], more["width"])


def disturbances(trial: Trial) -> list[Disturbance]:
    """The effects that are in the recording."""
    kinds: dict[str, type[Disturbance]] = {
        kind.name: kind
        for kind in (
            ForceOffset,
            ForceDrift,
            ForceGain,
            AxisGain,
            Friction,
            LoadCellNonlinearity,
            StiffnessDrift,
            Lag,
            Rotation,
            Scale,
            Tilt,
            LensDistortion,
            OutOfPlane,
            MagnificationDrift,
            UnmeasuredStrip,
        )
    }
    found: list[Disturbance] = []
    for hidden in trial.effects:
        if hidden.name in kinds:
            found.append(kinds[hidden.name](**hidden.amplitudes, **hidden.shape))
        elif hidden.name == SubsetSmoothing.name:
            found.append(SubsetSmoothing(hidden.more["side"]))
        elif hidden.name == Warp.name:
            found.append(warp(hidden.more))
    return found
