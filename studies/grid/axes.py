"""The grid of a study: which specimens, thicknesses, resolutions, noises and seeds are combined, and what fixes each case.

In: values of the axes, as they stand in file names. Out: `Settings`, which a folder stores in ``run.json``, and `Case`, one
calibration. Thickness in mm, or `PLANE`; resolution in percent of the camera's nodes; noise: standard deviation of a
displacement in mm; seed: a number, or `CLEAN` where the noise is 0.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import astuple, dataclass, fields
from enum import StrEnum
from itertools import product
from pathlib import Path
from typing import Any, Self

from meshes.known_specimens import SPECIMENS

PLANE = "2D"
PLANE_THICKNESS = 1.0  # mm
CLEAN = "clean"
LEAST_NODES = 800
# mm at each grip by default, of the specimens that rigid grips can hold
EXTENT = {name: kind.displacement for name, kind in SPECIMENS.items() if kind.displacement is not None}


class Loss(StrEnum):
    """How a case is calibrated. POLISHED: the default loss, then a polish; CORRECTED: the default loss on displacements of the mean over the
    thickness."""

    WEIGHTED = "weighted"
    POLISHED = "polished"
    CORRECTED = "thickness-corrected"
    FROZEN = "paper-frozen"
    DEPENDENT = "paper-dependent"


@dataclass(frozen=True)
class Case:
    """One calibration, as `Settings` name it."""

    specimen: str
    thickness: str
    resolution: str
    noise: str
    seed: str

    @property
    def noisy(self) -> bool:
        """Whether the camera of this case has noise."""
        return float(self.noise) > 0

    @property
    def record(self) -> str:
        """Noise and seed, as used in file names."""
        return f"{self.noise}_{self.seed}"

    def path(self, folder: Path) -> Path:
        """Where its result is."""
        return folder / "cases" / self._file(".json")

    def experiment(self, folder: Path) -> Path:
        """Where its Experiment is, in studies that keep it."""
        return folder / "experiments" / self._file(".npz")

    def _file(self, suffix: str) -> Path:
        return Path(self.specimen, "_".join(astuple(self)[1:]) + suffix)


@dataclass(frozen=True)
class Settings:
    """What fixes the results of a study. study: its name.

    nodes: of the camera at 100 %. losses: fitted to every case; the dependent scaling only to clean data and the first
    `dependent_seeds` seeds, the correction only to what is thick, the polish only at the resolutions `polished`. inputs, layers, starts: of the network. displacement: of
    each arm of the cross, mm; other specimens in proportion (`EXTENT`). forward_size: of the elements relative to the
    default; extra_layers: of hexes in half the thickness. normalisation: of the random field. batch: seeds a job fits.

    plane_reference: the 2D solution is the reference of every thickness: models are judged in its calibrated range and at
    its states, surfaces are compared with it. keep_all: solids, Experiments, curves and covariances stay in the folder.
    record_failures: data that cannot be calibrated are a result and end no job.
    """

    study: str = "study"
    specimens: tuple[str, ...] = ("cross",)
    thicknesses: tuple[str, ...] = (PLANE,)
    resolutions: tuple[str, ...] = ("100",)
    noises: tuple[str, ...] = ("0", "0.1")
    seeds: tuple[int, ...] = tuple(range(10))
    nodes: int = 5000
    losses: tuple[Loss, ...] = (Loss.WEIGHTED,)
    dependent_seeds: int = 0
    polished: tuple[str, ...] = ()
    inputs: str = "I1"
    layers: tuple[int, ...] = (4, 4)
    starts: int = 20
    displacement: float = 60.0
    increments: int = 10
    forward_size: float = 1.0
    extra_layers: int = 0
    normalisation: str = "unit-variance"
    batch: int = 1
    plane_reference: bool = False
    keep_all: bool = True
    record_failures: bool = False

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Settings of an output folder."""
        stored: dict[str, Any] = json.loads((folder / "run.json").read_text())["settings"]
        content = {f.name: stored[f.name] for f in fields(cls)}
        content = {name: tuple(value) if isinstance(value, list) else value for name, value in content.items()}
        return cls(**{**content, "losses": tuple(map(Loss, content["losses"]))})

    @property
    def cases(self) -> list[Case]:
        """Every combination; clean data (noise 0) have no seed, so they are one case instead of one a seed."""
        kinds = product(self.specimens, self.thicknesses, self.resolutions, self.records())
        return [Case(s, h, r, noise, seed) for s, h, r, (noise, seed) in kinds]

    def records(self) -> list[tuple[str, str]]:
        """(noise, seed) of every record of a surface."""
        return [(noise, seed) for noise in self.noises for seed in self._seeds_with(noise)]

    def _seeds_with(self, noise: str) -> list[str]:
        return [CLEAN] if float(noise) == 0 else list(map(str, self.seeds))

    def batches(self) -> list[list[str]]:
        """Records that one job calibrates, 'NOISE_SEED' each; as many in one as in another, or one less."""
        records = ["_".join(record) for record in self.records()]
        count = -(-len(records) // self.batch)
        return [records[k::count] for k in range(count)]

    @property
    def solids(self) -> Iterator[tuple[str, str]]:
        """(specimen, thickness) of every 3D solution."""
        return ((s, h) for s in self.specimens for h in self.thicknesses if h != PLANE)

    def losses_of(self, case: Case) -> tuple[Loss, ...]:
        """Losses that a case is fitted with."""
        few = [CLEAN, *map(str, self.seeds[: self.dependent_seeds])]
        left_out = {Loss.CORRECTED} if case.thickness == PLANE else set()
        if case.resolution not in self.polished:
            left_out.add(Loss.POLISHED)
        if case.seed not in few:
            left_out.add(Loss.DEPENDENT)
        return tuple(loss for loss in self.losses if loss not in left_out)

    def pull(self, specimen: str) -> float:
        """Displacement of each grip of a specimen, mm."""
        return self.displacement * EXTENT[specimen] / EXTENT["cross"]

    def solid_memory(self, ranks: int = 1) -> int:
        """MB for a 3D solution: half as much again as 40 mm took at the default size (0.9 GB), and in proportion.

        A factorisation grows a little faster than the number of elements.
        """
        return round(1500 * self.forward_size ** (-7 / 3) * (1 + self.extra_layers / 5) + 300 * (ranks - 1))

    @property
    def fit_memory(self) -> int:
        """MB for a calibration; the paper's loss needs more."""
        return 1500 if self.losses == (Loss.WEIGHTED,) else 2500

    def targets(self, folder: Path) -> list[Path]:
        """Every file that the report needs."""
        paths = [case.path(folder) for case in self.cases]
        if self.plane_reference:
            paths += [folder / "epsilon" / f"{specimen}_{thickness}.npz" for specimen, thickness in self.solids]
            paths += [folder / "states" / f"{specimen}.npz" for specimen in self.specimens]
        return paths
