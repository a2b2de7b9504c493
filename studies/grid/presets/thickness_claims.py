"""The paper's three claims about thickness beside our numbers: `ThicknessResults` in, `Claim`s out."""

from __future__ import annotations

import numpy as np

from studies.grid.axes import PLANE, Loss
from studies.grid.claims import Claim, ClaimVerdict, Statement
from studies.grid.presets.thickness_results import ThicknessResults, condition_name
from studies.grid.presets.thickness_tables import LIMITS, Trust, trusts

CHANGE_COLUMNS = ("loss", "change of the bias from 2D to the thickest, clean data (%)")


def claims(results: ThicknessResults) -> list[Claim]:
    """What each loss finds, with noise and without."""
    judges = (little_influence, larger_errors)
    fitted = [(loss, noisy) for loss in results.losses for noisy in (True, False) if results.fitted(PLANE, loss, noisy)]
    return [*(judge(results, loss, noisy) for judge in judges for loss, noisy in fitted), severe_deformation(results)]


def little_influence(results: ThicknessResults, loss: Loss, noisy: bool) -> Claim:
    """Little influence up to 10 mm: the change of the bias against the 2D reference."""
    changes = {h: worst_change(results, h, loss, noisy) for h in results.thicknesses}
    thin = [abs(change) for h, change in changes.items() if float(h) <= 10]
    found = {condition_name(h): change for h, change in changes.items()}
    verdict = ClaimVerdict.of(max(thin) <= LIMITS.bias) if thin else ClaimVerdict.NOT_STUDIED
    return _judged(results, Statement.LITTLE_INFLUENCE, verdict, found, {"bias": LIMITS.bias}, loss, noisy)


def larger_errors(results: ThicknessResults, loss: Loss, noisy: bool) -> Claim:
    """Clearly larger stress errors from 15 mm: 15 mm against 10 mm."""
    sizes = stress_sizes(trusts(results, loss, noisy))
    studied = {"10 mm", "15 mm"} <= set(sizes)
    verdict = ClaimVerdict.of(sizes["15 mm"] / sizes["10 mm"] >= LIMITS.ratio) if studied else ClaimVerdict.NOT_STUDIED
    return _judged(results, Statement.LARGER_ERRORS, verdict, sizes, {"ratio": LIMITS.ratio}, loss, noisy)


def stress_sizes(judged: list[Trust]) -> dict[str, float]:
    """Size of the worst P5 or P95 of the stress error, %, by condition in words."""
    return {condition_name(one.condition): abs(one.stress) for one in judged}


def severe_deformation(results: ThicknessResults) -> Claim:
    """Severe deformation errors at 40 mm around the holes: the 95th percentile of epsilon near the rims."""
    near = {h: field.statistics(field.near_holes(LIMITS.near_rim)).p95 for h, field in results.fields.items()}
    verdict = ClaimVerdict.of(near["40"] >= LIMITS.epsilon) if "40" in near else ClaimVerdict.NOT_STUDIED
    found = {condition_name(h): value for h, value in near.items()} if "40" in near else {}
    return Claim(Statement.SEVERE_DEFORMATION, verdict, found, {"near_rim": LIMITS.near_rim, "epsilon": LIMITS.epsilon})


def _judged(
    results: ThicknessResults, statement: Statement, verdict: ClaimVerdict, found: dict[str, float],
    limits: dict[str, float], loss: Loss, noisy: bool,
) -> Claim:  # fmt: skip
    """The claim, open where calibration fails before thickness comes in."""
    if verdict is ClaimVerdict.NOT_STUDIED:
        return Claim(statement, verdict, {}, limits, loss, noisy)
    start = trusts(results, loss, noisy)[0].bias
    if abs(start) <= LIMITS.meaningless:
        return Claim(statement, verdict, found, limits, loss, noisy)
    return Claim(statement, ClaimVerdict.OPEN, found, limits, loss, noisy, start)


def worst_change(results: ThicknessResults, condition: str, loss: Loss, noisy: bool) -> float:
    """Change of the bias against the 2D reference, %, of the mode where it is largest: the median over seeds.

    The noise of a seed is the same in both.
    """
    plane = {case.seed: fit for case, fit in results.fitted(PLANE, loss, noisy).items()}
    changes = [[a.bias - b.bias for a, b in zip(fit.inside, plane[case.seed].inside, strict=True)]
               for case, fit in results.fitted(condition, loss, noisy).items()]  # fmt: skip
    return 100 * float(max(np.median(changes, axis=0), key=abs))


def change_rows(results: ThicknessResults) -> list[list[object]]:
    """What thickness changes with each loss on the same clean data; see `CHANGE_COLUMNS`."""
    thickest = results.thicknesses[-1]
    return [[loss, worst_change(results, thickest, loss, False)] for loss in results.losses
            if results.fitted(PLANE, loss, False) and results.fitted(thickest, loss, False)]  # fmt: skip
