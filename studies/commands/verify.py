"""`equigap verify`: are the numbers of a run of `equigap figures` those that are known?

In: the folder of a run. Out: a table of key numbers beside their reference (``reference.json``), with tolerances from the spread
that was observed over machines and seeds; what differs is named. With --same-as: the data files of two runs, byte by byte.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from studies.errors import OutputFolderError, StudyError

DESCRIPTION = """\
Compares key numbers of a run of `equigap figures` with reference values, and names what differs. Tolerances come from the
spread observed over machines and seeds. With --same-as OTHER: compares the data files of two runs byte by byte."""
FORMAT = "equigap-verification"
DATA = (".csv", ".npz", ".msh")
LEAST = 1e-5  # relative: no tolerance is smaller; two systems on one machine differ by 5e-9
SPREADS = 3.0  # observed ranges that a number may be away


@dataclass(frozen=True)
class Key:
    """A number: file in the folder of all results, keys to it in the JSON, reference and tolerance (None: unknown)."""

    name: str
    file: str
    path: tuple[str | int, ...]
    value: float | None = None
    tolerance: float = 0.0
    observed: tuple[float, ...] = ()

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
        return (
            self.found is not None
            and self.key.value is not None
            and abs(self.found - self.key.value) <= self.key.tolerance
        )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `equigap verify`."""
    parser.add_argument("folder", type=Path, metavar="RESULTS", help="output folder of `equigap figures`")
    parser.add_argument("--same-as", type=Path, metavar="OTHER", help="compare the data files of two runs instead")
    parser.add_argument(
        "--collect", type=Path, nargs="+", metavar="RESULTS",
        help="print reference values from RESULTS and these further runs (other machines, other seeds)",
    )  # fmt: skip
    group = parser.add_argument_group("output")
    group.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="of the table, as JSON (default: RESULTS/verify.json)"
    )
    group.add_argument(
        "--overwrite", action="store_true", help="replace FILE even if it is not a table of this command"
    )


def main(args: argparse.Namespace) -> int:
    """Compare and print. Raises `StudyError` naming what differs, `OutputFolderError` for a file of another origin."""
    from studies.output import write_json

    if args.collect:
        print(json.dumps(collect([args.folder, *args.collect], stored()["keys"]), indent=1))
        return 0
    if args.same_as is not None:
        differing = different_files(args.folder, args.same_as)
        if differing:
            raise StudyError(f"{len(differing)} data files differ: {', '.join(differing[:10])}")
        print("every data file is the same")
        return 0
    content = run_record(args.folder)
    findings = verify(args.folder, reference(content["scale"]), content.get("left_out", {}))
    for line in table(findings):
        print(line)
    rows = [
        {
            "name": f.key.name,
            "found": f.found,
            "reference": f.key.value,
            "tolerance": f.key.tolerance,
            "agrees": f.agrees,
        }
        for f in findings
    ]
    output = args.output or args.folder / "verify.json"
    if not (args.overwrite or is_own(output)):
        raise OutputFolderError(f"{output}: was not written by `equigap verify`; give --overwrite or another --output")
    write_json(output, {"format": FORMAT, "scale": content["scale"], "numbers": rows})
    wrong = [f.key.name for f in findings if not f.agrees]
    if wrong:
        raise StudyError(f"{len(wrong)} of {len(findings)} numbers differ from their reference: {', '.join(wrong)}")
    print(f"all {len(findings)} numbers agree with their reference")
    return 0


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


def stored() -> dict[str, Any]:
    """``reference.json``: keys {"name", "file", "path"}, and of every scale the same with value, tolerance, observed.

    observed: of runs on other systems, or, of networks fitted to clean data, with displacements changed by 1e-8 mm (docs/limits.md).
    """
    return json.loads(resources.files("studies.commands").joinpath("reference.json").read_text())


def reference(scale: str) -> list[Key]:
    """Reference values of a scale, which may lack values. Raises `StudyError` where there are none."""
    content = stored()
    if not content["scales"].get(scale):
        known = ", ".join(name for name, keys in content["scales"].items() if keys)
        raise StudyError(f"no reference values of scale {scale} are known; known: {known or 'none'}")
    return [
        Key(k["name"], k["file"], tuple(k["path"]), k["value"], k["tolerance"], tuple(k["observed"]))
        for k in content["scales"][scale]
    ]


def verify(folder: Path, keys: Sequence[Key], left_out: Sequence[str] | dict[str, str] = ()) -> list[Finding]:
    """Every key number of the studies that were not left out."""
    return [Finding(key, number(folder, key)) for key in keys if key.study not in left_out]


def number(folder: Path, key: Key) -> float | None:
    """The number of a key, None where its file or its keys are not there."""
    try:
        value = json.loads((folder / key.file).read_text())
        for name in key.path:
            value = value[name]
        return float(value)
    except (OSError, ValueError, KeyError, IndexError, TypeError):
        return None


def table(findings: Sequence[Finding]) -> list[str]:
    """A line a number."""
    width = max((len(f.key.name) for f in findings), default=0)
    lines = []
    for f in findings:
        found = "missing" if f.found is None else f"{f.found:.6g}"
        mark = "  " if f.agrees else "! "
        expected = "none" if f.key.value is None else f"{f.key.value:.6g} +- {f.key.tolerance:.2g}"
        lines.append(f"{mark}{f.key.name:{width}}  {found:>12}  reference {expected}")
    return lines


def collect(folders: Sequence[Path], keys: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Reference values from several runs of one scale: median, and a tolerance of `SPREADS` times the range observed.

    Raises `StudyError` for runs of different scales, or a folder without a run.
    """
    scales = {run_record(folder)["scale"] for folder in folders}
    if len(scales) != 1:
        raise StudyError(f"runs of different scales: {', '.join(sorted(scales))}; collect one scale at a time")
    scale = scales.pop()
    result = []
    for k in keys:
        key = Key(k["name"], k["file"], tuple(k["path"]))
        values = [value for folder in folders if (value := number(folder, key)) is not None]
        if values:
            middle = statistics.median(values)
            spread = SPREADS * (max(values) - min(values))
            result.append({**k, "value": middle, "tolerance": max(spread, LEAST * abs(middle)), "observed": values})
    return {scale: result}


def different_files(here: Path, there: Path) -> list[str]:
    """Data files of two runs whose bytes differ, or that only one has. Raises `StudyError` where `here` has none."""
    hashes = [{str(p.relative_to(folder)): _hash(p) for p in _data(folder)} for folder in (here, there)]
    if not hashes[0]:
        raise StudyError(f"{here}: holds no data files")
    names = sorted({*hashes[0], *hashes[1]})
    return [name for name in names if hashes[0].get(name) != hashes[1].get(name)]


def _data(folder: Path) -> list[Path]:
    return [p for p in sorted(folder.glob("*/**/*")) if p.suffix in DATA and "cache" not in p.relative_to(folder).parts]


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
