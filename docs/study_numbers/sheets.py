"""Numbers and tables of the measured sheets: the folders of `equigap measured`, and of `equigap replay` of the first sheet with the plausible model and with
neo-Hooke, in; what the pages state out."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from wording import share

from calibrate.effects import KNOWN
from calibrate.models.addition_json import amplitude_unit
from studies.output.words import with_unit

SHORT = {"Soft_Homo": "soft", "Stiff2_Homo": "stiff", "Stiff2_Hetero": "hetero"}
MODELS = {
    "neo-Hooke": "neo_hooke",
    "base": "base",
    "base and effects found": "found",
    "all effects at once": "all",
    "plausible effects": "plausible",
}


EFFECTS = {effect.name: effect for effect in KNOWN}
UNTIL = 15.0  # s


def take(folder: Path, replay: Path, neo_hooke: Path) -> dict[str, Any]:
    """Errors of every model of every sheet, tables as the report has them, amplitudes of all effects, and the forces of a replay of the first sheet."""
    found = json.loads((folder / "measured.json").read_text())
    record = json.loads((folder / "Soft_Homo" / "report.json").read_text())  # a report may be made again later
    numbers: dict[str, Any] = {}
    for name, short in SHORT.items():
        one = found[f"sheet_{name}"]
        for model in one["models"]:
            for part in ("fitted", "held_out"):
                for kind in ("force", "field"):
                    numbers[f"{short}_{MODELS[model['name']]}_{kind}_{part}"] = share(model[part][kind])
        numbers[f"{short}_chi_square"] = f"{one['chi_square']:.0f}"
        numbers[f"{short}_verdict"] = one["verdict"]
        numbers[f"{short}_implausible"] = ", ".join(one["implausible"]) or "none"
        numbers[f"{short}_minutes"] = f"{one['seconds'] / 60:.0f}"
        if one["discrepancy"] is not None:
            numbers[f"{short}_discrepancy"] = f"{one['discrepancy']:.0f}"
    controls = [one for name, one in found.items() if name.startswith("control_")]
    numbers["control_smallest_p"] = f"{min(one['smallest_adjusted_p'] for one in controls):.2f}"
    tables = {name: list(csv.reader((folder / f"{name}.csv").read_text().splitlines()))
              for name in ("verdicts", "errors", "transfers", "homogeneous", "control")}  # fmt: skip
    tables["amplitudes"] = [["sheet", "fit", "effect", "amplitude", "prior standard deviations", "shape", "R^2 on the others"],
                            *(row for name in SHORT for row in amplitudes(folder, name))]  # fmt: skip
    numbers |= forces(replay)
    numbers |= {f"{name}_mm": last_field(one) for name, one in (("replay", replay), ("replay_neo_hooke", neo_hooke))}
    return {
        "command": "equigap measured; equigap replay results/measured/Soft_Homo.npz results/measured/Soft_Homo/model_plausible.json; equigap replay results/measured/Soft_Homo.npz neo_hooke --parameter mu=0.4",
        "how": f"revision {record.get('revision', 'unknown')}; first 15 s fitted, what comes after held out and looked at once",
        "numbers": numbers,
        "tables": tables,
    }


def amplitudes(folder: Path, name: str) -> list[list[str]]:
    """Of every effect that a fit needs, the amplitude that is furthest from none."""
    found = json.loads((folder / name / "discovery.json").read_text())
    together = found["all_effects"]
    fits = {} if together is None else {"all effects at once": together, "plausible effects": together["plausible"]}
    rows = []
    for fit, one in ((fit, one) for fit, content in fits.items() if content is not None for one in content["effects"]):
        if not one["needed"]:
            continue
        effect = EFFECTS[one["effect"]]
        nulls = np.array([p.null for p in effect.amplitudes])
        k = int(np.argmax(np.abs(np.array(one["amplitudes"]) - nulls) / np.array(one["prior_standard_deviations"])))
        parameter = effect.amplitudes[k]
        value = f"{parameter.name} = {one['amplitudes'][k]:.3g} ± {one['standard_deviations'][k]:.1g}"
        value = with_unit(value, amplitude_unit(parameter, found["stress_unit"]))
        shape = ", ".join(
            with_unit(f"{p.name} = {v:.2g}", p.unit) for p, v in zip(effect.shapes, one["shape"], strict=True)
        )
        rows.append(
            [name, fit, effect.name, value, f"{one['over_prior']:.1f}", shape, share(one["r_squared_on_others"])]
        )
    return rows


def forces(replay: Path) -> dict[str, str]:
    """Norm of the force errors of a replay over that of the forces: in all, after `UNTIL`, in the first picture, and over the record of the machine."""
    at_pictures = _errors(replay / "forces.csv")
    return {
        "replay_force": at_pictures(lambda time: time > 0),
        "replay_force_after": at_pictures(lambda time: time > UNTIL),
        "replay_force_first": at_pictures(lambda time: time == time[0]),
        "replay_record": _errors(replay / "record.csv")(lambda time: time > 0),
    }


def _errors(path: Path) -> Callable[[Callable[[Any], Any]], str]:
    """Of a file of forces, the error in rows that are chosen by their time."""
    rows = _table(path)
    time = np.array([float(row["time"]) for row in rows])
    names = [key.removesuffix("_measured") for key in rows[0] if key.endswith("_measured") and rows[0][key] != ""]
    measured, found = (
        np.array([[float(row[f"{name}_{kind}"]) for name in names] for row in rows])
        for kind in ("measured", "predicted")
    )

    def error(chosen: Callable[[Any], Any]) -> str:
        part = chosen(time)
        known = np.isfinite(measured[part])
        return share(
            float(np.linalg.norm((found[part] - measured[part])[known]) / np.linalg.norm(measured[part][known]))
        )

    return error


def last_field(replay: Path) -> str:
    """Root mean square residual of the last increment of a replay, mm."""
    return f"{float(_table(replay / 'fields.csv')[-1]['residual, rms, mm']):.2f}"


def _table(path: Path) -> list[dict[str, str]]:
    """Rows by the names of their columns; lines of remarks are left out."""
    return list(csv.DictReader(line for line in path.read_text().splitlines() if not line.startswith("#")))
