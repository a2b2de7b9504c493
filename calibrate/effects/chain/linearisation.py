"""Links one after another: run from some quantities, and the derivatives of that run along and against its direction.

Quantities, changes and duals are dictionaries by the names that stages read and write. A stage may write what it reads.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from calibrate.effects.chain.addition import Addition
from calibrate.effects.chain.link import Link, Parameters, apply, pull, push, push_parameters
from calibrate.effects.support.effect_data import Data

Quantities = dict[str, Any]


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Constants:
    """What links read beside their inputs. c (n,): coefficients of the base model; top: range of its basis."""

    data: Data
    top: Any
    c: Any

    def of(self, link: Link) -> Any:
        """What one link needs, so that those without coefficients are compiled once for all bases."""
        return self if link.uses_coefficients else self.data


@dataclass(frozen=True, eq=False)
class Stage:
    """A link in its place.

    additions: the effects that it depends on, with their values, none for a link of the base. places: of these among all in their order, which
    tells two of one effect apart. names: what a quantity of the link is called here, if not as in the link.
    """

    link: Link
    additions: tuple[Addition, ...] = ()
    places: tuple[int, ...] = ()
    names: Mapping[str, str] = field(default_factory=dict)

    @property
    def parameters(self) -> Parameters:
        """Amplitudes (p,) and shape (s,) of each effect."""
        return tuple((jnp.asarray(a.amplitudes, float), jnp.asarray(a.shape, float)) for a in self.additions)

    @property
    def reads(self) -> tuple[str, ...]:
        """Names of the quantities that are read."""
        return tuple(self.names.get(name, name) for name in self.link.reads)

    @property
    def writes(self) -> str:
        """Name of the quantity that is written."""
        return self.names.get(self.link.writes, self.link.writes)

    def inputs(self, quantities: Quantities) -> tuple[Any, ...]:
        """Values of the quantities that are read."""
        return tuple(quantities[name] for name in self.reads)


class Memory:
    """What those links that are `remembered` make of a start, and of what each other make of it, with the coefficients seen last: for many runs from that start."""

    def __init__(self, *start: Any) -> None:
        self._start = start
        self._found: dict[Link, tuple[tuple[Any, ...], bytes, Any]] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return Memory, self._start

    def __call__(self, stage: Stage, inputs: tuple[Any, ...], constants: Constants) -> Any:
        """What a stage writes."""
        link, given = stage.link, (inputs, constants.of(stage.link), stage.parameters)
        known = (*self._start, *(output for *_, output in list(self._found.values())))  # other threads may add
        if not link.remembered or not all(any(one is other for other in known) for one in inputs):
            return apply(link, *given)
        c = np.asarray(constants.c).tobytes() if link.uses_coefficients else b""
        if link in self._found:
            before, of, output = self._found[link]
            if of == c and all(one is other for one, other in zip(inputs, before, strict=True)):
                return output
        output = apply(link, *given)
        self._found[link] = inputs, c, output
        return output


@dataclass(frozen=True, eq=False)
class Step:
    """A stage that was run: what it read, and wrote, where anybody asks for it."""

    stage: Stage
    inputs: tuple[Any, ...]
    constants: Constants = field(repr=False)
    memory: Memory = field(repr=False)

    @cached_property
    def output(self) -> Any:
        """What it wrote."""
        return self.memory(self.stage, self.inputs, self.constants)


@dataclass(frozen=True, eq=False)
class Linearisation:
    """A run of stages: everything that its derivatives need."""

    constants: Constants
    start: Quantities
    steps: tuple[Step, ...]

    @classmethod
    def run(
        cls, stages: Sequence[Stage], constants: Constants, start: Mapping[str, Any], memory: Memory | None = None
    ) -> Linearisation:
        """Apply the stages in their order; the last one only once what it writes is asked for, as derivatives do not. memory: of runs from the same start."""
        memory = Memory() if memory is None else memory
        quantities, steps = dict(start), list[Step]()
        for stage in stages:
            if steps:
                quantities[steps[-1].stage.writes] = steps[-1].output
            steps.append(Step(stage, stage.inputs(quantities), constants, memory))
        return cls(constants, dict(start), tuple(steps))

    @property
    def quantities(self) -> Quantities:
        """Every quantity, as it is at the end."""
        return self.start | {step.stage.writes: step.output for step in self.steps}

    def split_at(self, name: str) -> tuple[Linearisation, Linearisation]:
        """The steps up to the first one that writes a quantity, and those behind it."""
        place = 1 + next(i for i, step in enumerate(self.steps) if step.stage.writes == name)
        first = Linearisation(self.constants, self.start, self.steps[:place])
        return first, Linearisation(self.constants, first.quantities, self.steps[place:])

    def push(self, changes: Quantities) -> Quantities:
        """Changes (k, ...) of every quantity at the end, of those at the start; none where nothing changes."""
        moved = dict(changes)
        for step in self.steps:
            _write(moved, step, self._pushed(step, moved))
        return moved

    def by_parameters(self, place: int, with_shape: bool, changes: Quantities) -> Quantities:
        """Derivatives (p, ...) of every quantity at the end by the amplitudes of the addition at a place, and by its shape behind them;
        changes: those of the quantities at the start."""
        moved = dict(changes)
        for step in self.steps:
            change = self._pushed(step, moved)
            if place in step.stage.places:
                link, which = step.stage.link, step.stage.places.index(place)
                given = step.inputs, self.constants.of(link), step.stage.parameters
                own = push_parameters(link, which, with_shape, *given)
                change = own if change is None else own + change
            _write(moved, step, change)
        return moved

    def pull(self, duals: Quantities) -> Quantities:
        """Duals (k, ...) of every quantity at the start, of those at the end."""
        found = dict(duals)
        for step in reversed(self.steps):
            link = step.stage.link
            dual = found.pop(step.stage.writes, None)
            if dual is None:
                continue
            backs = pull(link, step.inputs, self.constants.of(link), step.stage.parameters, dual)
            for name, back in zip(step.stage.reads, backs, strict=True):
                found[name] = found[name] + back if name in found else back
        return found

    def _pushed(self, step: Step, changes: Quantities) -> Any:
        """Changes (k, ...) of what a step writes; None if none of its inputs changes."""
        given, link = tuple(changes.get(name) for name in step.stage.reads), step.stage.link
        if all(change is None for change in given):
            return None
        return push(link, step.inputs, self.constants.of(link), step.stage.parameters, given)


def _write(changes: Quantities, step: Step, change: Any) -> None:
    if change is None:
        changes.pop(step.stage.writes, None)
    else:
        changes[step.stage.writes] = change
