"""Tables of the thickness study, and the judgement that its answer rests on.

In: `Results`. Out: rows for CSV files and the report. Medians and ranges are over noise seeds; every percentile is by
area and increment. What counts as trustworthy is defined here (`BIAS_LIMIT`, `STRESS_LIMIT`, `LARGEST_LIMIT`), not in the literature.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.equations.deformation_modes import MODES
from studies.accuracy.epsilon import EpsilonField, weighted_quantile
from studies.accuracy.stress_error import COMPONENTS
from studies.grid.thickness_case import LOSSES
from studies.grid.thickness_results import Results, arm_forces

Array = NDArray[np.float64]
Fit = dict[str, Any]
BIAS_LIMIT = 1.0  # %, of the median over seeds, every homogeneous mode
STRESS_LIMIT = 5.0  # %, of the 5th and 95th percentile of the signed stress error, every component
LARGEST_LIMIT = 5.0  # % of the largest stress, of the median over seeds of the largest error, every homogeneous mode
NEAR_RIM = 5.0  # mm
SIDES = {"right": "arms along x", "top": "arms along y"}
NOISES = {False: "clean", True: "noisy"}


def _bias(mode: int) -> Callable[[Fit], float]:
    return lambda fit: 100 * fit["inside"][mode]["bias"]


def _stiffness(key: str) -> Callable[[Fit], float]:
    return lambda fit: fit["stiffness_error"][key]


def _stress(component: str, key: str) -> Callable[[Fit], float]:
    return lambda fit: fit["stress_error"][component][key]


LARGEST = "largest error (% of largest stress)"
BIASES = {f"bias {MODES[mode].title} (%)": _bias(i) for i, mode in enumerate(MODES)}
AGREEMENT = {
    **BIASES,
    LARGEST: lambda fit: 100 * max(score["max_error"] for score in fit["inside"]),
    "lowest r2": lambda fit: min(score["r2"] for score in fit["inside"]),
    "energy error, median (%)": lambda fit: fit["energy_error"]["median_abs"],
    "energy error, P95 (%)": lambda fit: fit["energy_error"]["p95_abs"],
}
SHARES = {"median": "median", "P5": "p05", "P95": "p95"}
STRESSES = {f"{c} {words} (%)": _stress(c, key) for c in COMPONENTS for words, key in SHARES.items()} | {
    f"along P {words} (%)": _stiffness(key) for words, key in SHARES.items()
}
QUANTITIES: dict[str, Callable[[Fit], float]] = {**AGREEMENT, **STRESSES}
KEYS = ("condition", "loss", "noise", "fits")
FIT_COLUMNS = (*KEYS, "quantity", "median", "min", "max")
FIELD_COLUMNS = ("thickness (mm)", "mean", "median", "P95", "P99", "maximum", "maximum at (mm)", "mm from a rim",
                 "area with ε > 1 % (%)", f"P95 within {NEAR_RIM:g} mm of a rim", "P95 within h/2 of a grip",
                 "P95 elsewhere")  # fmt: skip
FORCE_COLUMNS = ("thickness (mm)", "arms", "force 3D (N)", "force / thickness 3D (N/mm)",
                 "force / thickness 2D (N/mm)", "difference at the end (%)", "largest difference (%)")  # fmt: skip


@dataclass(frozen=True)
class Verdict:
    """One condition, loss and noise: the median bias and the P5 or P95 of the stress error, %, that are worst.

    bias_mode, component: where they are. largest: error on the curves of the homogeneous modes, % of the largest
    stress, median over seeds. ok: all within the limits.
    """

    condition: str
    loss: str
    noisy: bool
    bias: float
    bias_mode: str
    stress: float
    component: str
    largest: float

    @property
    def ok(self) -> bool:
        """Whether all are within the limits."""
        small = abs(self.bias) <= BIAS_LIMIT and abs(self.stress) <= STRESS_LIMIT
        return small and self.largest <= LARGEST_LIMIT


def spread(fits: list[Fit], quantity: str) -> tuple[float, float, float]:
    """Median, lowest and highest value of a quantity over fits; NaN where one of them has none."""
    values = np.array([QUANTITIES[quantity](fit) for fit in fits], float)
    return float(np.median(values)), float(values.min()), float(values.max())


def groups(results: Results) -> list[tuple[str, str, bool, list[Fit]]]:
    """(condition, loss, noisy, fits) of all that was fitted."""
    found = [(condition, loss, noisy, results.fits(condition, loss, noisy))
             for loss in LOSSES for noisy in NOISES for condition in results.conditions]  # fmt: skip
    return [group for group in found if group[-1]]


def fit_rows(results: Results) -> list[list[Any]]:
    """One row a condition, loss, noise and quantity; see `FIT_COLUMNS`."""
    return [[condition, loss, NOISES[noisy], len(fits), quantity, *spread(fits, quantity)]
            for condition, loss, noisy, fits in groups(results) for quantity in QUANTITIES]  # fmt: skip


def wide_rows(results: Results, quantities: dict[str, Callable[[Fit], float]], loss: str) -> list[list[Any]]:
    """One row a condition and noise for reading: 'median [lowest, highest]' of every quantity."""
    rows = []
    for condition, own, noisy, fits in groups(results):
        if own == loss:
            cells = [words(*spread(fits, quantity), len(fits), 5 if "r2" in quantity else 2) for quantity in quantities]
            rows.append([results.name(condition), NOISES[noisy], len(fits), *cells])
    return rows


def words(median: float, low: float, high: float, n: int, digits: int) -> str:
    """'0.12 [-0.30, 0.45]', or the number alone where there is one fit."""
    if not np.isfinite(median):
        return "–"
    text = f"{median:.{digits}f}"
    return (text if n == 1 else f"{text} [{low:.{digits}f}, {high:.{digits}f}]").replace("-", "\N{MINUS SIGN}")


def verdict(results: Results, condition: str, loss: str, noisy: bool) -> Verdict | None:
    """Judgement of a condition; None where it was not fitted."""
    fits = results.fits(condition, loss, noisy)
    if not fits:
        return None
    biases = {mode: spread(fits, name)[0] for mode, name in zip(MODES, BIASES, strict=True)}
    mode = max(biases, key=lambda m: abs(biases[m]))
    stresses = {(c, q): spread(fits, f"{c} {q} (%)")[0] for c in COMPONENTS for q in ("P5", "P95")}
    place = max(stresses, key=lambda key: abs(stresses[key]))
    return Verdict(condition, loss, noisy, biases[mode], MODES[mode].title, stresses[place], place[0],
                   spread(fits, LARGEST)[0])  # fmt: skip


def verdicts(results: Results, loss: str, noisy: bool) -> list[Verdict]:
    """Judgements in the order of the conditions."""
    found = (verdict(results, condition, loss, noisy) for condition in results.conditions)
    return [v for v in found if v is not None]


def trusted(judged: list[Verdict]) -> str | None:
    """The last condition for which it and all thinner ones are within the limits; None if not even the first."""
    last = None
    for one in judged:
        if not one.ok:
            break
        last = one.condition
    return last


def field_rows(results: Results) -> list[list[Any]]:
    """epsilon of every thickness at the last increment; see `FIELD_COLUMNS`."""
    return [field_row(name, field) for name, field in results.fields.items()]


def field_row(name: str, field: EpsilonField) -> list[Any]:
    """epsilon at the last increment, near rims, near grips and elsewhere."""
    last, weights = field.epsilon[-1], field.weights
    worst = int(last.argmax())
    x, y = field.points[worst]
    rim = field.near_holes(NEAR_RIM)
    grip = ~field.away_from_grips(float(name) / 2)
    median, p95, p99 = weighted_quantile(last, weights, np.array([0.5, 0.95, 0.99]))
    parts = [field.statistics(where).p95 for where in (rim, grip & ~rim, ~grip & ~rim)]
    return [float(name), field.statistics().mean, median, p95, p99, last[worst], f"({x:.1f}, {y:.1f})",
            field.rim_distance[worst], 100 * weights[last > 0.01].sum() / weights.sum(), *parts]  # fmt: skip


def force_rows(results: Results) -> list[list[Any]]:
    """Forces of whole arms at the last increment; see `FORCE_COLUMNS`."""
    plane = arm_forces(results.plane.reactions)
    rows = []
    for name, numbers in results.numbers.items():
        for side, arms in SIDES.items():
            force, h = numbers.forces[side], float(name)
            off = 100 * (force / h / plane[side] - 1)
            most = off[np.abs(off).argmax()]
            rows.append([h, arms, force[-1], force[-1] / h, plane[side][-1], off[-1], most])
    return rows
