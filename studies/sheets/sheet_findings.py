"""The findings of the study on measured data: results of the steps in, one `Finding` a line of the answer out."""

from __future__ import annotations

from typing import Any

from calibrate.diagnosis.selection import DEFAULT
from studies.output.findings import Finding, Macro
from studies.sheets.measured_results import MeasuredResults
from studies.sheets.sheet_results import ModelName, SheetResult
from studies.sheets.tables import spread


class SheetCode(Macro):
    """Macros of ``templates/measured.txt``."""

    SHEET = "sheet"
    ALONE = "alone"
    TRANSFERRED = "transferred"
    STIFFNESS = "stiffness"
    CONTROL = "control"


def sheet(learnt: SheetResult) -> Finding:
    """The verdict on a sheet, with its errors in increments never used."""
    base, retained, final = (
        learnt.model(name).errors.scored.to_dict() for name in (ModelName.BASE, ModelName.RETAINED, ModelName.MEAN)
    )
    ranges = spread(learnt)
    data = {
        "name": learnt.name, "verdict": learnt.verdict, "closest": learnt.closest,
        "predicts": learnt.predicts, "unfinished": learnt.unfinished_fits,
        "base": base, "final": final, "retained": retained, "fits": len(learnt.leave_one_out),
        "force_range": ranges["force"], "field_range": ranges["field"],
    }  # fmt: skip
    return Finding("measured", SheetCode.SHEET, data)


def findings(results: MeasuredResults) -> list[Finding]:
    """The answer of the study."""
    second, located = results.second, results.map.errors.scored
    before, after = (one.errors.scored.force for one in (second.model(ModelName.BASE), second.final))
    significant = [c.name for c in results.controls.values() if c.smallest_adjusted_p < DEFAULT.significance]
    transferred = {"name": second.name, "factor": second.final.factor, "before": before, "after": after}
    lines: list[tuple[SheetCode, dict[str, Any]]] = [
        (SheetCode.ALONE, {"text": sheet(results.own).text}),
        (SheetCode.TRANSFERRED, transferred),
        (SheetCode.STIFFNESS, {"name": results.map.name, **located.to_dict()}),
        (SheetCode.CONTROL, {"found": significant}),
    ]
    return [sheet(results.first), *(Finding("measured", code, data) for code, data in lines)]
