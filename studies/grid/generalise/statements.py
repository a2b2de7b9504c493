"""The paper's statements of its second half, one by one: by which numbers each is judged, and the verdict.

In: `GeneraliseResults` and a truth. Out: `Judged`, a statement with its numbers (median and range over seeds) and a verdict. The rules and limits are
ours and were fixed before the study was run in full.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from enum import Enum
from typing import Any

import numpy as np
from scipy.stats import spearmanr

from calibrate.equations.deformation_modes import MODES
from studies.grid.claims import ClaimVerdict
from studies.grid.generalise.generalise_results import GeneraliseResults, mean_score
from studies.grid.generalise.generalise_settings import CROSS, MIDDLE, PAPER_SETS
from studies.grid.results import Spread

BOTH = "I1I2"


@dataclass(frozen=True)
class Rules:
    """Limits of the verdicts. correlation: of ranks, in size; good, insufficient: r2_F; margin: by which one r2_F exceeds another; unphysical, sane:
    relative error of the biaxial stress at the end of the prediction; most: share of sets; lack: factor on the loss per equation."""

    correlation: float = 0.5
    good: float = 0.99
    insufficient: float = 0.95
    margin: float = 0.001
    unphysical: float = 1.0
    sane: float = 0.5
    most: float = 0.9
    lack: float = 1.05


RULES = Rules()


class GeneraliseStatement(Enum):
    """A statement of the paper; value: the macros of ``templates/generalise.txt`` that state it and its measure."""

    RICH_COVERAGE_BETTER = "rich_coverage_better"
    RICH_COVERAGE_CLEARER = "rich_coverage_clearer"
    BEST_PARTNER = "best_partner"
    UT_AND_PS = "ut_and_ps"
    PS_ALONE = "ps_alone"
    FEW_HOLES = "few_holes"
    SECOND_UNPHYSICAL = "second_unphysical"
    FIRST_SANE = "first_sane"
    BOTH_BEST = "both_best"
    MIDDLE_SUFFICES = "middle_suffices"
    LARGE_OVERFIT = "large_overfit"
    SMALL_LACK = "small_lack"


@dataclass(frozen=True)
class Judged:
    """A statement and what became of it. found: number over seeds by name."""

    statement: GeneraliseStatement
    truth: str
    verdict: ClaimVerdict
    found: Mapping[str, Spread]

    def to_dict(self) -> dict[str, Any]:
        """For a file."""
        found = {name: asdict(spread) for name, spread in self.found.items()}
        return {"statement": self.statement.value, "truth": self.truth, "verdict": self.verdict.value, "found": found}


@dataclass(frozen=True)
class _Case:
    """Results of one truth: what the rules ask of them."""

    results: GeneraliseResults
    truth: str

    def over_seeds(self, number: Callable[..., float], *arguments: Any) -> Spread:
        return self.results.spread(number, *arguments)

    def score(self, seed: int, tests: str, specimen: str, inputs: str = BOTH) -> float:
        """Median over sizes of r2_F."""
        group = self.results.chosen(self.truth, seed, tests=tests, inputs=inputs)
        return float(np.median([one.scores[specimen] for one in group]))

    def mean(self, seed: int, tests: str, inputs: str = BOTH) -> float:
        """Median over sizes of the mean r2_F over the sheets."""
        group = self.results.chosen(self.truth, seed, tests=tests, inputs=inputs)
        return float(np.median([mean_score(one) for one in group]))

    def end_errors(self, seed: int, inputs: str) -> np.ndarray:
        """Median over sizes of the error of the biaxial stress at the end, for every set without the cross."""
        sets = [tests for tests in self.results.settings.sets if CROSS not in tests]
        groups = [self.results.chosen(self.truth, seed, tests=tests, inputs=inputs) for tests in sets]
        return np.array(
            [np.median([self.results.end_error(self.truth, one, "equibiaxial") for one in g]) for g in groups]
        )


def judge(results: GeneraliseResults, truth: str) -> list[Judged]:
    """Every statement that the sets of these results can judge."""
    case = _Case(results, truth)
    there = set(results.settings.sets)
    complete = results.settings.inputs == ("I1", "I2", BOTH) and there >= set(PAPER_SETS)
    rules = RULES_OF if complete else {}
    found = []
    for statement in GeneraliseStatement:
        verdict, numbers = rules[statement](case) if complete else (ClaimVerdict.NOT_STUDIED, {})
        found.append(Judged(statement, truth, verdict, numbers))
    return found


def three_way(confirmed: bool, refuted: bool) -> ClaimVerdict:
    """OPEN where the numbers are neither."""
    if confirmed:
        return ClaimVerdict.CONFIRMED
    return ClaimVerdict.REFUTED if refuted else ClaimVerdict.OPEN


Found = tuple[ClaimVerdict, dict[str, Spread]]


def _with_coverage(case: _Case, number: Callable[[int, str], float]) -> Found:
    sets = case.results.settings.sets
    covered = [case.results.coverage(case.truth, tests) for tests in sets]

    def correlation(seed: int) -> float:
        numbers = [number(seed, tests) for tests in sets]
        return float(spearmanr(covered, numbers)[0]) if np.ptp(numbers) > 0 else 0.0

    rank, limit = case.over_seeds(correlation), RULES.correlation
    return three_way(rank.median <= -limit, rank.median > -limit / 2), {"rank correlation with coverage": rank}


def _rich_better(case: _Case) -> Found:
    def error(seed: int, tests: str) -> float:
        group = case.results.chosen(case.truth, seed, tests=tests, inputs=BOTH)
        return float(np.median([max(case.results.error(case.truth, one, mode) for mode in MODES) for one in group]))

    return _with_coverage(case, error)


def _rich_clearer(case: _Case) -> Found:
    def ambiguity(seed: int, tests: str) -> float:
        group = case.results.chosen(case.truth, seed, tests=tests, inputs=BOTH)
        return max(case.results.ambiguity(case.truth, group, mode) for mode in MODES)

    return _with_coverage(case, ambiguity)


def _best_partner(case: _Case) -> Found:
    means = {tests: case.over_seeds(case.mean, tests) for tests in PAPER_SETS}
    own = means["UT+TTd"]
    rival = max((tests for tests in PAPER_SETS if tests != "UT+TTd"), key=lambda tests: means[tests].median)
    ahead = case.over_seeds(lambda seed: case.mean(seed, "UT+TTd") - case.mean(seed, rival))
    verdict = three_way(ahead.median >= -RULES.margin / 10, ahead.high < -RULES.margin)
    return verdict, {"UT+TTd": own, f"best other, {rival}": means[rival]}


def _ut_and_ps(case: _Case) -> Found:
    worst = case.over_seeds(
        lambda seed: min(case.score(seed, "UT+PS", name) for name in case.results.settings.specimens if name != CROSS)
    )
    return three_way(worst.median >= RULES.good, worst.median < RULES.insufficient), {"worst sheet": worst}


def _ps_alone(case: _Case) -> Found:
    sheets = [name for name in case.results.settings.specimens if name != CROSS]
    on_ut = case.over_seeds(case.score, "PS", "UT")
    worst = case.over_seeds(lambda seed: min(case.score(seed, "PS", name) for name in sheets if name != "UT"))
    confirmed = on_ut.median < RULES.insufficient and on_ut.median < worst.median
    return three_way(confirmed, on_ut.median >= RULES.good), {"UT": on_ut, "worst other sheet": worst}


def _few_holes(case: _Case) -> Found:
    found = {tests: case.over_seeds(case.score, tests, "UT") for tests in ("TTa", "TTb")}
    medians = [spread.median for spread in found.values()]
    return three_way(max(medians) < RULES.insufficient, min(medians) >= RULES.good), found


def _second_unphysical(case: _Case) -> Found:
    share = case.over_seeds(lambda seed: float((np.abs(case.end_errors(seed, "I2")) > RULES.unphysical).mean()))
    error = case.over_seeds(lambda seed: float(np.median(case.end_errors(seed, "I2"))))
    return three_way(share.median >= 0.5, share.median == 0), {"share of sets": share, "error, median set": error}


def _first_sane(case: _Case) -> Found:
    share = case.over_seeds(lambda seed: float((np.abs(case.end_errors(seed, "I1")) <= RULES.sane).mean()))
    error = case.over_seeds(lambda seed: float(np.median(case.end_errors(seed, "I1"))))
    return three_way(share.median >= RULES.most, share.median < 0.5), {
        "share of sets": share,
        "error, median set": error,
    }


def _both_best(case: _Case) -> Found:
    def overall(seed: int, inputs: str) -> float:
        return float(np.mean([case.mean(seed, tests, inputs) for tests in PAPER_SETS]))

    found = {inputs: case.over_seeds(overall, inputs) for inputs in ("I1", "I2", BOTH)}
    rival = max(found["I1"].median, found["I2"].median)
    ahead = found[BOTH].median - rival
    return three_way(ahead >= -RULES.margin / 10, ahead < -RULES.margin), found


def _by_size(case: _Case, layers: tuple[int, ...]) -> Spread:
    """Mean r2_F over sheets and the paper's sets."""

    def number(seed: int) -> float:
        return float(
            np.mean(
                [
                    mean_score(one)
                    for one in case.results.chosen(case.truth, seed, inputs=BOTH, layers=layers)
                    if one.tests in PAPER_SETS
                ]
            )
        )

    return case.over_seeds(number)


def _middle_suffices(case: _Case) -> Found:
    own = _by_size(case, MIDDLE)
    others = {layers: _by_size(case, layers) for layers in case.results.settings.sizes if layers != MIDDLE}
    best = max(others, key=lambda layers: others[layers].median)
    behind = others[best].median - own.median
    verdict = three_way(behind <= RULES.margin, behind > 10 * RULES.margin)
    return verdict, {str(MIDDLE): own, f"best other, {best}": others[best]}


def _large_overfit(case: _Case) -> Found:
    own, large = _by_size(case, MIDDLE), _by_size(case, (16, 16))
    worse = own.median - large.median
    return three_way(worse > RULES.margin, worse <= RULES.margin / 10), {str(MIDDLE): own, "(16, 16)": large}


def _small_lack(case: _Case) -> Found:
    def ratio(seed: int) -> float:
        pairs = [
            (
                case.results.chosen(case.truth, seed, tests=tests, inputs=BOTH, layers=layers)[0].loss_per_equation
                for layers in ((1,), MIDDLE)
            )
            for tests in PAPER_SETS
        ]
        return float(np.median([small / middle for small, middle in pairs]))

    found = case.over_seeds(ratio)
    verdict = three_way(found.median >= RULES.lack, found.median < 1 + (RULES.lack - 1) / 5)
    return verdict, {"loss per equation, (1) over (4, 4)": found}


RULES_OF: dict[GeneraliseStatement, Callable[[_Case], Found]] = {
    GeneraliseStatement.RICH_COVERAGE_BETTER: _rich_better,
    GeneraliseStatement.RICH_COVERAGE_CLEARER: _rich_clearer,
    GeneraliseStatement.BEST_PARTNER: _best_partner,
    GeneraliseStatement.UT_AND_PS: _ut_and_ps,
    GeneraliseStatement.PS_ALONE: _ps_alone,
    GeneraliseStatement.FEW_HOLES: _few_holes,
    GeneraliseStatement.SECOND_UNPHYSICAL: _second_unphysical,
    GeneraliseStatement.FIRST_SANE: _first_sane,
    GeneraliseStatement.BOTH_BEST: _both_best,
    GeneraliseStatement.MIDDLE_SUFFICES: _middle_suffices,
    GeneraliseStatement.LARGE_OVERFIT: _large_overfit,
    GeneraliseStatement.SMALL_LACK: _small_lack,
}
