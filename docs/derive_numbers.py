"""Result files that follow from others: rates of the blind trials, the catalogue of effects, the alerts (`make numbers`).

In: the judged trials of `SETS` and `FOREIGN_SETS`, the classes of `calibrate.effects`, `studies/output/alerts.toml`. Out: `trials.json`, `foreign_trials.json`, `trial_sets.json`, `probabilities.json`, `catalogue.json` and
`alerts.json` in `docs/results`.

The definitions of the rates are those of `studies.trials.trial_summary`. A strong effect is one with a score above 10. Of these are told apart:
named right; right with a wrong name beside it; right only through a group, which names an effect that the data cannot tell from it;
not explained, and the dominant effect; missed; and a wrong name, or a wrong dominant effect.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from calibrate.diagnosis.evidence.priors import read_priors
from calibrate.effects import CATALOGUE, Effect
from calibrate.effects.chain import Addition
from studies.output.alerts import Alert, registry
from studies.output.words import percent
from studies.trials.foreign import FOREIGN as FOREIGN_FORMS
from studies.trials.foreign import NEARLY
from studies.trials.judgement import JudgedAmplitude, JudgedTrial, read
from studies.trials.trial_summary import CLEAR, FIELD, summary

FOLDER = Path(__file__).parent
FEW, NONE = 5, "none"
AIMS = {"group": "90 %", "amplitudes": "85 %", "explained": "", "pairs": "70 %"}
AIMS_OF_FOREIGN = {"group": "85 %", "amplitudes": "90 to 98 %", "explained": "at most 10 %", "pairs": "85 %"}
NEVER = "never: a common factor of modulus, force, thickness and DIC scale"


@dataclass(frozen=True)
class TrialSet:
    """Judged trials in a file of docs/trials, of the command with these options. version: what the diagnosis had that the one before had not; how: what was known. nearly: foreign forms that
    the catalogue nearly had then. same_seeds: as those of a later set, so that it is not counted with the others."""

    file: str
    options: str
    version: str
    how: str
    nearly: frozenset[str] = frozenset()
    same_seeds: bool = False

    @property
    def judged(self) -> list[JudgedTrial]:
        """Its trials."""
        return read(FOLDER / "trials" / self.file)

    @property
    def seed(self) -> str:
        """Of the first trial."""
        return self.options.split("--seed ")[1].split()[0]

    @property
    def command(self) -> str:
        """That made it."""
        return f"equigap blind {self.options}"


FIXED = "none was looked at before the diagnosis was fixed"
FOREIGN = "--foreign --seed {} --trials 6 --nulls 46 --pairs 40"
BEFORE_CORNERS = frozenset(NEARLY) - {"inclusion"}  # inclusions kept their form, an ellipse
BEFORE_FINITE = BEFORE_CORNERS - {
    "viscoelasticity"
}  # branches with a multiplicative split were not in the catalogue then
RECENT = 80000  # first seed of the sets that are counted together
WITH_FORMULA = 97000  # first seed of the sets whose intervals hold the error of the formula
BEFORE_INCLUSIONS = BEFORE_FINITE - {"stiffness field"}  # nor was an inclusion
SETS = (
    TrialSet("blind.json", "--seed 20000", "verdicts of the rounds alone", FIXED),
    TrialSet(
        "blind_of_today.json",
        '--seed 61000 --trials 1 --nulls 8 --pairs 4 --only "second invariant,viscoelasticity,Mullins softening,one fibre family,stiffness gradient,lens distortion,force offset,image rotation"',
        "evidence, replays, three-dimensional relaxation, fit of all effects",
        FIXED,
    ),
    TrialSet(
        "blind_since.json",
        "--seed 70000 --trials 4 --nulls 30 --pairs 10",
        "shapes of softening and fibres, a second start, quadratic triangles",
        "those that had ended when the time was up, looked at while it ran",
    ),
    TrialSet(
        "blind_79000.json",
        "--seed 79000 --trials 5 --nulls 36 --pairs 20",
        "all that foreign trials from 77000 have",
        "the whole plan: revisions e2872af (36, the largest tests, on 16 cores), ad9835a (62) and 5cacae2 (63); the first 98 were looked at before the last were made",
    ),
)
DEVELOPED = TrialSet(
    "foreign_64000.json",
    FOREIGN.format(64000),
    "evidence, replays",
    "used to develop: forms and the dominant effect were chosen on them",
)
FOREIGN_SETS = (
    TrialSet(
        "foreign_67000.json",
        FOREIGN.format(67000),
        "shapes of softening and fibres, the dominant effect",
        "looked at while it ran, the diagnosis unchanged; stopped for time",
        BEFORE_INCLUSIONS,
    ),
    TrialSet(
        "foreign_69000.json",
        FOREIGN.format(69000),
        "a second start, quadratic triangles",
        "stopped for time, looked at once",
        BEFORE_INCLUSIONS,
    ),
    TrialSet(
        "foreign_71000.json",
        FOREIGN.format(71000),
        "two correlation lengths of noise, inclusions, weights by one Cholesky factor",
        "revisions 91a02ac and ec5213a, the diagnosis the same; stopped for time, looked at once",
        BEFORE_FINITE,
    ),
    TrialSet(
        "foreign_75000.json",
        FOREIGN.format(75000),
        "weights that do not follow what a base misses, edges and thickness by the twin's elements",
        "revision 9a48653, the first 100 of the plan: some on 16 cores, the long ones first, then in the order of the plan; stopped for time, looked at once",
        BEFORE_FINITE,
    ),
    TrialSet(
        "foreign_77000.json",
        FOREIGN.format(77000),
        "a lens about its own centre, fibres with dispersion, tried with little stiffening",
        "revisions cab7f5d and 794276b, the diagnosis of one test the same, and ea63503, f771f59 and 122819e, which have a camera tilt in their catalogue; the whole plan, in five parts, looked at after each",
        BEFORE_FINITE,
    ),
    TrialSet(
        "foreign_80000.json",
        "--foreign --seed 80000 --trials 6 --nulls 4",
        "replays with the strip that the camera does not see",
        "revision ceb4422, in the order of the plan; stopped for time, looked at when 58 were there and at the end",
        BEFORE_FINITE,
    ),
    TrialSet(
        "foreign_84000.json",
        "--foreign --seed 84000 --trials 8 --nulls 46 --pairs 33",
        "a second relaxation time, drifts, no alarm where evidence for none is positive",
        "revisions 621a6be (21) and 8cc3557 (35), in the order of the plan; stopped for time, looked at when 14, 18 and 21 were there and at the end",
        BEFORE_FINITE,
    ),
    TrialSet(
        "foreign_86000.json",
        "--foreign --seed 86000 --trials 4 --nulls 30 --pairs 40",
        "an ellipse as inclusion, finite viscoelasticity, a drift of the stiffness, a more probable explanation in the place of one that explains",
        "revision 0198196, in the order of the plan; stopped for time, looked at when 65 were there and at the end",
        BEFORE_CORNERS,
    ),
    TrialSet(
        "foreign_88000.json",
        "--foreign --seed 88000 --trials 4 --nulls 30 --pairs 40",
        "friction, unequal gains of two axes and a nonlinear load cell in the catalogue",
        "revision 24dad38, in the order of the plan, which reached none of the three; stopped for time, looked at when 48 and 54 were there and at the end",
        BEFORE_CORNERS,
    ),
    TrialSet(
        "foreign_90000.json",
        '--foreign --seed 90000 --trials 8 --nulls 20 --pairs 10 --only "lag between force and image,force offset,friction in the load train,axis gain,load cell nonlinearity"',
        "a lag that moves forces",
        "revision 66eed21, effects of load cell and clock alone; the whole plan, looked at once",
        BEFORE_CORNERS,
    ),
    TrialSet(
        "foreign_91000.json",
        FOREIGN.format(91000),
        "a lag that moves readings, weights rid of noise",
        "revision 0d85193, in the order of the plan; stopped for time, looked at when 23 and 36 were there and at the end",
        BEFORE_CORNERS,
    ),
    TrialSet(
        "foreign_92000.json",
        FOREIGN.format(92000),
        "run on from an explanation three times as probable, two fibre families of one chart",
        "revision 6e62e547, in the order of the plan; stopped for time, looked at once",
        BEFORE_CORNERS,
    ),
    TrialSet(
        "foreign_93000_before.json",
        FOREIGN.format(93000),
        "errors of formulas that look like effects, strengths of pairs with a twin",
        "revision d7d8bf7c, in the order of the plan; stopped for the next version, looked at once",
        BEFORE_CORNERS,
        same_seeds=True,
    ),
    TrialSet(
        "foreign_93000.json",
        FOREIGN.format(93000),
        "evidence of fits as of their linear models, the final model of the rounds always among them",
        "revision a1a32975, in the order of the plan; stopped for time, looked at when 22 were there and at the end",
        BEFORE_CORNERS,
    ),
    TrialSet(
        "foreign_94000.json",
        FOREIGN.format(94000),
        "no steps of a fit to and fro, a warp about one axis or both, errors of forces as they are drawn",
        "revisions 1e5438c5 (14), 90e0dac7 (34) and d434839e (9), in the order of the plan; stopped for time and for the next version, looked at when 27 and 48 were there and at the end",
        BEFORE_CORNERS,
    ),
    TrialSet(
        "foreign_95000.json",
        FOREIGN.format(95000),
        "inclusions with corners, shapes refined from several starts, rounds that do not go back to the less probable",
        "revision 5089e4bb, in the order of the plan; stopped for time, looked at once",
        frozenset(NEARLY),
    ),
    TrialSet(
        "foreign_96000.json",
        FOREIGN.format(96000),
        "amplitudes within three deviations of their priors, effects told from none at their own shapes",
        "revision 57778956, in the order of the plan; stopped for time, looked at when 11, 23 and 35 were there and at the end",
        frozenset(NEARLY),
    ),
    TrialSet(
        "foreign_97000.json",
        FOREIGN.format(97000),
        "intervals with the error of the formula, rivals that replay what was fitted, rounds that exchange nothing for the less probable",
        "revisions ac6f4766 (45) and 41a6bf29 (22), in the order of the plan; stopped for time and for the next version, looked at when 24 were there and at the end",
        frozenset(NEARLY),
    ),
    TrialSet(
        "foreign_98000.json",
        FOREIGN.format(98000),
        "lesser effects named where they are certain, weights with the amplitudes of the fit",
        "revisions e13cdb46 (41, of the first of both) and 27d78e00 (17), in the order of the plan; stopped for time, looked at when 16, 40 and 50 were there and at the end",
        frozenset(NEARLY),
    ),
    TrialSet(
        "foreign_99000.json",
        FOREIGN.format(99000),
        "explanations weighed at their optimum, each with the noise that it makes",
        "revision cf355255, in the order of the plan; stopped for time, looked at once, at the end",
        frozenset(NEARLY),
    ),
    TrialSet(
        "foreign_101000.json",
        FOREIGN.format(101000),
        "one likelihood for models that make different noise, in the rounds as in the evidence",
        "revision 4c78656f, in the order of the plan; stopped for time, looked at once, at the end",
        frozenset(NEARLY),
    ),
)


def numbers(trials: list[JudgedTrial]) -> dict[str, Any]:
    """What the pages state."""
    found = summary(trials)
    plain, endings, removed = found.to_dict(), found.endings, found.removed
    for name in ("effects", "endings", "removed", "reliability", "replaced"):
        del plain[name]
    return {
        **plain,
        "with_dominant": sum(bool(one.dominant or (one.absent and one.absent.dominant)) for one in trials),
        "strong": endings.strong,
        "strong_group_named": endings.group_named,
        "strong_named": endings.named,
        "null_quiet": found.nulls - found.null_detections,
        **asdict(endings),
        "removed": removed.trials,
        "removed_explained": removed.explained,
        "removed_alike": removed.alike,
        "removed_wrong": removed.wrong,
        "removed_dominant": removed.dominant,
        "removed_dominant_alike": removed.dominant_alike,
    }


def share(part: int, whole: int) -> str:
    return f"{part} of {whole} ({100 * part / whole:.0f} %)" if whole else NONE


def rates(columns: dict[str, dict[str, Any]], sought: dict[str, str]) -> list[list[str]]:
    """The table of all trials, a column for each of these numbers, with what is sought."""
    each = [_rates(n, sought) for n in columns.values()]
    rows = [[question, *(one[k][1] for one in each), aim] for k, (question, _, aim) in enumerate(each[0])]
    return [["question", *columns, "aim"], *(row for row in rows if set(row[1:-1]) != {NONE})]


def _rates(n: dict[str, Any], sought: dict[str, str]) -> list[list[str]]:
    """Question, rate and aim."""
    return [
        ["nothing hidden: something called significant", share(n["null_detections"], n["nulls"]), "at most 5 %"],
        ["one strong effect: its group named", share(n["strong_group_named"], n["strong"]), sought["group"]],
        ["- named right, and nothing else", share(n["right"], n["strong"]), ""],
        ["- named right, with a wrong name beside it", share(n["beside"], n["strong"]), ""],
        ["- right only through a group: one that the data cannot tell from it is named", share(n["group"], n["strong"]), ""],
        ["one strong effect: not explained, but traced to it as the dominant effect", share(n["dominant"], n["strong"]) if n["with_dominant"] else NONE, ""],
        ["one strong effect: neither", share(n["missed"], n["strong"]), ""],
        ["one strong effect: a wrong name, or a wrong dominant effect", share(n["wrong"], n["strong"]), ""],
        ["amplitude within its 95 % interval", share(n["amplitudes_within"], n["amplitudes"]), sought["amplitudes"]],
        ["effect removed from the catalogue: a name that is no declared look-alike", share(n["absent_wrong"], n["absent"]), "at most 15 %"],
        ["strong effect removed: verdict *explained*, by whatever name", share(n["removed_explained"], n["removed"]), sought["explained"]],
        ["- explained by a declared look-alike, which the line on names excuses", share(n["removed_alike"], n["removed"]), ""],
        ["strong effect removed: not explained, and another one dominant", share(n["removed_dominant"], n["removed"]) if n["with_dominant"] else NONE, ""],
        ["two effects, each strong beside the other: both named", share(n["pairs_found"], n["pairs"]), sought["pairs"]],
        ["- both named right, themselves", share(n["pairs_right"], n["pairs"]), ""],
        [f"- of those with a score above {CLEAR:.0f} each: both named", share(n["pairs_clear_found"], n["pairs_clear"]), ""],
        ["two effects, each strong before either is found: both named", share(n["pairs_at_first_found"], n["pairs_at_first"]), ""],
        ["both in the model, named or too small beside the other to be named", share(n["pairs_in_model"], n["pairs"]), ""],
        ["stiffness field: correlation with the hidden one, median", NONE if n["field_correlation"] is None else f"{n['field_correlation']:.2f}", ""],
        ["CPU time of a diagnosis, median", f"{n['seconds']:.0f} s", ""],
    ]  # fmt: skip


def effects(trials: list[JudgedTrial]) -> list[list[str]]:
    """A line for each effect: how the strong ones ended, intervals, and what happens without it in the catalogue."""
    head = ["hidden", "strong", "right", "wrong name beside", "only its group", "dominant", "missed", "wrong", "amplitude within", "rms pull",
            "removed: explained (strong)", "removed: wrong name (all)"]  # fmt: skip
    rows = []
    for one in summary(trials).effects:
        inside = "see the correlation" if one.effect == FIELD else f"{one.amplitudes_within} of {one.amplitudes}"
        counts = list(map(str, asdict(one.endings).values()))
        explained = f"{one.removed.explained} of {one.removed.trials}"
        wrong = f"{one.absent_wrong} of {one.absent}"
        rms = "" if one.rms_pull is None else f"{one.rms_pull:.1f}"
        rows.append([one.effect, str(one.endings.strong), *counts, inside, rms, explained, wrong])
    place = head.index("dominant")
    kept = [k for k in range(len(head)) if k != place or any(row[place] != "0" for row in rows)]
    return [[row[k] for k in kept] for row in (head, *rows)]


def trials(one: TrialSet) -> dict[str, Any]:
    """`trials.json`."""
    n = numbers(one.judged)
    return {
        "command": f"python docs/derive_numbers.py, from docs/trials/{one.file} of {one.command}",
        "how": one.how,
        "numbers": n,
        "tables": {"rates": rates({"found": n}, AIMS), "effects": effects(one.judged)},
    }


def foreign_trials() -> dict[str, Any]:
    """`foreign_trials.json`: of the largest set, and of all since `RECENT`, each of the version of its day. Told apart are forms that are foreign, those that are nearly the catalogue's, and those that are foreign
    in base and noise alone."""
    largest = max(FOREIGN_SETS, key=lambda one: len(one.judged))
    recent = [one for one in FOREIGN_SETS if int(one.seed) >= RECENT and not one.same_seeds]
    pooled = [trial for one in recent for trial in one.judged]
    n, since = numbers(largest.judged) | _by_form([largest]), numbers(pooled) | _by_form(recent)
    before = [trial for one in recent if int(one.seed) < WITH_FORMULA for trial in one.judged]
    as_they_were, widened = summary(before), summary([_with_formula(one) for one in before])
    since |= {
        "amplitudes_before": as_they_were.amplitudes,
        "amplitudes_before_within": as_they_were.amplitudes_within,
        "amplitudes_with_formula": widened.amplitudes_within,
    }
    columns = {
        f"one version, {n['trials']} trials": n,
        f"the last {len(recent)} versions, {since['trials']} trials": since,
    }
    return {
        "command": f"python docs/derive_numbers.py, from docs/trials/{largest.file} of {largest.command}, and {', '.join(one.file for one in recent)}",
        "how": largest.how,
        "numbers": n | {f"recent_{name}": value for name, value in since.items()} | {"recent_sets": len(recent)},
        "tables": {"rates": rates(columns, AIMS_OF_FOREIGN), "effects": effects(pooled)},
    }


def _with_formula(one: JudgedTrial) -> JudgedTrial:
    """The same amplitudes over deviations that hold the error of the formula; those of a warp lack its next orders."""
    known = {effect.name: effect for effect in CATALOGUE}

    def widened(a: JudgedAmplitude) -> JudgedAmplitude:
        addition = Addition(known[a.effect], tuple(a.amplitudes.values()))
        wider = dict(zip(a.amplitudes, addition.with_formula_error(tuple(a.deviations.values())), strict=True))
        return replace(a, pulls={name: pull * a.deviations[name] / wider[name] for name, pull in a.pulls.items()})

    return replace(one, amplitudes=[a and widened(a) for a in one.amplitudes])


def _by_form(sets: list[TrialSet]) -> dict[str, int]:
    """Strong effects by how foreign their form is, and those of them whose group is named."""
    found: dict[str, int] = {}
    for kind in ("foreign_form", "near_form", "own_form"):
        ones = [trial for one in sets for trial in one.judged if _kind(trial, one) == kind]
        found |= {kind: len(ones), f"{kind}_named": sum(one.hit[0] for one in ones)}
    return found | {
        f"other_form{end}": found[f"foreign_form{end}"] + found[f"near_form{end}"] for end in ("", "_named")
    }


def _kind(trial: JudgedTrial, of: TrialSet) -> str | None:
    """How foreign the form of the one strong effect is; None of other trials."""
    if not trial.strong or len(trial.hidden) != 1:
        return None
    (effect,) = trial.hidden
    if effect in of.nearly:
        return "near_form"
    return "foreign_form" if effect in FOREIGN_FORMS else "own_form"


def trial_sets() -> dict[str, Any]:
    """`trial_sets.json`: a line a set."""
    head = ["seeds from", "new in the diagnosis", "trials", "alarms, nothing hidden", "strong: named", "dominant", "wrong", "amplitudes within", "strong pairs: both named", "removed: explained", "of these by a look-alike", "how"]  # fmt: skip

    def row(one: TrialSet) -> list[str]:
        n = numbers(one.judged)
        pairs = ("null_detections", "nulls"), ("strong_group_named", "strong"), ("amplitudes_within", "amplitudes"), ("pairs_found", "pairs"), ("removed_explained", "removed")  # fmt: skip
        alarms, named, within, both, explained = (f"{n[a]} of {n[b]}" for a, b in pairs)
        counts = str(n["trials"]), alarms, named, str(n["dominant"]), str(n["wrong"]), within, both, explained, str(n["removed_alike"])  # fmt: skip
        return [one.seed, one.version, *counts, one.how]

    groups = {"own": SETS, "foreign": (DEVELOPED, *FOREIGN_SETS)}
    before = {one.trial: one for of in FOREIGN_SETS if of.same_seeds for one in of.judged}
    again = [
        (before[one.trial], one) for of in FOREIGN_SETS if not of.same_seeds for one in of.judged if one.trial in before
    ]
    alike = sum((a.verdict, a.named) == (b.verdict, b.named) for a, b in again)
    return {
        "command": "python docs/derive_numbers.py, from the files of `docs/trials` that it names",
        "numbers": {"again": len(again), "alike": alike},
        "tables": {name: [head, *map(row, some)] for name, some in groups.items()},
    }


def probabilities() -> dict[str, Any]:
    """`probabilities.json`: how often what has a probability is there, of the last set whose trials have them."""
    today = next(one for one in reversed(FOREIGN_SETS) if any(trial.probabilities for trial in one.judged))
    found = summary(today.judged)
    rows = [
        [f"{100 * one.low:.0f} to {100 * one.high:.0f} %", str(one.effects), percent(one.mean), str(one.there), percent(one.there / one.effects)]
        for one in found.reliability
    ]  # fmt: skip
    head = ["probability of an effect", "effects, over all trials", "mean probability", "of these hidden", "share"]
    certain, told = found.reliability[-1], _told(today)
    versions = [
        [
            "seeds from",
            "new in the diagnosis",
            "trials with probabilities",
            "effects with more than 95 %",
            "of these hidden",
        ]
    ]
    for one in FOREIGN_SETS:
        if _told(one):
            top = summary(one.judged).reliability[-1]
            versions.append([one.seed, one.version, str(_told(one)), str(top.effects), str(top.there)])
    return {
        "command": f"python docs/derive_numbers.py, from docs/trials/{today.file} of {today.command}",
        "numbers": {**asdict(found.replaced), "told": told, "certain": certain.effects, "certain_there": certain.there},
        "tables": {"reliability": [head, *rows], "versions": versions},
    }


def _told(one: TrialSet) -> int:
    """Trials of a set whose explanations were fitted."""
    return sum(trial.probabilities is not None for trial in one.judged)


def catalogue() -> dict[str, Any]:
    """`catalogue.json`: a row for each effect that is tested."""
    rows = [["effect", "stage", "formula", "amplitudes and shapes (unit)", "decided by", "source"]]
    for effect in CATALOGUE:
        formula = f"`{effect.formula}`".replace("|", "\\|")
        source = effect.source.replace("derived in docs/thickness.md", "[derived here](thickness.md)")
        rows.append([effect.name, effect.stage, formula, parameters(effect), effect.decided_by or NEVER, source])
    return {
        "command": "python docs/derive_numbers.py, from the classes of calibrate.effects",
        "numbers": {"effects": len(CATALOGUE)},
        "tables": {"effects": rows, "priors": priors()},
    }


def priors() -> list[list[str]]:
    """What is believed of every effect before a test, from `priors.toml`."""
    table = [["effect", "standard deviation", "why"]]
    for name, prior in read_priors().items():
        size = f"{prior.std:g} of the {prior.of}" if prior.of.isalpha() else f"{prior.std:g} {prior.of}".strip()
        table.append([name, size, prior.why])
    return table


def parameters(effect: Effect) -> str:
    """Names and units; the first and last of many."""
    words = [
        f"{p.name} ({p.unit})" if p.unit not in ("", "1") else p.name for p in (*effect.amplitudes, *effect.shapes)
    ]
    return ", ".join(words) if len(words) < FEW else f"{words[0]}, ..., {words[-1]}"


def alerts() -> dict[str, Any]:
    """`alerts.json`: a table for each letter, with a place to link to in each row."""
    tables: dict[str, list[list[str]]] = {}
    for alert in registry().values():
        rows = tables.setdefault(alert.code[0], [["code", "severity", "it means", "what to do"]])
        rows.append([f'<a id="{alert.anchor}"></a>{alert.code}', severity(alert), alert.means, alert.do])
    return {
        "command": "python docs/derive_numbers.py, from studies/output/alerts.toml",
        "numbers": {"codes": len(registry())},
        "tables": tables,
    }


def severity(alert: Alert) -> str:
    """'warning; **serious** where ...'."""
    named = [f"**{s}**" if s == "serious" else str(s) for s in (alert.severity, alert.raised) if s is not None]
    return named[0] if alert.raised is None else f"{named[0]}; {named[1]} where {alert.when}"


def main() -> dict[str, dict[str, Any]]:
    """Everything that is written, by file."""
    return {
        "trials": trials(SETS[0]),
        "foreign_trials": foreign_trials(),
        "trial_sets": trial_sets(),
        "probabilities": probabilities(),
        "catalogue": catalogue(),
        "alerts": alerts(),
    }


if __name__ == "__main__":
    for name, content in main().items():
        (FOLDER / "results" / f"{name}.json").write_text(json.dumps(content, indent=1) + "\n")
