"""What the thickness study says, in sentences around numbers that are computed here.

In: `Results`. Out: paragraphs and the table that stands beside the paper's claims. What "little", "clearly" and
"severe" mean is ours, and is said with each judgement.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from studies.grid.cases import EXTRAPOLATION
from studies.grid.resolution_report import LABELS as NAMES
from studies.grid.thickness_case import CORRECTED, LOSSES
from studies.grid.thickness_results import PLANE, Line, Results
from studies.grid.thickness_tables import (
    BIAS_LIMIT,
    LARGEST_LIMIT,
    NEAR_RIM,
    NOISES,
    STRESS_LIMIT,
    Verdict,
    field_row,
    force_rows,
    trusted,
    verdicts,
)

LABELS = {**NAMES, CORRECTED: "default loss, thickness-corrected"}
CLEARLY = 1.5  # a stress error is clearly larger when it is this many times as large
SEVERE = 0.1  # a deformation error is severe where epsilon reaches this
MEANINGLESS = 5.0  # %, bias of the 2D reference from which on a loss tells nothing about thickness
NEAR_HOLE = 5.0  # mm, in which the largest epsilon of a line is looked for
CLAIM_COLUMNS = ("the paper", "loss", "data", "what we compare", "here", "agreement")
NOT_STUDIED = ("not studied in this run", "–")
UNTESTED = (
    "Not tested here: the specimen, which is ours apart from its length, the short semi-axis of its holes and the pull "
    "(docs/specimens.md), and holes of another shape or place meet other gradients; the grips, which let the thickness "
    "free here; and the noise, which is ours (unit variance, squared exponential), as the paper leaves its "
    "normalisation open."
)
DEFINITION = (
    f"Trustworthy is our word, and our definition: inside the calibrated range the median bias over seeds is at most "
    f"{BIAS_LIMIT:g} % in each homogeneous mode, and the 5th and the 95th percentile of the signed stress error of each "
    f"component (by area and increment, median over seeds) lie within ±{STRESS_LIMIT:g} %, and the largest error on the "
    f"stress-stretch curves is at most {LARGEST_LIMIT:g} % of the largest stress (median over seeds). The bias is a mean over "
    "a curve, in which errors of both signs cancel; for a network of one invariant it is one number for all three modes."
)
CONDITION = (
    "All of this is for grips that leave the thickness free, as plane stress does. Real clamps hold it: then ε is largest "
    "at the grips, the forces are higher (1 % at 10 mm, docs/thickness.md), and that goes straight into the stiffness."
)


def answer(results: Results) -> list[str]:
    """Up to which thickness each loss can be trusted, with and without noise, the default loss first."""
    text = [DEFINITION]
    for loss in LOSSES:
        for noisy in (True, False):
            judged = verdicts(results, loss, noisy)
            if judged:
                n = len(results.fits(judged[0].condition, loss, noisy))
                noise = f"with noise ({n} seed{'s' * (n > 1)})" if noisy else "without noise"
                text.append(f"{title(loss)}, {noise}: {_reach(results, judged)}")
    return [*text, *extended(results), beyond(results), first(results), CONDITION]


def extended(results: Results) -> list[str]:
    """What the correction for the thickness changes, noisy and clean; nothing where it was not fitted."""
    text = []
    for noisy, noise in NOISES.items():
        pairs = zip(verdicts(results, LOSSES[0], noisy), verdicts(results, CORRECTED, noisy), strict=False)
        parts = [f"{results.name(a.condition)}: {_change(a.bias, b.bias)} % bias, {_change(a.largest, b.largest)} % largest "
                 f"error, {_change(a.stress, b.stress)} % stress error"
                 for a, b in pairs if a.condition != PLANE]  # fmt: skip
        if parts:
            text.append(f"Displacements of the mean over the thickness, from those of the surface by the leading-order correction "
                        f"(docs/thickness.md), {noise}: {'; '.join(parts)}.")  # fmt: skip
    return text


def _change(before: float, after: float) -> str:
    return f"{before:+.2f} to {after:+.2f}"


def beyond(results: Results) -> str:
    """Bias of the default loss outside the calibrated range, which no definition of ours covers."""
    parts = []
    for noisy, noise in NOISES.items():
        found = {c: results.fits(c, LOSSES[0], noisy) for c in results.conditions}
        worst = {c: max(np.median([[s["bias"] for s in fit["outside"]] for fit in fits], axis=0), key=abs)
                 for c, fits in found.items() if fits}  # fmt: skip
        if worst:
            parts.append(f"{noise}: " + ", ".join(f"{results.name(c)} {100 * b:+.1f} %" for c, b in worst.items()))
    return (f"None of this holds outside the calibrated range. Up to where I1 − 3 is {EXTRAPOLATION:g} times as large, the median "
            f"bias of the default loss is, worst mode, {'; '.join(parts)}.")  # fmt: skip


def first(results: Results) -> str:
    """Where the deformation of the thinnest specimen differs most."""
    name, field = next(iter(results.fields.items()))
    _, _, _, p95, _, top, at, rim, *_ = field_row(name, field)
    where = "at the holes" if rim <= NEAR_RIM else "away from the holes"
    return (f"The deformation goes wrong first {where}: at {name} mm ε is largest at {at} mm, {rim:.1f} mm from a rim, with "
            f"{top:.3f}, while its 95th percentile is {p95:.3f}.")  # fmt: skip


def title(loss: str) -> str:
    """Name of a loss at the beginning of a sentence."""
    return LABELS[loss][0].upper() + LABELS[loss][1:]


def _reach(results: Results, judged: list[Verdict]) -> str:
    last, worst = trusted(judged), judged[-1]
    if last is None:
        return (f"already the 2D reference misses the definition ({_limits(judged[0])}), before thickness comes in; "
                f"{results.name(worst.condition)} has {_limits(worst)}.")  # fmt: skip
    if last == worst.condition:
        return (f"trustworthy at every thickness studied, up to {results.name(last)}; there the worst numbers are "
                f"{_limits(worst)}.")  # fmt: skip
    failing = judged[[v.condition for v in judged].index(last) + 1]
    kept = next(v for v in judged if v.condition == last)
    if last == PLANE:
        reach = f"the 2D reference meets the definition, {results.name(failing.condition)} no longer does"
    else:
        reach = f"trustworthy up to {results.name(last)}, no longer at {results.name(failing.condition)}"
    return (f"{reach}. The worst numbers are {_limits(kept)} ({results.name(last)}) and {_limits(failing)} "
            f"({results.name(failing.condition)}).")  # fmt: skip


def _limits(one: Verdict) -> str:
    return (f"a median bias of {one.bias:+.2f} % ({one.bias_mode}), {one.stress:+.2f} % for the 5th or 95th percentile of the "
            f"stress error ({one.component}), and {one.largest:.1f} % for the largest error on a curve")  # fmt: skip


def claims(results: Results) -> list[list[Any]]:
    """Rows of `CLAIM_COLUMNS`: three statements of the paper and what each loss finds."""
    fitted = [(loss, noisy) for loss in LOSSES for noisy in (True, False) if results.fits(PLANE, loss, noisy)]
    rows = [[text, loss, NOISES[noisy], *_judged(results, loss, noisy, judge)]
            for text, judge in (("little influence up to 10 mm", _little),
                                ("stress errors clearly larger from 15 mm", _larger))
            for loss, noisy in fitted]  # fmt: skip
    return [*rows, ["severe deformation errors at 40 mm around the holes", "–", "clean", *_severe(results)]]


def _judged(results: Results, loss: str, noisy: bool, judge: Callable[[Results, str, bool], list[str]]) -> list[str]:
    """What a judgement finds, but no verdict where calibration fails before thickness comes in."""
    found = judge(results, loss, noisy)
    start = verdicts(results, loss, noisy)[0].bias
    return (
        found if abs(start) <= MEANINGLESS else [*found[:2], f"not judged: the 2D reference is off by {start:+.0f} %"]
    )


def _little(results: Results, loss: str, noisy: bool) -> list[str]:
    """Up to 10 mm against the 2D reference."""
    thin = [h for h in results.thicknesses if float(h) <= 10]
    measure = ("change of the bias against the 2D reference with the same noise, median over seeds, worst mode: "
               f"little is at most {BIAS_LIMIT:g} %")  # fmt: skip
    if not thin:
        return [measure, *NOT_STUDIED]
    changes = {h: worst_change(results, h, loss, noisy) for h in results.thicknesses}
    numbers = ", ".join(f"{results.name(h)} {value:+.2f} %" for h, value in changes.items())
    return [measure, numbers, _agree(all(abs(changes[h]) <= BIAS_LIMIT for h in thin))]


def worst_change(results: Results, condition: str, loss: str, noisy: bool) -> float:
    """Change of the bias against the 2D reference, %, of the mode where it is largest: the median over seeds.

    The noise of a seed is the same in both.
    """
    plane = {fit["seed"]: fit for fit in results.fits(PLANE, loss, noisy)}
    changes = [[a["bias"] - b["bias"] for a, b in zip(fit["inside"], plane[fit["seed"]]["inside"], strict=True)]
               for fit in results.fits(condition, loss, noisy)]  # fmt: skip
    return 100 * float(max(np.median(changes, axis=0), key=abs))


def _larger(results: Results, loss: str, noisy: bool) -> list[str]:
    """15 mm against 10 mm."""
    measure = f"largest |P5| or |P95| of the stress error: clearly is {CLEARLY:g} times that at 10 mm"
    if not {"10", "15"} <= set(results.thicknesses):
        return [measure, *NOT_STUDIED]
    sizes = {v.condition: abs(v.stress) for v in verdicts(results, loss, noisy)}
    numbers = ", ".join(f"{results.name(c)} {size:.2f} %" for c, size in sizes.items())
    ratio = sizes["15"] / sizes["10"]
    return [measure, f"{numbers}; 15 mm over 10 mm: {ratio:.2f}", _agree(ratio >= CLEARLY)]


def _severe(results: Results) -> list[str]:
    """40 mm around the holes."""
    measure = f"95th percentile of ε at most {NEAR_RIM:g} mm from a rim: severe is {SEVERE:g} and more"
    if "40" not in results.thicknesses:
        return [measure, *NOT_STUDIED]
    near = {name: field.statistics(field.near_holes(NEAR_RIM)) for name, field in results.fields.items()}
    numbers = ", ".join(f"{name} mm {s.p95:.3f} (maximum {s.maximum:.3f})" for name, s in near.items())
    return [measure, numbers, _agree(near["40"].p95 >= SEVERE)]


def _agree(yes: bool) -> str:
    return "agrees" if yes else "disagrees"


def reasons(results: Results) -> list[str]:
    """Why we and the paper may differ: what the losses show on the same data, and what was not tested."""
    text = []
    changes = {loss: worst_change(results, results.thicknesses[-1], loss, False)
               for loss in LOSSES if results.fits(PLANE, loss, False)}  # fmt: skip
    if len(changes) > 1:
        thickest = results.name(results.thicknesses[-1])
        numbers = "; ".join(f"{LABELS[loss]}: {value:+.2f} %" for loss, value in changes.items())
        largest, own = max(map(abs, changes.values())), abs(changes[LOSSES[0]])
        tail = "decides much" if largest > 2 * own else "decides little"
        text.append(f"Tested here, on the same clean data, is the loss. Change of the bias from the 2D reference to {thickest}: "
                    f"{numbers}. On this specimen the loss {tail} of what thickness does to a calibration.")  # fmt: skip
    return [*text, UNTESTED]


def deformation(results: Results) -> list[str]:
    """Where 2D and 3D deformation differ, how that grows and decays, and what it does to the forces."""
    rows = [field_row(name, field) for name, field in results.fields.items()]
    parts = [f"{h:g} mm: 95th percentile {p95:.3f}, maximum {top:.3f} at {at} mm, {rim:.1f} mm from a rim"
             for h, _, _, p95, _, top, at, rim, *_ in rows]  # fmt: skip
    text = [f"ε at {results.settings.displacement:g} mm: " + "; ".join(parts) + "."]
    h, rim, grip, rest = rows[-1][0], *rows[-1][-3:]
    known = {f"within {NEAR_RIM:g} mm of a rim": rim, "within half a thickness of a grip": grip, "elsewhere": rest}
    shares = ", ".join(f"{value:.3f} {where}" for where, value in known.items() if np.isfinite(value))
    text.append(f"The thickest ({h:g} mm) has a 95th percentile of {shares}.")
    lengths = {name: [half_length(line) for line in numbers.lines] for name, numbers in results.numbers.items()}
    words = ", ".join(f"{min(x):.1f} to {max(x):.1f} mm at {name} mm thickness ({min(x) / float(name):.2f} to "
                      f"{max(x) / float(name):.2f} h)" for name, x in lengths.items())  # fmt: skip
    text.append(f"From its peak near a rim, ε falls to one half within a distance of {words}.")
    forces: dict[float, float] = {}
    for h, _, *_, off, _ in force_rows(results):
        forces[h] = max(off, forces.get(h, 0.0), key=abs)
    words = ", ".join(f"{off:+.2f} % at {h:g} mm" for h, off in forces.items())
    text.append(f"Force over thickness, 3D against 2D, at the end, of the pair of arms where it differs more: {words}.")
    return text


def half_length(line: Line) -> float:
    """Distance from the rim, mm, where epsilon is first half of its largest value within 5 mm of the rim."""
    near = np.flatnonzero(line.distance <= NEAR_HOLE)
    peak = int(near[line.epsilon[near].argmax()])
    below = np.flatnonzero(line.epsilon[peak:] <= line.epsilon[peak] / 2)
    return float(line.distance[peak + below[0]] if below.size else line.distance[-1])


def reservations(results: Results) -> list[str]:
    """What a reader must know before trusting the numbers."""
    text = []
    settings = results.settings
    missing = [h for h in (10, 15, 20, 40) if f"{h:g}" not in results.thicknesses]
    if len(settings.seeds) < 10 or missing:
        gaps = f" and without {', '.join(f'{h} mm' for h in missing)}" if missing else ""
        n = len(settings.seeds)
        text.append(f"This is a reduced run, with {n} noise seed{'s' * (n != 1)}{gaps}: it shows the path; its medians "
                    "and ranges over seeds prove little.")  # fmt: skip
    return text
