"""`equigap verify`: are the numbers of a run of `equigap figures` those that are known?

In: the folder of a run. Out: a table of key numbers beside their reference (``reference.json``: value, tolerance and its reason);
what differs is named. With --same-as: the data files of two runs, byte by byte.
"""

from __future__ import annotations

import json
import statistics
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from studies.commandline.option_types import Overwrite
from studies.commandline.outcome import Outcome
from studies.errors import OptionError, OutputFolderError, StudyError
from studies.output import write_json
from studies.output.manifest import sha256_of

FORMAT = "equigap-verification"
DATA = (".csv", ".npz", ".msh")
SMALLEST_TOLERANCE = 1e-5  # relative; two systems on one machine differ by 5e-9
RANGES = 3.0  # a tolerance is so many times the range observed over runs


@dataclass(frozen=True)
class Key:
    """A number: file in the folder of all results, keys to it in the JSON, reference, tolerance and why it is so large."""

    name: str
    file: str
    path: tuple[str | int, ...]
    value: float
    tolerance: float
    reason: str = ""

    @property
    def study(self) -> str:
        """Folder that it is in."""
        return self.file.split("/")[0]


@dataclass(frozen=True)
class Finding:
    """A key number as it is. found: None where it is not there."""

    key: Key
    found: float | None

    @property
    def agrees(self) -> bool:
        """Whether it is there and within its tolerance."""
        return self.found is not None and abs(self.found - self.key.value) <= self.key.tolerance

    def to_dict(self) -> dict[str, Any]:
        """As it is written to ``verify.json``."""
        key = self.key
        return {
            "name": key.name, "found": self.found, "reference": key.value, "tolerance": key.tolerance,
            "reason": key.reason, "agrees": self.agrees,
        }  # fmt: skip


@dataclass(frozen=True)
class Verification(Outcome):
    """Key numbers of a run beside their reference."""

    findings: tuple[Finding, ...]

    def lines(self) -> Iterable[str]:
        """A line a number."""
        width = max((len(f.key.name) for f in self.findings), default=0)
        for f in self.findings:
            found = "missing" if f.found is None else f"{f.found:.6g}"
            mark = " " if f.agrees else "!"
            yield f"{mark} {f.key.name:{width}}  {found:>12}  reference {f.key.value:.6g} +- {f.key.tolerance:.2g}"
        if self.failure() is None:
            yield f"all {len(self.findings)} numbers agree with their reference"

    def failure(self) -> StudyError | None:
        """Numbers that differ."""
        wrong = [f.key.name for f in self.findings if not f.agrees]
        if not wrong:
            return None
        return StudyError(
            f"{len(wrong)} of {len(self.findings)} numbers differ from their reference: {', '.join(wrong)}"
        )


@dataclass(frozen=True)
class Comparison(Outcome):
    """Data files of two runs. differing: names of those that are not the same."""

    differing: tuple[str, ...]

    def lines(self) -> Iterable[str]:
        """That they are the same, if so."""
        if not self.differing:
            yield "every data file is the same"

    def failure(self) -> StudyError | None:
        """Files that differ."""
        if not self.differing:
            return None
        return StudyError(f"{len(self.differing)} data files differ: {', '.join(self.differing[:10])}")


@dataclass(frozen=True)
class Collected(Outcome):
    """Reference values from several runs. scales: {scale: {name: {"value", "tolerance"}}}."""

    scales: dict[str, dict[str, dict[str, float]]]

    def lines(self) -> Iterable[str]:
        """The values as JSON."""
        yield json.dumps(self.scales, indent=1)


def verify(
    folder: Annotated[Path, Parameter(name="RESULTS")],
    /,
    *,
    same_as: Path | None = None,
    collect: Annotated[tuple[Path, ...], Parameter(consume_multiple=True)] = (),
    output: Annotated[Path | None, Parameter(alias="-o")] = None,
    overwrite: Overwrite = False,
) -> Outcome:
    """Compare key numbers of a run of `equigap figures` with reference values, and name what differs.

    Each reference value has a tolerance and the reason for it, from the spread observed over machines and seeds.

    Args:
        folder: output folder of `equigap figures`
        same_as: compare the data files of two runs instead, byte by byte
        collect: print reference values from RESULTS and these further runs (other machines, other seeds)
        output: file of the table, JSON (default: RESULTS/verify.json)

    Raises:
        StudyError: a folder without a run, a scale without reference, a run that left out all that has one.
        OptionError: options that do not go together.
        OutputFolderError: the file of the table was not written by this command.
    """
    refuse_unused(same_as, collect, output, overwrite)
    if collect:
        return Collected(reference_from([folder, *collect]))
    if same_as is not None:
        return Comparison(tuple(different_files(folder, same_as)))
    run = run_record(folder)
    left_out = run.get("left_out", {})
    findings = compared(folder, reference(run["scale"]), left_out)
    if not findings:
        raise StudyError(
            f"{folder}: nothing was compared, as every study with a reference was left out ({', '.join(left_out)}); "
            "get their data and run `equigap figures` again"
        )
    output = output or folder / "verify.json"
    if not (overwrite or is_own(output)):
        raise OutputFolderError(f"{output}: was not written by `equigap verify`; give --overwrite or another --output")
    write_json(output, {"format": FORMAT, "scale": run["scale"], "numbers": [f.to_dict() for f in findings]})
    return Verification(tuple(findings))


def refuse_unused(same_as: Path | None, collect: Sequence[Path], output: Path | None, overwrite: bool) -> None:
    """Raises `OptionError` for options that would have no effect."""
    if collect and same_as is not None:
        raise OptionError("--collect and --same-as do different things; give one of them")
    if (collect or same_as is not None) and (output is not None or overwrite):
        name = "--collect" if collect else "--same-as"
        raise OptionError(f"{name} writes no file; leave --output and --overwrite out")


def is_own(path: Path) -> bool:
    """Whether a file is free to be written: absent, or a table of an earlier comparison."""
    try:
        return bool(json.loads(path.read_text()).get("format") == FORMAT)
    except FileNotFoundError:
        return True
    except (OSError, ValueError, AttributeError):
        return False


def run_record(folder: Path) -> dict[str, Any]:
    """``figures.json`` of a run. Raises `StudyError`."""
    try:
        content = json.loads((folder / "figures.json").read_text())
    except (OSError, ValueError) as error:
        raise StudyError(f"{folder}: holds no finished run of `equigap figures` ({error}); run it first") from None
    if not isinstance(content, dict) or content.get("format") != "equigap-figures":
        raise StudyError(f"{folder / 'figures.json'}: was not written by `equigap figures`")
    return content


def stored() -> list[dict[str, Any]]:
    """Keys of ``reference.json``: name, file, path, reason, and of every scale value and tolerance."""
    return json.loads(resources.files("studies.commands").joinpath("reference.json").read_text())["keys"]


def reference(scale: str) -> list[Key]:
    """Reference values of a scale. Raises `StudyError` where there are none."""
    keys = [
        Key(k["name"], k["file"], tuple(k["path"]), **k["scales"][scale], reason=k["reason"])
        for k in stored()
        if scale in k["scales"]
    ]
    if not keys:
        known = ", ".join(sorted({name for k in stored() for name in k["scales"]}))
        raise StudyError(f"no reference values of scale {scale} are known; known: {known}")
    return keys


def compared(folder: Path, keys: Sequence[Key], left_out: Collection[str] = ()) -> list[Finding]:
    """Every key number of the studies that were not left out."""
    return [Finding(key, number(folder, key.file, key.path)) for key in keys if key.study not in left_out]


def number(folder: Path, file: str, path: Sequence[str | int]) -> float | None:
    """The number at a place, None where its file or its keys are not there."""
    try:
        value = json.loads((folder / file).read_text())
        for name in path:
            value = value[name]
        return float(value)
    except (OSError, ValueError, KeyError, IndexError, TypeError):
        return None


def reference_from(folders: Sequence[Path]) -> dict[str, dict[str, dict[str, float]]]:
    """{scale: {name: value and tolerance}} of several runs of one scale: the median, and `RANGES` times the range.

    Raises `StudyError` for runs of different scales, or a folder without a run.
    """
    scales = {run_record(folder)["scale"] for folder in folders}
    if len(scales) != 1:
        raise StudyError(f"runs of different scales: {', '.join(sorted(scales))}; collect one scale at a time")
    found = {}
    for key in stored():
        values = [v for folder in folders if (v := number(folder, key["file"], key["path"])) is not None]
        if values:
            middle, spread = statistics.median(values), RANGES * (max(values) - min(values))
            found[key["name"]] = {"value": middle, "tolerance": max(spread, SMALLEST_TOLERANCE * abs(middle))}
    return {scales.pop(): found}


def different_files(here: Path, there: Path) -> list[str]:
    """Data files of two runs whose bytes differ, or that only one has. Raises `StudyError` where `here` has none."""
    hashes = [{str(p.relative_to(folder)): sha256_of(p) for p in _data(folder)} for folder in (here, there)]
    if not hashes[0]:
        raise StudyError(f"{here}: holds no data files")
    names = sorted({*hashes[0], *hashes[1]})
    return [name for name in names if hashes[0].get(name) != hashes[1].get(name)]


def _data(folder: Path) -> list[Path]:
    return [p for p in sorted(folder.glob("*/**/*")) if p.suffix in DATA and "cache" not in p.relative_to(folder).parts]
