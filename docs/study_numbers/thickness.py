"""The page on thickness. A bias is that of the worst of the three homogeneous modes; conditions: the 2D reference and every thickness."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from wording import percentage, span

from studies.grid.axes import PLANE, Loss, Settings
from studies.grid.case import Fit
from studies.grid.presets import thickness_tables as tables
from studies.grid.presets.thickness_results import ThicknessResults, condition_name
from studies.grid.results import Spread, median_biases

DEFAULT, CORRECTED, FROZEN, DEPENDENT = Loss.WEIGHTED, Loss.CORRECTED, Loss.FROZEN, Loss.DEPENDENT
FIELDS = {
    "ε, 95th percentile": 3,
    "ε, maximum": 5,
    "ε, 95th percentile within 5 mm of a rim": 9,
}  # columns of `field_row`


class Page:
    """What the page says of a finished run."""

    def __init__(self, results: ThicknessResults):
        self.results = results

    def fits(self, condition: str, loss: Loss, noisy: bool) -> list[Fit]:
        return list(self.results.fitted(condition, loss, noisy).values())

    def bias(self, condition: str, loss: Loss, noisy: bool) -> float:
        """Median over seeds, worst mode, %."""
        found = tables.trust(self.results, condition, loss, noisy)
        return float("nan") if found is None else found.bias

    def largest(self, condition: str, loss: Loss, noisy: bool) -> float:
        """Largest error on the curves, % of the largest stress."""
        found = tables.trust(self.results, condition, loss, noisy)
        return float("nan") if found is None else found.largest

    def outside(self, condition: str, loss: Loss, noisy: bool) -> float:
        """Median bias outside the calibrated range, worst mode, %."""
        return 100 * float(max(median_biases(self.fits(condition, loss, noisy), outside=True), key=abs))

    def stress(self, condition: str, loss: Loss, noisy: bool) -> str:
        """'-0.02 to 0.09': P5 to P95 of the signed error of P11, medians over seeds."""
        fits = self.fits(condition, loss, noisy)
        low, high = (Spread.of(map(tables.STRESSES[f"P11 {q} (%)"], fits)).median for q in ("P5", "P95"))
        return f"{round(low, 2) + 0.0:.2f} to {round(high, 2) + 0.0:.2f}"

    def row(self, title: str, quantity: Any, loss: Loss, noisy: bool, digits: int) -> list[str]:
        """A line of the table: the reference has no corrected fits."""
        conditions = self.results.conditions
        found = [quantity(c, loss, noisy) if (c, loss) != (PLANE, CORRECTED) else "" for c in conditions]
        return [title, *(one if isinstance(one, str) else f"{one:.{digits}f}" for one in found)]

    def pair(self, title: str, quantity: Any, noisy: bool, digits: int) -> list[list[str]]:
        """The default loss, and below it the correction."""
        name = f"default loss, {'noisy' if noisy else 'clean'}: {title}"
        return [self.row(name, quantity, DEFAULT, noisy, digits),
                self.row("the same, **corrected**", quantity, CORRECTED, noisy, digits)]  # fmt: skip

    def table(self) -> list[list[str]]:
        rows = [["", *(condition_name(c).removesuffix(" reference") for c in self.results.conditions)]]
        fields = [tables.field_row(h, self.results.fields[h]) for h in self.results.thicknesses]
        at = {row[6] for row in fields}
        for title, column in FIELDS.items():
            place = f", at {at.pop()} mm" if column == 5 and len(at) == 1 else ""
            rows.append([title + place, "", *(f"{row[column]:.3f}" for row in fields)])
        forces: dict[float, float] = {}
        for h, _, _, _, _, end, _ in tables.force_rows(self.results):
            forces[h] = max(forces.get(h, 0.0), abs(end))
        rows.append(
            ["force over thickness against 2D, at the end, worst arm (%)", "", *(f"{f:.2f}" for f in forces.values())]
        )
        for noisy in (False, True):
            rows += self.pair("bias (%)", self.bias, noisy, 2)
            rows += self.pair("largest error (% of largest stress)", self.largest, noisy, 1)
            rows += self.pair("P5 to P95 of the stress error of P11 (%)", self.stress, noisy, 2)
            rows += self.pair("bias outside the calibrated range (%)", self.outside, noisy, 1)
        rows.append(self.row("paper's loss, C_F dependent, clean, one start: bias (%)", self.bias, DEPENDENT, False, 1))
        for noisy, name in ((False, "clean"), (True, "noisy")):
            rows.append(self.row(f"paper's loss, C_F frozen, {name}: bias (%)", self.bias, FROZEN, noisy, 0))
        return rows

    def numbers(self) -> dict[str, str]:
        def corrected(noisy: bool) -> list[float]:
            return [abs(self.outside(h, CORRECTED, noisy)) for h in self.results.thicknesses]

        seeds = [abs(100 * float(max(fit.outside, key=lambda score: abs(score.bias)).bias))
                 for h in self.results.thicknesses for fit in self.fits(h, CORRECTED, True)]  # fmt: skip
        return {
            "bias_10": percentage(self.bias("10", DEFAULT, False)),
            "bias_40": percentage(self.bias("40", DEFAULT, False)),
            "bias_40_noisy": percentage(self.bias("40", DEFAULT, True), 2),
            "largest_10": percentage(self.largest("10", DEFAULT, False)),
            "largest_40": percentage(self.largest("40", DEFAULT, False)),
            "paper_2d": percentage(self.bias(PLANE, DEPENDENT, False)),
            "paper_10": percentage(self.bias("10", DEPENDENT, False), 0),
            "paper_40": percentage(self.bias("40", DEPENDENT, False), 0),
            "outside_10": percentage(self.outside("10", DEFAULT, False), 0),
            "outside_40": percentage(self.outside("40", DEFAULT, False), 0),
            "corrected_40": percentage(self.bias("40", CORRECTED, False)),
            "corrected_40_noisy": percentage(self.bias("40", CORRECTED, True)),
            "corrected_outside_clean": span(corrected(noisy=False)),
            "corrected_outside_noisy": span(corrected(noisy=True)),
            "corrected_outside_worst": percentage(float(np.max(seeds)), 0),
            "noisy_20": span((abs(self.bias(h, DEFAULT, True)) for h in ("10", "15", "20")), 1),
            "corrected_noisy_20": span((abs(self.bias(h, CORRECTED, True)) for h in ("10", "15", "20")), 1),
            "seeds": str(len(self.results.settings.seeds)),
        }


def take(folder: Path) -> dict[str, Any]:
    """Content of the file, of the folder of `equigap thickness`."""
    settings = Settings.read(folder)
    page = Page(ThicknessResults(folder, settings))
    how = f"the cross; noisy: medians over {len(settings.seeds)} noise seeds"
    return {
        "command": "equigap thickness (default)",
        "how": how,
        "numbers": page.numbers(),
        "tables": {"study": page.table()},
    }
