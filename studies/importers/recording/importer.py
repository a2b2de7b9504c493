"""What an importer is: it recognises a source, and reads it into a `Recording`. One vendor or layout, one file.

A class in a module of `studies/importers` that derives from `Importer` is found by `studies.importers.importer_of`; so is one
that a script defines.
"""

from __future__ import annotations

import zipfile
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal, get_args

from calibrate import errors
from calibrate.data.experiment import Experiment
from studies.commandline.option_types import Names
from studies.importers.exports.frame_order import Rule
from studies.importers.exports.guesses import Guesses
from studies.importers.map_tables import ForceUnit, LengthUnit, TimeUnit
from studies.importers.masking.masks import SIDES
from studies.importers.recording.series import Series, to_experiment
from studies.importers.recording.stated_noise import StatedNoise
from studies.importers.recording.synchronise import DEFAULT_SELECTION, Selection

type EdgeColumns = Literal["extrapolate", "drop", "keep"]
type FreeEdges = Literal["auto", "yes", "no"]
type Part = Literal["name", "record", "frames", "sheet", "noise", "answers"]
type NoiseKind = Literal["total", "temporal"]
SCALE_MM_PER_PIXEL = 0.0432


@dataclass(frozen=True)
class SheetOptions:
    """How pixels become a specimen. Raises `ConfigError` for what cannot be.

    edge_columns: 'extrapolate' replaces the displacements of the unreliable columns by a quadratic through the next seven of the
    same row, so that the sheet keeps its width; 'drop' leaves a strip unmeasured; 'keep' trusts them. free_edges: 'auto' = yes
    (the true edge is there, or at most two pitches away); 'no' makes them the rim of the measured region.
    """

    scale: float | None = None
    """mm per pixel (default: 0.0432 for printed sheets)"""
    frame_rate: float | None = None
    """frames per second (default: as the files state; printed sheets: 5)"""
    offset: float = 0.0
    """time of frame 0 on the clock of the machine, s"""
    drop_rows: int = 2
    """unreliable rows a side"""
    drop_columns: int = 2
    """unreliable columns a side"""
    edge_columns: EdgeColumns = "extrapolate"
    """unreliable columns are replaced from their neighbours, left out, or trusted"""
    free_edges: FreeEdges = "auto"
    """whether the left and right rim carry no traction (auto: yes)"""
    thickness: float | None = None
    """mm (default: unknown)"""

    def __post_init__(self) -> None:
        for name, choices in (
            ("edge_columns", get_args(EdgeColumns.__value__)),
            ("free_edges", get_args(FreeEdges.__value__)),
        ):
            if getattr(self, name) not in choices:
                raise errors.ConfigError(f"{name} '{getattr(self, name)}' unknown; choose one of {', '.join(choices)}")
        for option, value, unit in (("--scale", self.scale, "mm per pixel"), ("--frame-rate", self.frame_rate, "Hz")):
            if value is not None and not value > 0:
                raise errors.ConfigError(f"{option} {value:g}: must be positive ({unit})")
        if self.drop_rows < 0 or self.drop_columns < 0:
            raise errors.ConfigError("numbers of rows and columns to drop cannot be negative")


@dataclass(frozen=True)
class Answers:
    """What an export of a DIC program may leave open."""

    files: str | None = None
    """pattern of the files that are frames, such as 'frame*.csv'"""
    order: Rule = "auto"
    """of the frames, where several numbers of their names disagree: natural, from left to right"""
    step: float | None = None
    """distance of the points of a matrix, mm"""
    unit: LengthUnit | None = None
    """of positions and displacements"""
    y_axis: Literal["up", "down"] | None = None
    """which way y of the export points"""
    loaded: Names = ()
    """gripped sides: left, right, bottom, top"""
    free: Names = ()
    """traction-free sides, and holes"""
    force_column: str | None = None
    """column of the force in the machine record"""
    time_column: str | None = None
    """column of the time in the machine record"""
    force_unit: ForceUnit | None = None
    """of the machine record"""
    time_unit: TimeUnit | None = None
    """of the machine record"""

    def __post_init__(self) -> None:
        for name, value in (("loaded", self.loaded), ("free", self.free)):
            for side in value:
                if side not in SIDES and (name, side) != ("free", "holes"):
                    raise errors.ConfigError(
                        f"--{name} {side}: unknown; choose of {', '.join((*SIDES, *(['holes'] if name == 'free' else [])))}"
                    )
        if self.step is not None and not self.step > 0:
            raise errors.ConfigError(f"--step {self.step:g}: the distance of the points must be positive")


@dataclass(frozen=True)
class Processing:
    """What is made of a Series. selection: which frames; noise: as far as it is stated; the rest is estimated, as
    noise_kind says."""

    selection: Selection = DEFAULT_SELECTION
    noise: StatedNoise | None = None
    noise_kind: NoiseKind = "total"


@dataclass(frozen=True)
class Recording:
    """What an importer reads. inputs: files that were read. processing: as the source states it; None: the user chooses.
    guesses: the column map that was found, where there is one."""

    series: Series
    inputs: tuple[Path, ...]
    processing: Processing | None = None
    guesses: Guesses | None = None

    def experiment(self, processing: Processing = Processing()) -> Experiment:
        """The Experiment. Raises whatever `to_experiment` finds."""
        chosen = self.processing or processing
        return to_experiment(self.series, chosen.selection, chosen.noise, chosen.noise_kind)


class Importer(ABC):
    """One vendor or layout. source: its sources in words; looks_for: what of its content tells one, for an error.

    takes: parts of the command's options that it makes use of; others are refused, with `instead`, and not recorded.
    """

    source: ClassVar[str]
    looks_for: ClassVar[str] = ""
    takes: ClassVar[tuple[Part, ...]] = ("name", "record", "frames", "sheet", "noise")
    instead: ClassVar[str] = "leave it out"

    def answered(self, answers: Answers) -> Importer:
        """The same with answers to what no file states, where it takes them."""
        return self

    def parts(self, source: str) -> tuple[str, ...]:
        """Sources of the tests that one holds; none where it is one test."""
        return ()

    @abstractmethod
    def reads(self, source: str) -> bool:
        """Whether a source, as given on the command line, is one of these, by what is in it; no other importer may say so too."""

    @abstractmethod
    def read(self, source: str, options: SheetOptions, name: str | None, record: Path | None) -> Recording:
        """Read it. name: of the experiment, None: from the source; record: machine record in a file of its own.

        Raises the named errors of `calibrate.errors`.
        """


def arrays_in(source: str | Path) -> frozenset[str]:
    """Names of the arrays in a ``.npz``; none where it is no such file."""
    if Path(source).suffix != ".npz" or not zipfile.is_zipfile(source):
        return frozenset()
    with zipfile.ZipFile(source) as content:
        return frozenset(name.removesuffix(".npy") for name in content.namelist())
