"""What load cells get wrong: their zero, the drift of it, their gains, the drift of that or of the material, friction before them, and their time.

In: an exact solution and a mesh of the camera. Out: small classes with their amplitudes, see `studies.synthetic.disturbances`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from forward.solution import SurfaceSolution
from studies.errors import OptionError
from studies.synthetic.disturbances import Disturbance

Array = NDArray[np.float64]
FIXED_POINT = 20  # iterations


@dataclass(frozen=True)
class ForceOffset(Disturbance):
    """Every load cell reads f0, N, too much in the direction of its largest force."""

    f0: float
    name: ClassVar[str] = "force offset"

    def forces(self, force, time):
        return force + self.f0 * _largest_direction(force)


@dataclass(frozen=True)
class ForceDrift(Disturbance):
    """Every load cell reads d, N/s, times the time too much in the direction of its largest force."""

    d: float
    name: ClassVar[str] = "force drift"

    def forces(self, force, time):
        return force + self.d * time[:, None] * _largest_direction(force)


@dataclass(frozen=True)
class ForceGain(Disturbance):
    """Load cells read 1 + g times the force."""

    g: float
    name: ClassVar[str] = "force gain"

    def forces(self, force, time):
        return force * (1 + self.g)


@dataclass(frozen=True)
class AxisGain(Disturbance):
    """Forces along y are read 1 + g times as large as they are."""

    g: float
    name: ClassVar[str] = "axis gain"

    def forces(self, force, time):
        return force * np.array([1.0, 1.0 + self.g])


@dataclass(frozen=True)
class Friction(Disturbance):
    """Every load cell reads more while forces grow, and less while they fall, at rest as before: R0, N, in the direction of its largest force, and R1, N, times what it reads over the largest of that."""

    R0: float
    R1: float
    name: ClassVar[str] = "friction in the load train"

    def forces(self, force, time):
        steps = np.sign(np.diff(_sizes(force), prepend=0.0))
        last = np.maximum.accumulate(np.where(steps != 0, np.arange(len(steps)), 0))
        sign = np.where(steps[last] < 0, -1.0, 1.0)[:, None]
        return _read(force, lambda f: force + sign * (self.R0 * _largest_direction(f) + self.R1 * f / _sizes(f).max()))


@dataclass(frozen=True)
class LoadCellNonlinearity(Disturbance):
    """The largest force is read 1 + a times as large as it is, others in proportion to what is read less wrong."""

    a: float
    name: ClassVar[str] = "load cell nonlinearity"

    def forces(self, force, time):
        return _read(force, lambda f: force * (1 + self.a * _sizes(f) / _sizes(f).max())[:, None])


@dataclass(frozen=True)
class StiffnessDrift(Disturbance):
    """Forces grow by a share s in every second, 1/s: of the material, or of the gain."""

    s: float
    name: ClassVar[str] = "stiffness or gain drift"

    def forces(self, force, time):
        return force * (1 + self.s * time)[:, None]


@dataclass(frozen=True)
class Lag(Disturbance):
    """Forces are read dt, s, after the picture. The solution must hold both instants: `schedule` before, `split` after."""

    dt: float
    name: ClassVar[str] = "lag between force and image"

    def schedule(self, factors: Sequence[float] | Array, times: Sequence[float] | Array) -> tuple[Array, Array]:
        """Load factors and times, s, of all pictures and readings, rising; the last straight line is continued.

        factors (t,) at times (t,), s, of the pictures. Raises `OptionError` for a reading before the test begins.
        """
        knots, values = np.concatenate([[0.0], times]), np.concatenate([[0.0], factors])
        late = np.asarray(times) + self.dt
        if late[0] <= 0:
            raise OptionError(f"a lag of {self.dt:g} s reads a force before the test begins at 0 s")
        slope = (values[-1] - values[-2]) / (knots[-1] - knots[-2])
        read = np.where(late > knots[-1], values[-1] + slope * (late - knots[-1]), np.interp(late, knots, values))
        every, first = np.unique(np.concatenate([times, late]), return_index=True)
        return np.concatenate([factors, read])[first], every

    def split(self, solution: SurfaceSolution, times: Sequence[float] | Array) -> SurfaceSolution:
        """Displacements at the pictures, taken at times (t,), s, and forces at the readings."""
        pictures = np.searchsorted(solution.time, times)
        readings = np.searchsorted(solution.time, np.asarray(times) + self.dt)
        return replace(
            solution,
            displacements=solution.displacements[pictures],
            reactions={side: force[readings] for side, force in solution.reactions.items()},
            time=solution.time[pictures],
            energy=solution.energy[pictures],
            iterations=solution.iterations[pictures],
        )


def _largest_direction(force: Array) -> Array:
    """Direction (2,) of the largest of the forces (t, 2), N; none of a grip without a force."""
    sizes = _sizes(force)
    return np.asarray(force[sizes.argmax()] / sizes.max()) if sizes.any() else np.zeros(2)


def _sizes(force: Array) -> Array:
    """(t,), N."""
    return np.linalg.norm(force, axis=1)


def _read(force: Array, reading: Callable[[Array], Array]) -> Array:
    """What is read (t, 2), N, of a true force, where what is wrong is in proportion to what is read. A grip without a force reads none."""
    if not force.any():
        return force
    for _ in range(FIXED_POINT):
        force = reading(force)
    return force
