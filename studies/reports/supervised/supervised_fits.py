"""PANNs fitted to stress-stretch curves of homogeneous tests (Sobolev fit), and their r2.

In: the five-term Arruda-Boyce material sampled in the three modes, and classical measurements. Out: r2 by mode.

The Arruda-Boyce case checks the path: one neuron with skip connection on I1 alone must reach r2 > 0.9999 in all
three modes. On measured rubber r2 is limited by the model class and by scatter: a PANN of I1 alone cannot
distinguish modes at equal I1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from calibrate.equations.deformation_modes import MODES, largest_stretch, nominal_stress
from calibrate.fitting.homogeneous.sobolev_fit import Curves, fit_supervised
from calibrate.models.network_model import Model
from studies.accuracy.metrics import ArrudaBoyceTruth, r2
from studies.importers import homogeneous_curves

TRUTH = "arruda-boyce"
TARGET_R2, TRUTH_I1, TRUTH_POINTS = 0.9999, 20.0, 50
COLUMNS = ("data", "inputs", "layers", "mode", "points", "largest_stretch", "r2", "loss", "why_stopped")


@dataclass(frozen=True)
class Case:
    """One fit: a data set and the network PANN_inputs^layers."""

    data: str
    inputs: str
    layers: tuple[int, ...]

    @property
    def name(self) -> str:
        """Data, inputs and layers, as its files are called."""
        return f"{self.data}-{self.inputs}-{'-'.join(map(str, self.layers))}"


@dataclass(frozen=True)
class Result:
    """A fitted case: r2 by mode, loss, why the optimiser stopped."""

    case: Case
    model: Model
    r2: dict[str, float]
    loss: float
    reason: str


def default_cases(quick: bool = False) -> list[Case]:
    """One neuron on Arruda-Boyce; both transcriptions of Treloar's data with I1 alone and with both invariants."""
    cases = [Case(TRUTH, "I1", (1,))]
    measured = ["treloar-a", "treloar-b"] + ([] if quick else ["kawabata"])
    networks = [("I1", (4,))] if quick else [("I1", (1,)), ("I1", (4, 4)), ("I1I2", (4,)), ("I1I2", (4, 4))]
    return cases + [Case(name, inputs, layers) for name in measured for inputs, layers in networks]


def curves_of(name: str) -> Curves:
    """{mode: (stretch, nominal stress MPa)} of a data set, the Arruda-Boyce material up to I1 = 20 included."""
    if name != TRUTH:
        return homogeneous_curves.load(name)
    truth = ArrudaBoyceTruth()
    stretches = {mode: np.linspace(1.0, largest_stretch(mode, TRUTH_I1), TRUTH_POINTS) for mode in MODES}
    return {mode: (stretch, nominal_stress(truth, mode, stretch)) for mode, stretch in stretches.items()}


def run(case: Case, starts: int = 10, seed: int = 0) -> Result:
    """Fit one case and measure r2 in every mode."""
    curves = curves_of(case.data)
    fitted = fit_supervised(curves, case.inputs, case.layers, starts, seed)
    quality = {mode: r2(stress, fitted.model.homogeneous(mode, stretch)) for mode, (stretch, stress) in curves.items()}
    return Result(case, fitted.model, quality, fitted.loss, fitted.reason)


def table_rows(results: list[Result]) -> list[tuple[Any, ...]]:
    """Rows of the table, one a case and mode."""
    rows: list[tuple[Any, ...]] = []
    for r in results:
        for mode, (stretch, _) in curves_of(r.case.data).items():
            layers = "-".join(map(str, r.case.layers))
            place = (r.case.data, r.case.inputs, layers, mode, len(stretch), float(stretch.max()))
            rows.append((*place, r.r2[mode], r.loss, r.reason))
    return rows


def short_r2(value: float) -> str:
    """'0.9987', or '1 - 3e-05' above the target."""
    return f"{value:.4f}" if value < TARGET_R2 else f"1 - {1 - value:.0e}"
