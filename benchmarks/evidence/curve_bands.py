"""How often the bands of a diagnosis' curves hold the material: `python -m benchmarks.evidence.curve_bands FOLDER`.

In: a folder for the tests, which are gone on with. Each is a cross of one of seven laws, solved with biquadratic quads and seen with noise: four are functions of I1, which the spline
of a diagnosis can be; one has its second invariant; two (`FOREIGN`) have forms that it has not. Out: `docs/results/curve_bands.json`: of each law, over seeds, the error of the stress over
stretch at four stretches of the calibrated range and at the end of the curves, a quarter beyond, and how many of these the 95 % bands hold.
"""

from __future__ import annotations

import argparse
import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from calibrate.equations.deformation_modes import MODES, nominal_stress
from calibrate.models.diagnosed_law import DiagnosedLaw
from calibrate.models.extended_model import ExtendedModel
from calibrate.models.parameter_covariance import Z95
from forward.materials import MATERIALS
from studies import cli
from studies.accuracy.metrics import MaterialDerivatives
from studies.reports.prediction.predicted_curves import Curve, predict

RESULTS = Path(__file__).parents[2] / "docs" / "results" / "curve_bands.json"
LAWS = ("neo_hooke", "arruda_boyce", "gent", "yeoh", "mooney_rivlin", "carroll", "ogden")
FOREIGN = ("carroll", "ogden")
FIRST, SEEDS = 986000, 3
NODES, PICTURES, DISPLACEMENT = 700, 8, 40.0
PLACES, END = (0.25, 0.5, 0.75, 1.0), -1.0  # of the calibrated range of stretch; the end of a curve
HEAD = ["law", "named", "mode", "in the band", "error, rms", "half of the band, rms", "in the band at the end", "error there, rms", "half of the band there, rms"]  # fmt: skip


def main() -> None:
    """Make what is not there yet, and write the numbers."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=FIRST, help="seed (default %(default)s)")
    parser.add_argument("--seeds", type=int, default=SEEDS, help="of each law (default %(default)s)")
    parser.add_argument("--results", type=Path, default=RESULTS)
    options = parser.parse_args()
    plans = [(law, options.first + 100 * i + j) for i, law in enumerate(LAWS) for j in range(options.seeds)]
    plans = sorted(plans, key=lambda plan: plan[1] % 100)  # every law once, then again
    found = []
    for law, seed in plans:
        found.append((law, *trial(law, seed, options.folder)))
        print(f"{law} {seed}: {found[-1][1]}", flush=True)
    write(found, options.results)


def trial(law: str, seed: int, folder: Path) -> tuple[list[str], list[Curve]]:
    """Effects that were found, and the curves of the model beside the material."""
    test, out = folder / f"{law}-{seed}", folder / f"{law}-{seed}-found"
    if not (out / "run.json").exists() or not (out / "model.json").exists():
        size = ["--nodes", NODES, "--increments", PICTURES, "--displacement", DISPLACEMENT]
        words = ["simulate", "--material", law, *size, "--seed", seed, "-o", test, "--overwrite"]
        done = [cli.main([str(word) for word in words])]
        done.append(cli.main(["discover", str(test / "experiment.npz"), "-o", str(out), "--overwrite"]))
        if any(done):
            raise SystemExit(f"{law} {seed}: simulate or discover failed")
    model, slopes = ExtendedModel.load(out / "model.json"), MaterialDerivatives(MATERIALS[law]())
    curves = predict(DiagnosedLaw(model), truth=lambda mode, x, axis: nominal_stress(slopes, mode, x))
    return [a.effect.name for a in model.additions], curves


def write(found: list[tuple[str, list[str], list[Curve]]], path: Path) -> None:
    """The numbers of the trials so far."""
    inside, ends = (_all_pulls(found, places) for places in (PLACES, (END,)))
    foreign, own = ([one for one in found if (one[0] in FOREIGN) == is_foreign] for is_foreign in (True, False))
    content = {
        "command": "python -m benchmarks.evidence.curve_bands FOLDER",
        "made": datetime.now(UTC).date().isoformat(),
        "how": f"{len(found)} crosses of {NODES} points and {PICTURES} pictures; band: {Z95} standard deviations; errors relative to the stress of the material",
        "numbers": {
            "trials": len(found), "held": _share(inside), "held_at_end": _share(ends),
            "held_own": _share(_all_pulls(own, PLACES)), "held_foreign": _share(_all_pulls(foreign, PLACES)),
            "rms_pull": f"{_rms(inside):.2f}", "rms_pull_at_end": f"{_rms(ends):.2f}",
        },
        "tables": {"laws": [HEAD, *(row for law in LAWS for row in rows(law, [one for one in found if one[0] == law]))]},
    }  # fmt: skip
    path.write_text(json.dumps(content, indent=1) + "\n")


def rows(law: str, found: list[tuple[str, list[str], list[Curve]]]) -> list[list[Any]]:
    """Of a law, a line for each mode."""
    names = ", ".join(sorted({" + ".join(one[1]) or "nothing" for one in found}))
    result = []
    for mode in MODES if found else ():
        at = [_at_places(curve) for *_, curves in found for curve in curves if curve.mode == mode]
        line: list[Any] = [law.replace("_", "-"), names, mode.replace("_", " ")]
        for places in (PLACES, (END,)):
            errors, halves = (np.array([one[p][k] for one in at for p in places]) for k in (0, 1))
            line += [_share(Z95 * errors / halves), f"{100 * _rms(errors):.2f} %", f"{100 * _rms(halves):.2f} %"]
        result.append(line)
    return result


def _at_places(curve: Curve) -> dict[float, tuple[float, float]]:
    """Relative error and half of the band of a curve at places of its calibrated range, and at its end."""
    assert curve.truth is not None and curve.deviation is not None
    x, size = curve.stretch, np.where(curve.truth > 0, curve.truth, 1.0)
    error, half = (curve.stress - curve.truth) / size, Z95 * curve.deviation / size
    stretches = {p: 1 + p * (min(curve.limit, float(x[-1])) - 1) for p in PLACES} | {END: float(x[-1])}
    return {p: (float(np.interp(s, x, error)), float(np.interp(s, x, half))) for p, s in stretches.items()}


def _all_pulls(found: list[tuple[str, list[str], list[Curve]]], places: tuple[float, ...]) -> np.ndarray:
    """Errors over standard deviations."""
    at = [_at_places(curve) for *_, curves in found for curve in curves]
    return np.array([Z95 * one[p][0] / one[p][1] for one in at for p in places])


def _share(pulls: np.ndarray) -> str:
    return f"{int((np.abs(pulls) <= Z95).sum())} of {pulls.size}"


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


if __name__ == "__main__":
    main()
