"""One link of the chain: a function of quantities, applied and differentiated by JAX, and compiled by itself.

A link reads some quantities and writes one. Since every link is compiled by itself, for the sizes of its arrays, a model with
a new combination of effects compiles hardly anything, nor does another experiment of the same size.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import partial
from typing import Any, ClassVar

import jax
import jax.numpy as jnp

Parameters = tuple[
    tuple[Any, Any], ...
]  # amplitudes (p,) and shape (s,) of each effect in a link; none for a link of no effect


class Link(ABC):
    """A function from quantities to one quantity; equal links share their compiled code, so that subclasses are frozen
    dataclasses.

    reads, writes: names of the quantities. uses_coefficients: whether it depends on the base model. remembered: whether a `Memory` keeps what it writes.
    """

    reads: ClassVar[tuple[str, ...]]
    writes: ClassVar[str]
    uses_coefficients: ClassVar[bool] = False
    remembered: ClassVar[bool] = False

    @abstractmethod
    def __call__(self, inputs: tuple[Any, ...], constants: Any, parameters: Parameters) -> Any:
        """The quantity that is written; constants: `Constants`, or its `data` where no coefficients are used."""


@partial(jax.jit, static_argnums=0)
def apply(link: Link, inputs: tuple[Any, ...], constants: Any, parameters: Parameters) -> Any:
    """The quantity that a link writes."""
    return link(inputs, constants, parameters)


@partial(jax.jit, static_argnums=0)
def push(link: Link, inputs: tuple[Any, ...], constants: Any, parameters: Parameters, changes: tuple[Any, ...]) -> Any:
    """Changes (k, ...) of what is written, by changes (k, ...) of each input; None for an input that stays."""
    moving = [i for i, change in enumerate(changes) if change is not None]

    def moved(*values: Any) -> Any:
        given = list(inputs)
        for i, value in zip(moving, values, strict=True):
            given[i] = value
        return link(tuple(given), constants, parameters)

    at = tuple(inputs[i] for i in moving)
    return jax.lax.map(lambda change: jax.jvp(moved, at, change)[1], tuple(changes[i] for i in moving))


@partial(jax.jit, static_argnums=0)
def pull(link: Link, inputs: tuple[Any, ...], constants: Any, parameters: Parameters, duals: Any) -> tuple[Any, ...]:
    """Duals (k, ...) of each input, of duals (k, ...) of what is written."""
    back = jax.vjp(lambda inputs: link(inputs, constants, parameters), inputs)[1]
    return tuple(jax.lax.map(lambda dual: back(dual)[0], duals))


@partial(jax.jit, static_argnums=(0, 1, 2))
def push_parameters(
    link: Link, which: int, with_shape: bool, inputs: tuple[Any, ...], constants: Any, parameters: Parameters
) -> Any:
    """Derivatives (p, ...) of what is written by the amplitudes of an effect in the link, and behind them by its shape if
    `with_shape`."""
    amplitudes, shape = parameters[which]

    def moved(a: Any, s: Any) -> Any:
        return link(inputs, constants, (*parameters[:which], (a, s), *parameters[which + 1 :]))

    if not with_shape:
        return jnp.moveaxis(jax.jacfwd(lambda a: moved(a, shape))(amplitudes), -1, 0)
    n = len(amplitudes)
    both = jax.jacfwd(lambda x: moved(x[:n], x[n:]))(jnp.concatenate([amplitudes, shape]))
    return jnp.moveaxis(both, -1, 0)
