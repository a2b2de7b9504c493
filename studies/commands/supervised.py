"""`equigap supervised`: PANNs fitted to stress-stretch curves of homogeneous tests (Sobolev fit), and their r2.

In: the five-term Arruda-Boyce material sampled in the three modes, and classical measurements. Out: a table of r2
by mode, a figure of every data set, the models, a manifest beside each, ``report.html``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from calibrate import errors
from studies.commandline.option_types import Count, Integers, OutputFolder, Overwrite, Seed, Several, default_folder
from studies.commandline.outcome import Outcome
from studies.importers import homogeneous_curves
from studies.output import Manifest, open_output_folder, track
from studies.reports.supervised.report import write
from studies.reports.supervised.supervised_fits import TRUTH, Case, Result, default_cases, run, short_r2

QUICK_STARTS = 4
DATA = f"data sets: {TRUTH}, {', '.join(homogeneous_curves.COLLECTIONS)}"


@dataclass(frozen=True)
class Supervised(Outcome):
    """Fitted networks."""

    results: tuple[Result, ...]
    table: Path
    report: Path

    def lines(self) -> Iterable[str]:
        """r2 of every fit, and the files."""
        for r in self.results:
            yield f"{r.case.name:28s} " + "  ".join(f"{mode} r2 {short_r2(value)}" for mode, value in r.r2.items())
        yield f"wrote {self.table}"
        yield f"report: {self.report}"


def supervised(
    *,
    data: Annotated[Several, Parameter(help=DATA)] = (),
    inputs: Literal["I1", "I2", "I1I2"] | None = None,
    layers: Integers = (),
    starts: Count = 10,
    seed: Seed = 0,
    quick: bool = False,
    output: Annotated[OutputFolder, Parameter(help="folder (default: results/supervised)")] = None,
    overwrite: Overwrite = False,
) -> Supervised:
    """Fit physics-augmented neural networks (PANN) to stress-stretch curves of homogeneous tests.

    Args:
        inputs: one set of inputs instead of the default cases
        layers: one network size, such as 8,8, instead of the default cases
        starts: random starts
        seed: of the starts
        quick: fewer cases and starts

    Raises:
        ConfigError: unknown data set.
    """
    cases = cases_of(data, inputs, tuple(layers), quick)
    starts = min(starts, QUICK_STARTS) if quick else starts
    settings = {"study": "supervised", "cases": [asdict(c) for c in cases], "starts": starts, "seed": seed}
    folder = open_output_folder(output or default_folder("supervised"), overwrite, settings)
    manifest = Manifest(seed=seed, settings=settings)
    results = [run(case, starts, seed) for case in track(cases, "supervised fits", unit="fits")]
    report = write(folder, results, manifest)
    return Supervised(tuple(results), folder / "supervised.csv", report)


def cases_of(
    data: Sequence[str] = (), inputs: str | None = None, layers: tuple[int, ...] = (), quick: bool = False
) -> list[Case]:
    """Cases asked for. Raises `ConfigError` for an unknown data set and for layers without neurons."""
    known = {TRUTH, *homogeneous_curves.COLLECTIONS}
    for name in data:
        if name not in known:
            raise errors.ConfigError(f"data set '{name}' unknown; choose one of {', '.join(sorted(known))}")
    if any(n < 1 for n in layers):
        raise errors.ConfigError(f"--layers {','.join(map(str, layers))}: give whole numbers above 0")
    cases = default_cases(quick)
    if data:
        networks = list(dict.fromkeys((c.inputs, c.layers) for c in cases))
        cases = [Case(name, *network) for name in data for network in networks]
    if inputs or layers:
        cases = [Case(c.data, inputs or c.inputs, layers or c.layers) for c in cases]
    return list(dict.fromkeys(cases))
