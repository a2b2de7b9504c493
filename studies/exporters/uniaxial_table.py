"""Targets that are a table of the model's uniaxial curve, and what the law that a program makes of it misses in the other modes."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray

from calibrate.equations.deformation_modes import TITLES
from studies.exporters.certificate import Errors, errors_of_stress
from studies.exporters.material_law import MaterialLaw
from studies.exporters.nearest_law import seen_curves
from studies.exporters.target import Target, Volume

Array = NDArray[np.float64]
ROWS, CHECKED = 100, 400  # of the table, in tension; stretches of each mode at which it is checked


class UniaxialTable(Target):
    """Base of the targets that tabulate one curve; a subclass says which law its program makes of it."""

    @abstractmethod
    def sheet_stress(self, law: MaterialLaw, F: Array) -> Array:
        """Nominal stress (n, 2, 2), MPa, of the law of the table in an incompressible sheet at F (n, 2, 2)."""

    def errors(self, law: MaterialLaw, volume: Volume, body: str) -> Errors | None:
        return errors_of_stress(law, lambda F: self.sheet_stress(law, F), "of the tabulated law itself")

    def mode_errors(self, law: MaterialLaw) -> dict[str, float]:
        """Largest stress error of each mode that was seen, as far as it was, over its largest stress."""
        return {
            mode: float(np.abs(self.sheet_stress(law, F)[:, 0, 0] - true).max() / np.abs(true).max())
            for mode, (F, true) in seen_curves(law, CHECKED).items()
        }

    def stated_errors(self, law: MaterialLaw) -> list[str]:
        """Comment lines with the error of every mode."""
        head = "Stress error of the tabulated law, linear between its points, over the largest stress of the mode"
        lines = [head, *(f"  {TITLES[mode]}: {share:.2e}" for mode, share in self.mode_errors(law).items())]
        return [f"{self.comment} {line}" for line in lines]
