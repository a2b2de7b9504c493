"""A test of a diagnosis as its models are replayed and compared on it.

In: a `Part` and a model. Out: rows, and what a change of the law does to them. What the camera, the clock and the load cell do in the model is taken out of what was measured
(`calibrate.effects.chain.true_surface`); its law is replayed with the motion of the grips that is left. All models of a test are compared at the same increments: six held out and six fitted,
at most, with all their forces where such are there. A law with a history is replayed at all up to the last of these, an elastic one at these.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment
from calibrate.diagnosis.problem import Part
from calibrate.effects.chain import Additions
from calibrate.effects.chain.true_surface import is_expressed, true_surface
from calibrate.models.extended_model import ExtendedModel
from forward.sheet.sheet_run import Options
from studies.errors import OptionError
from studies.replay.law_changes import LawChanges
from studies.replay.model_law import Law, is_solved, law_of
from studies.replay.replay_rows import Layout, SheetRows, forces_known, sheet_rows
from studies.replay.replayed_experiment import TOLERANCE, BoundaryValues, replay
from studies.replay.twin_replay import MOST_TRIANGLES

Array = NDArray[np.float64]
EACH = 6  # increments that are compared, of those held out and of those fitted
OPTIONS = Options(TOLERANCE, max_iterations=12, max_bisections=3)  # a model that fails should do so soon


@dataclass(frozen=True, eq=False)
class ReplayedModel:
    """Coefficients (n,) and effects, as they are replayed."""

    c: Array
    additions: Additions = ()

    @property
    def remembers(self) -> bool:
        return any(a.effect.remembers for a in self.additions)


@dataclass(eq=False)
class ComparedTest:
    """A test of the diagnosis and what is compared of it: increments that were fitted, and those held out where with_held; at most `each` of a kind."""

    part: Part
    each: int = EACH
    with_held: bool = True

    @cached_property
    def experiment(self) -> Experiment:
        e = replace(self.part.experiment, record=None)
        return e if e.interpolated is None else e.select(e.pictures)

    @cached_property
    def held(self) -> NDArray[np.bool_]:
        """Pictures (t,) no equation of which was fitted, but one that fixes a nominal level."""
        return ~self.part.fitted_increments[self.part.experiment.pictures]

    @cached_property
    def layout(self) -> Layout:
        kinds = (~self.held, self.held) if self.with_held else (~self.held,)
        known = forces_known(self.experiment)
        best = [which & known if (which & known).any() else which for which in kinds]
        some = [_spread(np.flatnonzero(which), self.each) for which in best]
        judged = BoundaryValues.of(self.experiment).judged
        return Layout.of(self.experiment, np.unique(np.concatenate(some)), judged)

    def replayed(self, model: ReplayedModel, linear: bool) -> tuple[SheetRows, LawChanges]:
        """Raises the errors of the forward model, `OptionError` for an effect that cannot be expressed, and `ConfigError`."""
        if len(self.experiment.triangles) > MOST_TRIANGLES:
            raise OptionError(
                f"{self.experiment.name}: more than the {MOST_TRIANGLES} triangles of which a replay is affordable"
            )
        additions = self.part.valid(model.additions)
        true = true_surface(self.experiment, tuple(a for a in additions if not is_solved(a.effect.name)))
        law = _law(self.part, model.c, additions, true)
        chosen = self.layout.chosen
        solved = np.arange(chosen[-1] + 1) if model.remembers else chosen
        found = replay(true.select(solved), law, check_mesh=False, options=OPTIONS)
        rows = sheet_rows(true, self.layout, found, solved, linear)
        u = true.displacements.copy()
        u[solved] = found.displacements
        return rows, LawChanges(self.part, replace(true, displacements=u), rows)


def _spread(numbers: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """At most so many of them, evenly, the last among them."""
    if len(numbers) <= most:
        return numbers
    return numbers[np.round(np.linspace(0, len(numbers) - 1, most)).astype(int)]


def _law(part: Part, c: Array, additions: Additions, true: Experiment) -> Law:
    unknown = [a.effect.name for a in additions if not is_solved(a.effect.name) and not is_expressed(a.effect)]
    if unknown:
        raise OptionError(
            f"{' and '.join(unknown)}: neither the forward model nor a correction of what was measured has it"
        )
    return law_of(_extended(part, c, tuple(a for a in additions if is_solved(a.effect.name)), true), true)


def _extended(part: Part, c: Array, additions: Additions, true: Experiment) -> ExtendedModel:
    deviations = tuple((0.0,) * len(a.amplitudes) for a in additions)
    training = ({"name": true.name, "fingerprint": true.fingerprint},)
    return ExtendedModel(part.chain.basis, c, additions, deviations, true.stress_unit, training)
