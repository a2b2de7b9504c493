"""Joint fits to a measured sheet as model files, with their errors on the whole sheet: a `Joint` in, a `FittedModel` out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.diagnosis.effect_fit import Fit
from calibrate.diagnosis.joint.fit import Joint
from calibrate.diagnosis.problem import Problem
from calibrate.effects.chain import Addition
from calibrate.effects.out_of_plane import OutOfPlane
from calibrate.models.addition_json import amplitude_unit
from calibrate.models.extended_model import ExtendedModel
from studies.sheets.model_errors import Split, prediction
from studies.sheets.sheet_results import Amplitude, FittedModel, ModelName, Shape

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Say = Callable[[str], None]


def base_name(splines: int) -> str:
    """'neo-Hooke' or how many splines."""
    return "neo-Hooke" if splines == 1 else f"{splines} splines"


@dataclass(frozen=True)
class SheetModels:
    """Joint fits as model files, with their errors on the whole sheet."""

    whole: Experiment
    early: Experiment
    split: Split
    spacing: float
    until: float
    problem: Problem

    def extended(self, one: Joint) -> ExtendedModel:
        """The model file; an amplitude that is a share of the whole loading holds for all increments."""
        present, deviations = list(one.present), list(one.errors)
        for i, a in enumerate(present):
            if a.effect.name == OutOfPlane.name:
                present[i] = replace(a, amplitudes=(self.growth * a.amplitudes[0],))
                deviations[i] = (self.growth * deviations[i][0],)
        return self._model(one.c, present, deviations)

    @property
    def growth(self) -> float:
        """Displacements of the whole loading over those of what was fitted."""
        both = (np.sqrt((e.displacements**2).mean(axis=(1, 2))).max() for e in (self.whole, self.early))
        return float(next(both) / next(both))

    def of_early(self, additions: Sequence[Addition]) -> tuple[Addition, ...]:
        """Additions of a model file as they are in a fit of the increments up to the limit."""
        return tuple(
            replace(a, amplitudes=(a.amplitudes[0] / self.growth,)) if a.effect.name == OutOfPlane.name else a
            for a in additions
        )

    def _model(self, c: Array, additions: Sequence[Addition], deviations: Sequence[tuple[float, ...]]) -> ExtendedModel:
        e = self.whole
        training = ({"name": e.name, "fingerprint": e.fingerprint},)
        held = f"increments after {self.until:g} s"
        basis = self.problem.basis
        return ExtendedModel(basis, c, tuple(additions), tuple(deviations), e.stress_unit, training, held)

    def errors(self, one: Joint) -> dict[str, float]:
        """Errors of force and field on what was fitted and scored: the fields of `PartErrors`."""
        found = prediction(self.whole, [self.extended(one)], self.split, self.spacing).errors
        return {
            "force_fitted": found.fitted.force,
            "field_fitted": found.fitted.field,
            "force_scored": found.scored.force,
            "field_scored": found.scored.field,
        }

    def of(self, one: Joint, name: str, splines: int = 1) -> FittedModel:
        """A model with everything that the report shows of it."""
        return self._described([self.extended(one)], name, splines, one.loss / one.n_rows, one.dispersion)

    def mean(self, fits: Sequence[Joint], name: str) -> FittedModel:
        """Several models whose predictions are averaged."""
        chi_square, reduced = (
            float(np.mean(v)) for v in zip(*((f.loss / f.n_rows, f.dispersion) for f in fits), strict=True)
        )
        return self._described([self.extended(one) for one in fits], name, 1, chi_square, reduced)

    def of_base(self, fit: Fit) -> FittedModel:
        """Neo-Hooke alone."""
        model = self._model(fit.c, (), ())
        return self._described([model], ModelName.BASE, 1, fit.loss / fit.n_rows, fit.loss / (fit.n_rows - 1))

    def _described(
        self, found: Sequence[ExtendedModel], name: str, splines: int, chi_square: float, reduced: float
    ) -> FittedModel:
        """One model, or several whose predictions are averaged; amplitudes are those of a single one."""
        alone = found if len(found) == 1 else ()
        return FittedModel(
            name=name,
            members=[model.to_dict() for model in found],
            base=base_name(splines),
            effects=sorted({a.effect.name for model in found for a in model.additions}),
            chi_square=chi_square,
            reduced_chi_square=reduced,
            amplitudes=[
                Amplitude(a.effect.name, p.name, amplitude_unit(p, model.unit), v, d)
                for model in alone
                for a, deviations in zip(model.additions, model.errors, strict=True)
                for p, v, d in zip(a.effect.amplitudes, a.amplitudes, deviations, strict=True)
            ],
            shapes=[
                Shape(a.effect.name, p.name, amplitude_unit(p, model.unit), v)
                for model in alone
                for a in model.additions
                for p, v in zip(a.effect.shapes, a.shape, strict=True)
            ],
            **vars(prediction(self.whole, found, self.split, self.spacing)),
        )
