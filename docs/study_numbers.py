"""Numbers of the pages on resolution and thickness, from the folders of the finished studies.

    python docs/study_numbers.py results/resolution results/thickness

In: output folders of `equigap resolution` and `equigap thickness`. Out: ``resolution.json`` and ``thickness.json`` in
`docs/results`; `make numbers` puts them into the pages. Biases are those of the worst of the three homogeneous modes.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterable, Sequence
from datetime import date
from pathlib import Path
from typing import Any

from studies.grid.axes import Loss, Settings
from studies.grid.presets import thickness_tables as tables
from studies.grid.presets.resolution_study import Row, rows_of
from studies.grid.presets.thickness_results import ThicknessResults
from studies.grid.results import Results, Spread

RESULTS = Path(__file__).parent / "results"
THICK = ("10", "15", "20", "40")  # mm


def percent(value: float, digits: int = 1, sign: bool = False) -> str:
    """'0.1 %'; no negative zero."""
    value = round(value, digits) + 0.0
    return f"{value:{'+' if sign else ''}.{digits}f} %"


def span(values: Iterable[float], digits: int = 0, sign: bool = False) -> str:
    """'1 to 2 %', the smaller one in magnitude first; '1 %' where both are equal."""
    low, *_, high = sorted([*values] * 2, key=abs)
    first = f"{low:.{digits}f}"
    return percent(high, digits, sign) if first == f"{high:.{digits}f}" else f"{first} to {percent(high, digits, sign)}"


def worst(rows: Iterable[Row]) -> Row:
    """The mode with the largest median bias."""
    return max(rows, key=lambda row: abs(row.bias.median))


def extremes(rows: Sequence[Row], digits: int) -> str:
    """'-1 to +118 %': lowest and highest bias of any mode and seed."""
    low, high = min(row.bias.low for row in rows), max(row.bias.high for row in rows)
    return f"{round(low, digits) + 0.0:.{digits}f} to {percent(high, digits, sign=True)}"


def resolution(results: Results) -> dict[str, Any]:
    """Content of `resolution.json` but for what it is made of."""
    rows = rows_of(results)

    def at(loss: Loss, level: str, noisy: bool, place: str = "inside") -> Row:
        chosen = [r for r in rows if (r.loss, r.resolution, r.noisy, r.place) == (loss, level, noisy, place)]
        return worst(chosen)

    levels = sorted(results.settings.resolutions, key=float, reverse=True)
    noisy = [at(Loss.WEIGHTED, level, True) for level in levels]

    def every(loss: Loss, noisy: bool) -> list[Row]:
        return [r for r in rows if (r.loss, r.noisy, r.place) == (loss, noisy, "inside")]

    outside = [r for r in rows if r.loss is Loss.WEIGHTED and r.noisy and r.place == "outside"]
    frozen, dependent = Loss.FROZEN, Loss.DEPENDENT
    lowest = [min(r.r2.median for r in rows if (r.loss, r.resolution, r.noisy, r.place) == (Loss.WEIGHTED, level, True, "inside"))
              for level in levels]  # fmt: skip
    numbers = {
        "nodes_fine": noisy[0].nodes,
        "nodes_coarse": noisy[-1].nodes,
        "bias_fine": percent(worst(noisy[:-1]).bias.median),
        "bias_coarse": percent(noisy[-1].bias.median),
        "bias_coarse_range": f"{noisy[-1].bias.low:.2f} to {percent(noisy[-1].bias.high, 2)}",
        "paper_frozen": span(at(frozen, level, True).bias.median for level in levels),
        "paper_dependent": extremes(every(dependent, noisy=True), 0),
        "paper_clean_frozen": span(at(frozen, level, False).bias.median for level in levels),
        "paper_clean_dependent": extremes(every(dependent, noisy=False), 1),
        "outside_median": percent(max(abs(r.bias.median) for r in outside)),
        "outside_low": percent(min(r.bias.low for r in outside)),
        "outside_high": percent(max(r.bias.high for r in outside), sign=True),
    }
    clean = [at(Loss.WEIGHTED, level, False) for level in levels]
    table = [["nodes", "clean data", "with noise: median [range over seeds]", "lowest median r2 with noise"]]
    for level, a, b, r2 in zip(levels, clean, noisy, lowest, strict=True):
        spread = f"{percent(b.bias.median, 2)} [{b.bias.low:.2f}, {b.bias.high:.2f}]"
        table.append([f"{b.nodes} ({level} %)", percent(a.bias.median, 2), spread, f"{r2:.5f}"])
    return {"numbers": numbers, "tables": {"bias": table}, "seeds": len(results.settings.seeds)}


def thickness(results: ThicknessResults) -> dict[str, Any]:
    """Content of `thickness.json` but for what it is made of."""

    def trust(name: str, loss: Loss, noisy: bool = False) -> tables.Trust:
        found = tables.trust(results, name, loss, noisy)
        assert found is not None, (name, loss, noisy)
        return found

    def outside(name: str, loss: Loss, noisy: bool = False) -> float:
        fits = [*results.fitted(name, loss, noisy).values()]
        return 100 * float(max(tables.median_biases(fits, outside=True), key=abs))

    def worst_seed(name: str) -> float:
        fits = results.fitted(name, Loss.CORRECTED, True).values()
        return 100 * max(abs(score.bias) for fit in fits for score in fit.outside)

    weighted, corrected, dependent = Loss.WEIGHTED, Loss.CORRECTED, Loss.DEPENDENT
    plane = results.conditions[0]
    numbers = {
        "bias_10": percent(trust("10", weighted).bias),
        "bias_40": percent(trust("40", weighted).bias),
        "bias_40_noisy": percent(trust("40", weighted, True).bias, 2),
        "largest_10": percent(trust("10", weighted).largest),
        "largest_40": percent(trust("40", weighted).largest),
        "paper_10": percent(trust("10", dependent).bias, 0),
        "paper_40": percent(trust("40", dependent).bias, 0),
        "paper_2d": percent(trust(plane, dependent).bias),
        "outside_10": percent(outside("10", weighted), 0),
        "outside_40": percent(outside("40", weighted), 0),
        "corrected_40": percent(trust("40", corrected).bias),
        "corrected_40_noisy": percent(trust("40", corrected, True).bias),
        "corrected_outside_clean": span(abs(outside(h, corrected)) for h in THICK),
        "corrected_outside_noisy": span(abs(outside(h, corrected, True)) for h in THICK),
        "corrected_outside_worst": percent(max(map(worst_seed, THICK)), 0),
    }
    return {
        "numbers": numbers,
        "tables": {"study": study_table(results, trust, outside)},
        "seeds": len(results.settings.seeds),
    }


def study_table(
    results: ThicknessResults, trust: Callable[..., tables.Trust], outside: Callable[..., float]
) -> list[list[str]]:
    """Rows of quantities, a column for each thickness."""
    conditions = (results.conditions[0], *THICK)
    fields = [tables.field_row(name, results.fields[name]) for name in THICK]
    forces = {h: max(abs(row[5]) for row in tables.force_rows(results) if row[0] == float(h)) for h in THICK}

    def fitted(loss: Loss, of: Callable[..., str], noisy: bool = False) -> list[str]:
        return [of(name, loss, noisy) if results.fitted(name, loss, noisy) else "" for name in conditions]

    def bias(digits: int) -> Callable[..., str]:
        return lambda *key: f"{trust(*key).bias + 0.0:.{digits}f}"

    def largest(*key: Any) -> str:
        return f"{trust(*key).largest:.1f}"

    def beyond(*key: Any) -> str:
        return f"{outside(*key):.{1 if abs(outside(*key)) < 10 else 0}f}"

    def first_stress(name: str, loss: Loss, noisy: bool) -> str:
        fits = [*results.fitted(name, loss, noisy).values()]
        p5, p95 = (Spread.of(map(tables.STRESSES[f"P11 {q} (%)"], fits)).median + 0.0 for q in ("P5", "P95"))
        return f"{p5:.2f} to {p95:.2f}"

    quantities: list[tuple[str, Callable[..., str], bool]] = [
        ("default loss, clean: bias (%)", bias(2), False),
        ("default loss, clean: largest error (% of largest stress)", largest, False),
        ("default loss, clean: P5 to P95 of the stress error of P11 (%)", first_stress, False),
        ("default loss, clean: bias outside the calibrated range (%)", beyond, False),
        ("default loss, noisy: bias (%)", bias(2), True),
        ("default loss, noisy: largest error (%)", largest, True),
        ("default loss, noisy: bias outside the calibrated range (%)", beyond, True),
    ]
    rows = [["", "2D", *(f"{h} mm" for h in THICK)],
            ["ε, 95th percentile", "", *(f"{row[3]:.3f}" for row in fields)],
            [f"ε, maximum, at {fields[0][6]}", "", *(f"{row[5]:.3f}" for row in fields)],
            ["ε, 95th percentile within 5 mm of a rim", "", *(f"{row[9]:.3f}" for row in fields)],
            ["force over thickness against 2D, at 60 mm, worst arm (%)", "", *(f"{forces[h]:.2f}" for h in THICK)]]  # fmt: skip
    for title, of, noisy in quantities:
        rows.append([title, *fitted(Loss.WEIGHTED, of, noisy)])
        if of is not first_stress or not noisy:
            rows.append(["the same, **corrected**", *fitted(Loss.CORRECTED, of, noisy)])
    rows.append(["paper's loss, C_F dependent, clean, one start: bias (%)", *fitted(Loss.DEPENDENT, bias(1))])
    rows.append(["paper's loss, C_F frozen, clean: bias (%)", *fitted(Loss.FROZEN, bias(0))])
    rows.append(["paper's loss, C_F frozen, noisy: bias (%)", *fitted(Loss.FROZEN, bias(0), True)])
    return rows


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("resolution", type=Path)
    parser.add_argument("thickness", type=Path)
    args = parser.parse_args(words)
    for name, reader, of in (("resolution", Results, resolution), ("thickness", ThicknessResults, thickness)):
        folder = getattr(args, name)
        found = of(reader(folder, Settings.read(folder)))
        how = f"medians and ranges over {found.pop('seeds')} noise seeds; computed by docs/study_numbers.py from the study's folder"
        head = {"command": f"equigap {name} (default)", "made": date.today().isoformat(), "how": how}
        (RESULTS / f"{name}.json").write_text(json.dumps({**head, **found}, indent=1, ensure_ascii=False) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
