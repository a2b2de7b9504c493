"""What was learnt on one measured sheet, on another: transferred with one factor.

In: Experiments and models. Out: `TransferResult`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calibrate import errors
from calibrate.data.experiment import Experiment
from calibrate.effects.chain import Chain
from calibrate.equations.equilibrium import equilibrium
from calibrate.models.extended_model import ExtendedModel
from studies.sheets.model_errors import Split, grip_rows, prediction
from studies.sheets.sheet_results import ModelName, NamedModel, TransferredModel, TransferResult

Array = NDArray[np.float64]
REFITTED = ", relaxation refitted"


def transferred(
    e: Experiment, model: ExtendedModel, split: Split, spacing: float, strength: bool = False
) -> tuple[ExtendedModel, dict[str, float]]:
    """The model with the factor on its stiffness, and on the `strength` of its relaxation, that fits the forces best.

    Fitted to the forces at the grips in the increments to be fitted; everything else stays as it was learnt.
    spacing: of the virtual fields, mm. Raises `FitError` where no factor is found.
    """
    system = equilibrium(e, spacing)
    rows = split.fitted
    grips = grip_rows(system)

    def residuals(logs: Array) -> Array:
        scaled = model.scaled(*np.exp(logs))
        return Chain(system, model.basis).residual(scaled.c, scaled.additions)[rows][:, grips].ravel()

    load = system.loads[rows][:, grips].ravel()
    guess = float(load @ load) / max(float(load @ (residuals(np.zeros(1)) + load)), 1e-3 * float(load @ load))
    start = np.log([guess, 1.0] if strength else [guess])
    best = least_squares(residuals, start, x_scale=0.1, diff_step=1e-2, xtol=1e-4, max_nfev=20)
    if not best.success:
        raise errors.FitError(f"{e.name}: the transferred material cannot be scaled to its forces: {best.message}")
    factors = [float(f) for f in np.exp(best.x)]
    return model.scaled(*factors), dict(zip(("stiffness", "relaxation"), factors, strict=False))


def transfer(e: Experiment, models: Sequence[NamedModel], until: float, spacing: float) -> TransferResult:
    """Every model learnt on another sheet, on this one, with one factor refitted; the mean also with its relaxation.

    Of a mean of several models each is refitted; the factor shown is their median. until: s; spacing: of the virtual
    fields, mm. Raises `ConfigError` where the sheet cannot be split there, `FitError`.
    """
    split = Split.of(e, until)
    cases = [(one, False) for one in models]
    cases += [
        (one, True) for one in models if one.name == ModelName.MEAN and all(model.relaxes for model in one.models)
    ]
    found = [_transferred_model(e, one, split, spacing, strength) for one, strength in cases]
    return TransferResult(e.name, [] if e.time is None else e.time.tolist(), found)


def _transferred_model(
    e: Experiment, one: NamedModel, split: Split, spacing: float, strength: bool
) -> TransferredModel:
    found = [transferred(e, model, split, spacing, strength) for model in one.models]
    factors = {key: float(np.median([factors[key] for _, factors in found])) for key in found[0][1]}
    return TransferredModel(
        name=one.name + (REFITTED if strength else ""),
        members=[model.to_dict() for model, _ in found],
        factor=factors["stiffness"],
        factors=factors,
        **vars(prediction(e, [model for model, _ in found], split, spacing)),
    )
