"""Named errors of the forward models: each message says what is wrong and what to do."""

from typing import Any


class ForwardError(Exception):
    """Base of every error of this package."""


class MaterialError(ForwardError, ValueError):
    """Parameters, or a model file, that make no material."""


class LoadingError(ForwardError, ValueError):
    """A loading that does not fit the mesh."""


class ConvergenceError(ForwardError, RuntimeError):
    """No equilibrium was found, even with the smallest load step. `solution`: the increments reached."""

    def __init__(self, message: str, solution: Any = None) -> None:
        super().__init__(message)
        self.solution = solution


class SolutionError(ForwardError, ValueError):
    """A solution or checkpoint file that is damaged or belongs to another problem."""


class CheckpointError(ForwardError, OSError):
    """A checkpoint that cannot be written; what was written before is whole."""


class LinearSolverError(ForwardError, RuntimeError):
    """The linear solver lacks memory, or its numbers are too short for the mesh."""


class MissingSolverError(ForwardError, RuntimeError):
    """DOLFINx or its PETSc is not installed."""


class FormsCacheError(ForwardError, RuntimeError):
    """The folder of compiled forms cannot be used."""
