"""What an effect is: one small thing a model may lack, as a differentiable change of the chain from images to forces.

The chain of an Experiment is displacements -> deformation gradients -> stresses -> virtual work - measured forces. An
effect may change any link; with its amplitudes at their null value nothing changes, exactly. Amplitudes are what is
tested and fitted; shapes (a relaxation time, an angle) mean nothing at the null value, so that a few of them are tried.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.effects.support.effect_data import Data
from calibrate.equations.tensors import Tensors

Array = NDArray[np.float64]
MATERIAL = (
    "energy",  # adds to it
    "set",  # chains formed anew, free of stress where they formed
    "stiffness",  # a factor on the stress by the place
    "softening",  # a factor by the history
    "relaxation",  # stress that follows in time
)
STAGES = (
    *MATERIAL,
    "kinematics",  # a sheet in three dimensions
    "clock",  # when it is seen
    "measurement",  # where, and how large
    "perspective",  # from where
    "lens",  # through what
    "correlation",  # by which subsets
    "force",  # a factor on all forces
    "load",  # how they are read
)
"""Where effects act, from the material to what is recorded, whichever was found first. What varies, softens or relaxes is all that comes before; what is recorded is corrected in the opposite order."""


@dataclass(frozen=True)
class Parameter:
    """An amplitude or shape. null: no effect. lower, upper: physically admissible. typical: of a strong effect; of a shape that may be 0 its size."""

    name: str
    unit: str
    null: float = 0.0
    lower: float = -np.inf
    upper: float = np.inf
    typical: float = 0.1
    may_be_zero: bool = False

    @property
    def stiffness_power(self) -> int:
        """Power of the stiffness of the material that it grows with, if everything is as many times stiffer."""
        return {"MPa": 1, "1/MPa": -1}.get(self.unit, 0)

    def shape_size(self, value: float) -> float:
        """Of a shape at a value: a radian, a typical one of a place or a dispersion, which may be 0, else the value itself."""
        if self.unit == "rad":
            return 1.0
        return self.typical if self.may_be_zero else max(abs(value), 1e-12)


FORMULA_ERROR, TRUNCATED_ERROR = 0.02, 0.05  # relative, of what an effect explains; of the beginning of a series
APART = 0.05  # of the whole: load and time that never are further apart go together
LATE = 10.0  # durations of the record: what begins so late has the time of a clock


def lacks_plane_stress(data: Data) -> str | None:
    """What is missing for an effect that is derived for a sheet with free faces."""
    return None if data.plane == "stress" else "plane stress"


def lacks_rate(data: Data) -> str | None:
    """What is missing for an effect that is seen in how fast the sheet is loaded."""
    if data.time is None:
        return "time"
    if len(data.time) < 3:
        return "more increments"
    late = float(data.time[0]) > LATE * float(data.time[-1] - data.time[0])
    return "time counted from the start of loading" if late else None


def lacks_turn(data: Data) -> str | None:
    """What is missing for an effect that goes on with time while the load does not: on a ramp at constant speed it is another one, of the load."""
    if (lacking := lacks_rate(data)) is not None:
        return lacking
    apart = jnp.abs(share_of_loading(data.u) - data.time / data.time[-1]).max()
    return "a pause or a way back" if float(apart) < APART else None


def share_of_loading(u: Any) -> Any:
    """Share (t,) of the largest, by the root mean square of displacements (t, n, 2)."""
    size = jnp.sqrt((u**2).mean(axis=(1, 2)))
    return size / size.max()


@dataclass(frozen=True)
class Effect:
    """Base of the effects; a subclass states its class variables and overrides the links it changes.

    - name.
    - stage: one of `STAGES`, in whose order effects act on the stress, whichever was found first.
    - formula: for the report. source: of the formula.
    - amplitudes: what is tested and fitted.
    - shapes: what means nothing at the null value.
    - former_shape: values of the last shapes in model files that were written without them, or without some of them.
    - shapes_vary: False where shapes only choose a derivative at the null value and mean nothing once the amplitude is known.
    - nested_in: the effect that has it as a special case, or nearly.
    - beside: the effect that it is more of, as a second relaxation time, and beside which alone it is a candidate.
    - confounded_with: what it can never be told from, or nothing.
    - decided_by: the experiment that tells it from its likes.
    - measured_by: why it is no candidate where it is `excluded`.
    - of_material: holds for every specimen of a material, not of one test alone.
    - of_rig: of a camera and grips that several tests share.
    - rough: adds second derivatives of the displacements to them, whose noise the weights of a model with it must know (`adjoint`).
    - reads_twin: takes from `Data.twin`, where there is one, what triangles of the camera cannot tell.
    - truncated: its formula is the beginning of a series, so that a small part of what it explains is left for others.
    - alone: amplitudes, by their places, that may be there without the others, beside all of them: a sheet is bent about one axis or about both. Each is as probable.
    - has_spring: its stress in time is that of a spring of its own, and not of the stress so far.

    In the links below a (p,) are the values of the amplitudes, shape those of the shapes, in the units of `Parameter`.
    """

    name: ClassVar[str]
    stage: ClassVar[str]
    formula: ClassVar[str]
    source: ClassVar[str] = "its own definition"
    amplitudes: ClassVar[tuple[Parameter, ...]]
    shapes: ClassVar[tuple[Parameter, ...]] = ()
    former_shape: ClassVar[tuple[float, ...]] = ()
    shapes_vary: ClassVar[bool] = True
    nested_in: ClassVar[str] = ""
    beside: ClassVar[Effect | None] = None
    confounded_with: ClassVar[str] = ""
    decided_by: ClassVar[str] = ""
    measured_by: ClassVar[str] = "two cameras measured it"
    of_material: ClassVar[bool] = False
    of_rig: ClassVar[bool] = False
    rough: ClassVar[bool] = False
    reads_twin: ClassVar[bool] = False
    truncated: ClassVar[bool] = False
    alone: ClassVar[tuple[tuple[int, ...], ...]] = ()
    has_spring: ClassVar[bool] = False

    @property
    def sets(self) -> NDArray[np.bool_]:
        """Sets of amplitudes (s, p) that it may have: those of `alone`, then all."""
        every = tuple(range(len(self.amplitudes)))
        return np.array([[k in some for k in every] for some in (*self.alone, every)])

    @property
    def formula_error(self) -> float:
        """Largest relative error of what it explains."""
        return TRUNCATED_ERROR if self.truncated else FORMULA_ERROR

    @property
    def in_material(self) -> bool:
        """Whether it makes stress from F at a place and its past."""
        return self.stage in MATERIAL

    @property
    def remembers(self) -> bool:
        """Whether its stress depends on earlier increments."""
        return self.stage in ("set", "softening", "relaxation")

    @property
    def of_forces(self) -> bool:
        """Whether it is seen in measured forces only."""
        return self.stage in ("clock", "force", "load")

    def is_degenerate(self, shape: tuple[float, ...]) -> bool:
        """Whether a member of a family is a simpler effect under another name."""
        return False

    def as_simpler(
        self, a: tuple[float, ...], shape: tuple[float, ...]
    ) -> tuple[Effect, tuple[float, ...], tuple[float, ...]]:
        """That effect, its amplitudes and its shapes, of a degenerate member."""
        raise NotImplementedError

    def limits(self, data: Data) -> tuple[Array, Array]:
        """Lower and upper amplitudes (p,) that are possible in a test."""
        return np.array([p.lower for p in self.amplitudes]), np.array([p.upper for p in self.amplitudes])

    def is_possible(self, data: Data, a: Any, shape: Any) -> bool:
        """Whether a body can have these amplitudes (p,) together, beyond the limits of each."""
        return True

    def is_told(self, data: Data, shape: Any) -> bool:
        """Whether a test can tell these shapes from farther ones; of several tests one that can is enough."""
        return True

    def missing(self, data: Data) -> str | None:
        """What the data lack for this effect to be tested ('time', 'unloading', ...), or None."""
        return None

    def excluded(self, data: Data) -> bool:
        """Whether the data measure what it guesses, or rule it out, so that it is no candidate."""
        return False

    def shape_values(self, data: Data) -> list[tuple[float, ...]]:
        """Shapes to be tried; one empty one for an effect without shapes."""
        return [()]

    def located(self, data: Data, shape: tuple[float, ...]) -> str:
        """Where in the picture its shape puts it, mm, in words; nothing where it has no place."""
        return ""

    def places(self, data: Data, X: Any, a: Any, shape: Any) -> Any:
        """True places of the nodes in the reference (n, 2), mm, of where they were measured, X (n, 2)."""
        return X

    def displacements(self, data: Data, u: Any, a: Any, shape: Any) -> Any:
        """Displacements (t, n, 2), mm, from the measured places of the reference to true places, of those to measured ones. At each node of its own
        displacement, but for what `rough` says; an effect may look at others in data.u, whose noise does not count there."""
        return u

    def adjoint(self, data: Data, places: Any, a: Any, shape: Any) -> Callable[[Array, Array], Array]:
        """Of a rough effect: the map of u (n, 2), mm, of an increment, and rows (r, n, 2) by displacements as the effect corrects them, to rows by those
        that it is given. places (n, 2), mm: of the reference, as `places` corrects them."""
        raise NotImplementedError

    def readings(self, data: Data, a: Any, shape: Any) -> Any:
        """Weights (t, t) of what is at all pictures (times, displacements, forces of the sections) in what is when the force of each is read."""
        return jnp.eye(len(data.u))

    def stress(self, data: Data, F: Any, P: Any, a: Any, shape: Any) -> Any:
        """In-plane first Piola-Kirchhoff stress (t, m, 2, 2), MPa, from the one so far, P; F (t, m, 2, 2), of an
        incompressible sheet.

        In plane strain F is the isochoric part, and P what it would be in such a sheet; see `calibrate.equations.isochoric`.
        """
        return P

    def stress_formed(self, data: Data, F: Any, formed: Any, a: Any, shape: Any) -> Any:
        """What an energy adds to P (t, m, 2, 2), MPa, where it is free of stress at the deformation `formed` (t, m, 2, 2)."""
        back = Tensors.of(formed).inverse
        found = self.stress(data, (Tensors.of(F) @ back).array, jnp.zeros_like(F), a, shape)
        return (Tensors.of(found) @ back.T).array

    def loads(self, data: Data, loads: Any, a: Any, shape: Any) -> Any:
        """True forces (t, 2, b), N, of the measured ones (t, 2, b) on the b loaded boundaries."""
        return loads


def distinct(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """The same effects, no two of one name: a model file knows them by it. Raises `ConfigError`."""
    seen: dict[str, Effect] = {}
    for effect in effects:
        other = seen.setdefault(effect.name, effect)
        if other is not effect:
            raise errors.ConfigError(
                f"two effects are named '{effect.name}': {_place(other)} and {_place(effect)}; give one of them another name"
            )
    return tuple(seen.values())


def _place(effect: Effect) -> str:
    return f"{type(effect).__module__}.{type(effect).__name__}"
