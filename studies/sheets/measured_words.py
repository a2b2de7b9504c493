"""Tables and sentences on measured data. Results of `studies.commands.measured` in, text out."""

from __future__ import annotations

from typing import Any

from calibrate.diagnosis.selection import DEFAULT
from studies.commands.measured import SHEETS
from studies.sheets.measured_account import members
from studies.sheets.measured_searches import NESTED

Table = tuple[list[str], list[list[Any]]]
PARTS = ("fitted", "scored")


def percent(value: float) -> str:
    """'2.6 %', '120 %'."""
    text = f"{100 * value:.2g}"
    return f"{float(text):.0f} %" if "e+" in text else f"{text} %"


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


def amplitude_table(models: list[dict[str, Any]]) -> Table:
    """Amplitudes of what pays, and their range over the searches."""
    columns = ["effect", "amplitude", "value", "standard deviation", "unit", "told from zero", "over the searches"]
    pays, searched = models[-2], [one.additions for one in members(models[-1])]
    rows = []
    for a in pays["amplitudes"]:
        values = [
            value
            for additions in searched
            for one in additions
            if one.effect.name == a["effect"]
            for p, value in zip(one.effect.amplitudes, one.amplitudes, strict=True)
            if p.name == a["name"]
        ]
        told = "yes" if abs(a["value"]) > 2 * a["deviation"] else "no"
        over = f"{min(values):.3g} to {max(values):.3g}" if values else "in none"
        rows.append([a["effect"], a["name"], a["value"], a["deviation"], a["unit"], told, over])
    return columns, rows


def search_table(learnt: dict[str, Any]) -> Table:
    """What pays without each increment, and how that predicts."""
    columns = ["without the increment at (s)", "effects", "force, fitted", "force, scored", "field, scored"]
    keys = ("force_fitted", "force_scored", "field_scored")
    return columns, [
        [round(one["left_out"], 2), ", ".join(one["effects"]), *(percent(one[k]) for k in keys)]
        for one in learnt["searches"]
    ]


def kept(learnt: dict[str, Any], effect: str) -> str:
    """In how many searches an effect, or one more general or special than it, is kept."""
    alike = {effect, NESTED.get(effect, effect), *(s for s, general in NESTED.items() if general == effect)}
    found = sum(bool(alike & set(one["effects"])) for one in learnt["searches"])
    return f"{found} of {len(learnt['searches'])}"


def effect_table(learnt: dict[str, Any]) -> Table:
    """What each effect is worth: errors of the model that is fitted without it."""
    columns = ["effect", "outcome", "kept in searches", "rise of the misfit without it", "price of its parameters",
               "imitated by the others", "force, scored, without it", "field, scored, without it", "decided by"]  # fmt: skip
    rows: list[list[Any]] = []
    for line in sorted(learnt["without"], key=lambda line: -line["rise"]):
        outcome = "in the model" + (", doubtful" if line["doubtful"] else "")
        rows.append([line["effect"], outcome, kept(learnt, line["effect"]), line["rise"], line["price"],
                     f"{100 * line['imitated']:.1f} %", percent(line["force_scored"]), percent(line["field_scored"]), line["decided_by"]])  # fmt: skip
    gone = [(pair["general"], f"{pair['special']} does as well") for pair in learnt["exchanged"]]
    gone += [(name, "taken out: does not pay") for name in learnt["taken_out"]]
    rows += [[name, why, kept(learnt, name), *[None] * 6] for name, why in gone]
    rows += [[name, why, *[None] * 7] for name, why in learnt["not_testable"].items()]
    return columns, rows


def variant_table(learnt: dict[str, Any]) -> Table:
    """The whole from other starts, and what pays beside other bases."""
    columns = ["variant", "misfit or price over the first", "force, fitted", "force, foreseen", "field, foreseen",
               "force, scored", "field, scored"]  # fmt: skip
    first = learnt["starts"][0]["objective"]
    rows: list[list[Any]] = []
    for i, s in enumerate(learnt["starts"], start=1):
        rows.append([f"every effect, start {i}", s["objective"] - first, percent(s["force_fitted"]), None, None,
                     percent(s["force_scored"]), percent(s["field_scored"])])  # fmt: skip
    for b in learnt["bases"]:
        name = f"what pays, {b['name']}" + (" (chosen)" if b["chosen"] else "")
        seen = (percent(b["foresight"][kind]) for kind in ("force", "field"))
        rows.append([name, b["price"], percent(b["force_fitted"]), *seen, percent(b["force_scored"]),
                     percent(b["field_scored"])])  # fmt: skip
    return columns, rows


def spread(learnt: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Smallest and largest error after the limit over the searches: models that the data fitted do not choose between."""
    lines = learnt["searches"]
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


def loop_table(results: dict[str, Any]) -> Table:
    """Homogeneous tests, before and after."""
    rows = []
    for key, r in results.items():
        if key.startswith("loop_"):
            effects = ", ".join([*r["named"], *(f"({name})" for name in r["closest"])]) or "none"
            for t in r["tests"]:
                role = "fitted" if t["fitted"] else "held out"
                rows.append(
                    [r["name"], t["name"], role, percent(t["before"]), percent(t["after"]), r["verdict"], effects]
                )
    return ["loop", "test", "role", "before", "after", "verdict", "effects"], rows


def verdict(learnt: dict[str, Any]) -> str:
    """One line on a sheet."""
    base, pays, final = (learnt["models"][i]["errors"]["scored"] for i in (0, -2, -1))
    effects = ", ".join(learnt["closest"])
    (low, high), (lowest, highest) = spread(learnt).values()
    text = f"{learnt['name']}: {learnt['verdict']}"
    if effects:
        text += f"; closest: {effects}"
    if not learnt.get("predicts", True):
        text += "; what was fitted is met, what comes after is predicted worse than by neo-Hooke"
    if learnt.get("unfinished_fits"):
        text += f"; fits stopped before they had converged: {learnt['unfinished_fits']}"
    return (
        f"{text}; on increments never used, force error {percent(base['force'])} -> {percent(final['force'])}, "
        f"field error {percent(base['field'])} -> {percent(final['field'])} (mean of {len(learnt['searches'])} searches, each "
        f"without one increment, that predict force to {percent(low)} to {percent(high)}, field to {percent(lowest)} to "
        f"{percent(highest)}; the one search with all of them {percent(pays['force'])} and {percent(pays['field'])})"
    )


def answers(results: dict[str, Any]) -> list[str]:
    """The findings, a line each."""
    second, located = results["second"]["models"], results["map"]["errors"]["scored"]
    carried = [percent(m["errors"]["scored"]["force"]) for m in (second[0], second[-1])]
    controls = [results[f"control_{name}"] for name in SHEETS]
    found = [c["name"] for c in controls if c["smallest_adjusted_p"] < DEFAULT.significance]
    return [
        verdict(results["first"]),
        f"the same loop on its own: {verdict(results['own'])}",
        f"carried to {results['second']['name']} with the stiffness times {second[-1]['factor']:.3g}: force error "
        f"{carried[0]} -> {carried[1]}",
        f"{results['map']['name']}: with a stiffness that varies, force error {percent(located['before']['force'])} -> "
        f"{percent(located['after']['force'])}, field error {percent(located['before']['field'])} -> "
        f"{percent(located['after']['field'])}",
        "between neighbouring pictures: "
        + (f"something significant in {', '.join(found)}" if found else "nothing significant"),
    ]
