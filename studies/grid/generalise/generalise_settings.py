"""What fixes a study of generalisation: specimens, truths, camera, sets of tests that are calibrated together, networks.

In: values. Out: `GeneraliseSettings`, which a folder stores in ``run.json``, and the names of its files. Lengths in mm.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, fields
from itertools import product
from pathlib import Path
from typing import Any, Self

SHEETS = ("UT", "PS", "TTa", "TTb", "TTc", "TTd", "TTe", "TTf")
CROSS = "cross"
MEASURED = "measured"  # in place of a truth: tests that were measured
PAPER_SETS = (*SHEETS, "UT+TTd", "UT+TTe", "UT+TTf", "UT+PS")
SETS = (*PAPER_SETS, CROSS, f"UT+{CROSS}")
SIZES = ((1,), (8,), (2, 2), (4, 4), (16, 16))
MIDDLE = (4, 4)  # the size that the paper finds to suffice
INPUTS = ("I1", "I2", "I1I2")
ENOUGH_SEEDS = 5


@dataclass(frozen=True)
class GeneraliseSettings:
    """truths: names of materials, or `MEASURED`. sets: tests that are calibrated together, joined by '+'.

    nodes: of the camera on each specimen. margin: how far the region of interest ends before grips and free sides. noise:
    standard deviation of a displacement; correlation_length: of that; force_noise: half width of the factor on forces. spacing:
    of the virtual fields. starts: of each network. end_I1: up to which modes are predicted. as_width: also calibrate the middle
    size as the paper does, which takes the width that is seen for the width of the specimen.
    """

    study: str = "generalise"
    truths: tuple[str, ...] = ("arruda_boyce", "carroll")
    seeds: tuple[int, ...] = tuple(range(ENOUGH_SEEDS))
    sets: tuple[str, ...] = SETS
    inputs: tuple[str, ...] = INPUTS
    sizes: tuple[tuple[int, ...], ...] = SIZES
    starts: int = 5
    nodes: int = 1500
    increments: int = 10
    forward_size: float = 0.5
    margin: float = 2.5
    noise: float = 0.01
    correlation_length: float = 1.0
    force_noise: float = 1e-3
    spacing: float = 5.0
    end_I1: float = 17.0
    as_width: bool = True

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Settings of an output folder."""
        stored: dict[str, Any] = json.loads((folder / "run.json").read_text())["settings"]
        content = {f.name: _tuples(stored[f.name]) for f in fields(cls)}
        return cls(**content)

    @property
    def enough_seeds(self) -> int:
        """With fewer a run is a reduced one; a measured test has the noise that it has."""
        return 1 if self.truths == (MEASURED,) else ENOUGH_SEEDS

    @property
    def specimens(self) -> tuple[str, ...]:
        """Every specimen that some set has, in the order of the paper."""
        there = {name for joined in self.sets for name in joined.split("+")}
        return tuple(name for name in (*SHEETS, CROSS) if name in there)

    @property
    def cases(self) -> Iterator[tuple[str, int, str]]:
        """(truth, seed, inputs) of every job of calibrations."""
        return product(self.truths, self.seeds, self.inputs)

    def case_path(self, folder: Path, truth: str, seed: int, inputs: str) -> Path:
        """Where the calibrations of a job are."""
        return folder / "cases" / f"{truth}_{seed}_{inputs}.json"

    def width_path(self, folder: Path, truth: str) -> Path:
        """Where the calibrations with the width that is seen are, of the first seed."""
        return folder / "cases" / f"{truth}_width.json"

    def clean_path(self, folder: Path, truth: str, specimen: str) -> Path:
        """Where the Experiment without noise, or the measured one, is."""
        return folder / "clean" / f"{truth}_{specimen}.npz"

    def targets(self, folder: Path) -> list[Path]:
        """Every file that the report needs."""
        paths = [self.case_path(folder, *case) for case in self.cases]
        paths += [folder / "states" / f"{truth}.npz" for truth in self.truths]
        return paths + [self.width_path(folder, truth) for truth in self.truths if self.as_width]


def _tuples(value: Any) -> Any:
    """Lists as tuples, all the way down."""
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
