"""Accuracy of the formulas of effects: amplitudes fitted to data of the forward models, printed and written as a table.

In: blind trials (`studies.trials.blind_data`) whose effect is given three sizes, without noise; what noise is stated is a tenth
of the trial's, so that the errors are those of formulas and discretisation. Out, in a folder: ``effect_accuracy.csv`` and
a manifest. A row for each effect, specimen and size: true and fitted amplitude, relative error, standard deviation that
the fit states, chi-square before and after. A base energy is fitted beside the amplitude, as a diagnosis does.
Run: ``python benchmarks/effect_accuracy.py`` (some minutes), or with the names of a few effects.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

LEVEL = 0.1  # of the noise that is stated
SEED = 1013
SPECIMENS = ("plate", "wide plate", "cross")


@dataclass(frozen=True)
class Case:
    """An effect of one amplitude: its name, three sizes in the units of the catalogue and shapes."""

    effect: str
    amplitude: str
    sizes: tuple[float, float, float]
    shape: tuple[tuple[str, float], ...] = ()


CASES = (
    Case("second invariant", "c01", (0.002, 0.008, 0.03)),
    Case("compressibility", "beta", (0.05, 0.2, 0.8)),
    Case("one fibre family", "k", (0.002, 0.008, 0.02), (("angle", 0.7), ("k2", 0.5), ("kappa", 0.0))),
    Case("viscoelasticity", "g", (0.03, 0.1, 0.4), (("tau", 2.0),)),
    Case("finite viscoelasticity", "mu", (0.01, 0.04, 0.15), (("tau", 2.0),)),
    Case("Mullins softening", "r", (0.03, 0.1, 0.4), (("m", 0.02), ("beta", 0.3))),
    Case("Payne softening", "r", (0.05, 0.2, 0.5), (("x0", 0.1),)),
    Case("force offset", "f0", (0.02, 0.1, 0.4)),
    Case("force drift", "d", (0.01, 0.1, 0.2)),
    Case("stiffness or gain drift", "s", (0.001, -0.005, 0.02)),
    Case("load cell nonlinearity", "a", (0.002, 0.01, 0.04)),
    Case("lag between force and image", "dt", (0.02, -0.1, 0.4)),
    Case("image rotation", "phi", (0.002, 0.01, 0.04)),
    Case("lens distortion", "k", (0.0005, -0.003, 0.01)),
    Case("out-of-plane motion", "m", (0.0005, -0.002, 0.008)),
    Case("magnification drift", "m", (0.0005, -0.002, 0.008)),
    Case("subset smoothing", "s2", (0.05, 0.2, 0.5)),
    Case("unmeasured strip", "w", (0.08, 0.2, 0.5)),
)


def arguments(words: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("effects", nargs="*", metavar="EFFECT", help="by default all that have one amplitude")
    parser.add_argument("-o", "--output", type=Path, default=Path("results/benchmark-effect-accuracy"))
    parser.add_argument("--overwrite", action="store_true", help="empty an earlier folder of this benchmark")
    parser.add_argument("--specimen", choices=SPECIMENS, default="plate")
    return parser.parse_args(words)


def observed(case: Case, size: float, specimen: str, seed: int = SEED) -> Any:
    """The Experiment of a trial whose effect has this amplitude; its noise is stated, not added."""
    from studies.trials.blind_data import draw, record
    from studies.trials.blind_effects import Hidden
    from studies.trials.blind_solution import clean_experiment

    trial = draw(seed, case.effect)
    more = {"side": (12 * size) ** 0.5} if case.effect == "subset smoothing" else {}
    trial = replace(
        trial,
        specimen=specimen,
        times=tuple(10 * t / trial.times[-1] for t in trial.times),
        effects=(Hidden(case.effect, {case.amplitude: size}, dict(case.shape), more),),
        displacement_std=LEVEL * trial.displacement_std,
        force_relative=LEVEL * trial.force_relative,
        force_floor=LEVEL * trial.force_floor,
    )
    clean = clean_experiment(trial)
    return replace(clean, noise=record(trial, clean).noise)


def fitted(experiment: Any, name: str) -> tuple[Any, Any]:
    """With the twin of a diagnosis: base alone, and base and effect fitted together from the best shape of the effect's grid."""
    from calibrate.diagnosis import base_fit, score_tests, weighted_fit
    from calibrate.diagnosis.hold_out import HoldOut
    from calibrate.diagnosis.twin import with_twins
    from calibrate.effects import CATALOGUE
    from calibrate.effects.chain import Addition
    from studies.replay.twin_replay import twin_replay

    effect = next(e for e in CATALOGUE if e.name == name)
    problem, base, without = with_twins(*base_fit.prepare([experiment], [HoldOut().training]), twin_replay)
    assert not without, without
    U = base.columns
    r = base.residual - U @ (U.T @ base.residual)
    one, _ = score_tests.examine(problem, base, effect, U, r)
    start = Addition(effect, one.amplitudes or tuple(p.typical for p in effect.amplitudes), one.shape)
    return base, weighted_fit.fit_with_weights(problem, base.c, (start,))[1]


def main(words: list[str] | None = None) -> int:
    args = arguments(words)
    import jax

    jax.config.update("jax_enable_x64", True)
    from studies.output import Manifest, open_output_folder, write_csv

    settings = {key: value for key, value in vars(args).items() if key not in ("output", "overwrite")}
    started = time.time()
    open_output_folder(args.output, args.overwrite, {"benchmark": "effect accuracy", **settings})
    rows = []
    for case in CASES:
        if args.effects and case.effect not in args.effects:
            continue
        for size in case.sizes:
            base, fit = fitted(observed(case, size, args.specimen), case.effect)
            value, deviation = fit.additions[0].amplitudes[0], fit.deviations[0][0]
            rows.append([case.effect, args.specimen, case.amplitude, size, value, value / size - 1, deviation,
                         base.reduced_chi_square, fit.reduced_chi_square])  # fmt: skip
            print(f"{case.effect:30s} {size:9.4g} {value:9.4g} {value / size - 1:+7.1%} +- {deviation / abs(size):.1%}"
                  f"  chi-square {base.reduced_chi_square:.3g} -> {fit.reduced_chi_square:.3g}", flush=True)  # fmt: skip
    columns = ["effect", "specimen", "amplitude", "true", "fitted", "relative error", "standard deviation",
               "chi-square of the base", "chi-square with the effect"]  # fmt: skip
    write_csv(args.output / "effect_accuracy.csv", columns, rows, ["amplitudes fitted to clean data"])
    Manifest(SEED, settings, started=started).beside(args.output / "effect_accuracy.csv")
    return 0


if __name__ == "__main__":
    sys.exit(main())
