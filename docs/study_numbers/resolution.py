"""The page on resolution. Biases are those of the worst of the three homogeneous modes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from wording import percentage, span

from studies.grid.axes import Loss, Settings
from studies.grid.presets.resolution_study import Row, rows_of
from studies.grid.results import Results


def worst(rows: Iterable[Row]) -> Row:
    """The mode with the largest median bias."""
    return max(rows, key=lambda row: abs(row.bias.median))


def extremes(rows: Sequence[Row], digits: int) -> str:
    """'-1 to +118 %': lowest and highest bias of any mode and seed."""
    low, high = min(row.bias.low for row in rows), max(row.bias.high for row in rows)
    return f"{round(low, digits) + 0.0:.{digits}f} to {percentage(high, digits, sign=True)}"


def spread(row: Row) -> str:
    """'-0.36 % [-0.52, -0.11]': median and range over seeds."""
    return f"{percentage(row.bias.median, 2)} [{row.bias.low:.2f}, {row.bias.high:.2f}]"


def resolution(results: Results) -> dict[str, Any]:
    """Numbers and table."""
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
        "bias_fine": percentage(worst(noisy[:-1]).bias.median),
        "bias_coarse": percentage(noisy[-1].bias.median),
        "bias_coarse_range": f"{noisy[-1].bias.low:.2f} to {percentage(noisy[-1].bias.high, 2)}",
        "paper_frozen": span(at(frozen, level, True).bias.median for level in levels),
        "paper_dependent": extremes(every(dependent, noisy=True), 0),
        "paper_clean_frozen": span(at(frozen, level, False).bias.median for level in levels),
        "paper_clean_dependent": extremes(every(dependent, noisy=False), 1),
        "outside_median": percentage(max(abs(r.bias.median) for r in outside)),
        "outside_low": percentage(min(r.bias.low for r in outside)),
        "outside_high": percentage(max(r.bias.high for r in outside), sign=True),
    }
    clean = [at(Loss.WEIGHTED, level, False) for level in levels]
    table = [
        [
            "nodes",
            "clean data",
            "with noise: median [range over seeds]",
            "lowest median r2 with noise",
            "polished, with noise",
        ]
    ]
    for level, a, b, r2 in zip(levels, clean, noisy, lowest, strict=True):
        polished = spread(at(Loss.POLISHED, level, True)) if level in results.settings.polished else ""
        table.append([f"{b.nodes} ({level} %)", percentage(a.bias.median, 2), spread(b), f"{r2:.5f}", polished])
    return {"numbers": numbers, "tables": {"bias": table}}


def take(folder: Path) -> dict[str, Any]:
    """Content of the file, of the folder of `equigap resolution`."""
    settings = Settings.read(folder)
    how = f"medians and ranges over {len(settings.seeds)} noise seeds"
    return {"command": "equigap resolution (default)", "how": how, **resolution(Results(folder, settings))}
