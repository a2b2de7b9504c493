"""`equigap design`: which specimen to cut next, and what it would tell of the law.

In: a design file, or none. Out: specimens ranked by the information that their tests are expected to give, an optimised one with its drawing
(DXF), a report; with --validate also whether the ranking predicts the actual error of calibrations.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from studies.commandline.option_types import Count, OutputFolder, Overwrite, default_folder
from studies.commandline.outcome import Outcome
from studies.design.candidates import family_of, judge, judge_all, load, rank, save
from studies.design.design_plan import OPTIMISED, Plan, read_plan
from studies.design.pattern_search import Search, search
from studies.design.report import Design, answers, summary, write_report
from studies.design.validation import validate as validated
from studies.output import Manifest, open_output_folder, write_bytes, write_json

QUICK_SPECIMENS = ("cross", "UT", "PS", "TTa", "TTe")  # of the file that is used where none is given


@dataclass(frozen=True)
class Designed(Outcome):
    """A finished design. folder: with ``report.html``, ``design.json`` and ``drawings``."""

    folder: Path
    design: Design
    report: Path

    def lines(self) -> Iterable[str]:
        """The answer, and files."""
        yield from answers(self.design.ranking)
        yield f"drawings: {self.folder / 'drawings'}"
        yield f"report: {self.report}"


def design(
    file: Annotated[
        Path | None, Parameter(help="design file, TOML (default: the one that docs/design.md shows)")
    ] = None,
    /,
    *,
    quick: bool = False,
    validate: bool = False,
    seeds: Count | None = None,
    evaluations: Count | None = None,
    output: OutputFolder = None,
    overwrite: Overwrite = False,
) -> Designed:
    """Rank specimens by what their tests would tell of a law, and optimise one.

    Each is pulled as far as machine, sheet and camera allow. Lengths in mm, forces in N, stresses in MPa.

    Args:
        quick: coarse, few specimens and evaluations, about a minute
        validate: also test and calibrate every specimen and the optimised one in simulation: does the ranking predict the error?
        seeds: of the noise in the validation (5; quick: 1)
        evaluations: of the search (80; quick: 10)

    Raises:
        DesignError: a design file that cannot be read or met.
        MaterialError, SpecimenError: what it names is impossible.
    """
    plan = completed(file, quick, seeds, evaluations)
    key = {"command": "design", "quick": quick, "plan": plan.model_dump(mode="json")}
    folder = open_output_folder(output or default_folder("design", quick), overwrite, key)
    manifest = Manifest(seed=plan.optimise.seed if plan.optimise else None, settings=key, inputs=[file] if file else [])
    if file is None:
        write_bytes(folder / "plan.toml", default_file().read_bytes())
    family = family_of(plan)
    candidates = judge_all(plan, folder / "candidates")
    ranking = rank(candidates, family)
    found: Search | None = None
    optimised = None
    if plan.optimise is not None:
        found = search(plan, candidates, folder / "search")
        path = folder / "candidates" / f"{OPTIMISED}.json"
        if not path.exists():
            save(judge(OPTIMISED, found.specimen, plan), path)
        optimised = next(iter(rank([*(c for c in candidates if c.tested), load(path)], family).places), None)
    checked = None
    if validate:
        checked = validated(ranking, plan, folder / "validation", optimised.candidate if optimised else None)
    result = Design(plan, ranking, found, optimised, checked)
    report = write_report(result, folder, manifest)
    write_json(folder / "design.json", {**manifest.to_dict(), "results": summary(result)})
    return Designed(folder, result, report)


def default_file() -> Path:
    """The design file that is used where none is given."""
    return Path(str(resources.files("studies") / "templates" / "design_plan.toml"))


def completed(file: Path | None, quick: bool, seeds: int | None, evaluations: int | None) -> Plan:
    """The plan of a run. Raises `DesignError`."""
    plan = read_plan(file or default_file())
    changes: dict[str, object] = {}
    if quick:
        changes |= {"size_factor": max(plan.size_factor, 2.5)}
        changes |= {"camera": plan.camera.model_copy(update={"pictures": min(plan.camera.pictures, 4)})}
        if file is None:
            changes |= {"specimen": tuple(s for s in plan.specimen if s.title in QUICK_SPECIMENS)}
    if plan.optimise is not None:
        most = evaluations or (10 if quick else plan.optimise.evaluations)
        changes |= {"optimise": plan.optimise.model_copy(update={"evaluations": most})}
    changes |= {
        "validation": plan.validation.model_copy(update={"seeds": seeds or (1 if quick else plan.validation.seeds)})
    }
    return plan.model_copy(update=changes)
