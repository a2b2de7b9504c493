"""Time of a law of 2 x 2 tensors, and of its derivative, by arrays (..., 2, 2) and by their components: `python -m benchmarks.tensor_components`.

In: numbers of tensors (--counts). Out: a table on the terminal, in nanoseconds a tensor: the isochoric stress that viscoelasticity convolves, F (S - (S : C) / 3 C^-1), by
matrix products of arrays, by their components put together after every operation, and by components put together at the end (`calibrate.equations.tensors.Tensors`).
All three are equal to round-off. Run it alone on the machine.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from calibrate.equations.tensors import Tensors, inverse, product

COUNTS = (1_000, 10_000, 100_000, 1_000_000)
REPEATS = 20


def by_matrix_products(F: Any, P: Any) -> Any:
    S, C = inverse(F) @ P, jnp.swapaxes(F, -1, -2) @ F
    return F @ (S - (jnp.sum(S * C, axis=(-2, -1)) / 3)[..., None, None] * inverse(C))


def put_together_every_time(F: Any, P: Any) -> Any:
    S, C = product(inverse(F), P), product(jnp.swapaxes(F, -1, -2), F)
    return product(F, S - (jnp.sum(S * C, axis=(-2, -1)) / 3)[..., None, None] * inverse(C))


def by_components(F: Any, P: Any) -> Any:
    whole = Tensors.of(F)
    S, C = whole.inverse @ Tensors.of(P), whole.T @ whole
    return (whole @ (S - C.inverse * (S.dot(C) / 3))).array


WAYS = (by_matrix_products, put_together_every_time, by_components)


def least_time(work: Callable[..., Any], *given: Any) -> float:
    """Seconds of the fastest of some calls, compiled before."""
    jax.block_until_ready(work(*given))
    times = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        jax.block_until_ready(work(*given))
        times.append(time.perf_counter() - began)
    return min(times)


def main() -> None:
    """Print the table. Raises `AssertionError` where the ways differ."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--counts", type=int, nargs="*", default=COUNTS)
    counts = parser.parse_args().counts
    rng = np.random.default_rng(0)
    print(f"{'ns a tensor':28s}" + "".join(f"{count:>14,}{'derivative':>12s}" for count in counts))
    given = {n: [jnp.asarray(np.eye(2) + 0.1 * rng.standard_normal((n, 2, 2))) for _ in range(2)] for n in counts}
    for way in WAYS:
        line = f"{way.__name__.replace('_', ' '):28s}"
        for count, (F, P) in given.items():
            np.testing.assert_allclose(way(F, P), by_matrix_products(F, P), atol=1e-12)
            value = least_time(jax.jit(way), F, P)
            derivative = least_time(jax.jit(lambda a, b, of=way: jax.jvp(of, (a, b), (b, a))[1]), F, P)
            line += f"{1e9 * value / count:14.1f}{1e9 * derivative / count:12.1f}"
        print(line, flush=True)


if __name__ == "__main__":
    main()
