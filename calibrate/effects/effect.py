"""What an effect is: one small thing a model may lack, as a differentiable change of the chain from images to forces.

The chain of an Experiment is displacements -> deformation gradients -> stresses -> virtual work - measured forces. An
effect may change any link; with its amplitudes at their null value nothing changes, exactly. Amplitudes are what is
tested and fitted; shapes (a relaxation time, an angle) mean nothing at the null value, so that a few of them are tried.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from calibrate import kinematics
from calibrate.experiment import Experiment

Array = NDArray[np.float64]
STAGES = ("material", "kinematics", "measurement", "load")


@dataclass(frozen=True)
class Parameter:
    """An amplitude or shape. null: no effect. lower, upper: physically admissible. typical: of a strong effect."""

    name: str
    unit: str
    null: float = 0.0
    lower: float = -np.inf
    upper: float = np.inf
    typical: float = 0.1


@dataclass(frozen=True, eq=False)
class Data:
    """An Experiment prepared for the chain, as arrays.

    points (n, 2), triangles (m, 3), slopes (m, 3, 2) 1/mm, areas (m,) mm^2, centroids (m, 2), u (t, n, 2) mm,
    time (t,) s or None, thickness mm (1 where unknown), free (n,): node on a free edge, size: extent, mm.
    """

    experiment: Experiment
    points: Any
    triangles: Any
    slopes: Any
    areas: Any
    centroids: Any
    u: Any
    time: Any
    thickness: float
    free: Any
    size: float

    @classmethod
    def of(cls, experiment: Experiment) -> Data:
        """Prepare an Experiment."""
        slopes, areas = kinematics.shape_gradients(experiment.points, experiment.triangles)
        free = np.zeros(len(experiment.points), bool)
        free[experiment.free_nodes] = True
        centroids = experiment.points[experiment.triangles].mean(axis=1)
        return cls(
            experiment,
            jnp.asarray(experiment.points),
            jnp.asarray(experiment.triangles),
            jnp.asarray(slopes),
            jnp.asarray(areas),
            jnp.asarray(centroids),
            jnp.asarray(experiment.displacements),
            None if experiment.time is None else np.asarray(experiment.time),
            experiment.thickness or 1.0,
            free,
            float(np.ptp(experiment.points, axis=0).max()),
        )


@dataclass(frozen=True)
class Effect:
    """Base of the effects; a subclass states its class variables and overrides the links it changes.

    name; stage: one of STAGES; formula: for the report; amplitudes; shapes; gauge: why it can never be told apart
    from another quantity, or nothing.
    """

    name: ClassVar[str]
    stage: ClassVar[str]
    formula: ClassVar[str]
    amplitudes: ClassVar[tuple[Parameter, ...]]
    shapes: ClassVar[tuple[Parameter, ...]] = ()
    gauge: ClassVar[str] = ""
    decided_by: ClassVar[str] = ""

    def missing(self, data: Data) -> str | None:
        """What the data lack for this effect to be tested ('time', 'unloading', ...), or None."""
        return None

    def shape_values(self, data: Data) -> list[tuple[float, ...]]:
        """Shapes to be tried; one empty one for an effect without shapes."""
        return [()]

    def displacements(self, data: Data, u: Any, a: Any, shape: Any) -> Any:
        """True displacements (t, n, 2), mm, of the measured ones."""
        return u

    def stress(self, data: Data, F: Any, P: Any, a: Any, shape: Any, law: Any) -> Any:
        """In-plane first Piola-Kirchhoff stress (t, m, 2, 2) from the one so far, P; F (t, m, 2, 2).

        law: the base model's stress (2, 2) at one deformation gradient (2, 2).
        """
        return P

    def loads(self, data: Data, loads: Any, boundary: Any, a: Any, shape: Any) -> Any:
        """True forces of the rows (t, 2, v), N, of the measured ones; boundary (v,): whether the field carries a load."""
        return loads
