"""Which few effects leave the measured sheets' fields least, replayed from the motion of the grips alone: `python -m benchmarks.sheet_fields -o results/sheet-fields`.

In: the published sheets. A neo-Hookean sheet with effects is replayed in four pictures of the first 15 s and four after them. The amplitudes are fitted to the smooth part of the displacements
(three cosines a side, the same weight in every picture) of the first four, by Gauss and Newton's method with the adjoint of the replay, without a prior. No force is used: with displacements
prescribed the level of a neo-Hookean sheet changes no field.

Out: ``sheet_fields.json`` with a row for every sheet and set of effects: amplitudes, root mean square of measured minus replayed displacement, mm, in the pictures fitted
and in those held out, beside the stated noise of the camera. Sets are those of `SETS`, fixed before what comes after 15 s was looked at. Then, with the amplitudes of `BOTH`
as they are, the level and one relaxation branch (g with its prior) are fitted to the forces of the first 15 s, of twelve pictures, as `equigap discover` updates a model: a row
``forces`` for every sheet, with the error of the forces, too. --forces does the latter alone, with the amplitudes of an earlier run in the folder.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.diagnosis import base_fit
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.evidence.priors import read_priors
from calibrate.diagnosis.evidence.signatures import prior_deviations
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.parameters import Variables
from calibrate.diagnosis.problem import Problem
from calibrate.diagnosis.replayed.observations import ReplayErrors, level_of
from calibrate.diagnosis.replayed.parameter_spread import Directions
from calibrate.diagnosis.replayed.updating import update
from calibrate.effects import CATALOGUE, Viscosity
from calibrate.effects.chain import Addition, Additions
from calibrate.fitting.least_squares import bounded
from forward.errors import ForwardError
from studies.commands.import_data import Frames, import_experiment
from studies.output.folder import open_output_folder
from studies.output.manifest import Manifest
from studies.output.writing import write_json
from studies.replay.compared_test import ComparedTest, ReplayedModel
from studies.replay.flat_rows import observations
from studies.replay.parameter_changes import of_parameters
from studies.replay.updated_replay import Replays

Array = NDArray[np.float64]
SHEETS = ("Soft_Homo", "Stiff2_Homo", "Stiff2_Hetero")
BOTH = ("compressibility", "stiffness gradient")
SETS: tuple[tuple[str, ...], ...] = (
    (),
    ("compressibility",),
    ("stiffness gradient",),
    BOTH,
    *((*BOTH, name) for name in ("second invariant", "camera tilt", "out-of-plane motion", "lens distortion", "initial warp")),
    ("stiffness gradient", "one fibre family"),
    ("stiffness gradient", "out-of-plane motion"),
)  # fmt: skip
FRAMES, PICTURES, UNTIL = 24, 4, 15.0  # imported; replayed, of those fitted and of those held out; s
REPLAYS, HALVINGS, ENOUGH = 8, 4, 1e-3  # at most; of a step; relative fall of the misfit that ends a fit
FORCES, HELD = 12, 1e-6  # pictures whose forces are fitted; deviation of amplitudes that are as the fields have them
RELAXATION = Viscosity()
EFFECTS = {effect.name: effect for effect in CATALOGUE}


@dataclass(frozen=True, eq=False)
class Fitted:
    """misfit: mean square of the smooth rows that were fitted, mm^2; squares (k,): mean square of all measured minus replayed displacements of each picture, mm^2."""

    additions: Additions
    misfit: float
    residual: Array
    slopes: Array
    squares: Array


def replayed(test: ComparedTest, c: Array, additions: Additions) -> Fitted:
    """Effects at their values. Raises the errors of a replay."""
    present = tuple(a for a in additions if not a.is_null)
    rows, changes = test.replayed(ReplayedModel(c, present), True)
    directions = Directions.of(c, additions, c[:, None], 1.0)
    amplitudes = np.concatenate([[False], ~Variables(additions).is_shape]) if additions else np.zeros(1, bool)
    slopes = of_parameters(test, changes, directions, 1.0, amplitudes)[:, amplitudes]
    fields = np.tile(~test.layout.is_force, len(rows.measured))
    used = fields & ~np.repeat(test.held[test.layout.chosen], test.layout.rows)
    residual = (rows.measured - rows.replayed).ravel()[used]
    return Fitted(additions, float(residual @ residual), residual, slopes[used], rows.squares)


def fitted(test: ComparedTest, c: Array, names: Sequence[str]) -> Fitted:
    """Amplitudes that leave the least, from none on."""
    effects = [EFFECTS[name] for name in names]
    start = tuple(
        Addition(e, tuple(p.null for p in e.amplitudes), tuple(e.shape_values(test.part.chain.data)[0]))
        for e in effects
    )
    now = replayed(test, c, start)
    for _ in range(REPLAYS if effects else 0):
        step = _step(now)
        better = next(filter(None, (_tried(test, c, now, 0.5**k * step) for k in range(HALVINGS))), None)
        if better is None:
            break
        fall = 1 - better.misfit / now.misfit
        now = better
        if fall < ENOUGH:
            break
    return now


def _step(now: Fitted) -> Array:
    """Of Gauss and Newton, of every amplitude, within its bounds."""
    variables = Variables(now.additions)
    amplitudes = ~variables.is_shape
    low, high = (np.array([getattr(p, end) for p, _ in variables.parameters])[amplitudes] for end in ("lower", "upper"))
    size = np.linalg.norm(now.slopes, axis=0)
    values = variables.values[amplitudes]
    return bounded(now.slopes / size, -now.residual, (low - values) * size, (high - values) * size) / size


def _tried(test: ComparedTest, c: Array, now: Fitted, step: Array) -> Fitted | None:
    """Amplitudes a step away; None where that leaves more, or has no equilibrium."""
    variables = Variables(now.additions)
    values = variables.values.copy()
    values[~variables.is_shape] += step
    try:
        found = replayed(test, c, variables.at(values))
    except ForwardError:
        return None
    return found if found.misfit < now.misfit else None


def prepared(sheet: str) -> tuple[Problem, Fit]:
    """Equations of the first 15 s, and neo-Hooke fitted to them."""
    experiment = import_experiment(sheet, frames=Frames(FRAMES))
    return base_fit.prepare([experiment], [HoldOut.parse(f"after:{UNTIL:g}").training], base="neo-Hooke")


def rows_of(sheet: str) -> list[dict[str, Any]]:
    """Of one sheet: every set of effects."""
    problem, base = prepared(sheet)
    experiment = problem.parts[0].experiment
    test = ComparedTest(problem.parts[0], PICTURES)
    held = test.held[test.layout.chosen]
    noise = experiment.noise.displacement_std if experiment.noise else None
    found = []
    for names in SETS:
        one = fitted(test, base.c, names)
        errors = [float(np.sqrt(one.squares[which].mean())) for which in (~held, held)]
        amplitudes = {
            a.effect.name: dict(zip((p.name for p in a.effect.amplitudes), a.amplitudes, strict=True))
            for a in one.additions
        }
        found.append({"sheet": sheet, "effects": list(names), "amplitudes": amplitudes,
                      "fitted_mm": errors[0], "held_out_mm": errors[1], "noise_mm": noise})  # fmt: skip
        print(sheet, names, amplitudes, [f"{error:.4f}" for error in errors], flush=True)
    return found


def with_forces(sheet: str, amplitudes: dict[str, dict[str, float]]) -> dict[str, Any]:
    """Effects as the fields have them, beside a relaxation that the forces have."""
    problem, base = prepared(sheet)
    held = tuple(Addition(EFFECTS[name], tuple(values.values())) for name, values in amplitudes.items())
    times = [tuple(shape) for shape in RELAXATION.shape_values(problem.parts[0].chain.data)]
    starts = [(*held, Addition(RELAXATION, (0.0,), shape)) for shape in times]
    known = {a.effect.name: (np.array(a.amplitudes), np.full(len(a.amplitudes), HELD)) for a in held}
    prior = known | {RELAXATION.name: (np.zeros(1), prior_deviations(problem, RELAXATION, read_priors()))}
    found = update(Replays([ComparedTest(problem.parts[0], FORCES, False)]), base.c, starts[0], prior, starts[1:])
    assert found is not None
    test = ComparedTest(problem.parts[0])
    rows = observations([test], [test.replayed(ReplayedModel(found.c, found.present[0]), True)[0]])
    rows = rows.scaled(level_of(rows).factor)
    errors = {
        name: ReplayErrors.of(rows, which).to_dict()
        for name, which in (("fitted", ~rows.held), ("held_out", rows.held))
    }
    relaxation = found.additions[-1]
    return {
        "sheet": sheet,
        "g": relaxation.amplitudes[0],
        "tau": relaxation.shape[0],
        "converged": found.converged,
        **errors,
    }


def main() -> None:
    """Every sheet, kept as soon as it is there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, default=Path("results/sheet-fields"))
    parser.add_argument("--overwrite", action="store_true")
    parser.add_argument("--forces", action="store_true", help="only what forces add to an earlier run")
    options = parser.parse_args()
    started = time.time()
    open_output_folder(options.output, options.overwrite, {"benchmark": "sheet fields"})
    path = options.output / "sheet_fields.json"
    found: list[dict[str, Any]] = json.loads(path.read_text())["rows"] if options.forces else []
    forces: list[dict[str, Any]] = []
    for sheet in SHEETS:
        found += [] if options.forces else rows_of(sheet)
        both = next(row for row in found if row["sheet"] == sheet and row["effects"] == list(BOTH))
        forces.append(with_forces(sheet, both["amplitudes"]))
        print(forces[-1], flush=True)
        write_json(path, {"rows": found, "forces": forces})
    Manifest(0, {}, started=started).beside(options.output / "sheet_fields.json")


if __name__ == "__main__":
    main()
