"""Every number of a blind trial, and the specimens it chooses from."""

from __future__ import annotations

from dataclasses import dataclass

from forward.materials import Material
from meshes import Cross, PlateWithHole, Specimen
from studies.trials.blind_effects import Hidden

CROSS_SCALE = 0.25
FIELD_RESOLUTION = 512  # of the fields of noise, grid points a side
SPECIMENS: dict[str, Specimen] = {
    "cross": Cross(**{name: CROSS_SCALE * value for name, value in Cross().dimensions().items()}),
    "plate": PlateWithHole(half_length=30, half_width=15, far_size=3, hole_radius=5, hole_size=0.8),
    "wide plate": PlateWithHole(half_length=25, half_width=20, far_size=3, hole_radius=8, hole_size=1.0),
}


@dataclass(frozen=True)
class ForeignNoise:
    """Of a foreign trial. common: share of the variance of the displacement noise that all pictures have in common, half of it with the
    pattern, half with the reference; stated: what the Experiment states, over what is there; None: it states none."""

    common: float
    stated: float | None


@dataclass(frozen=True)
class Trial:
    """Every number of a trial. Lengths in mm, times in s.

    stretch: nominal, of the specimen; factors, times: load factor and time of each increment; displacement_std and
    correlation_length of the noise; force_relative: std of a force over its size; force_floor: over the largest. foreign: forms and noise that
    are not those of the catalogue, see `studies.trials.foreign`.
    """

    seed: int
    specimen: str
    material: Material
    thickness: float
    stretch: float
    factors: tuple[float, ...]
    times: tuple[float, ...]
    effects: tuple[Hidden, ...]
    displacement_std: float
    correlation_length: float
    force_relative: float
    force_floor: float
    foreign: ForeignNoise | None = None

    @property
    def displacement(self) -> float:
        """Of each grip at load factor 1, mm."""
        return (self.stretch - 1) * SPECIMENS[self.specimen].half_extent[0]
