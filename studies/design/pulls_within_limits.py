"""How far a specimen can be pulled: specimen, expected law and the limits of machine, sheet and camera in; the solved pull out.

The pull ends where the first limit is met: displacement of a grip, force, largest principal stretch anywhere (the material tears), or
the camera's largest field, which has to hold the stretched specimen.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

from forward.errors import ConvergenceError
from forward.loading import Loading
from forward.materials import Material
from forward.sheet.plane_stress import solve
from forward.solution import SurfaceSolution
from meshes import Mesh, Specimen, quads
from meshes.errors import MeshQualityError
from meshes.ligaments import narrowest_ligament
from studies.design.design_plan import AXES, CameraTable, Plan
from studies.errors import DesignError

Array = NDArray[np.float64]
MARGIN = 0.995  # of the displacement at which a limit is met
FINER = (1.0, 0.75, 0.5)  # sizes that are tried
FIELD_MARGIN = 1.05  # of the camera's field, over the stretched specimen


class Limit(StrEnum):
    """What ends a pull."""

    DISPLACEMENT = "displacement"
    FORCE = "force"
    STRETCH = "stretch"
    FIELD = "field of view"
    EQUILIBRIUM = "equilibrium"


@dataclass(frozen=True)
class View:
    """What the camera makes of a pull. field: side of its field, mm; std, correlation_length: of the noise, mm; pitch: of the points, mm."""

    field: float
    std: float
    correlation_length: float
    pitch: float

    @classmethod
    def of(cls, camera: CameraTable, extent: float) -> View:
        """Zoomed to a stretched specimen of `extent`, mm."""
        field = float(np.clip(FIELD_MARGIN * extent, camera.smallest_field_mm, camera.largest_field_mm))
        return cls(field, camera.noise * field, camera.correlation_length * field, field / np.sqrt(camera.points))


@dataclass(frozen=True, eq=False)
class Pull:
    """A specimen at its limit. quarter: solution of the first quadrant; displacement: of each grip at the end, mm; limit: that ended it."""

    specimen: Specimen
    loading: Loading
    quarter: SurfaceSolution
    displacement: float
    limit: Limit
    view: View

    @property
    def forces(self) -> dict[str, Array]:
        """Side to the pull of its grip (n_inc,), N, of the sides that a quarter has."""
        return {side: 2 * force[:, AXES[side]] for side, force in self.quarter.reactions.items()}

    @property
    def stretches(self) -> Array:
        """Largest principal stretch (n_inc,) in the specimen."""
        return largest_stretches(self.quarter)


def limited_pull(
    specimen: Specimen, law: Material, plan: Plan, size_factor: float | None = None, tested: bool = False
) -> Pull:
    """Pull a specimen as far as the plan's limits allow. tested: it was, so that machine and sheet must have allowed it. Raises `DesignError` where it
    cannot be tested, `MeshError`, `ForwardError`."""
    if not tested:
        check_feasible(specimen, plan)
    mesh = meshed(specimen, size_factor or plan.size_factor)
    bounds = displacement_bounds(specimen, plan)
    limit = min(bounds, key=lambda name: bounds[name])
    displacement = bounds[limit]
    if displacement <= 0:
        raise DesignError(f"{specimen.name}: does not fit the camera's field of {plan.camera.largest_field_mm:g} mm")
    for _ in range(3):
        loading = Loading.clamped(specimen.loaded, displacement)
        try:
            quarter = solve(mesh, law, loading, plan.camera.pictures, plan.sheet.thickness_mm)
        except ConvergenceError as error:
            if error.solution is None or not len(error.solution.time):
                raise DesignError(f"{specimen.name}: no equilibrium ({error})") from error
            limit, displacement = Limit.EQUILIBRIUM, MARGIN * float(error.solution.time[-1]) * displacement
            continue
        pull = Pull(specimen, loading, quarter, displacement, limit, view_of(specimen, displacement, plan))
        share, met = first_limit(pull, plan)
        if met is None:
            return pull
        limit, displacement = met, MARGIN * share * displacement
    raise DesignError(f"{specimen.name}: no displacement was found that keeps the limits")


def meshed(specimen: Specimen, size_factor: float) -> Mesh:
    """A quarter in quads; finer where these sizes make bad cells, as at the tips of slits. Raises `MeshQualityError`."""
    for finer in FINER:
        try:
            return quads(specimen, quarter=True, size_factor=finer * size_factor)
        except MeshQualityError:
            if finer == FINER[-1]:
                raise
    raise AssertionError


def check_feasible(specimen: Specimen, plan: Plan) -> None:
    """Raises `DesignError` where machine or sheet do not allow the specimen."""
    axes = {AXES[side] for side in specimen.loaded}
    if len(axes) > plan.machine.axes:
        raise DesignError(f"{specimen.name}: is pulled along two axes, the machine has one")
    least = narrowest_ligament(specimen)
    if least < plan.sheet.least_ligament_mm:
        raise DesignError(
            f"{specimen.name}: its narrowest ligament is {least:.2f} mm, at least {plan.sheet.least_ligament_mm:g} mm are wanted"
        )


def displacement_bounds(specimen: Specimen, plan: Plan) -> dict[Limit, float]:
    """Displacement of each grip, mm, beyond which a limit is passed whatever the law: the mean stretch along a line between grips
    is no larger than the largest."""
    axes = {AXES[side] for side in specimen.loaded}
    length = min(specimen.half_extent[axis] for axis in axes)
    room = min(plan.camera.largest_field_mm / FIELD_MARGIN / 2 - specimen.half_extent[axis] for axis in axes)
    across = min((plan.camera.largest_field_mm / FIELD_MARGIN / 2 - half for half in specimen.half_extent), default=0.0)
    return {
        Limit.DISPLACEMENT: plan.machine.largest_displacement_mm,
        Limit.STRETCH: (plan.sheet.largest_stretch - 1) * length,
        Limit.FIELD: room if across >= 0 else -1.0,
    }


def view_of(specimen: Specimen, displacement: float, plan: Plan) -> View:
    """The camera zoomed to a specimen whose grips have moved by `displacement`, mm."""
    axes = {AXES[side] for side in specimen.loaded}
    ends = [half + (displacement if axis in axes else 0.0) for axis, half in enumerate(specimen.half_extent)]
    return View.of(plan.camera, 2 * max(ends))


def first_limit(pull: Pull, plan: Plan) -> tuple[float, Limit | None]:
    """Share of the pull at which force or stretch pass their limit first, and which; 1 and None where they do not."""
    curves = [(Limit.FORCE, force, plan.machine.largest_force_N) for force in pull.forces.values()]
    curves.append((Limit.STRETCH, pull.stretches - 1, plan.sheet.largest_stretch - 1))
    found: tuple[float, Limit | None] = (1.0, None)
    for limit, values, most in curves:
        if values.max() > most:
            curve = PchipInterpolator(np.append(0.0, pull.quarter.time), np.append(0.0, values))
            last = pull.quarter.time[np.argmax(values > most)]
            share = float(brentq(lambda t, c=curve, m=most: float(c(t)) - m, 0.0, last))
            found = min(found, (share, limit), key=lambda pair: pair[0])
    return found


def largest_stretches(solution: SurfaceSolution) -> Array:
    """Largest principal stretch (n_inc,) of all Gauss points."""
    F = solution.gauss()[2]
    return np.linalg.norm(F, ord=2, axis=(-2, -1)).max(axis=1)
