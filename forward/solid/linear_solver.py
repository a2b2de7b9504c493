"""What a linear solver of the solid does: a state and prescribed steps in, the Newton step of the displacement out.

`Pardiso` (MKL, package pypardiso) serves one process and is several times faster; `Mumps` serves any number of
ranks. Both factorise the symmetric condensed tangent, and both check the residual of their result in float64.
"""

from __future__ import annotations

from typing import Protocol

from meshes.mesh import Array

ACCURACY = 1e-6  # of a linear solve; the nonlinear iteration forgives more, a broken factor gives 1 and above


class LinearSolver(Protocol):
    """name; negative: negative pivots of the last factor, -1 if unknown."""

    name: str
    negative: int

    def step(self, u: Array, q: Array, jump: Array, fresh: bool) -> Array | None:
        """Step du (n, 3), mm, from u (n, 3), q (m, 4), where held components move by `jump` (n, 3).

        fresh: whether the state has changed too much since the last step to use its factor again. None if it fails.
        Raises `LinearSolverError` for want of memory.
        """
