"""`equigap decide`: a diagnosis that leaves several explanations in; the specimen and loading that would tell them apart, and by how much, out.

Out: ``report.html``, ``decision.json``, ``tests.csv``, a picture and a manifest. Every specimen is kept in ``steps/`` and not made again.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import jax

from calibrate.diagnosis.evidence.priors import Priors, read_priors
from calibrate.errors import EquigapError
from forward.errors import FormsCacheError, ForwardError, MissingSolverError
from meshes.errors import MeshError
from studies.commandline.option_types import OutputFolder, Overwrite, Positive, default_folder
from studies.commandline.outcome import Outcome
from studies.commands.design import completed
from studies.decide import report
from studies.decide.expected_evidence import expected
from studies.decide.programmes import Programme, loaded, recorded
from studies.decide.report import Decision, SpecimenResult
from studies.decide.rivals import Undecided, read
from studies.design.design_plan import Plan, SpecimenTable, file_name
from studies.design.pulls_within_limits import limited_pull
from studies.errors import DesignError
from studies.output import Manifest, open_output_folder
from studies.output.progress import track
from studies.output.writing import write_json
from studies.reports.alert_table import alert_lines

DURATION = 60.0  # s, of a ramp, where the diagnosed tests have no times


@dataclass(frozen=True)
class DecideOutcome(Outcome):
    """Tests ranked by what they would decide."""

    found: Decision
    report: Path

    def lines(self) -> Iterable[str]:
        """The findings and the report."""
        yield from alert_lines(report.findings(self.found))
        yield f"report: {self.report}"


def decide(
    diagnosis: Path,
    plan: Path | None = None,
    /,
    *,
    duration: Positive | None = None,
    priors: Path | None = None,
    quick: bool = False,
    output: OutputFolder = None,
    overwrite: Overwrite = False,
) -> DecideOutcome:
    """Which test would tell explanations of a diagnosis apart.

    Each specimen of a design file is pulled to its limit in a simulation; held there; unloaded. For every two explanations that the diagnosis leaves, the
    expected evidence of the one against the other says what that test would decide. A stopped run goes on where it was.

    Args:
        diagnosis: folder of `equigap discover`, or its discovery.json
        plan: design file of machine, sheet, camera and specimens (docs/design.md; default: that of `equigap design`)
        duration: of a ramp, s (default: of the longest test that was diagnosed)
        priors: TOML of priors, as `equigap discover` takes it
        quick: fewer specimens and pictures, coarser elements

    Raises:
        FileFormatError: no discovery.json of this version.
        ConfigError: a diagnosis whose explanations were not fitted.
        DesignError: a design file that cannot be read or fulfilled.
    """
    undecided, family, beliefs = read(diagnosis), completed(plan, quick, None, None), read_priors(priors)
    time = duration or undecided.duration or DURATION
    source = diagnosis / "discovery.json" if diagnosis.is_dir() else diagnosis
    settings = {"command": "decide", "quick": quick, "duration": time, "plan": family.model_dump(mode="json")}
    manifest = Manifest(settings=settings, inputs=[source, *filter(None, (plan, priors))])
    key = {**settings, "inputs": list(manifest.to_dict()["inputs"].values())}
    folder = open_output_folder(output or default_folder("decide", quick), overwrite, key)
    tables = family.specimen if undecided.rivals else ()
    results = [_step(folder, t, undecided, family, time, beliefs) for t in track(tables, "specimens", unit="specimens")]
    found = Decision(source.resolve().parent.name, undecided.rivals, tuple(results), undecided.unknown)
    return DecideOutcome(found, report.write(folder, found, manifest))


def _step(
    folder: Path, table: SpecimenTable, undecided: Undecided, plan: Plan, time: float, priors: Priors
) -> SpecimenResult:
    """What a specimen would decide; kept from an earlier run, or new."""
    path = folder / "steps" / f"{file_name(table.title)}.json"
    if not path.exists():
        write_json(path, _judged(table, undecided, plan, time, priors).to_dict())
        jax.clear_caches()  # compiled code of all specimens together takes more memory maps than a process may have
    return SpecimenResult.from_dict(json.loads(path.read_text()))


def _judged(table: SpecimenTable, undecided: Undecided, plan: Plan, time: float, priors: Priors) -> SpecimenResult:
    try:
        ramp = recorded(limited_pull(table.read(), plan.law.read(), plan), plan)
        values = {
            str(programme): expected(loaded(ramp, programme, time), undecided.rivals, undecided.modulus, priors)
            for programme in Programme
        }
    except (FormsCacheError, MissingSolverError):
        raise  # of the machine, and of no specimen
    except (DesignError, MeshError, ForwardError, EquigapError) as error:
        return SpecimenResult(table.title, {}, str(error))
    return SpecimenResult(table.title, values)
