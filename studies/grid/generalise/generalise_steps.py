"""The steps of the study, each one a job of the workflow `generalise.smk`.

In: the settings in the folder's ``run.json``. Out, in the same folder: ``forward/TRUTH_SPECIMEN.npz`` (`SurfaceSolution` of a quarter),
``clean/TRUTH_SPECIMEN.npz`` (Experiment without noise), ``states/TRUTH.npz`` (`coverage`), ``cases/TRUTH_SEED_INPUTS.json`` (`calibrated_set`) and ``cases/TRUTH_width.json`` (the same with the width that is seen).

Run as ``python -m studies.grid.generalise.generalise_steps STEP FOLDER [KEYS]``. Files are written whole or not at all.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

from calibrate.data.experiment import Experiment
from calibrate.equations.unseen_strip import window_equilibrium
from calibrate.fitting import joint_calibration
from calibrate.fitting.joint_calibration import WeightedTest, weighted_test
from calibrate.fitting.uncertainty import coefficients_and_slopes
from forward.loading import Loading
from forward.materials import MATERIALS
from forward.sheet import plane_stress
from forward.solution import SurfaceSolution
from meshes import quads
from studies.grid.generalise import calibrated_set, coverage, windows
from studies.grid.generalise.force_prediction import PredictedTest, fine_basis, predicted_test
from studies.grid.generalise.generalise_settings import MEASURED, MIDDLE, GeneraliseSettings
from studies.importers import abbasi_sheets
from studies.output import write_json, write_npz
from studies.synthetic import camera


def forward(folder: Path, settings: GeneraliseSettings, truth: str, specimen: str) -> None:
    """Solve a quarter of a specimen in plane stress; goes on from its checkpoint."""
    shape, path = windows.specimen(specimen), folder / "forward" / f"{truth}_{specimen}.npz"
    path.parent.mkdir(exist_ok=True)
    checkpoint = path.with_suffix(".checkpoint.npz")
    loading = Loading.clamped(shape.loaded, windows.pull(specimen))
    plane = quads(shape, quarter=True, size_factor=settings.forward_size)
    plane_stress.solve(plane, MATERIALS[truth](), loading, settings.increments, checkpoint=checkpoint).save(path)
    checkpoint.unlink(missing_ok=True)


def observe(folder: Path, settings: GeneraliseSettings, truth: str, specimen: str) -> None:
    """What the camera sees of it without noise; or the measured test."""
    path = settings.clean_path(folder, truth, specimen)
    path.parent.mkdir(exist_ok=True)
    if truth == MEASURED:
        abbasi_sheets.sheet(specimen).save(path)
        return
    solution = SurfaceSolution.load(folder / "forward" / f"{truth}_{specimen}.npz").mirrored()
    mesh = windows.camera_mesh(specimen, settings.margin, settings.nodes)
    known = {"specimen": windows.specimen(specimen).to_dict(), "material": MATERIALS[truth]().to_dict(),
             "margin_mm": settings.margin, "solution": solution.description}  # fmt: skip
    windows.observe(solution, mesh, specimen, known).save(path)


def states(folder: Path, settings: GeneraliseSettings, truth: str) -> None:
    """States of every test, where the camera sees them."""
    found = {}
    for specimen in settings.specimens:
        clean = Experiment.load(settings.clean_path(folder, truth, specimen))
        found[specimen] = coverage.states(window_equilibrium(clean, 0.0, settings.spacing), settings.end_I1)
    write_npz(folder / "states" / f"{truth}.npz", **coverage.to_arrays(found))


def recorded(folder: Path, settings: GeneraliseSettings, truth: str, seed: int) -> dict[str, Experiment]:
    """Every test as the camera records it; a measured one as it is. Each specimen has noise of its own."""
    field = camera.GaussianField(settings.correlation_length, resolution=1024)
    device = camera.Camera(field, relative_noise=settings.noise, length_scale=1.0, force_noise=settings.force_noise)
    found = {}
    for k, specimen in enumerate(settings.specimens):
        clean = Experiment.load(settings.clean_path(folder, truth, specimen))
        found[specimen] = clean if truth == MEASURED else camera.record(clean, device, 100 * seed + k)
    return found


def calibrate(folder: Path, settings: GeneraliseSettings, truth: str, inputs: str, *seeds: str) -> None:
    """Every set and every size with one set of invariants; a seed that is done is skipped."""
    for seed in map(int, seeds):
        path = settings.case_path(folder, truth, seed, inputs)
        if not path.exists():
            tests = {}
            for name, test in recorded(folder, settings, truth, seed).items():
                tests[name] = weighted_test(window_equilibrium(test, test.provenance["margin_mm"], settings.spacing))
            found = calibrate_sets(settings, tests, inputs, settings.sizes, seed)
            write_json(path, calibrated_set.to_file(found))


def width(folder: Path, settings: GeneraliseSettings, truth: str) -> None:
    """The middle size on the first seed, with the region of interest taken for the specimen."""
    tests = {}
    for name, experiment in recorded(folder, settings, truth, settings.seeds[0]).items():
        tests[name] = weighted_test(window_equilibrium(windows.as_if_whole(experiment), 0.0, settings.spacing))
    found = [
        one
        for inputs in settings.inputs
        for one in calibrate_sets(settings, tests, inputs, (MIDDLE,), settings.seeds[0])
    ]
    write_json(settings.width_path(folder, truth), calibrated_set.to_file(found))


def calibrate_sets(
    settings: GeneraliseSettings,
    tests: dict[str, WeightedTest],
    inputs: str,
    sizes: tuple[tuple[int, ...], ...],
    seed: int,
) -> list[calibrated_set.CalibratedSet]:
    """Every set of tests and every size, with r2_F on all tests."""
    basis = fine_basis(inputs, [test.system for test in tests.values()])
    forces: dict[str, PredictedTest] = {name: predicted_test(test.system, basis) for name, test in tests.items()}
    found = []
    for joined in settings.sets:
        reduced = joint_calibration.reduce([tests[name] for name in joined.split("+")], inputs)
        for layers in sizes:
            begin = time.perf_counter()
            fit = joint_calibration.fit(reduced, layers, settings.starts, seed)
            seconds = time.perf_counter() - begin
            c = coefficients_and_slopes(fit.architecture, basis, fit.parameters[fit.best])[0]
            scores = {name: force.score(c) for name, force in forces.items()}
            found.append(calibrated_set.calibrated_set(joined, inputs, fit, scores, settings.end_I1, seconds))
    return found


STEPS: dict[str, Callable[..., None]] = {
    "forward": forward, "observe": observe, "states": states, "calibrate": calibrate, "width": width,
}  # fmt: skip


def main(words: list[str]) -> None:
    """Run one step: its name, the folder, and keys."""
    if len(words) < 2 or words[0] not in STEPS:
        print(
            f"usage: python -m studies.grid.generalise.generalise_steps {'|'.join(STEPS)} FOLDER [KEY ...]",
            file=sys.stderr,
        )
        raise SystemExit(2)
    step, folder = words[0], Path(words[1])
    STEPS[step](folder, GeneraliseSettings.read(folder), *words[2:])


if __name__ == "__main__":
    main(sys.argv[1:])
