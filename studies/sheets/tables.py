"""Tables of the report on measured data: results of the steps in, columns and rows out."""

from __future__ import annotations

from typing import Any

from studies.output.words import percent
from studies.sheets.leave_one_out import NESTED
from studies.sheets.measured_record import SHEETS
from studies.sheets.model_errors import MEAN, RETAINED, entry, members

Table = tuple[list[str], list[list[Any]]]
PARTS = ("fitted", "scored")


def error_table(models: list[dict[str, Any]]) -> Table:
    """One row a model: errors on what was fitted and on what was scored."""
    columns = ["model", "factors", "force, fitted", "force, scored", "mean force, fitted", "mean force, scored",
               "field, fitted", "field, scored", "section scatter, scored", "lower / upper third, scored"]  # fmt: skip
    rows = []
    for m in models:
        fitted, scored = m["errors"]["fitted"], m["errors"]["scored"]
        factors = ", ".join(f"{name} {value:.3g}" for name, value in m.get("factors", {}).items())
        rows.append([m["name"], factors, percent(fitted["force"]), percent(scored["force"]),
                     percent(fitted["mean_force"]), percent(scored["mean_force"]),
                     percent(fitted["field"]), percent(scored["field"]), percent(scored["section_scatter"]),
                     round(scored["lower_over_upper"], 3)])  # fmt: skip
    return columns, rows


def record_table(results: dict[str, Any]) -> Table:
    """What each record says before any model."""
    columns = ["sheet", "missing frames", "exponent of the force", "contraction in the middle",
               "largest axial strain left at no load", "lateral"]  # fmt: skip
    rows = []
    for name in SHEETS:
        r = results[f"record_{name}"]
        gaps = ", ".join(f"{n} before frame {k}" for k, n in r["missing_frames"].items()) or "none"
        inner = [max(map(abs, part[1:-1])) for part in r["at_rest"]]
        rows.append(
            [
                name,
                gaps,
                round(r["force_exponent"], 3),
                round(r["contraction"], 3),
                percent(inner[0]),
                percent(inner[1]),
            ]
        )
    return columns, rows


def amplitude_table(learnt: dict[str, Any]) -> Table:
    """Amplitudes of the retained effects, and their range over the leave-one-out fits."""
    columns = [
        "effect",
        "amplitude",
        "value",
        "standard deviation",
        "unit",
        "told from zero",
        "over the leave-one-out fits",
    ]
    left_out = [one.additions for one in members(entry(learnt, MEAN))]
    rows = []
    for a in entry(learnt, RETAINED)["amplitudes"]:
        values = [
            value
            for additions in left_out
            for one in additions
            if one.effect.name == a["effect"]
            for p, value in zip(one.effect.amplitudes, one.amplitudes, strict=True)
            if p.name == a["name"]
        ]
        told = "yes" if abs(a["value"]) > 2 * a["deviation"] else "no"
        over = f"{min(values):.3g} to {max(values):.3g}" if values else "in none"
        rows.append([a["effect"], a["name"], a["value"], a["deviation"], a["unit"], told, over])
    return columns, rows


def leave_one_out_table(learnt: dict[str, Any]) -> Table:
    """What is retained without each increment, and how that predicts."""
    columns = ["without the increment at (s)", "effects", "force, fitted", "force, scored", "field, scored"]
    keys = ("force_fitted", "force_scored", "field_scored")
    return columns, [
        [round(one["left_out"], 2), ", ".join(one["effects"]), *(percent(one[k]) for k in keys)]
        for one in learnt["leave_one_out"]
    ]


def kept(learnt: dict[str, Any], effect: str) -> str:
    """In how many leave-one-out fits an effect, or one more general or special than it, is kept."""
    alike = {effect, NESTED.get(effect, effect), *(s for s, general in NESTED.items() if general == effect)}
    found = sum(bool(alike & set(one["effects"])) for one in learnt["leave_one_out"])
    return f"{found} of {len(learnt['leave_one_out'])}"


def effect_table(learnt: dict[str, Any]) -> Table:
    """What each effect is worth: errors of the model that is fitted without it."""
    columns = ["effect", "outcome", "kept in leave-one-out fits", "rise of the misfit without it", "penalty of its parameters",
               "imitated by the others", "force, scored, without it", "field, scored, without it", "decided by"]  # fmt: skip
    rows: list[list[Any]] = []
    for line in sorted(learnt["without"], key=lambda line: -line["rise"]):
        outcome = "in the model" + (", doubtful" if line["doubtful"] else "")
        rows.append([line["effect"], outcome, kept(learnt, line["effect"]), line["rise"], line["penalty"],
                     f"{100 * line['imitated']:.1f} %", percent(line["force_scored"]), percent(line["field_scored"]), line["decided_by"]])  # fmt: skip
    gone = [(pair["general"], f"{pair['special']} does as well") for pair in learnt["exchanged"]]
    gone += [(name, "removed: not retained by BIC") for name in learnt["taken_out"]]
    rows += [[name, why, kept(learnt, name), *[None] * 6] for name, why in gone]
    rows += [[name, why, *[None] * 7] for name, why in learnt["not_testable"].items()]
    return columns, rows


def variant_table(learnt: dict[str, Any]) -> Table:
    """Every effect from other starts, and the retained effects beside other bases."""
    columns = ["variant", "misfit, of bases with penalty, over the first", "force, fitted", "force, validation", "field, validation",
               "force, scored", "field, scored"]  # fmt: skip
    first = learnt["starts"][0]["objective"]
    rows: list[list[Any]] = []
    for i, s in enumerate(learnt["starts"], start=1):
        rows.append([f"every effect, start {i}", s["objective"] - first, percent(s["force_fitted"]), None, None,
                     percent(s["force_scored"]), percent(s["field_scored"])])  # fmt: skip
    for b in learnt["bases"]:
        name = f"retained, {b['name']}" + (" (chosen)" if b["chosen"] else "")
        seen = (percent(b["validation_error"][kind]) for kind in ("force", "field"))
        rows.append([name, b["penalised_misfit"], percent(b["force_fitted"]), *seen, percent(b["force_scored"]),
                     percent(b["field_scored"])])  # fmt: skip
    return columns, rows


def spread(learnt: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Smallest and largest error after the limit over the leave-one-out fits: models that the data fitted do not choose between."""
    lines = learnt["leave_one_out"]
    kinds = {kind: [line[f"{kind}_scored"] for line in lines] for kind in ("force", "field")}
    return {kind: (min(values), max(values)) for kind, values in kinds.items()}


def rival_table(results: dict[str, Any]) -> Table:
    """Softening with strain against relaxation in time."""
    columns = ["base", "force, fitted", "field, fitted", "force, scored", "field, scored"]
    lines = [{**b, "name": f"{b['name']}, relaxing"} for b in results["first"]["bases"]]
    keys = ("force_fitted", "field_fitted", "force_scored", "field_scored")
    return columns, [[m["name"], *(percent(m[k]) for k in keys)] for m in [*lines, *results["rivals"]["models"]]]


def map_table(located: dict[str, Any]) -> Table:
    """Errors of the heterogeneous sheet before and after."""
    rows = [
        [
            part,
            *(
                percent(located["errors"][part][when][what])
                for what in ("force", "field")
                for when in ("before", "after")
            ),
        ]
        for part in PARTS
    ]
    return ["increments", "force before", "force after", "field before", "field after"], rows


def control_table(results: dict[str, Any]) -> Table:
    """The negative control."""
    rows = []
    for name in SHEETS:
        r = results[f"control_{name}"]
        first = max(r["effects"], key=lambda e: e["score"], default={"effect": None})
        rows.append(
            [name, r["pictures"], r["reduced_chi_square"], len(r["effects"]), r["smallest_adjusted_p"], first["effect"]]
        )
    return [
        "sheet",
        "pictures compared",
        "reduced chi-square",
        "effects tested",
        "smallest adjusted p",
        "highest score",
    ], rows


def loops_of(results: dict[str, Any]) -> list[dict[str, Any]]:
    """Results of the homogeneous tests."""
    return [r for key, r in results.items() if key.startswith("loop_")]


def loop_table(results: dict[str, Any]) -> Table:
    """Homogeneous tests, before and after."""
    rows = []
    for r in loops_of(results):
        effects = ", ".join([*r["named"], *(f"({name})" for name in r["closest"])]) or "none"
        for t in r["tests"]:
            role = "fitted" if t["fitted"] else "held out"
            rows.append([r["name"], t["name"], role, percent(t["before"]), percent(t["after"]), r["verdict"], effects])
    return ["loop", "test", "role", "before", "after", "verdict", "effects"], rows
