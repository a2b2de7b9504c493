"""A folder as a DIC program wrote it: the program is recognised from the content, a column map is made and read.

In: a folder, and answers to what no file states. Out: a `Recording` with the column map, every entry with its reason; or the error
`Undecided`, which asks for all that is missing by name and carries the map so far.
"""

from __future__ import annotations

import fnmatch
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from calibrate import errors
from studies.importers.column_import import mapped_series
from studies.importers.column_map import checked_map
from studies.importers.exports.field_guesses import say_coordinates, say_edges, say_grid, say_reference
from studies.importers.exports.frame_order import Order, Rule, frame_order
from studies.importers.exports.guesses import Guesses, Undecided
from studies.importers.exports.hdf5_file import hdf5_file
from studies.importers.exports.incomplete_frames import (
    refuse_empty,
    refuse_headers_alone,
    refuse_other_columns,
    unnumbered,
)
from studies.importers.exports.machine_record import RecordAnswers, say_channels, say_record
from studies.importers.exports.ncorr_file import ncorr_file
from studies.importers.exports.text_files import TextFile, text_file
from studies.importers.frame_tables import read_frames
from studies.importers.map_tables import PointsTable
from studies.importers.nn_euclid import NODES
from studies.importers.recording.importer import Answers, Importer, Part, Recording, SheetOptions
from studies.importers.recording.series import Series, elongation
from studies.importers.recording.synchronise import forces_at
from studies.importers.vendors import Vendor, vendors

HDF5 = (".hdf5", ".h5", ".hdf")
SHEETS_ALONE = ("drop_rows", "drop_columns", "edge_columns", "free_edges")


@dataclass(frozen=True)
class Export:
    """Tables of a folder. frames: of one vendor, unsorted; others: what is no frame; rivals: files by vendor, where several claim some."""

    vendor: Vendor
    frames: list[TextFile]
    others: list[TextFile]
    rivals: dict[str, int]


class VendorFolder(Importer):
    """Every program of `studies.importers.vendors`."""

    source: ClassVar[str] = "a folder as a DIC program exported it"
    looks_for: ClassVar[str] = "tables with the columns of " + ", ".join(vendor.name for vendor in vendors())
    takes: ClassVar[tuple[Part, ...]] = ("name", "record", "frames", "sheet", "noise", "answers")
    answers: Answers = Answers()

    def reads(self, source: str) -> bool:
        """A folder with a frame of a known program, or with such folders in it."""
        path = Path(source)
        return path.is_dir() and (_is_export(path) or any(map(_is_export, _folders(path))))

    def answered(self, answers: Answers) -> VendorFolder:
        """The same with answers to what no file states."""
        importer = VendorFolder()
        importer.answers = answers
        return importer

    def read(self, source: str, options: SheetOptions, name: str | None, record: Path | None) -> Recording:
        """Raises `Undecided` for what is not stated, `ConfigError` for a folder of folders, and the errors of a column map."""
        _refuse_sheet_options(options)
        folder = Path(source)
        if not _is_export(folder):
            exports = ", ".join(str(one) for one in _folders(folder) if _is_export(one))
            raise errors.ConfigError(f"{source}: holds several exports; import one of {exports}")
        found = Guesses()
        found.say("name", name or folder.resolve().name, "as given" if name else "name of the folder")
        if options.thickness is not None:
            found.say("thickness_mm", options.thickness, "as given")
        export = exported(folder, self.answers.files)
        self._describe(export, folder, options, record, found)
        if found.questions:
            raise Undecided(found, source)
        series = _series(found)
        inputs = [file.path for file in export.frames]
        if found.get("force.file"):
            inputs.append(Path(found.get("force.file")))
        return Recording(series, tuple(inputs), guesses=found)

    def _describe(
        self, export: Export, folder: Path, options: SheetOptions, record: Path | None, found: Guesses
    ) -> None:
        """All entries, in the order in which one depends on another."""
        answers, vendor = self.answers, export.vendor
        found.facts.append(f"program: {vendor.name}; {_tested(vendor)}")
        if len(export.rivals) > 1:
            kinds = ", ".join(f"{count} of {kind}" for kind, count in export.rivals.items())
            found.ask(
                "points.files",
                "--files",
                f"the folder holds several exports ({kinds}); name the files of one, such as '{_alike(export.frames)}'",
            )
        order, times = _ordered(vendor, export.frames, answers.order)
        frames = [export.frames[i] for i in order.index]
        found.say("points.folder", str(folder.resolve()), "as given")
        found.say(
            "points.files",
            [frame.path.name for frame in frames],
            f"{len(frames)} files in the order of the {order.found}",
        )
        vendor.describe(frames, found)
        if found.get("points.decimal") is None and any(frame.decimal == "," for frame in frames):
            found.say("points.decimal", ",", "decimal commas in some files")
        _say_unit(answers.unit, found)
        if answers.y_axis:
            found.say("points.y_axis", answers.y_axis, "as given")
        _say_scale(options.scale, answers.step, found)
        separate, count = _say_field(answers, found)
        _say_times(order, times, separate, options, found)
        told = RecordAnswers(record, answers.force_column, answers.time_column, answers.force_unit, answers.time_unit)
        if not say_channels(vendor.channels(frames), told, export.others, found):
            say_record(export.others, told, count or len(frames), found)
        if not any(found.get(key) for key in ("frames.times_s", "frames.rate_hz", "force.time")):
            found.facts.append("no time of the frames is stated: effects of time are then not tested (--frame-rate)")


def exported(folder: Path, pattern: str | None) -> Export:
    """What a folder holds. pattern: glob of the frames. Raises `DataNotFoundError` for a pattern without a frame, `FileFormatError` for a frame
    without content."""
    files = [file for path in sorted(folder.iterdir()) if path.is_file() and (file := _file(path))]
    claims = [(next((v for v in vendors() if v.claims(file)), None), file) for file in files]
    chosen = [(v, f) for v, f in claims if v and (pattern is None or fnmatch.fnmatch(f.path.name, pattern))]
    if not chosen:
        raise errors.DataNotFoundError(f"{folder / (pattern or '*')}: no file of a known program; correct --files")
    count = Counter(v.name for v, _ in chosen)
    name = count.most_common(1)[0][0]
    vendor = next(v for v, _ in chosen if v.name == name)
    frames = [f for v, f in chosen if v.name == name]
    refuse_empty(folder, pattern, {f.path.suffix for f in frames})
    names = {unnumbered(f.path) for f in frames}
    refuse_headers_alone(folder, {f.path for f in files}, names)
    refuse_other_columns([f for v, f in claims if v is None and (pattern is None or fnmatch.fnmatch(f.path.name, pattern))], names)  # fmt: skip
    others = [f for v, f in claims if v is None and not any(one.belongs(f) for one in vendors())]
    return Export(vendor, frames, others, dict(count))


def _is_export(folder: Path) -> bool:
    """Whether one of its files is a frame of a known program."""
    files = (_file(path) for path in sorted(folder.iterdir()) if path.is_file())
    return any(file is not None and any(v.claims(file) for v in vendors()) for file in files)


def _file(path: Path) -> TextFile | None:
    """A table, a file of ncorr, or HDF5."""
    if path.suffix == ".mat":
        return ncorr_file(path)
    return hdf5_file(path) if path.suffix in HDF5 else text_file(path)


def _alike(frames: list[TextFile]) -> str:
    """A pattern of the files of one export: * where numbers differ, ? for brackets, which mean something in patterns."""
    names = {unnumbered(frame.path) if len(frames) > 1 else frame.path.name for frame in frames}
    return min(names).translate(str.maketrans("[]", "??"))


def _folders(path: Path) -> list[Path]:
    """Folders in a folder that are no load steps of NN-EUCLID, whose tables have positions and displacements too."""
    return sorted(one for one in path.iterdir() if one.is_dir() and not (one / NODES).is_file())


def _tested(vendor: Vendor) -> str:
    return f"tested on {vendor.tested_on}" if vendor.tested_on else "never tested on a real export: look at every entry"


def _refuse_sheet_options(options: SheetOptions) -> None:
    """Options of printed sheets alone."""
    usual = SheetOptions()
    for name in SHEETS_ALONE:
        if getattr(options, name) != getattr(usual, name):
            raise errors.ConfigError(f"--{name.replace('_', '-')} is for printed sheets; change the column map instead")


def _ordered(vendor: Vendor, frames: list[TextFile], rule: Rule) -> tuple[Order, list[float] | None]:
    """The order of the frames, and their times, s, where they are stated."""
    times = [vendor.stated_time(frame) for frame in frames]
    stated = [time for time in times if time is not None]
    if len(stated) == len(frames) and len(set(stated)) == len(frames):
        index = np.argsort(stated)
        return Order(tuple(index.tolist()), None, True, "times stated in the files"), sorted(stated)
    order = frame_order([frame.path.stem for frame in frames], rule)
    return order, order.values.tolist() if order.seconds and order.values is not None else None


def _say_unit(unit: str | None, found: Guesses) -> None:
    """Unit of all lengths, as given."""
    if unit is None:
        return
    for key in ("points.position_unit", "points.displacement_unit"):
        found.entries.pop(key, None)
    found.questions = [q for q in found.questions if q.option != "--unit"]
    found.say("points.unit", unit, "as given")


def _say_scale(scale: float | None, step: float | None, found: Guesses) -> None:
    """mm per pixel, where something is in pixels; step of a matrix."""
    units = {found.get(f"points.{key}") for key in ("unit", "position_unit", "displacement_unit")}
    if "px" in units and scale is None:
        found.ask("points.scale_mm_per_px", "--scale", "in pixels, and no file states mm per pixel")
    elif scale is not None and "px" in units:
        found.say("points.scale_mm_per_px", scale, "as given")
        found.say("recording.image_scale", f"{scale:g} mm/px", "as given")
    elif scale is not None:
        raise errors.ConfigError("--scale: nothing in this export is in pixels; leave it out")
    if step is not None:
        found.questions = [q for q in found.questions if q.key != "points.step"]
        found.say("points.step", step, "as given")


def _say_field(answers: Answers, found: Guesses) -> tuple[bool, int]:
    """Grid, reference and edges of the measured field; whether the reference is in no file, and the number of frames that are (0: unread)."""
    points: dict[str, Any] = found.tables()["points"]
    unread = {q.key for q in found.questions} & {"points.v", "points.step"}
    if unread:
        return False, 0
    say_coordinates(PointsTable.model_validate(points | {"reference": "separate"}), found)
    points = found.tables()["points"]
    frames = read_frames(PointsTable.model_validate(points | {"reference": "separate"}), Path())
    frames = replace(frames, displacements=frames.displacements[1:])
    separate = say_reference(frames, found)
    say_grid(frames, found)
    say_edges(frames, answers.loaded, answers.free, found)
    return separate, len(frames.displacements)


def _say_times(order: Order, times: list[float] | None, separate: bool, options: SheetOptions, found: Guesses) -> None:
    """Times of the frames: stated, or from the frame rate and the numbers of the files."""
    rate = options.frame_rate
    if times is not None and rate is not None:
        raise errors.ConfigError("--frame-rate: the times of the frames are stated in the export; leave it out")
    if times is not None:
        why = f"s, {order.found}" + ("; 0 for the reference picture" if separate else "")
        found.say("frames.times_s", [0.0, *times] if separate else times, why)
    elif rate is not None and order.values is not None and (np.diff(order.values) != 1).any():
        numbered, step = order.values - order.values[0], float(np.median(np.diff(order.values)))
        apart = separate or len(order.values) < len(order.index)  # the reference picture has no number
        found.say(
            "frames.times_s",
            [0.0, *((numbered + step) / rate).tolist()] if apart else (numbered / rate).tolist(),
            "numbers of the files over the frame rate"
            + ("; the reference picture a step before the first: assumed" if apart else ""),
        )
    elif rate is not None:
        found.say("frames.rate_hz", rate, "as given")
    if rate is not None:
        found.say("recording.frame_rate", f"{rate:g} Hz", "as given")
    if times is not None or rate is not None:
        found.say(
            "frames.offset_s",
            options.offset,
            "as given" if options.offset else "camera and machine on one clock: assumed, --offset",
        )


def _series(found: Guesses) -> Series:
    """Read the column map; the force is turned where the specimen lengthens under a falling force."""
    columns = checked_map(found.tables(), found.get("name"))
    series = mapped_series(columns, Path())
    force = forces_at(series.record, np.clip(series.time, series.record.time[0], series.record.time[-1]))
    if float((force - force[0]) @ np.nan_to_num(elongation(series))) < 0:
        found.say("force.sign", -1.0, "the specimen lengthens while the recorded force falls")
        series = mapped_series(checked_map(found.tables(), found.get("name")), Path())
    series.provenance.update(source=found.get("name"), found=list(found.lines()))
    return series
