"""Tables and sentences on measured data. Results of `studies.measured` in, text out."""

from __future__ import annotations

from typing import Any

from calibrate.discovery import ALPHA
from studies.measured import SHEETS

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
    """Amplitudes of the last model."""
    columns = ["effect", "amplitude", "value", "standard deviation", "unit", "told from zero"]
    return columns, [
        [
            a["effect"],
            a["name"],
            a["value"],
            a["deviation"],
            a["unit"],
            "yes" if abs(a["value"]) > 2 * a["deviation"] else "no",
        ]
        for a in models[-1]["amplitudes"]
    ]


def effect_table(learnt: dict[str, Any]) -> Table:
    """What each effect is worth: errors of the model that is fitted without it."""
    columns = ["effect", "outcome", "rise of the misfit without it", "price of its parameters", "imitated by the others",
               "force, scored, without it", "field, scored, without it", "decided by"]  # fmt: skip
    rows: list[list[Any]] = []
    for line in sorted(learnt["without"], key=lambda line: -line["rise"]):
        outcome = "in the model" + (", doubtful" if line["doubtful"] else "")
        rows.append([line["effect"], outcome, line["rise"], line["price"], f"{100 * line['imitated']:.1f} %",
                     percent(line["force_scored"]), percent(line["field_scored"]), line["decided_by"]])  # fmt: skip
    rows += [[pair["general"], f"{pair['special']} does as well", *[None] * 6] for pair in learnt["exchanged"]]
    rows += [[name, "taken out: does not pay", *[None] * 6] for name in learnt["taken_out"]]
    rows += [[name, why, *[None] * 6] for name, why in learnt["not_testable"].items()]
    return columns, rows


def variant_table(learnt: dict[str, Any]) -> Table:
    """The whole from other starts, and what pays beside other bases."""
    columns = ["variant", "misfit or price over the first", "force, fitted", "force, scored", "field, scored"]
    first = learnt["starts"][0]["objective"]
    lines = [(f"every effect, start {i}", s["objective"] - first, s) for i, s in enumerate(learnt["starts"], start=1)]
    lines += [(f"what pays, {b['name']}", b["price"], b) for b in learnt["bases"]]
    return columns, [
        [name, value, percent(e["force_fitted"]), percent(e["force_scored"]), percent(e["field_scored"])]
        for name, value, e in lines
    ]


def spread(learnt: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Smallest and largest error after the limit over every model with effects that was fitted."""
    lines = [*learnt["starts"], *learnt["without"], *learnt["bases"]]
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
    base, final = learnt["models"][0]["errors"]["scored"], learnt["models"][-1]["errors"]["scored"]
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
        f"field error {percent(base['field'])} -> {percent(final['field'])} (over all models with effects force "
        f"{percent(low)} to {percent(high)}, field {percent(lowest)} to {percent(highest)})"
    )


def answers(results: dict[str, Any]) -> list[str]:
    """The findings, a line each."""
    second, located = results["second"]["models"], results["map"]["errors"]["scored"]
    carried = [percent(m["errors"]["scored"]["force"]) for m in (second[0], second[-1])]
    controls = [results[f"control_{name}"] for name in SHEETS]
    found = [c["name"] for c in controls if c["smallest_adjusted_p"] < ALPHA]
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
