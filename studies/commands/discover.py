"""`equigap discover`: Experiments in; what a hyperelastic model leaves, which effect explains it, and the evidence, out.

Out: ``report.html``, its figures as PNG, the same as data (``discovery.json``, ``effects.csv``, ``amplitudes.csv``,
``forces.csv``, ``residuals.npz``), the extended model ``model.json``, and a manifest. The method is in docs/discover.md.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

from cyclopts import Parameter

from calibrate.data.chosen_pictures import Wanted, chosen
from calibrate.data.experiment import Experiment
from calibrate.diagnosis import discovery
from calibrate.diagnosis.evidence.priors import read_priors
from calibrate.diagnosis.hold_out import HoldOut, Kind
from calibrate.effects import CATALOGUE, Effect
from calibrate.errors import ConfigError
from studies.commandline.option_types import (
    NonNegative,
    OutputFolder,
    Overwrite,
    Pictures,
    Positive,
    Repeated,
    Seed,
    default_folder,
    nearest,
)
from studies.commandline.outcome import Complete, Outcome
from studies.errors import OptionError
from studies.output import Manifest, open_output_folder, released_if_refused
from studies.output.findings import Finding
from studies.output.folder import CHECKPOINT, complete, earlier_answer
from studies.output.run_progress import RunProgress
from studies.replay.replay_check import FiniteElementCheck
from studies.replay.twin_replay import twin_replay
from studies.reports.alert_table import alert_lines
from studies.reports.discovery.discovery_findings import no_time
from studies.reports.discovery.discovery_findings import remarks as all_remarks
from studies.reports.discovery.discovery_quality import discovery_headline, others_hold
from studies.reports.discovery.model_files import extended, unexplained
from studies.reports.discovery.replays.replayed_models import to_predict_with
from studies.reports.discovery.report import write
from studies.reports.discovery.statement import clauses, use_of_models
from studies.reports.discovery.view import View


@Parameter(name="*", group="Diagnosis")
@dataclass(frozen=True)
class Diagnosis:
    """What is tested, and what confirms it."""

    hold_out: Repeated = ()
    """what confirms: another EXPERIMENT.npz (may be repeated), every:N, after:SECONDS, half:left|right|bottom|top, last[:SHARE],
    random[:SHARE] (a share of the increments, 0.3 where it is not given), or none
    (default: the files given here, else every:3)"""
    base: Literal["positive", "convex", "neo-Hooke"] = "positive"
    """base model: energy of I1 that rises, one that is convex too, as a network is, or neo-Hooke"""
    spacing: Positive | None = None
    """of the virtual fields, mm (default: from the noise)"""
    without: Repeated = ()
    """leave a candidate out (may be repeated)"""
    priors: Path | None = None
    """standard deviations of amplitudes before the test, TOML (default: those of docs/discover_method.md)"""
    readings: NonNegative = 0
    """use the machine record: parts of each interval between pictures at whose ends the force of the grips is fitted, too (0: pictures alone)"""
    seed: Seed = 0
    """of the simulated search"""


@dataclass(frozen=True)
class Discovered(Outcome):
    """A diagnosis. folder: with ``model.json``."""

    folder: Path
    view: View
    report: Path

    def lines(self) -> Iterable[str]:
        """The verdict, what to know of it, and the files."""
        first, *others = clauses(self.view)
        yield f"{first}."
        yield from (f"  {clause}." for clause in others)
        yield from use_of_models(self.view)
        yield from alert_lines(all_remarks(self.view))
        if others_hold(self.view) and (file := to_predict_with(self.view.discovery)):
            yield f"to predict with: {self.folder / file}"
        yield f"model: {self.folder / 'model.json'}"
        yield f"report: {self.report}"


def discover(
    *experiments: Path,
    diagnosis: Diagnosis = Diagnosis(),
    pictures: Pictures = None,
    quick: bool = False,
    output: OutputFolder = None,
    overwrite: Overwrite = False,
) -> Discovered | Complete:
    """Test what a hyperelastic model of I1 leaves unexplained.

    Which effect of material, camera or load cell it looks like, whether data that were not used for fitting confirm it, and what
    cannot be told from it. Effects are added one by one until nothing is significant, or nothing that is known explains it. Takes
    some minutes for each model; a run that was killed goes on from its last stage.

    Args:
        experiments: tests of one material (.npz), fitted together
        quick: fit no explanations, which `equigap decide` needs, look for no few effects, draw fewer figures; minutes all the same

    Raises:
        OptionError: no experiment, unknown effect.
        ConfigError: experiments or hold-outs that do not go together.
    """
    started = time.time()
    if not experiments:
        raise OptionError("EXPERIMENT.npz: give at least one test; see `equigap discover --help`")
    rule, files = hold_outs(diagnosis.hold_out, diagnosis.seed)
    effects, priors = candidates(diagnosis.without), read_priors(diagnosis.priors)
    trained, held, remarks = read(experiments, files, rule, pictures)
    settings = {
        **asdict(diagnosis),
        "pictures": pictures,
        "quick": quick,
        "hold_out": list(diagnosis.hold_out) or ["(default)"],
    }
    settings["priors"] = "(default)" if diagnosis.priors is None else str(diagnosis.priors)
    manifest = Manifest(diagnosis.seed, settings, [*experiments, *files, *filter(None, [diagnosis.priors])], started)
    key = {"command": "discover", **settings, "experiments": manifest.read_files}
    folder = open_output_folder(output or default_folder("discover", quick), overwrite, key)
    if (answer := earlier_answer(folder)) is not None:
        (folder / CHECKPOINT).unlink(missing_ok=True)
        return Complete(folder, answer)
    with released_if_refused(folder), RunProgress(folder / CHECKPOINT) as say:
        found = discovery.discover(
            trained, rule, held, effects, diagnosis.spacing, diagnosis.base, diagnosis.seed, say,
            priors=priors, fitted=not quick, replay=twin_replay, readings=diagnosis.readings,
            check=FiniteElementCheck(),
        )  # fmt: skip
        view = View(found, held_out_words(rule, trained, held), remarks, quick)
        manifest.started -= say.earlier_seconds
        say("network of the base")
        model = replace(extended(found, view.hold_out, manifest.to_dict()), fitness=discovery_headline(view).fitness)
        say("writing the report")
        beside = unexplained(found, view.hold_out, manifest.to_dict())
        done = Discovered(folder, view, write(folder, view, model, manifest, beside))
        complete(folder, done.lines())
        say.finished()
    return done


def hold_outs(texts: Sequence[str], seed: int = 0) -> tuple[HoldOut | None, list[Path]]:
    """The rule (None: the default) and the files among the values of --hold-out. Raises `ConfigError`."""
    files = [Path(text) for text in texts if text.endswith(".npz") or Path(text).is_file()]
    rules = [text for text in texts if Path(text) not in files]
    if len(rules) > 1:
        raise ConfigError(f"--hold-out {' and '.join(rules)}: give one rule; only files may be repeated")
    return HoldOut.parse(rules[0], seed) if rules else None, files


def candidates(without: Sequence[str]) -> tuple[Effect, ...]:
    """The catalogue but the effects named. Raises `OptionError`."""
    names = [effect.name for effect in CATALOGUE]
    for name in without:
        if name not in names:
            raise OptionError(
                f"--without '{name}': no such effect{nearest(name, names)}; choose from {', '.join(names)}"
            )
    return tuple(effect for effect in CATALOGUE if effect.name not in without)


def read(
    paths: Sequence[Path], held_paths: Sequence[Path], rule: HoldOut | None, pictures: Wanted = None
) -> tuple[list[Experiment], list[Experiment], tuple[Finding, ...]]:
    """Experiments to be fitted, to be held out, and remarks; of each the pictures wanted. Raises `ConfigError` where they do not go together.

    Where one has no time, all do without: an effect of time cannot be carried over.
    """
    loaded = [(path, Experiment.load(path)) for path in (*paths, *held_paths)]
    seen: dict[str, tuple[Path, bool]] = {}
    for i, (path, experiment) in enumerate(loaded):
        other, fitted = seen.setdefault(experiment.fingerprint, (path, i < len(paths)))
        if i < len(paths) and seen[experiment.fingerprint][0] is not path:
            raise ConfigError(f"{path}: the same data as {other}; give each test once")
        if i >= len(paths) and (fitted or other is not path):
            raise ConfigError(
                f"--hold-out {path}: the same data as {other}; what is held out must not be fitted, nor given twice"
            )
    units = {experiment.stress_unit: path for path, experiment in loaded}
    if len(units) > 1:
        raise ConfigError(
            f"{units['MPa']} has a thickness, {units['N/mm']} has none, so that their stiffness cannot be compared; "
            "import them with a thickness each, or without"
        )
    remarks: list[Finding] = []
    experiments = [chosen(experiment, pictures) for experiment in _named_apart(loaded)]
    timeless = [str(path) for path, experiment in loaded if experiment.time is None]
    if 0 < len(timeless) < len(loaded):
        if rule is not None and rule.kind == "after":
            raise ConfigError(f"{timeless[0]}: has no time, which --hold-out after:SECONDS needs; use every:N")
        experiments = [experiment.without_time() for experiment in experiments]
        remarks.append(no_time(timeless[0]))
    return experiments[: len(paths)], experiments[len(paths) :], tuple(remarks)


def _named_apart(loaded: Sequence[tuple[Path, Experiment]]) -> list[Experiment]:
    """Tests of one name, as of two folders with the same, get that of the folder of their file as well, or a number where that is the same, too."""
    names = [experiment.name for _, experiment in loaded]
    longer = [f"{name} ({path.resolve().parent.name})" if names.count(name) > 1 else name for name, (path, _) in zip(names, loaded, strict=True)]  # fmt: skip
    apart = [f"{name} {longer[: i + 1].count(name)}" if longer.count(name) > 1 else name for i, name in enumerate(longer)]  # fmt: skip
    return [replace(experiment, name=name) for name, (_, experiment) in zip(apart, loaded, strict=True)]


def held_out_words(rule: HoldOut | None, trained: Sequence[Experiment], held: Sequence[Experiment]) -> str:
    """What is held out: 'every third increment', 'pull_y', ...; as `discover` chooses where there is no rule."""
    rule = rule or HoldOut.default(min(e.n_increments for e in trained), bool(held))
    words = [e.name for e in held] + ([str(rule)] if rule.kind != Kind.NONE else [])
    return " and ".join(words) or "nothing"
