"""`equigap import`: measured full-field data to an Experiment.

In: a published sheet by name, a packed ``.npz``, a folder of DIC frames with a machine record, or a column map
(TOML). Out: a folder with ``experiment.npz``, a picture of it, and a manifest with every decision taken.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from calibrate import errors
from calibrate.data.experiment import Experiment, Noise
from studies.importers import column_import, column_map, measured_data, printed_sheets
from studies.importers.missing_frames import with_missing_frames
from studies.importers.series import Series, to_experiment
from studies.importers.synchronise import Selection
from studies.output.folder import open_output_folder
from studies.output.manifest import Manifest
from studies.output.viewer import write_viewer_file
from studies.reports.experiments.import_report import picture, report, summary, write_report

SHEETS_ONLY = "not for column maps, which say this in the TOML"
OF_ANY_SOURCE = {"source", "output", "overwrite", "command"}
DESCRIPTION = "Read measured full-field data into an Experiment (docs/import.md)."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `equigap import`."""
    parser.add_argument(
        "source",
        help=f"a published sheet ({', '.join(measured_data.SHEETS)}), a packed .npz, a folder of frames, or a column map .toml",
    )
    parser.add_argument("-o", "--output", type=Path, help="output folder (default: results/import-NAME)")
    parser.add_argument("--overwrite", action="store_true", help="replace an earlier import in that folder")
    parser.add_argument("--name", help="name of the experiment (default: from the source; not for column maps)")
    parser.add_argument("--record", type=Path, help="machine record (CSV: Time, Displacement, Force) of a folder")
    _add_frames(parser.add_argument_group(f"which frames ({SHEETS_ONLY})"))
    _add_sheet(parser.add_argument_group(f"sheets in pixels ({SHEETS_ONLY})"))
    _add_noise(parser.add_argument_group(f"noise, default: estimated from all frames ({SHEETS_ONLY})"))


def _add_frames(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--frames", default="12", metavar="N|I,J,...",
        help="how many, spread evenly over the loading, or a list of frame numbers (default: 12)",
    )  # fmt: skip
    group.add_argument("--until", type=float, metavar="S", help="last time used, s on the clock of the machine")
    group.add_argument("--tare", type=float, metavar="N", help="force that counts as zero (default: that of frame 0)")


def _add_sheet(group: argparse._ArgumentGroup) -> None:
    default = printed_sheets.SheetOptions()
    group.add_argument("--scale", type=float, default=default.scale, metavar="MM", help="mm per pixel (%(default)s)")
    group.add_argument("--frame-rate", type=float, metavar="HZ", help="frames per second (default: file's own, else 5)")
    group.add_argument(
        "--offset",
        type=float,
        default=0.0,
        metavar="S",
        help="time of frame 0 on the clock of the machine (0)",
    )
    group.add_argument("--drop-rows", type=int, default=default.drop_rows, help="unreliable rows a side (%(default)s)")
    group.add_argument(
        "--drop-columns",
        type=int,
        default=default.drop_columns,
        help="unreliable columns a side (%(default)s)",
    )
    group.add_argument(
        "--edge-columns", choices=printed_sheets.EDGE_COLUMNS, default=default.edge_columns,
        help="unreliable columns are replaced from their neighbours, left out, or trusted (%(default)s)",
    )  # fmt: skip
    group.add_argument(
        "--free-edges", choices=printed_sheets.FREE_EDGES, default=default.free_edges,
        help="whether the left and right rim carry no traction (auto: yes)",
    )  # fmt: skip
    group.add_argument("--thickness", type=float, metavar="MM", help="thickness (default: unknown)")


def _add_noise(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--noise", choices=("total", "temporal"), default="total",
        help="estimate all errors of a frame, or only those that change from frame to frame (%(default)s)",
    )  # fmt: skip
    group.add_argument("--displacement-std", type=float, metavar="MM", help="state the noise instead of estimating it")
    group.add_argument("--correlation-length", type=float, metavar="MM", default=0.0, help="of the stated noise (0)")
    group.add_argument("--force-std", type=float, metavar="N", default=0.0, help="of the stated noise (0)")


def main(args: argparse.Namespace) -> int:
    """Import, write, and print a summary. Raises named errors of `calibrate.errors` and `studies.errors`."""
    series, selection, noise, kind, inputs = _read(args)
    experiment = to_experiment(series, selection, noise, kind)
    settings = {key: value for key, value in vars(args).items() if not callable(value) and key not in _NOT_SETTINGS}
    folder = open_output_folder(
        args.output or Path("results") / f"import-{experiment.name}",
        args.overwrite,
        {"study": "import", **settings},
    )
    manifest = Manifest(settings=settings, inputs=inputs)
    target = folder / "experiment.npz"
    experiment.save(target)
    write_viewer_file(experiment, target.with_suffix(".vtu"))
    picture(experiment, series, folder / "experiment.png")
    manifest.beside(target, folder / "experiment.png", **summary(experiment))
    report(experiment, target)
    print(f"report: {write_report(experiment, folder, manifest)}")
    return 0


_NOT_SETTINGS = {"output", "overwrite", "command"}


def import_experiment(source: str | Path, **options: Any) -> Experiment:
    """The Experiment that `equigap import SOURCE` makes; options as on the command line, '_' for '-'.

    Raises `ConfigError` for an unknown option, and whatever the reader of the source and `series.to_experiment` find.
    """
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    args = parser.parse_args([str(source)])
    for key, value in options.items():
        if not hasattr(args, key):
            raise errors.ConfigError(f"option '{key}' unknown; see `equigap import --help`")
        setattr(args, key, value)
    series, selection, noise, kind, _ = _read(args)
    return to_experiment(series, selection, noise, kind)


Read = tuple[Series, Selection, Noise | None, str, list[Path]]


def _read(args: argparse.Namespace) -> Read:
    source = Path(args.source)
    if source.suffix == ".toml":
        return _read_map(args, source)
    if source.is_file() and source.suffix != ".npz":
        raise errors.FileFormatError(f"{source}: give a packed .npz, a folder of frames, or a column map .toml")
    if str(args.source) in measured_data.SHEETS and not source.exists():
        reader: Callable[..., Any] = _read_packed
        source = measured_data.sheet(str(args.source))
    elif source.suffix == ".npz":
        reader = _read_packed
    elif source.is_dir():
        reader = _read_folder
    else:
        raise errors.DataNotFoundError(
            f"{source}: neither a published sheet ({', '.join(measured_data.SHEETS)}) nor a file or folder that exists"
        )
    frames, record, inputs = reader(source, args.record)
    options = printed_sheets.SheetOptions(
        args.scale, args.frame_rate, args.offset, args.drop_rows, args.drop_columns, args.edge_columns,
        args.free_edges, args.thickness,
    )  # fmt: skip
    series = printed_sheets.sheet_series(frames, record, options, args.name or source.stem)
    series.provenance["source"] = source.name
    series = with_missing_frames(series)
    return series, _selection(args), _stated(args), args.noise, inputs


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


def _read_map(args: argparse.Namespace, source: Path) -> Read:
    usual = argparse.ArgumentParser()
    add_arguments(usual)
    for key, value in vars(usual.parse_args([str(source)])).items():
        if key not in OF_ANY_SOURCE and getattr(args, key, value) != value:
            raise errors.ConfigError(
                f"--{key.replace('_', '-')} is not for a column map; say it in {source.name} (docs/import.md)"
            )
    columns = column_map.read_map(source)
    series = column_import.column_series(columns, source.parent)
    series.provenance.update(source=source.name, map=asdict(columns))
    if columns.frames.rate_hz is not None:
        series = with_missing_frames(series)
    return series, columns.selection, columns.stated_noise, columns.noise.kind, [source]


def _selection(args: argparse.Namespace) -> Selection:
    text = str(args.frames)
    try:
        numbers = tuple(int(part) for part in text.split(",") if part.strip())
    except ValueError:
        raise errors.ConfigError(f"--frames {text}: give a number, or frame numbers separated by commas") from None
    if not numbers:
        raise errors.ConfigError("--frames is empty; give a number, or frame numbers separated by commas")
    if "," in text:
        return Selection(frames=numbers, until=args.until, tare=args.tare)
    return Selection(count=numbers[0], until=args.until, tare=args.tare)


def _stated(args: argparse.Namespace) -> Noise | None:
    if args.displacement_std is None:
        return None
    return Noise(args.displacement_std, args.correlation_length, 0.0, args.force_std)
