"""Figures of a calibration: a `Review` in, matplotlib figures out. No screen is needed."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from calibrate.equations.basis import hencky_to_lode
from calibrate.equations.deformation_modes import MODES
from calibrate.equations.kinematics import invariants_and_derivatives
from calibrate.models.parameter_covariance import Z95
from studies.output import style
from studies.reports.calibration.fit_review import Review, initial_shear_modulus
from studies.reports.force_record import COMPONENTS
from studies.reports.prediction.predicted_curves import calibrated_stretch

Array = NDArray[np.float64]
COLOURS = {"x": style.COLOURS["blue"], "y": style.COLOURS["vermilion"]}
HELD_OUT = "#fbeed5"
NOISE_LIMIT = 4.0


def forces(view: Review) -> Figure:
    """Predicted and measured force of every loaded boundary over time or increment, residuals below."""
    names = [name for name, f in view.measured.items() if np.isfinite(f).any()]
    with style.figure(max(4.6, 2.9 * len(names)), 4.8) as figure:
        axes = figure.subplots(2, len(names), squeeze=False, sharex=True, sharey="row", height_ratios=(2, 1.2))
        x, label = style.over(view.experiment.time, view.experiment.n_increments)
        for column, name in zip(axes.T, names, strict=True):
            _force_column(view, name, x, *column)
            column[1].set_xlabel(label)
        _clip(axes, max(float(np.nanmax(np.abs(view.measured[name]))) for name in names))
        axes[0, 0].set_ylabel("force of the grip on the specimen, N")
        axes[1, 0].set_ylabel("predicted - measured, N")
        axes[0, 0].legend(fontsize=8)
        if view.deviations is not None:
            axes[1, 0].legend(fontsize=7, ncols=2)
    return figure


def _clip(axes: NDArray, largest: float) -> None:
    """Keep measured forces up to `largest`, N, readable where a prediction runs away."""
    for ax, limit in ((axes[0, 0], 1.5 * largest), (axes[1, 0], largest)):
        low, high = ax.get_ylim()
        ax.set_ylim(max(low, -limit), min(high, limit))


def _force_column(view: Review, name: str, x: Array, top: Axes, bottom: Axes) -> None:
    top.set_title(f"{name} edge")
    for k, component in enumerate(COMPONENTS):
        measured, predicted = view.measured[name][:, k], view.forces[name][:, k]
        if not np.isfinite(measured).any():
            continue
        colour = COLOURS[component]
        top.plot(x, measured, "o", color=colour, mfc="none", ms=4.5, label=f"measured, {component}")
        top.plot(x, predicted, "-", color=colour, lw=1.2, label=f"predicted, {component}")
        bottom.plot(x, predicted - measured, ".-", color=colour, lw=0.8)
        deviation = view.force_deviation(name, k)
        if deviation is not None:
            label = f"noise, 2 std, {component}"
            bottom.fill_between(x, -2 * deviation, 2 * deviation, color=colour, alpha=0.15, lw=0, label=label)
    bottom.axhline(0, color="0.4", lw=0.6)
    for axes in (top, bottom):
        half = 0.5 * float(np.median(np.diff(x))) if x.size > 1 else 0.5
        for position in x[~view.fitted]:
            axes.axvspan(position - half, position + half, color=HELD_OUT, lw=0, zorder=0)


def residual_map(view: Review) -> Figure:
    """Unexplained force at three increments and over all, in N with arrows, and in units of the noise."""
    n, fields = view.experiment.n_increments, view.system.fields
    chosen = sorted({max(0, round(n * share) - 1) for share in (1 / 3, 2 / 3, 1)})
    vectors = np.nan_to_num(view.residuals).reshape(n, 2, fields.n_fields)
    titles = [f"increment {i + 1}" for i in chosen]
    rows = [_magnitudes(vectors, chosen)]
    if view.deviations is not None:
        rows.append(_magnitudes(vectors / view.deviations.reshape(vectors.shape), chosen) / np.sqrt(2))
    arrows = list(vectors[chosen])
    if n > 1:
        titles, arrows = [*titles, "root mean square of all"], [*arrows, vectors.mean(axis=0)]
    else:
        rows = [row[:-1] for row in rows]
    width, height = np.ptp(view.experiment.points, axis=0)
    panel = 2.6 * min(1.5, max(0.4, height / width))
    with style.figure(2.6 * len(titles) + 0.9, len(rows) * (panel + 0.25) + 0.5) as figure:
        axes = figure.subplots(len(rows), len(titles), squeeze=False, sharex=True, sharey=True)
        _map_row(figure, axes[0], view, rows[0], "unexplained force, N")
        for ax, title, arrow in zip(axes[0], titles, arrows, strict=True):
            _arrows(ax, view, arrow)
            ax.set_title(title)
        if len(rows) > 1:
            _map_row(figure, axes[1], view, rows[1], "in std of the noise", top=NOISE_LIMIT)
        for ax in axes[-1]:
            ax.set_xlabel("x, mm")
        largest = max(float(np.nanmax(np.abs(f), initial=0.0)) for f in view.measured.values())
        figure.suptitle(
            f"Imbalance of each virtual field ({fields.spacing:.3g} mm wide); largest measured force {largest:.3g} N",
            fontsize=9,
        )
    return figure


def _magnitudes(vectors: Array, chosen: list[int]) -> Array:
    """Lengths (len(chosen) + 1, n_fields) of vectors (n_increments, 2, n_fields); the last is the rms of all."""
    lengths = np.linalg.norm(vectors, axis=1)
    return np.vstack([lengths[chosen], np.sqrt(np.mean(lengths**2, axis=0))])


def _map_row(figure: Figure, axes: NDArray, view: Review, size: Array, label: str, top: float | None = None) -> None:
    """Colour maps of sizes (n_panels, n_fields), averaged over the virtual fields that reach a node."""
    values = view.system.fields.values
    share = np.maximum(np.asarray(values.sum(axis=1)).ravel(), 1e-12)
    nodal = (values @ size.T).T / share
    limit = max(float(nodal.max()), 1e-300) if top is None else top
    points = view.experiment.points
    mesh = Triangulation(points[:, 0], points[:, 1], view.experiment.triangles)
    for ax, field in zip(axes, nodal, strict=True):
        image = ax.tripcolor(mesh, field, shading="gouraud", cmap="magma_r", vmin=0, vmax=limit, rasterized=True)
        ax.set(aspect="equal")
        ax.grid(False)
        ax.tick_params(labelsize=7)
    axes[0].set_ylabel("y, mm")
    figure.colorbar(image, ax=list(axes), label=label, shrink=0.9, extend="neither" if top is None else "max")


def _arrows(ax: Axes, view: Review, vectors: Array) -> None:
    values = view.system.fields.values
    mass = np.asarray(values.sum(axis=0)).ravel()
    centres = (values.T @ view.experiment.points) / mass[:, None]
    longest = max(float(np.linalg.norm(vectors, axis=0).max()), 1e-300)
    scale = longest / (1.2 * view.system.fields.spacing)
    ax.quiver(*centres.T, *vectors, angles="xy", scale_units="xy", scale=scale, width=0.005, color="0.25")


def starts(view: Review) -> Figure:
    """Loss of every start, sorted."""
    losses = np.sort(view.calibration.losses[np.isfinite(view.calibration.losses)])
    with style.figure(4.6, 3.0) as figure:
        ax = figure.subplots()
        ax.axhspan(losses[0], losses[0] + view.same_loss, color="0.85", lw=0, label="as low as the best")
        ax.plot(np.arange(1, losses.size + 1), losses, "o", ms=5)
        if view.expected_loss is not None:
            ax.axhline(view.expected_loss, color="0.4", ls="--", lw=0.9, label="expected from the noise alone")
        spread = losses[-1] > 3 * losses[0] > 0
        ax.set(xlabel="start, sorted", ylabel="loss", yscale="log" if spread else "linear")
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
        ax.legend(fontsize=8)
    return figure


def curves(view: Review) -> Figure:
    """Nominal stress and reduced stress in the three homogeneous modes; the calibrated range is shaded."""
    model, modulus = view.model, initial_shear_modulus(view.model)
    with style.figure(9.6, 5.4) as figure:
        axes = figure.subplots(2, 3, sharex="col", sharey="row", height_ratios=(1.6, 1))
        bounds, highest = [modulus], 0.0
        for column, mode in zip(axes.T, MODES, strict=True):
            stress, reduced = _curve_column(view, mode, modulus, *column)
            bounds += [float(reduced.min()), float(reduced.max())]
            highest = max(highest, float(stress[-1]))
        low, high = min(bounds), max(bounds)
        margin = max(0.1 * (high - low), 0.05 * high)
        axes[1, 0].set(ylabel=f"reduced stress, {model.unit}", ylim=(max(0.0, low - margin), high + margin))
        axes[0, 0].set(ylabel=f"nominal stress, {model.unit}", ylim=(0.0, 1.5 * highest))
        axes[0, 0].legend(fontsize=8)
    return figure


def _curve_column(view: Review, mode: str, modulus: float, top: Axes, bottom: Axes) -> tuple[Array, Array]:
    """Draw one mode; returns stress and reduced stress (k,) within the calibrated range of I1."""
    model, colour, exponent = view.model, style.MODES[mode]["color"], MODES[mode].neo_hooke_exponent
    furthest = max(model.largest_stretch(mode), 1.001)
    limit, end = min(calibrated_stretch(model, mode), furthest), 1 + 1.25 * (furthest - 1)
    stretch = np.linspace(1.0, end, 501)[1:]
    stress = model.homogeneous(mode, stretch)
    reduced = stress / (stretch - stretch**exponent)
    inside, shown = stretch <= limit, stretch <= furthest
    deviation = model.homogeneous_deviation(mode, stretch)
    if deviation is not None:
        for ax, scale in ((top, 1.0), (bottom, 1 / (stretch - stretch**exponent))):
            low, high = ((stress + sign * Z95 * deviation) * scale for sign in (-1, 1))
            ax.fill_between(stretch, low, high, color=colour, alpha=0.25, lw=0, label="95 % band")
    for part, line, label in ((inside, "-", "model"), (~inside, "--", "extrapolated")):
        top.plot(stretch[part], stress[part], line, color=colour, label=label)
        bottom.plot(stretch[part], reduced[part], line, color=colour)
    neo_hooke = modulus * (stretch - stretch**exponent)
    top.plot(stretch, neo_hooke, ":", color="0.4", lw=1, label="neo-Hooke, same initial modulus")
    bottom.axhline(modulus, color="0.4", ls=":", lw=1)
    for ax in (top, bottom):
        style.mark_range(ax, 1.0, limit)
    top.set(title=f"{MODES[mode].title}, calibrated to a stretch of {limit:.2f}", xlim=(1.0, end))
    bottom.set_xlabel("stretch")
    return stress[shown], reduced[shown]


def coverage(view: Review) -> Figure:
    """What the data have seen: distribution of I1, and kind of deformation (Lode angle) against its size."""
    F = view.system.isochoric_gradients
    I1 = np.asarray(invariants_and_derivatives(F)[0])[..., 0].ravel()
    weights = np.broadcast_to(view.system.areas, F.shape[:2]).ravel()
    weights = 100 * weights / weights.sum()
    with style.figure(9.6, 3.6) as figure:
        left, right = figure.subplots(1, 2)
        top = max(float(I1.max()), 3 + 1e-6)
        left.hist(I1, bins=np.linspace(3, top, 60), weights=weights, color=style.COLOURS["blue"], log=True)
        style.mark_range(left, 3.0, view.model.calibrated_range["I1"][1])
        left.set(xlabel="first invariant I1", ylabel="share of area and increments, %", xlim=(3, top))
        left.legend(fontsize=8)
        norm, angle = hencky_to_lode(F.reshape(-1, 2, 2))
        cells = [np.linspace(0, float(norm.max()) + 1e-9, 81), np.linspace(-30, 30, 61)]
        density, *_ = np.histogram2d(norm, np.degrees(angle), bins=cells, weights=weights)
        density[density == 0] = np.nan
        image = right.pcolormesh(*cells, np.log10(density.T), cmap=style.SEQUENTIAL, rasterized=True)
        right.set(xlabel="size of the deformation: norm of the Hencky strain")
        right.set_yticks([-30, 0, 30], ["uniaxial", "pure shear", "equi-biaxial"])
        figure.colorbar(image, ax=right, label="log10 of the share, %")
    return figure


# by name of the file; the caption of NAME is the macro figure_NAME of templates/calibration.txt
FIGURES = {
    "forces": forces,
    "residual_map": residual_map,
    "curves": curves,
    "coverage": coverage,
    "starts": starts,
}
