"""What an import should say of its data before anyone calibrates: sentences for a provenance, each with what can be done."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.fitting.calibrated_range import WEAK_SIGNAL
from calibrate.models.fitness import SOFT
from studies.importers.exports.field_guesses import mean_strains
from studies.importers.masking.masks import Masked
from studies.importers.masking.single_readings import Bridged
from studies.importers.recording.load_cell_noise import Origin
from studies.importers.recording.synchronise import ForceRecord
from studies.output.words import Words

WORDS = Words("experiment")
Array = NDArray[np.float64]
LISTED = 30  # places or readings that a note names
FILTERED = 10.0  # total over temporal noise, from which the latter says nothing of the errors of a frame
AUXETIC = 0.1  # of the strain along the pull: strain across of the same sign, from which no soft material has it
CLOCK = 3.0  # times the noise of the load cell
PRELOAD = 0.03  # of the largest force: what a load cell that was not zeroed hardly reads
OPPOSED = 0.05  # of their ranges: steps of elongation and force in opposite directions
YOUNG = 3.0  # modulus of a strip over the shear modulus
LARGEST = 1500.0  # mm, of what fits into a test stand


def bridged_notes(whole: Bridged, of_grips: int) -> list[str]:
    """Of readings that were replaced; of_grips: of points of grips that failed beside these."""
    found = whole.to_dict()
    notes = [WORDS.note_bridged(**found, of=whole.replaced.size)] if found["readings"] else []
    return notes + ([WORDS.note_grip_points(count=of_grips)] if of_grips else [])


def mask_notes(points: Array, mask: Masked, alone: Array) -> list[str]:
    """Of points (n, 2) mm that were left out; alone (k, 2): those without a triangle."""
    notes = []
    if mask.named.any():
        notes.append(WORDS.note_masked(count=int(mask.named.sum()), of=len(points)))
    if mask.spurious.any():
        count = int(mask.spurious.sum())
        notes.append(
            WORDS.note_spurious(count=count, of=len(points), places=places(points[mask.spurious]), removed=mask.removed)
        )
    if len(alone):
        notes.append(WORDS.note_alone(count=len(alone), places=places(alone)))
    return notes


def repeated_frame_notes(displacements: Array, frames: NDArray[np.int64]) -> list[str]:
    """Of chosen frames (t,) whose displacements (n_frames, n, 2) are those of the one before to the last digit, as no two pictures are."""
    pairs = [(int(a), int(b)) for a, b in pairwise(frames)
             if displacements[b].any() and np.array_equal(displacements[a], displacements[b], equal_nan=True)]  # fmt: skip
    return [WORDS.note_repeated_frames(pairs=pairs)] if pairs else []


def edge_notes(loaded: Sequence[str], free: Sequence[str], rim: bool) -> list[str]:
    """Whether the section carries the force: asked where a side along the pull is neither loaded nor free."""
    if rim:
        return [WORDS.note_rim()]
    sides = ("left", "right") if set(loaded) & {"bottom", "top"} else ("bottom", "top")
    open_sides = [side for side in sides if side not in (*free, *loaded)]
    return [WORDS.note_open_sides(sides=open_sides)] if open_sides else []


def record_notes(record: ForceRecord) -> list[str]:
    """Of readings without a force."""
    if not record.blank:
        return []
    readings = numbers(record.blank)
    return [WORDS.note_blank_forces(readings=readings, source=record.source, per_frame=record.per_frame)]


def preload_notes(tare: float, force: Array) -> list[str]:
    """Where the force at the reference picture, N, which is taken as zero, is more than an offset of a load cell beside the forces (t,), N, that are left."""
    largest = float(np.nanmax(np.abs(force), initial=0.0))
    if not abs(tare) > PRELOAD * (largest + abs(tare)):
        return []
    return [WORDS.note_preload(force=tare, share=abs(tare) / (largest + abs(tare)))]


def noise_notes(report: dict[str, Any]) -> list[str]:
    """Where the noise of the force is no more than a bound, or is that of the clocks, or temporal noise was chosen and is far smaller than what a frame shows."""
    notes = []
    match report["force"]:
        case Origin.MAY_HOLD_CURVATURE:
            notes += [
                WORDS.note_force_noise_bound(
                    std=report["load_cell_std_N"],
                    most=report["load_cell_std_at_most_N"],
                    readings=report["load_cell_readings"],
                )
            ]
        case Origin.UNKNOWN:
            notes += [WORDS.note_force_noise_unknown(readings=report["load_cell_readings"])]
    clock = report.get("synchronisation_std_s", 0.0) * report.get("force_rate_N_per_s", 0.0)
    if clock > CLOCK * report.get("load_cell_std_N", np.inf):
        std, cell = report["synchronisation_std_s"], report["load_cell_std_N"]
        notes.append(WORDS.note_synchronisation(std=std, force=clock, cell=cell))
    temporal, total = report.get("temporal"), report.get("total")
    chosen = report["displacement"] == "temporal"
    if chosen and temporal and total and total["std"] > FILTERED * temporal["std"]:
        notes.append(WORDS.note_filtered(temporal=temporal["std"], total=total["std"]))
    return notes


def strain_notes(experiment: Experiment) -> list[str]:
    """Of a strain near its noise, a stiffness above or below that of soft materials, a specimen as large as one in pixels, and what a wrong sign or order of pictures looks
    like."""
    signal, notes = experiment.strain_signal, []
    if signal.ratio < WEAK_SIGNAL:
        notes.append(WORDS.note_weak_strain(signal=signal))
    modulus = apparent_modulus(experiment)
    least, most = SOFT[experiment.stress_unit]
    if modulus > most or 0 < modulus < YOUNG * least:
        notes.append(WORDS.note_not_soft(modulus=modulus, unit=experiment.stress_unit, more=modulus > most))
    extent = float(np.ptp(experiment.points, axis=0).max())
    if extent > LARGEST:
        notes.append(WORDS.note_large(extent=extent))
    return notes + pull_notes(experiment)


def pull_notes(experiment: Experiment) -> list[str]:
    """Of a sheet that is pulled along one axis: whether it widens, and whether its length and its force go in opposite directions."""
    if experiment.is_biaxial:
        return []
    along, across = int(np.argmax(experiment.largest_forces)), int(np.argmin(experiment.largest_forces))
    strains = _mean_strains(experiment)
    most, notes = int(np.argmax(np.abs(strains[:, along]))), []
    if strains[most, across] / strains[most, along] > AUXETIC:
        notes.append(WORDS.note_auxetic(pull="xy"[along], along=strains[most, along], across=strains[most, across]))
    if opposed := against_the_force(experiment):
        notes.append(WORDS.note_opposed(increments=numbers(opposed)))
    return notes


def against_the_force(experiment: Experiment) -> list[int]:
    """Increments, from 1, to which the elongation goes one way and the force the other, each by more than `OPPOSED` of its range; none of a test that is pulled along two axes."""
    if experiment.is_biaxial:
        return []
    along = int(np.argmax(experiment.largest_forces))
    forces = max((b.force for b in experiment.loaded), key=lambda force: np.nanmax(np.abs(force), initial=0.0))
    known = np.flatnonzero(np.isfinite(forces[:, along]))
    if len(known) < 2:
        return []
    force = forces[known, along] * np.sign(forces[known, along][np.argmax(np.abs(forces[known, along]))])
    pairs = _mean_strains(experiment)[known, along], force
    steps = [np.diff(one) / max(float(np.ptp(one)), 1e-300) for one in pairs]
    opposed = (steps[0] * steps[1] < 0) & (np.minimum(*np.abs(steps)) > OPPOSED)
    return [int(k) + 1 for k in known[1:][opposed]]


def _mean_strains(experiment: Experiment) -> NDArray[np.float64]:
    """(t, 2)."""
    return np.array([mean_strains(experiment.points, u)[0] for u in experiment.displacements])


def apparent_modulus(experiment: Experiment) -> float:
    """Largest force over width, thickness and strain, MPa or N/mm: of a plain strip, to tell N from kN."""
    force = max(float(np.nanmax(np.abs(b.force), initial=0.0)) for b in experiment.loaded)
    width = max(float(np.ptp(experiment.points[b.nodes], axis=0).max()) for b in experiment.loaded)
    strain = experiment.strain_signal.strain
    return force / (width * (experiment.thickness or 1.0) * strain) if strain > 0 and width > 0 else 0.0


def numbers(found: Sequence[int]) -> str:
    """'3, 17, 18'."""
    text = ", ".join(map(str, found[:LISTED]))
    return text if len(found) <= LISTED else f"{text}, ... ({len(found)} in all)"


def places(points: Array) -> str:
    """'(1.2, 3.4), (5.6, 7.8) mm'."""
    text = ", ".join(f"({x:.4g}, {y:.4g})" for x, y in points[:LISTED])
    return f"{text} mm" if len(points) <= LISTED else f"{text}, ... ({len(points)} in all) mm"
