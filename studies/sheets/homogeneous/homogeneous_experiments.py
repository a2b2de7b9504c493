"""Measured homogeneous tests of rubber as Experiments.

In: the name of a test. Out: an Experiment on 10 mm x 1 mm of cross-section (`studies.sheets.homogeneous.homogeneous_sheet`).

What is assumed: in uniaxial tests the lateral stretch was not measured and is 1 / sqrt(stretch), that of an
incompressible isotropic rubber; the free edge is then no equation. In pure shear it is 1 and the lateral force is not
measured. Noise, where the sources state none:

- force: `local_residuals` of a cubic through seven neighbours, their robust standard deviation (in MPa, times the
  cross-section), and no less than the last digit given; for Treloar also, relative, what two transcriptions of the same
  markers differ by, over sqrt 2;
- displacement: the same difference in stretch, or the last digit given, over sqrt 12, times 10 mm.

An equi-biaxial reading stands for two equal forces, each with sqrt 2 of these standard deviations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.data.experiment import Experiment, Noise
from calibrate.equations.deformation_modes import MODES, stretches_to_gradient
from calibrate.robust_deviation import robust_std
from studies.importers import homogeneous_curves, measured_data
from studies.importers.exports.text_files import text_file
from studies.importers.text_tables import Layout, read_table
from studies.sheets.homogeneous import homogeneous_sheet
from studies.sheets.homogeneous.homogeneous_sheet import CROSS_SECTION, WIDTH

Array = NDArray[np.float64]
AXES = dict(zip(MODES, ("x", "xy", "xy"), strict=True))  # pulled
ROUNDING = 1 / np.sqrt(12)
WINDOW, DEGREE = 7, 3
HNBR50_FOLDER = "miehe_goktepe_hnbr50"
HNBR50_SOURCE = "Miehe, Goktepe 2005, JMPS 53, 2231-2258; tests of S. Lee and J. Mendez, Stuttgart"
# name: (file, nominal strain rate 1/s, nan = stepwise)
HNBR50 = {
    "slow": ("Fig7_CM+SG05_visco1_2.dat", 1.07e-3),
    "medium": ("Fig7_CM+SG05_visco3_2.dat", 8.6e-3),
    "fast": ("Fig7_CM+SG05_visco2_2.dat", 8.333e-2),
    "compression-slow": ("Fig8_CM+SG05_purecomp1_2.dat", 9.4548e-4),
    "compression-medium": ("Fig8_CM+SG05_purecomp3_2.dat", 8.5025e-3),
    "compression-fast": ("Fig8_CM+SG05_purecomp4_2.dat", 7.0462e-2),
    "relaxation": ("Fig9_CM+SG05_relax.dat", float("nan")),
}
SPLITS = ("all", "training", "held-out")


def scatter(x: Array, y: Array) -> float:
    """Standard deviation of y (n,) about a smooth curve of x (n,), in its unit. Raises `ConfigError` for too few
    points."""
    return robust_std(homogeneous_sheet.local_residuals(x, y, WINDOW, DEGREE))


def noise(stress_std: float, stretch_std: float, relative: float = 0.0) -> Noise:
    """Noise of the sheet from standard deviations of stress (MPa), of stretch, and of stress relative to itself."""
    return Noise(stretch_std * WIDTH, 0.0, relative, stress_std * CROSS_SECTION)


def curve(
    name: str,
    mode: str,
    stretch: Array,
    stress: Array,
    uncertainty: Noise | None = None,
    time: Array | None = None,
    axis: str = "x",
    **provenance: Any,
) -> Experiment:
    """A test of one `mode` of `MODES`: stretch (n,), nominal stress (n,) MPa, NaN where not measured, time (n,) s.

    axis: along which a uniaxial strip is pulled. uncertainty: by default from the scatter of the curve. Raises
    `ConfigError` for an unknown mode or too few points to see scatter, `InvalidDeformationError` for a stretch that is
    not positive, and the named errors of an Experiment.
    """
    if mode not in MODES:
        raise errors.ConfigError(f"mode '{mode}' unknown; choose one of {', '.join(MODES)}")
    stretch, stress = np.asarray(stretch, float), np.asarray(stress, float)
    if not (stretch > 0).all():
        raise errors.InvalidDeformationError(f"stretch {stretch.min()} is not positive; give lengths over first length")
    F = stretches_to_gradient(mode, stretch)
    other = stress if mode == "equibiaxial" else np.full_like(stress, np.nan)
    both, P = np.stack([F[:, 0, 0], F[:, 1, 1]], axis=1), np.stack([stress, other], axis=1)
    if uncertainty is None:
        known = np.isfinite(stress)
        order = np.arange(float(len(stretch))) if time is None else np.asarray(time)
        x = stretch if (np.diff(stretch) > 0).all() else order
        uncertainty = noise(max(scatter(x[known], stress[known]), 1e-4), 1e-3 * ROUNDING)
    if mode == "equibiaxial":
        # one reading stands for both forces: two equations of twice the variance
        uncertainty = Noise(*(np.sqrt(2) * v for v in asdict(uncertainty).values()))
    axes = AXES[mode]
    if axis == "y" and axes == "x":
        both, P, axes = both[:, ::-1], P[:, ::-1], "y"
    record = {"mode": mode, **provenance}
    if mode == "uniaxial":
        record["assumed"] = "lateral stretch 1 / sqrt(stretch): incompressible, isotropic"
    return homogeneous_sheet.experiment(name, both, P, axes, time, uncertainty, record)


def transcription(mode: str) -> tuple[float, float]:
    """Standard deviations of stretch, and of stress relative to itself, between the two tables of Treloar's markers.

    The markers are paired from the last backwards, as the tables differ in the first ones. Raises `DataNotFoundError`.
    """
    (xa, ya), (xb, yb) = (homogeneous_curves.load(f"treloar-{s}")[mode] for s in "ab")
    n = min(np.count_nonzero(ya), np.count_nonzero(yb))
    differences = xb[-n:] - xa[-n:], yb[-n:] / ya[-n:] - 1
    stretch, stress = (robust_std(d) / np.sqrt(2) for d in differences)
    return stretch, stress


def treloar(mode: str, source: str = "treloar-a") -> Experiment:
    """Treloar 1944, natural rubber: 'uniaxial', 'equibiaxial' or 'pure_shear' of one of the two transcriptions.

    Raises `ConfigError` for an unknown mode or source, `DataNotFoundError`.
    """
    if source not in ("treloar-a", "treloar-b"):
        raise errors.ConfigError(f"source '{source}' unknown; choose treloar-a or treloar-b")
    x, y = _mode(homogeneous_curves.load(source), mode)
    stretch, relative = transcription(mode)
    return curve(
        f"{source} {mode}",
        mode,
        x,
        y,
        noise(scatter(x, y), stretch, relative),
        source=homogeneous_curves.SOURCES[source],
    )


def classical(collection: str, mode: str) -> Experiment:
    """A curve of another collection of `studies.importers.homogeneous_curves`: 'kawabata', 'meunier'. Raises `ConfigError`,
    `DataNotFoundError`."""
    x, y = _mode(homogeneous_curves.load(collection), mode)
    return curve(f"{collection} {mode}", mode, x, y, source=homogeneous_curves.SOURCES[collection])


def kawabata_biaxial(split: str = "all") -> Experiment:
    """Kawabata et al. 1981, points of general biaxial tension with both forces, in order of I1 (no history).

    split: at each stretch 1 the stretches 2 are numbered from 0, uniaxial (its free edge is no equation, NaN). 'training'
    has the even numbers, 'held-out' the odd ones. Raises `ConfigError` for another split, `DataNotFoundError`.
    """
    if split not in SPLITS:
        raise errors.ConfigError(f"split '{split}' unknown; choose one of {', '.join(SPLITS)}")
    table = homogeneous_curves.kawabata_biaxial()
    table = table[np.lexsort((table[:, 1], table[:, 0]))]
    start = np.flatnonzero(np.diff(table[:, 0], prepend=0.0))
    rank = np.arange(len(table)) - start[np.searchsorted(start, np.arange(len(table)), side="right") - 1]
    uncertainty = noise(_table_scatter(table), 1e-3 * ROUNDING)
    table = np.where(table == 0, np.nan, table)
    if split != "all":
        table = table[rank % 2 == (split == "held-out")]
    x, y = table[:, 0], table[:, 1]
    table = table[np.argsort(x**2 + y**2 + 1 / (x * y) ** 2, kind="stable")]
    return homogeneous_sheet.experiment(
        f"kawabata biaxial {split}", table[:, :2], table[:, 2:], "xy", None, uncertainty,
        {"mode": "biaxial", "split": split, "source": homogeneous_curves.SOURCES["kawabata"].split(";")[0]},
    )  # fmt: skip


def _table_scatter(table: Array) -> float:
    """Scatter, MPa, of both stresses along stretch 2 in the series of stretch 1 with more than five points."""
    series = [table[table[:, 0] == x] for x in np.unique(table[:, 0])]
    residuals = [
        homogeneous_sheet.local_residuals(s[:, 1], s[:, k], WINDOW, DEGREE)
        for s in series
        if len(s) > 5
        for k in (2, 3)
    ]
    return robust_std(np.concatenate(residuals))


def calendered(direction: str) -> Experiment:
    """A calendered sheet pulled along ('calendering', x) or across ('transverse', y) its direction of rolling.

    The lateral stretch is assumed isotropic, which such a sheet is not: only forces along the pull mean something.
    The origin of the curves is not stated by their source. Raises `ConfigError` for another direction,
    `DataNotFoundError`.
    """
    if direction not in ("calendering", "transverse"):
        raise errors.ConfigError(f"direction '{direction}' unknown; choose calendering or transverse")
    table = read_table(measured_data.find("kawabata_jl/diani_anisotropic_calendering_transverse.csv"), ("x", direction))
    axis = "x" if direction == "calendering" else "y"
    return curve(f"calendered {direction}", "uniaxial", table["x"], table[direction], axis=axis, source="Diani et al.")


def hnbr50(test: str = "slow", increments: int = 120) -> Experiment:
    """Filled rubber HNBR50, uniaxial, preconditioned by ten cycles; a test of `HNBR50`, with unloading and time.

    Rates: two cycles between stretch 0.75 and 2 (compression: 0.75 and 1). The time of these records is path of strain
    over nominal rate, not a clock. Relaxation: stepwise up and down, 12 h. At most `increments` points, even along the path
    of stretch and stress. Points at the same time are averaged. The records were smoothed by their authors, so that the
    scatter is hardly noise. Two cycles of one test differ by 2 to 4 %.
    Raises `ConfigError` for an unknown test, `DataNotFoundError`.
    """
    if test not in HNBR50:
        raise errors.ConfigError(f"HNBR50 test '{test}' unknown; choose one of {', '.join(HNBR50)}")
    file, rate = HNBR50[test]
    table = read_table(measured_data.find(f"{HNBR50_FOLDER}/{file}"), None, Layout(" ", 0, comment="#"))
    raw_time, which = np.unique(table["5"], return_inverse=True)
    stretch, stress = (np.bincount(which, v) / np.bincount(which) for v in (1 + table["3"] / 100, table["1"]))
    moving = np.abs(np.diff(stretch, prepend=1.0)) > 1e-4
    std = robust_std(homogeneous_sheet.local_residuals(raw_time, stress, WINDOW, DEGREE)[moving])
    keep = homogeneous_sheet.evenly(raw_time, stretch, stress, increments)
    return curve(
        f"HNBR50 {test}", "uniaxial", stretch[keep], stress[keep],
        noise(max(std, 1e-4), 3.333e-4 * ROUNDING), raw_time[keep],
        source=HNBR50_SOURCE, file=file, rate=None if np.isnan(rate) else rate,
    )  # fmt: skip


def from_file(path: str | Path, mode: str = "uniaxial") -> Experiment:
    """A text table with the columns 'stretch' and 'stress' (MPa), or 'lambda1', 'lambda2', 'P1_MPa', 'P2_MPa'; 'time' (s) too.

    Separator and decimal mark are found from its content. Rows are kept in their order; a missing stress is NaN. mode: of the two-column form.
    Raises `DataNotFoundError`, `FileFormatError`, `ForceSignError` where a specimen that lengthens is under a negative stress, and the errors of `curve`, all with the file.
    """
    path = Path(path)
    try:
        return _under_tension(_of_table(path, mode))
    except errors.EquigapError as error:
        if str(path) in str(error):
            raise
        raise type(error)(f"{path}: {error}") from None


def _under_tension(test: Experiment) -> Experiment:
    """The test. Raises `ForceSignError` where its stresses do negative work."""
    work = np.nansum(homogeneous_sheet.stresses(test) * (homogeneous_sheet.stretches(test) - 1))
    if work < 0:
        raise errors.ForceSignError("the stress is negative while the specimen lengthens; give tension as positive")
    return test


def _of_table(path: Path, mode: str) -> Experiment:
    file = text_file(path) if path.is_file() else None
    layout = Layout(missing_allowed=True) if file is None or file.is_matrix else file.layout
    table = read_table(path, None, layout)
    time = table.get("time")
    if "lambda1" not in table:
        table |= read_table(path, ("stretch", "stress"), layout)
        return curve(path.stem, mode, table["stretch"], table["stress"], time=time, source=path.name)
    columns = read_table(path, ("lambda1", "lambda2", "P1_MPa", "P2_MPa"), layout)
    values = np.stack(list(columns.values()), axis=1)
    return homogeneous_sheet.experiment(
        path.stem, values[:, :2], values[:, 2:], "xy", time, noise(_last_digit(values[:, 2:]), 1e-3 * ROUNDING),
        {"mode": "biaxial", "source": path.name},
    )  # fmt: skip


def _last_digit(stress: Array) -> float:
    """A thousandth of the largest stress: what a table with three digits states."""
    return max(1e-3 * float(np.nanmax(np.abs(stress), initial=0.0)), 1e-6)


def _mode(curves: homogeneous_curves.Curves, mode: str) -> tuple[Array, Array]:
    if mode not in curves:
        raise errors.ConfigError(f"mode '{mode}' unknown; choose one of {', '.join(curves)}")
    return curves[mode]


EXPERIMENTS: dict[str, Callable[[], Experiment]] = {
    **{f"{s}-{m}": partial(treloar, m, s) for s in ("treloar-a", "treloar-b") for m in MODES},
    **{f"{c}-{m}": partial(classical, c, m) for c in ("kawabata", "meunier") for m in MODES},
    **{f"kawabata-biaxial-{s}": partial(kawabata_biaxial, s) for s in SPLITS},
    **{f"calendered-{d}": partial(calendered, d) for d in ("calendering", "transverse")},
    **{f"hnbr50-{t}": partial(hnbr50, t) for t in HNBR50},
}
