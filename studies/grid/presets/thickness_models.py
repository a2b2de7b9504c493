"""Figures of the thickness study that show calibrated models: stress errors, energy errors, predictions.

In: `ThicknessResults` and a loss. Out: matplotlib figures; no screen is needed.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import ConvexHull

from calibrate.equations.deformation_modes import MODES, TITLES
from calibrate.models.network_model import Model
from studies.accuracy.epsilon import weighted_quantile
from studies.accuracy.metrics import ArrudaBoyceTruth
from studies.accuracy.stress_error import COMPONENTS, energy_errors, energy_of, stress_errors
from studies.grid.axes import Loss
from studies.grid.case import Curve, Fit
from studies.grid.claims import NOISES
from studies.grid.presets.thickness_results import ThicknessResults, condition_name
from studies.grid.presets.thickness_tables import LIMITS
from studies.grid.results import median_biases
from studies.output import style

Array = NDArray[np.float64]
LEVELS = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0)  # %, of the energy error
BINS = 2000
MARGIN = 1.25  # the invariant plane is shown to this many times the calibrated range of I1 - 3


def median_fit(fits: list[Fit]) -> Fit:
    """The fit whose mean bias over the modes is the median of all (the lower one of two)."""
    means = [np.mean([score.bias for score in fit.inside]) for fit in fits]
    return fits[int(np.argsort(means)[(len(fits) - 1) // 2])]


def density(values: Array, weights: Array, grid: Array) -> Array:
    """Weighted kernel density on an equidistant grid (k,), per unit of `values`: Gaussian kernel, Silverman's width, or
    1 / 150 of the grid where that is more (states of one specimen are no independent draws).

    Weight beyond the ends of the grid is left out, so the area is the share within.
    """
    step = grid[1] - grid[0]
    mean = np.average(values, weights=weights)
    deviation = np.sqrt(np.average((values - mean) ** 2, weights=weights))
    low, high = weighted_quantile(values, weights, np.array([0.25, 0.75]))
    effective = weights.sum() ** 2 / (weights**2).sum()
    width = max(0.9 * min(deviation, (high - low) / 1.34) * effective**-0.2, (grid[-1] - grid[0]) / 150)
    edges = np.append(grid, grid[-1] + step) - step / 2
    histogram, _ = np.histogram(values, bins=edges, weights=weights)
    return gaussian_filter1d(histogram, max(width / step, 1.0), mode="constant") / (weights.sum() * step)


def densities(results: ThicknessResults, loss: Loss) -> Figure:
    """The paper's two rows: densities of the signed stress error per component, with noise and without."""
    errors = {(noisy, condition): pooled_errors(results, condition, loss, noisy)
              for noisy in (True, False) for condition in results.conditions}  # fmt: skip
    rows = [noisy for noisy in (True, False) if any(errors[noisy, c] is not None for c in results.conditions)]
    with style.figure(9.6, 2.7 * len(rows) + 0.5) as figure:
        axes = figure.subplots(len(rows), 3, squeeze=False)
        for row, noisy in zip(axes, rows, strict=True):
            present = {c: errors[noisy, c] for c in results.conditions if errors[noisy, c] is not None}
            for ax, component in zip(row, COMPONENTS, strict=True):
                _density_panel(ax, results, {c: e[component] for c, e in present.items() if e is not None})
                count = len(results.fitted(results.conditions[0], loss, noisy))
                noise = f"with noise ({count} seeds pooled)" if noisy else "without noise"
                ax.set_title(f"{component}, {noise}")
        for ax in axes[-1]:
            ax.set_xlabel("stress error (%)")
        for ax in axes[:, 0]:
            ax.set_ylabel("density (1/%)")
        axes[0, 0].legend(fontsize=8)
    return figure


def _density_panel(ax: Axes, results: ThicknessResults, errors: dict[str, tuple[Array, Array]]) -> None:
    """Densities {condition: (errors, weights)}; the x-axis holds 98 % of every condition."""
    ends = np.array([weighted_quantile(*pair, np.array([0.01, 0.99])) for pair in errors.values()])
    low, high = min(ends[:, 0].min(), -0.05), max(ends[:, 1].max(), 0.05)
    low, high = low - 0.05 * (high - low), high + 0.05 * (high - low)
    grid = np.linspace(low, high, BINS)
    top = 0.0
    for condition, pair in errors.items():
        curve = density(*pair, grid)
        ax.plot(grid, curve, label=condition_name(condition), **results.look(condition))
        top = max(top, float(curve.max()))
    ax.axvline(0, color="0.4", linewidth=0.7, linestyle="-")
    ax.set(xlim=(low, high), yscale="log", ylim=(1e-3 * top, 2 * top))
    if low < -LIMITS.stress or high > LIMITS.stress:
        ax.axvspan(-LIMITS.stress, LIMITS.stress, color=style.COLOURS["sky"], alpha=0.12, linewidth=0)


def pooled_errors(
    results: ThicknessResults, condition: str, loss: Loss, noisy: bool
) -> dict[str, tuple[Array, Array]] | None:
    """{component: (signed errors in %, weights)} at the states of the 2D reference, all seeds pooled."""
    fits = results.fitted(condition, loss, noisy)
    if not fits:
        return None
    errors = np.concatenate([stress_errors(Model.from_dict(fit.model), results.reference) for fit in fits.values()])
    weights = np.tile(results.reference.states.weights, len(fits))
    return {name: (errors[:, i], weights) for i, name in enumerate(COMPONENTS)}


def energy_error(model: Model, invariants: Array) -> Array:
    """(psi_model - psi_true) / psi_true (...), %, at invariants (..., 2)."""
    flat = invariants.reshape(-1, 2)
    return energy_errors(model, flat, energy_of(ArrudaBoyceTruth(), flat)).reshape(invariants.shape[:-1])


def admissible(I1: Array) -> tuple[Array, Array]:
    """Least and greatest I2 (k,) of an incompressible solid at I1 (k,): uniaxial and equi-biaxial tension."""
    stretch = np.linspace(1, np.sqrt(I1.max()) + 1, 20000)
    uniaxial = np.interp(I1, stretch**2 + 2 / stretch, 2 * stretch + stretch**-2)
    biaxial = np.interp(I1, 2 * stretch**2 + stretch**-4, stretch**4 + 2 * stretch**-2)
    return uniaxial, biaxial


def energies(results: ThicknessResults, loss: Loss) -> Figure:
    """Energy error over the invariant plane: a column a condition, with noise (median seed) and without."""
    rows = [n for n in (True, False) if results.fitted(results.conditions[0], loss, n)]
    end = 3 + MARGIN * (results.limit - 3)
    I1 = np.linspace(3.02, end, 240)
    low, high = admissible(I1)
    I2 = low + np.linspace(0, 1, 120)[:, None] * (high - low)
    plane = np.stack([np.broadcast_to(I1, I2.shape), I2], axis=-1)
    bounds = np.array([*(-x for x in reversed(LEVELS)), *LEVELS])
    norm = BoundaryNorm(bounds, 256, extend="both")
    hull = _hull(results.reference.states.invariants)
    with style.figure(2.1 * len(results.conditions) + 1.0, 2.6 * len(rows) + 0.6) as figure:
        axes = figure.subplots(len(rows), len(results.conditions), squeeze=False, sharex=True, sharey=True)
        for row, noisy in zip(axes, rows, strict=True):
            for ax, condition in zip(row, results.conditions, strict=True):
                model = Model.from_dict(median_fit([*results.fitted(condition, loss, noisy).values()]).model)
                values = energy_error(model, plane)
                image = ax.pcolormesh(*np.moveaxis(plane, -1, 0), values, norm=norm, cmap=style.DIVERGING, rasterized=True)  # fmt: skip
                _contours(ax, plane, np.where(plane[..., 0] <= results.limit, values, np.nan))
                ax.plot(I1, low, I1, high, color="black", linewidth=0.9, linestyle="-")
                ax.plot(*hull.T, color=style.COLOURS["vermilion"], linewidth=1.2, linestyle="--")
                ax.axvline(results.limit, color=style.COLOURS["blue"], linewidth=1.0, linestyle=":")
                ax.set(xlim=(3, end), ylim=(3, float(high[-1])))
                ax.set_title(f"{condition_name(condition)}, {NOISES[noisy]}")
        for ax in axes[-1]:
            ax.set_xlabel("I1 (-)")
        for ax in axes[:, 0]:
            ax.set_ylabel("I2 (-)")
        figure.colorbar(image, ax=list(axes.ravel()), label="energy error (%)", ticks=bounds, shrink=0.9)
    return figure


def _contours(ax: Axes, plane: Array, values: Array) -> None:
    """Lines within the calibrated range, dashed where negative, and the extremes: the sign survives grey print."""
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    inside = sorted(x for level in LEVELS for x in (-level, level) if low < x < high)
    if inside:
        ax.contour(*np.moveaxis(plane, -1, 0), values, levels=inside, colors="0.25", linewidths=0.6)
    ax.text(0.04, 0.96, f"{low:+.1f} to\n{high:+.1f} %", transform=ax.transAxes, va="top", fontsize=8)


def _hull(points: Array) -> Array:
    """Corners (k, 2) of the convex hull, closed."""
    corners = ConvexHull(points).vertices
    return points[np.append(corners, corners[0])]


def predictions(results: ThicknessResults, loss: Loss) -> Figure:
    """Nominal stress in the homogeneous modes above; its deviation from the truth, clean and noisy, below."""
    rows = [n for n in (False, True) if results.fitted(results.conditions[0], loss, n)]
    with style.figure(9.6, 2.6 + 2.1 * len(rows)) as figure:
        axes = figure.subplots(1 + len(rows), 3, squeeze=False, sharex="col", height_ratios=(1.3, *([1] * len(rows))))
        for column, mode in zip(axes.T, MODES, strict=True):
            _stress_panel(column[0], results, loss, mode, rows[-1])
            for ax, noisy in zip(column[1:], rows, strict=True):
                _deviation_panel(ax, results, loss, mode, noisy)
            column[-1].set_xlabel("stretch (-)")
        words = {False: "without noise", True: "with noise"}
        axes[0, 0].set_ylabel(f"{words[rows[-1]]}:\nnominal stress (MPa)")
        for ax, noisy in zip(axes[1:, 0], rows, strict=True):
            ax.set_ylabel(f"{words[noisy]}:\nstress − truth (% of truth)")
        axes[0, 0].legend(fontsize=7.5)
    return figure


def curves_of(results: ThicknessResults, condition: str, loss: Loss, mode: str, noisy: bool) -> list[Curve]:
    """Stress-stretch curves of every seed."""
    return [fit.curves[mode] for fit in results.fitted(condition, loss, noisy).values() if fit.curves]


def _stress_panel(ax: Axes, results: ThicknessResults, loss: Loss, mode: str, noisy: bool) -> None:
    for condition in results.conditions:
        curves = curves_of(results, condition, loss, mode, noisy)
        if curves:
            stress = np.median([np.array(c.stress) for c in curves], axis=0)
            ax.plot(curves[0].stretch, stress, label=condition_name(condition), **results.look(condition))
            reference = curves[0]
    ax.plot(reference.stretch, reference.truth, "o", color="black", ms=2.5, markevery=8, label="truth")
    style.mark_range(ax, 1.0, reference.limit)
    top = 1.4 * max(reference.truth)
    ax.set(title=TITLES[mode], ylim=(-0.03 * top, top))


def _deviation_panel(ax: Axes, results: ThicknessResults, loss: Loss, mode: str, noisy: bool) -> None:
    """Median (line) and full range over seeds (band) of the deviation, %."""
    fits = [[*results.fitted(c, loss, noisy).values()] for c in results.conditions]
    largest = max(100 * float(np.abs(median_biases(some)).max()) for some in fits if some)
    for condition in results.conditions:
        curves = curves_of(results, condition, loss, mode, noisy)
        if not curves:
            continue
        stretch, truth = np.array(curves[0].stretch)[1:], np.array(curves[0].truth)[1:]
        off = 100 * (np.array([c.stress for c in curves])[:, 1:] / truth - 1)
        look = results.look(condition)
        ax.plot(stretch, np.median(off, axis=0), **look)
        if len(curves) > 1:
            ax.fill_between(stretch, off.min(axis=0), off.max(axis=0), color=look["color"], alpha=0.12, linewidth=0)
    ax.axhline(0, color="black", linewidth=0.8, linestyle="-")
    style.mark_range(ax, 1.0, curves[0].limit, None)
    bound = max(3.0, 1.5 * largest)
    ax.set_ylim(-bound, bound)
