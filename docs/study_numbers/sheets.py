"""Numbers and tables of the measured sheets: the folders of `equigap measured`, and of `equigap replay` of the first sheet with few effects and with
neo-Hooke, in; what the pages state out."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from wording import share

from calibrate.data.experiment import Experiment
from calibrate.effects import CATALOGUE
from calibrate.equations.basis import energy_basis
from calibrate.models.extended_model import ExtendedModel

SHORT = {"Soft_Homo": "soft", "Stiff2_Homo": "stiff", "Stiff2_Hetero": "hetero"}
MODELS = {
    "neo-Hooke": "neo_hooke",
    "base": "base",
    "base and effects found": "found",
}
EFFECTS = {effect.name: effect for effect in CATALOGUE}
UNTIL = 15.0  # s


def take(folder: Path, replay: Path, neo_hooke: Path) -> dict[str, Any]:
    """Errors of every model of every sheet, tables as the report has them, and the forces of a replay of the first sheet."""
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
        numbers[f"{short}_added"] = ", ".join(one["named"] or one["closest"]) or "nothing"
        numbers[f"{short}_minutes"] = f"{one['seconds'] / 60:.0f}"
    controls = [one for name, one in found.items() if name.startswith("control_")]
    numbers["control_smallest_p"] = f"{min(one['smallest_adjusted_p'] for one in controls):.2f}"
    tables = {name: list(csv.reader((folder / f"{name}.csv").read_text().splitlines()))
              for name in ("verdicts", "errors", "transfers", "homogeneous", "control")}  # fmt: skip
    tables["sheets"] = the_sheets(folder)
    numbers |= forces(replay)
    numbers |= {f"{name}_mm": last_field(one) for name, one in (("replay", replay), ("replay_neo_hooke", neo_hooke))}
    return {
        "command": "equigap measured; equigap replay results/measured/Soft_Homo.npz results/measured/Soft_Homo/model_few_effects.json; equigap replay results/measured/Soft_Homo.npz neo_hooke --parameter mu=0.4",
        "how": f"revision {record.get('revision', 'unknown')}; first 15 s fitted, what comes after held out and looked at once",
        "numbers": numbers,
        "tables": tables,
    }


def the_sheets(folder: Path) -> list[list[str]]:
    """Size, points, stretch and speed of every sheet, and the modulus of neo-Hooke by its forces."""
    rows = [
        [
            "sheet",
            "between the grips, mm",
            "points",
            "stretch after 15 s",
            "at the end",
            "speed, mm/s",
            "neo-Hookean shear modulus, N/mm",
        ]
    ]
    for name in SHORT:
        test = Experiment.load(folder / f"{name}.npz")
        ends = [next(b.nodes for b in test.loaded if b.name == side) for side in ("top", "bottom")]
        height = float(np.subtract(*(test.points[nodes, 1].mean() for nodes in ends)))
        pulled = np.subtract(*(test.displacements[:, nodes, 1].mean(axis=1) for nodes in ends))
        assert test.time is not None
        stretch = 1 + np.array([np.interp(UNTIL, test.time, pulled), pulled[-1]]) / height
        width = float(np.ptp(test.points[:, 0]))
        rows.append(
            [
                name,
                f"{width:.1f} x {height:.1f}",
                str(len(test.points)),
                *(f"{v:.2f}" for v in stretch),
                f"{pulled[-1] / test.time[-1]:.2f}",
                f"{modulus(folder / name):.2f}",
            ]
        )
    return rows


def modulus(home: Path) -> float:
    """Shear modulus of neo-Hooke at the level of its replay, of a diagnosis that explains nothing."""
    model = ExtendedModel.load(home / "model_neo_hooke.json")
    psi, _ = energy_basis(model.basis).second(np.eye(2)[None] * 1.001, model.c)
    return float(2 * psi[0, 0])


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
