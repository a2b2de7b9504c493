"""`equigap import`: measured full-field data to an Experiment.

In: a published sheet by name, a packed ``.npz``, a folder of DIC frames with a machine record, or a column map
(TOML). Out: a folder with ``experiment.npz``, a picture of it, and a manifest with every decision taken.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from calibrate import errors
from calibrate.data.experiment import Experiment, Noise
from studies.commands.option_types import CountOrList, OutputFolder, Overwrite, default_folder
from studies.commands.outcome import Outcome
from studies.importers import column_import, column_map, measured_data, printed_sheets
from studies.importers.missing_frames import with_missing_frames
from studies.importers.printed_sheets import SheetOptions
from studies.importers.series import Series, to_experiment
from studies.importers.synchronise import Selection
from studies.output import Manifest, open_output_folder
from studies.output.viewer import write_viewer_file
from studies.reports.experiments.import_report import picture, report_lines, summary, write_report

SHEETS_ONLY = "not for column maps, which say this in the TOML"
SOURCE = (
    f"a published sheet ({', '.join(measured_data.SHEETS)}), a packed .npz, a folder of frames, or a column map .toml"
)


@Parameter(name="*", group=f"Which frames ({SHEETS_ONLY})")
@dataclass(frozen=True)
class Frames:
    """Which frames become increments."""

    frames: CountOrList = 12
    """how many, spread evenly over the loading, or frame numbers with commas between"""
    until: float | None = None
    """last time used, s on the clock of the machine"""
    tare: float | None = None
    """force that counts as zero, N (default: that of frame 0)"""

    @property
    def selection(self) -> Selection:
        """The same as the importers take it. Raises `ConfigError`."""
        if isinstance(self.frames, int):
            return Selection(count=self.frames, until=self.until, tare=self.tare)
        return Selection(frames=tuple(self.frames), until=self.until, tare=self.tare)


@Parameter(name="*", group=f"Noise, default: estimated from all frames ({SHEETS_ONLY})")
@dataclass(frozen=True)
class NoiseChoice:
    """Noise, estimated or stated."""

    noise: Literal["total", "temporal"] = "total"
    """estimate all errors of a frame, or only those that change from frame to frame"""
    displacement_std: float | None = None
    """state the noise instead of estimating it, mm"""
    correlation_length: float = 0.0
    """of the stated noise, mm"""
    force_std: float = 0.0
    """of the stated noise, N"""

    @property
    def stated(self) -> Noise | None:
        """The noise that is stated, None where it is to be estimated."""
        if self.displacement_std is None:
            return None
        return Noise(self.displacement_std, self.correlation_length, 0.0, self.force_std)


@dataclass(frozen=True)
class Request:
    """All options of an import beside its source."""

    name: str | None = None
    record: Path | None = None
    frames: Frames = field(default_factory=Frames)
    sheet: SheetOptions = field(default_factory=SheetOptions)
    noise: NoiseChoice = field(default_factory=NoiseChoice)

    def given(self) -> list[str]:
        """Names of the options that differ from their default."""
        usual = Request()
        names = [name for name in ("name", "record") if getattr(self, name) != getattr(usual, name)]
        for part in ("frames", "sheet", "noise"):
            mine, default = getattr(self, part), getattr(usual, part)
            names += [f.name for f in fields(mine) if getattr(mine, f.name) != getattr(default, f.name)]
        return names


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


def import_data(
    source: Annotated[str, Parameter(help=SOURCE)],
    /,
    *,
    name: str | None = None,
    record: Path | None = None,
    frames: Frames = Frames(),
    sheet: Annotated[SheetOptions, Parameter(name="*", group=f"Sheets in pixels ({SHEETS_ONLY})")] = SheetOptions(),
    noise: NoiseChoice = NoiseChoice(),
    output: OutputFolder = None,
    overwrite: Overwrite = False,
) -> Imported:
    """Read measured full-field data into an Experiment (docs/import.md).

    The folder is results/import-NAME unless told.

    Args:
        name: of the experiment (default: from the source; not for column maps)
        record: machine record (CSV: Time, Displacement, Force) of a folder

    Raises:
        EquigapError: whatever the reader of the source and `series.to_experiment` find.
    """
    series, selection, stated, kind, inputs = read(str(source), Request(name, record, frames, sheet, noise))
    experiment = to_experiment(series, selection, stated, kind)
    settings = {"source": source, "name": name, "record": record, **asdict(frames), **asdict(sheet), **asdict(noise)}
    folder = open_output_folder(
        output or default_folder(f"import-{experiment.name}"), overwrite, {"study": "import", **settings}
    )
    manifest = Manifest(settings=settings, inputs=inputs)
    target = folder / "experiment.npz"
    experiment.save(target)
    write_viewer_file(experiment, target.with_suffix(".vtu"))
    picture(experiment, series, folder / "experiment.png")
    manifest.beside(target, folder / "experiment.png", **summary(experiment))
    return Imported(experiment, target, write_report(experiment, folder, manifest))


def import_experiment(source: str | Path, **options: Any) -> Experiment:
    """The Experiment that `equigap import SOURCE` makes. options: fields of `Request`.

    Raises whatever the reader of the source and `series.to_experiment` find.
    """
    series, selection, noise, kind, _ = read(str(source), Request(**options))
    return to_experiment(series, selection, noise, kind)


Read = tuple[Series, Selection, Noise | None, str, list[Path]]


def read(text: str, request: Request) -> Read:
    """Whatever a source names, as a Series, with what is to be made of it and the files that were read.

    Raises `FileFormatError`, `DataNotFoundError`, `MissingForceError`, `ConfigError`.
    """
    source = Path(text)
    if source.suffix == ".toml":
        return _read_map(request, source)
    if source.is_file() and source.suffix != ".npz":
        raise errors.FileFormatError(f"{source}: give a packed .npz, a folder of frames, or a column map .toml")
    reader = _read_packed
    if text in measured_data.SHEETS and not source.exists():
        source = measured_data.sheet(text)
    elif source.is_dir():
        reader = _read_folder
    elif source.suffix != ".npz":
        raise errors.DataNotFoundError(
            f"{source}: neither a published sheet ({', '.join(measured_data.SHEETS)}) nor a file or folder that exists"
        )
    frames, record, inputs = reader(source, request.record)
    series = printed_sheets.sheet_series(frames, record, request.sheet, request.name or source.stem)
    series.provenance["source"] = source.name
    series = with_missing_frames(series)
    return series, request.frames.selection, request.noise.stated, request.noise.noise, inputs


def _read_packed(source: Path, record_file: Path | None) -> tuple[Any, Any, list[Path]]:
    frames, record = printed_sheets.read_packed(source)
    inputs = [source]
    if record_file is not None:
        record = printed_sheets.read_record(record_file)
        inputs.append(record_file)
    if record is None:
        raise errors.MissingForceError(f"{source} holds no force record; give one with --record")
    return frames, record, inputs


def _read_folder(source: Path, record_file: Path | None) -> tuple[Any, Any, list[Path]]:
    if record_file is None:
        record_file = source / "force_disp.csv"
        if not record_file.is_file():
            raise errors.MissingForceError(f"{source} holds no force_disp.csv; give the machine record with --record")
    record = printed_sheets.read_record(record_file)
    return printed_sheets.read_frames(source), record, [*printed_sheets.frame_files(source), record_file]


def _read_map(request: Request, source: Path) -> Read:
    for name in request.given():
        raise errors.ConfigError(
            f"--{name.replace('_', '-')} is not for a column map; say it in {source.name} (docs/import.md)"
        )
    columns = column_map.read_map(source)
    series = column_import.column_series(columns, source.parent)
    series.provenance.update(source=source.name, map=columns.model_dump())
    if columns.frames.rate_hz is not None:
        series = with_missing_frames(series)
    return series, columns.selection, columns.stated_noise, columns.noise.kind, [source]
