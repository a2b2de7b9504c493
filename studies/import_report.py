"""What `equigap import` says and shows about the Experiment it made.

In: an Experiment and the Series it came from. Out: numbers for a manifest, a summary in words, a picture.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from calibrate.experiment import Experiment
from studies.output import write_figure
from studies.series import Series


def summary(experiment: Experiment) -> dict[str, Any]:
    """Numbers of an Experiment for a manifest."""
    assert experiment.noise is not None
    return {
        "points": len(experiment.points),
        "triangles": len(experiment.triangles),
        "increments": experiment.n_increments,
        "size_mm": np.ptp(experiment.points, axis=0).tolist(),
        "largest_force_N": {b.name: float(np.nanmax(np.abs(b.force))) for b in experiment.loaded},
        "largest_displacement_mm": float(np.abs(experiment.displacements).max()),
        "stress_unit": experiment.stress_unit,
        "noise": asdict(experiment.noise),
        "provenance": experiment.provenance,
    }


def report(experiment: Experiment, target: Path) -> None:
    """Print what was imported."""
    size, noise = np.ptp(experiment.points, axis=0), experiment.noise
    assert noise is not None
    print(
        f"{experiment.name}: {len(experiment.points)} points, {size[0]:.1f} x {size[1]:.1f} mm, "
        f"{experiment.n_increments} increments"
    )
    for b in experiment.loaded:
        print(f"  {b.name}: {len(b.nodes)} nodes, force up to {np.nanmax(np.abs(b.force)):.3g} N")
    print(
        f"  noise: {1e3 * noise.displacement_std:.2g} um over {noise.correlation_length:.2g} mm, "
        f"force {noise.force_std:.2g} N ({experiment.provenance['noise']['kind']})"
    )
    if experiment.thickness is None:
        print("  thickness unknown: stiffness times thickness (N/mm) can be identified")
    for note in experiment.provenance["notes"]:
        print(f"  note: {note}")
    print(f"wrote {target}")


def picture(experiment: Experiment, series: Series, path: Path) -> None:
    """Deformed mesh of the last increment over the reference, and the force record with the chosen frames."""
    from matplotlib.figure import Figure  # slow to import, and only needed here

    figure = Figure(figsize=(9.5, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    moved = experiment.points + experiment.displacements[-1]
    size = np.linalg.norm(experiment.displacements[-1], axis=1)
    left.triplot(*experiment.points.T, experiment.triangles, color="0.8", linewidth=0.3)
    mapped = left.tripcolor(*moved.T, experiment.triangles, size, shading="gouraud", cmap="viridis")
    for b in experiment.loaded:
        left.plot(*moved[b.nodes].T, ".", markersize=2, color="tab:red")
    left.plot(*moved[experiment.free_nodes].T, ".", markersize=2, color="tab:blue")
    figure.colorbar(mapped, ax=left, label="displacement (mm)")
    left.set(aspect="equal", xlabel="x (mm)", ylabel="y (mm)", title="last increment; red: loaded, blue: free")
    right.plot(series.record.time, series.record.force, color="0.6", label="load cell")
    if experiment.time is not None:
        for b in experiment.loaded:
            known = np.isfinite(b.force).all(axis=0)
            for k in np.flatnonzero(known):
                right.plot(experiment.time, np.abs(b.force[:, k]), ".", label=f"{b.name}, {'xy'[k]}")
    right.set(xlabel="time (s)", ylabel="force (N)", title=experiment.name)
    right.legend()
    write_figure(path, figure, dpi=150)
