"""`equigap import`: measured full-field data to an Experiment.

In: a published sheet by name, a packed ``.npz``, a folder of DIC frames with a machine record, or a column map
(TOML), or a folder as a DIC program exported it. Out: a folder with ``experiment.npz``, a picture of it, a manifest with every
decision taken, and the column map that was found.
`equigap unpack`: a packed test between two pads to tables of columns and a column map, to be changed and imported.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from cyclopts import Parameter

from calibrate import errors
from calibrate.data.experiment import Experiment
from studies.commandline.option_types import CountOrList, OutputFolder, Overwrite, default_folder
from studies.commandline.outcome import Outcome
from studies.importers import Importer, Processing, Recording, SheetOptions, importer_of, importers, measured_data
from studies.importers.exports.guesses import Guesses, Undecided
from studies.importers.pad_tracks import write_tables
from studies.importers.recording.importer import Answers, Part
from studies.importers.recording.stated_noise import StatedNoise
from studies.importers.recording.synchronise import Selection
from studies.output import Manifest, open_output_folder
from studies.output.viewer import write_viewer_file
from studies.output.writing import write_text
from studies.reports.experiments.import_report import picture, report_lines, summary, write_report

SHEETS_ONLY = "not for column maps, which say this in the TOML"
MAP = "column_map.toml"
SOURCE = ", ".join(importer.source for importer in importers())


@Parameter(name="*", group=f"Which frames ({SHEETS_ONLY})")
@dataclass(frozen=True)
class Frames:
    """Which frames become increments."""

    frames: CountOrList = "all"
    """all under load, how many, spread evenly over the loading, or frame numbers with commas between"""
    until: float | None = None
    """last time used, s on the clock of the machine"""
    tare: float | None = None
    """force that counts as zero, N (default: that of frame 0)"""

    @property
    def selection(self) -> Selection:
        """The same as the importers take it. Raises `ConfigError`."""
        if isinstance(self.frames, tuple):
            return Selection(frames=self.frames, until=self.until, tare=self.tare)
        return Selection(count=None if self.frames == "all" else self.frames, until=self.until, tare=self.tare)


@Parameter(name="*", group=f"Noise, default: estimated from all frames ({SHEETS_ONLY})")
@dataclass(frozen=True)
class NoiseChoice:
    """Noise, estimated where it is not stated."""

    noise: Literal["total", "temporal"] = "total"
    """estimate all errors of a frame, or only those that change from frame to frame"""
    displacement_std: float | None = None
    """of the displacements, stated instead of estimated, mm"""
    correlation_length: float | None = None
    """of the stated noise of the displacements, mm (default: 0)"""
    force_std: float | None = None
    """of the forces, stated instead of estimated, N"""

    @property
    def stated(self) -> StatedNoise:
        """The noise as far as it is stated. Raises `ConfigError`."""
        return StatedNoise(self.displacement_std, self.correlation_length, self.force_std)


@dataclass(frozen=True)
class Request:
    """All options of an import beside its source."""

    name: str | None = None
    record: Path | None = None
    frames: Frames = field(default_factory=Frames)
    sheet: SheetOptions = field(default_factory=SheetOptions)
    noise: NoiseChoice = field(default_factory=NoiseChoice)
    answers: Answers = field(default_factory=Answers)

    def given(self, part: Part) -> dict[str, Any]:
        """Options of a part that differ from their defaults, by name."""
        mine, usual = self.options(part), Request().options(part)
        return {name: value for name, value in mine.items() if value != usual[name]}

    def options(self, part: Part) -> dict[str, Any]:
        """All options of a part, by name."""
        value = getattr(self, part)
        return {f.name: getattr(value, f.name) for f in fields(value)} if is_dataclass(value) else {part: value}


@dataclass(frozen=True)
class Imported(Outcome):
    """An Experiment that was read. path: of its file."""

    experiment: Experiment
    path: Path
    report: Path

    def lines(self) -> Iterable[str]:
        """What was read, and the files."""
        yield from report_lines(self.experiment, self.path)
        yield f"report: {self.report}"


@dataclass(frozen=True)
class SeveralImported(Outcome):
    """Experiments of one TOML file."""

    tests: tuple[Imported, ...]

    def lines(self) -> Iterable[str]:
        """Those of every test."""
        for one in self.tests:
            yield from one.lines()


def import_data(
    source: Annotated[str, Parameter(help=SOURCE)],
    /,
    *,
    name: str | None = None,
    record: Path | None = None,
    frames: Frames = Frames(),
    sheet: Annotated[SheetOptions, Parameter(name="*", group=f"Sheets in pixels ({SHEETS_ONLY})")] = SheetOptions(),
    noise: NoiseChoice = NoiseChoice(),
    answers: Annotated[
        Answers, Parameter(name="*", group="What an export leaves open (folders of DIC programs)")
    ] = Answers(),
    output: OutputFolder = None,
    overwrite: Overwrite = False,
) -> Imported | SeveralImported:
    """Read measured full-field data into an Experiment (docs/import.md).

    The folder is results/import-NAME unless told.

    Args:
        name: of the experiment (default: from the source; not for column maps)
        record: machine record (CSV: Time, Displacement, Force) of a folder

    Raises:
        EquigapError: whatever the reader of the source and `series.to_experiment` find.
    """
    request = Request(name, record, frames, sheet, noise, answers)
    parts = importer_of(source).parts(source)
    if parts:
        folder = Path(output or default_folder(f"import-{Path(source).stem}"))
        return SeveralImported(
            tuple(import_one(part, request, folder / part.partition("#")[2], overwrite) for part in parts)
        )
    return import_one(source, request, output, overwrite)


def import_one(source: str, request: Request, output: Path | None, overwrite: bool = False) -> Imported:
    """Read one test and write its folder. Raises what `import_data` does."""
    noise = request.noise
    try:
        importer, recording = read(source, request)
    except Undecided as error:
        raise _with_draft(
            error, Path(output) if output else default_folder(f"import-{error.guesses.get('name')}"), overwrite
        ) from error
    experiment = recording.experiment(Processing(request.frames.selection, noise.stated, noise.noise))
    settings: dict[str, Any] = {"source": source}
    for part in importer.takes:
        settings |= request.options(part)
    folder = open_output_folder(
        output or default_folder(f"import-{experiment.name}"), overwrite, {"study": "import", **settings}
    )
    manifest = Manifest(settings=settings, inputs=recording.inputs)
    target = folder / "experiment.npz"
    experiment.save(target)
    write_viewer_file(experiment, target.with_suffix(".vtu"))
    picture(experiment, recording.series, folder / "experiment.png")
    manifest.beside(target, folder / "experiment.png", **summary(experiment))
    if recording.guesses is not None:
        complete = _with_choices(recording.guesses, request)
        write_text(folder / MAP, complete.toml(folder.resolve()))
        manifest.beside(folder / MAP)
    return Imported(experiment, target, write_report(experiment, folder, manifest))


def _with_draft(error: Undecided, folder: Path, overwrite: bool) -> Undecided:
    """The same error, after what was found so far was written beside the output folder, to be completed by hand; an earlier one stays
    unless it is to be replaced."""
    place = folder.with_name(f"{folder.name}-{MAP}")
    if overwrite or not place.exists():
        place.parent.mkdir(parents=True, exist_ok=True)
        write_text(place, error.guesses.toml(place.parent.resolve()))
    return error.written(place)


def _with_choices(found: Guesses, request: Request) -> Guesses:
    """The column map with the frames and the noise that were chosen on the command line."""
    chosen, noise, why = request.frames.selection, request.noise, "chosen by the user, or the default"
    for key, value in (
        ("frames.count", None if chosen.frames else chosen.count),
        ("frames.list", chosen.frames and list(chosen.frames)),
        ("frames.until_s", chosen.until),
        ("frames.tare_N", chosen.tare),
        ("noise.kind", noise.noise),
        ("noise.displacement_std_mm", noise.displacement_std),
        ("noise.correlation_length_mm", noise.correlation_length),
        ("noise.force_std_N", noise.force_std),
    ):
        if value is not None:
            found.say(key, value, why)
    return found


@dataclass(frozen=True)
class Unpacked(Outcome):
    """Tables that were written. columns: the column map."""

    columns: Path

    def lines(self) -> Iterable[str]:
        """Where the map is, and what reads it."""
        yield f"tables and column map: {self.columns}"
        yield f"next: equigap import {self.columns}"


def unpack(
    packed: Path, /, *, name: str | None = None, output: OutputFolder = None, overwrite: Overwrite = False
) -> Unpacked:
    """Write a packed test between two pads as tables of columns, with a column map to be changed (docs/ugly_data.md).

    The folder is results/unpack-NAME unless told.

    Args:
        packed: .npz with xt_dic_mm, xt_pad_mov_mm, ux_pad_mm and fx_pad_N; also by its path in EQUIGAP_DATA
        name: of the experiment (default: that of the file)

    Raises:
        EquigapError: no such file, or another one.
    """
    settings = {"command": "unpack", "name": name, "packed": str(packed)}
    packed = packed if packed.is_file() else measured_data.find(str(packed))
    folder = open_output_folder(output or default_folder(f"unpack-{name or packed.stem}"), overwrite, settings)
    columns = write_tables(packed, folder, name)
    Manifest(settings=settings, inputs=[packed]).beside(columns)
    return Unpacked(columns)


def import_experiment(source: str | Path, **options: Any) -> Experiment:
    """The Experiment that `equigap import SOURCE` makes. options: fields of `Request`.

    Raises whatever the reader of the source and `series.to_experiment` find.
    """
    request = Request(**options)
    _, recording = read(str(source), request)
    return recording.experiment(Processing(request.frames.selection, request.noise.stated, request.noise.noise))


def read(source: str, request: Request) -> tuple[Importer, Recording]:
    """The importer of a source, and what it reads. Raises its errors, `ConfigError` for options that it does not take."""
    importer = importer_of(source).answered(request.answers)
    for part in get_args(Part.__value__):
        for name in request.given(part) if part not in importer.takes else ():
            raise errors.ConfigError(f"--{name.replace('_', '-')} is not for {importer.source}; {importer.instead}")
    return importer, importer.read(source, request.sheet, request.name, request.record)
