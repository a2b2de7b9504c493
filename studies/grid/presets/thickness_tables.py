"""Tables of the thickness study, and the judgement that its answer rests on.

In: `ThicknessResults`. Out: rows for CSV files and the report. Medians and ranges are over noise seeds; every percentile is
by area and increment. What counts as trustworthy is defined by `LIMITS`, not in the literature.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from calibrate.equations.deformation_modes import MODES, TITLES
from studies.accuracy.epsilon import EpsilonField, weighted_quantile
from studies.accuracy.stress_error import COMPONENTS, Quantiles, StateErrors
from studies.grid.axes import Loss
from studies.grid.case import Fit
from studies.grid.claims import NOISES
from studies.grid.presets.thickness_results import ThicknessResults, arm_forces, condition_name
from studies.grid.results import Spread, median_biases

SIDES = {"right": "arms along x", "top": "arms along y"}
Quantity = Callable[[Fit], float]


@dataclass(frozen=True)
class Limits:
    """bias: %, median over seeds, each homogeneous mode; stress: %, P5 and P95 of the signed stress error, each component;
    largest: error on the curves, % of the largest stress. near_rim: mm. The others belong to the claims (`thickness_claims`).
    """

    bias: float = 1.0
    stress: float = 5.0
    largest: float = 5.0
    near_rim: float = 5.0
    ratio: float = 1.5  # stress errors are clearly larger from here
    epsilon: float = 0.1  # deformation errors are severe from here
    meaningless: float = 5.0  # %, bias of the 2D reference from which on a loss tells nothing about thickness


LIMITS = Limits()


def _states(fit: Fit) -> StateErrors:
    assert fit.states is not None, "the study has a plane reference"
    return fit.states


def _bias(mode: int) -> Quantity:
    return lambda fit: 100 * fit.inside[mode].bias


def _along(key: str) -> Quantity:
    return lambda fit: getattr(_states(fit).stiffness, key)


def _stress(component: str, key: str) -> Quantity:
    def of(fit: Fit) -> float:
        quantiles: Quantiles = _states(fit).stress[component]
        return float(getattr(quantiles, key))

    return of


def largest_error(fit: Fit) -> float:
    """Largest error on the curves inside the calibrated range, % of the largest stress."""
    return 100 * max(score.max_error for score in fit.inside)


AGREEMENT: dict[str, Quantity] = {
    **{f"bias {TITLES[mode]} (%)": _bias(i) for i, mode in enumerate(MODES)},
    "largest error (% of largest stress)": largest_error,
    "lowest r2": lambda fit: min(score.r2 for score in fit.inside),
    "energy error, median (%)": lambda fit: _states(fit).energy.median_abs,
    "energy error, P95 (%)": lambda fit: _states(fit).energy.p95_abs,
}
SHARES = {"median": "median", "P5": "p05", "P95": "p95"}
STRESSES = {f"{c} {name} (%)": _stress(c, key) for c in COMPONENTS for name, key in SHARES.items()} | {
    f"along P {name} (%)": _along(key) for name, key in SHARES.items()
}
FIT_COLUMNS = ("condition", "loss", "noise", "fits", "quantity", "median", "min", "max")
FIELD_COLUMNS = ("thickness (mm)", "mean", "median", "P95", "P99", "maximum", "maximum at (mm)", "mm from a rim",
                 "area with ε > 1 % (%)", f"P95 within {LIMITS.near_rim:g} mm of a rim", "P95 within h/2 of a grip",
                 "P95 elsewhere")  # fmt: skip
LINE_COLUMNS = ("thickness (mm)", "line", "ε falls to half within (mm)", "within (thicknesses)")
FORCE_COLUMNS = ("thickness (mm)", "arms", "force 3D (N)", "force / thickness 3D (N/mm)",
                 "force / thickness 2D (N/mm)", "difference at the end (%)", "largest difference (%)")  # fmt: skip
VERDICT_COLUMNS = ("condition", "loss", "noise", "worst median bias (%)", "mode", "worst P5 or P95 of the stress error (%)",
                   "component", "largest error (% of largest stress)", "trustworthy")  # fmt: skip
REACH_COLUMNS = ("loss", "noise", "seeds", "trustworthy up to", "no longer at")
OUTSIDE_COLUMNS = ("condition", "noise", "median bias outside, worst mode (%)")
CORRECTION_COLUMNS = ("condition", "noise", "bias (%)", "corrected", "largest error (%)", "corrected ", "stress error (%)",
                      "corrected  ")  # fmt: skip


@dataclass(frozen=True)
class Trust:
    """One condition, loss and noise: the median bias and the P5 or P95 of the stress error, %, that are worst.

    mode, component: where they are. largest: error on the curves of the homogeneous modes, % of the largest stress,
    median over seeds. fits: number of seeds.
    """

    condition: str
    loss: Loss
    noisy: bool
    bias: float
    mode: str
    stress: float
    component: str
    largest: float
    fits: int = 1

    @property
    def ok(self) -> bool:
        """Whether all are within the limits."""
        small = abs(self.bias) <= LIMITS.bias and abs(self.stress) <= LIMITS.stress
        return small and self.largest <= LIMITS.largest

    def to_dict(self) -> dict[str, Any]:
        """For a file."""
        return {**asdict(self), "ok": self.ok}

    def row(self) -> list[Any]:
        """See `VERDICT_COLUMNS`."""
        return [condition_name(self.condition), self.loss, NOISES[self.noisy], self.bias, self.mode, self.stress,
                self.component, self.largest, self.ok]  # fmt: skip


def trust(results: ThicknessResults, condition: str, loss: Loss, noisy: bool) -> Trust | None:
    """Judgement of a condition; None where it was not fitted."""
    fits = [*results.fitted(condition, loss, noisy).values()]
    if not fits:
        return None
    biases = 100 * median_biases(fits)
    mode = int(np.abs(biases).argmax())
    stresses = {
        (c, q): Spread.of(map(STRESSES[f"{c} {q} (%)"], fits)).median for c in COMPONENTS for q in ("P5", "P95")
    }
    place = max(stresses, key=lambda key: abs(stresses[key]))
    largest = Spread.of(map(largest_error, fits)).median
    return Trust(condition, loss, noisy, float(biases[mode]), [*TITLES.values()][mode], stresses[place], place[0], largest,
                 len(fits))  # fmt: skip


def trusts(results: ThicknessResults, loss: Loss, noisy: bool) -> list[Trust]:
    """Judgements in the order of the conditions."""
    found = (trust(results, condition, loss, noisy) for condition in results.conditions)
    return [one for one in found if one is not None]


def trusted(judged: list[Trust]) -> str | None:
    """The last condition for which it and all thinner ones are within the limits; None if not even the first."""
    last = None
    for one in judged:
        if not one.ok:
            break
        last = one.condition
    return last


def reach_rows(results: ThicknessResults) -> list[list[Any]]:
    """Up to which thickness each loss can be trusted; see `REACH_COLUMNS`."""
    rows = []
    for loss in results.losses:
        for noisy in (True, False):
            judged = trusts(results, loss, noisy)
            if judged:
                last = trusted(judged)
                failing = next((condition_name(one.condition) for one in judged if not one.ok), None)
                name = None if last is None else condition_name(last)
                rows.append([loss, NOISES[noisy], judged[0].fits, name, failing])
    return rows


def correction_rows(results: ThicknessResults) -> list[list[Any]]:
    """The default loss beside the correction for the thickness; see `CORRECTION_COLUMNS`; empty where it was not fitted."""
    rows = []
    for noisy in NOISES if Loss.CORRECTED in results.losses else ():
        for condition in results.thicknesses:
            a, b = (trust(results, condition, loss, noisy) for loss in (Loss.WEIGHTED, Loss.CORRECTED))
            if a and b:
                rows.append([condition_name(condition), NOISES[noisy], a.bias, b.bias, a.largest, b.largest, a.stress, b.stress])  # fmt: skip
    return rows


def outside_rows(results: ThicknessResults) -> list[list[Any]]:
    """Bias of the default loss outside the calibrated range; see `OUTSIDE_COLUMNS`."""
    rows = []
    for noisy, noise in NOISES.items():
        for condition in results.conditions:
            fits = [*results.fitted(condition, Loss.WEIGHTED, noisy).values()]
            if fits:
                rows.append(
                    [condition_name(condition), noise, 100 * float(max(median_biases(fits, outside=True), key=abs))]
                )
    return rows


def groups(results: ThicknessResults) -> list[tuple[str, Loss, bool, list[Fit]]]:
    """(condition, loss, noisy, fits) of all that was fitted."""
    found = [(condition, loss, noisy, [*results.fitted(condition, loss, noisy).values()])
             for loss in results.losses for noisy in NOISES for condition in results.conditions]  # fmt: skip
    return [group for group in found if group[-1]]


def fit_rows(results: ThicknessResults) -> list[list[Any]]:
    """One row a condition, loss, noise and quantity; see `FIT_COLUMNS`."""
    rows: list[list[Any]] = []
    for condition, loss, noisy, fits in groups(results):
        for name, quantity in (AGREEMENT | STRESSES).items():
            found = Spread.of(map(quantity, fits))
            rows.append([condition, loss, NOISES[noisy], len(fits), name, found.median, found.low, found.high])
    return rows


def wide_rows(results: ThicknessResults, quantities: Mapping[str, Quantity], loss: Loss) -> list[list[Any]]:
    """One row a condition and noise for reading: 'median [lowest, highest]' of every quantity."""
    rows = []
    for condition, own, noisy, fits in groups(results):
        if own is loss:
            cells = [Spread.of(map(of, fits)).text(5 if name == "lowest r2" else 2) for name, of in quantities.items()]
            rows.append([condition_name(condition), NOISES[noisy], len(fits), *cells])
    return rows


def field_row(name: str, field: EpsilonField) -> list[Any]:
    """epsilon at the last increment, near rims, near grips and elsewhere; see `FIELD_COLUMNS`."""
    last, weights = field.epsilon[-1], field.weights
    worst = int(last.argmax())
    x, y = field.points[worst]
    rim = field.near_holes(LIMITS.near_rim)
    grip = ~field.away_from_grips(float(name) / 2)
    median, p95, p99 = weighted_quantile(last, weights, np.array([0.5, 0.95, 0.99]))
    parts = [field.statistics(where).p95 for where in (rim, grip & ~rim, ~grip & ~rim)]
    return [float(name), field.statistics().mean, median, p95, p99, last[worst], f"({x:.1f}, {y:.1f})",
            field.rim_distance[worst], 100 * weights[last > 0.01].sum() / weights.sum(), *parts]  # fmt: skip


def line_rows(results: ThicknessResults) -> list[list[Any]]:
    """How fast epsilon decays from the rims; see `LINE_COLUMNS`."""
    return [[float(name), line.where, line.half_length(), line.half_length() / float(name)]
            for name, numbers in results.numbers.items() for line in numbers.lines]  # fmt: skip


def force_rows(results: ThicknessResults) -> list[list[Any]]:
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
