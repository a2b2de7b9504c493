"""Pull test: does a stated standard deviation of predicted stress agree with the scatter over noise seeds?

In: a clean Experiment with the truth it was made with, a camera, options of the calibration. Out: `Pulls`: for every
seed and stretch the predicted stress and its standard deviation, beside two references:

- `reference`, the calibration of the clean data with the same weights: what is left is noise alone;
- `truth`, the material: errors of the measured triangles, of the network's form and of its prior are added.

A pull is (stress - reference) / standard deviation; over seeds its standard deviation should be 1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.equations.deformation_modes import MODES, Derivatives, largest_stretch, nominal_stress
from calibrate.fitting.calibration import Options, calibrate
from calibrate.models.network_model import Model
from calibrate.models.parameter_covariance import Z95
from studies.accuracy.metrics import ArrudaBoyceTruth
from studies.synthetic import camera

Array = NDArray[np.float64]
SHARES = (0.2, 0.4, 0.6, 0.8, 1.0)  # of the calibrated range of stretch - 1
PLATE_CAMERA = camera.Camera(camera.GaussianField(4.0, 512), relative_noise=5e-4, length_scale=60.0)


@dataclass(frozen=True)
class Pulls:
    """stretch (3, k) of `MODES`; stress, deviation (n_seeds, 3, k); reference, truth (3, k), MPa.

    chi_square (n_seeds,): reduced, with the effective number of parameters.
    """

    stretch: Array
    stress: Array
    deviation: Array
    reference: Array
    truth: Array
    chi_square: Array

    def pulls(self, true: bool = False) -> Array:
        """(n_seeds, 3, k), from the reference or from the truth."""
        return (self.stress - (self.truth if true else self.reference)) / self.deviation

    def spread(self, true: bool = False) -> Array:
        """Standard deviation (3, k) of the pulls over seeds."""
        return self.pulls(true).std(axis=0, ddof=1)

    def coverage(self, true: bool = False) -> Array:
        """Share of the seeds (3, k) whose 95 % band holds the reference, or the truth."""
        return (np.abs(self.pulls(true)) <= Z95).mean(axis=0)

    def table(self) -> tuple[list[str], list[list[Any]]]:
        """Columns and rows, one a stretch. scatter_%, stated_% (mean over seeds), bias: in % of the true stress."""
        size, mean = 100 / self.truth, self.stress.mean(axis=0)
        parts = {
            "scatter_%": self.stress.std(axis=0, ddof=1) * size,
            "stated_%": self.deviation.mean(axis=0) * size,
            "bias_clean_%": (mean - self.reference) * size,
            "bias_true_%": (mean - self.truth) * size,
        }
        for name, true in (("clean", False), ("true", True)):
            parts[f"pull_std_{name}"] = self.spread(true)
            parts[f"pull_median_{name}"] = np.median(self.pulls(true), axis=0)
            parts[f"in_band_{name}"] = self.coverage(true)
        rows = [
            [mode, float(self.stretch[m, k]), *(float(part[m, k]) for part in parts.values())]
            for m, mode in enumerate(MODES)
            for k in range(self.stretch.shape[1])
        ]
        return ["mode", "stretch", *parts], rows


def clean_plate(n_nodes: int = 1000, n_increments: int = 4, pull: float = 30.0) -> Experiment:
    """Plate with a hole in Arruda-Boyce rubber, pulled by `pull` mm at each side; biquadratic quads, seen clean."""
    from forward.loading import Loading
    from forward.materials import ArrudaBoyce
    from forward.sheet.plane_stress import solve
    from meshes import PlateWithHole, quads, triangles

    plate = PlateWithHole()
    loading = Loading.clamped(plate.loaded, pull)
    solution = solve(quads(plate, quarter=True), ArrudaBoyce(), loading, n_increments=n_increments)
    return camera.observe(solution.mirrored(), triangles(plate, n_nodes=n_nodes), name="plate with a hole")


def clean_cross(n_nodes: int = 1150, n_increments: int = 5) -> Experiment:
    """The perforated cross in Arruda-Boyce rubber, seen clean."""
    from forward.sheet.plane_stress import default_experiment
    from meshes import Cross, triangles

    solution = default_experiment(n_increments=n_increments)
    return camera.observe(solution, triangles(Cross(), n_nodes=n_nodes), name="perforated cross")


def pull_test(
    clean: Experiment,
    device: camera.Camera,
    options: Options,
    seeds: Sequence[int],
    truth: Derivatives = ArrudaBoyceTruth(),
    progress: Callable[[int, int], None] | None = None,
) -> Pulls:
    """Calibrate the clean data and `seeds` noisy recordings of them; compare scatter with stated deviation."""
    reference = calibrate(replace(clean, noise=device.noise()), options).model
    limits = [largest_stretch(mode, reference.calibrated_range["I1"][1]) for mode in MODES]
    stretch = 1 + np.multiply.outer(np.array(limits) - 1, SHARES)
    found = []
    for i, seed in enumerate(seeds):
        found.append(_predicted(calibrate(camera.record(clean, device, seed), options).model, stretch))
        if progress:
            progress(i + 1, len(seeds))
    stress, deviation = (np.array(part) for part in zip(*(row[:2] for row in found), strict=True))
    return Pulls(
        stretch,
        stress,
        deviation,
        _predicted(reference, stretch)[0],
        np.array([nominal_stress(truth, mode, x) for mode, x in zip(MODES, stretch, strict=True)]),
        np.array([row[2] for row in found]),
    )


def _predicted(model: Model, stretch: Array) -> tuple[Array, Array, float]:
    """Stress and its deviation (3, k) at stretches (3, k) of the three modes; reduced chi-square."""
    assert model.uncertainty is not None
    pairs = list(zip(MODES, stretch, strict=True))
    stress = np.array([model.homogeneous(mode, x) for mode, x in pairs])
    deviation = np.array([model.homogeneous_deviation(mode, x) for mode, x in pairs])
    return stress, deviation, model.uncertainty.reduced_chi_square
