"""What is held out to confirm a fit: the one rule and the one parser of the project.

In: words such as ``every:3``. Out: `HoldOut`, which says which increments and which equations of an Experiment are used for fitting.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.data.experiment import Experiment
from calibrate.equations.equilibrium import Equilibrium

Mask = NDArray[np.bool_]
SHARE = 0.3  # of the increments, where a share is not given
ORDINALS = {"2": "second", "3": "third"}
SIDES = ("left", "right", "bottom", "top")
HELP = "every:N (each N-th increment, N > 1), after:SECONDS, half:left|right|bottom|top, last[:SHARE], random[:SHARE], or none"


class Kind(StrEnum):
    """How what is held out is chosen."""

    EVERY = "every"
    AFTER = "after"
    HALF = "half"
    LAST = "last"
    RANDOM = "random"
    NONE = "none"


@dataclass(frozen=True)
class HoldOut:
    """Which equations are held out. value: n of each n-th increment; a time, s; a side of the specimen; a share of the increments.

    seed: of the random choice.
    """

    kind: Kind = Kind.EVERY
    value: int | float | str | None = 3
    seed: int = 0

    @classmethod
    def parse(cls, text: str, seed: int = 0) -> HoldOut:
        """'every:3', 'after:15', 'half:left', 'last', 'random:0.3' or 'none'. Raises `ConfigError`."""
        word, _, value = text.partition(":")
        try:
            return cls(Kind(word), _value(Kind(word), value), seed)
        except ValueError:
            raise errors.ConfigError(f"--hold-out {text}: give {HELP}; SHARE is between 0 and 1, such as 0.3") from None

    @classmethod
    def default(cls, fewest_increments: int, other_tests: bool) -> HoldOut:
        """Every third increment; nothing where another test is held out, or one has fewer than three increments."""
        return cls(Kind.NONE, None) if other_tests or fewest_increments < 3 else cls()

    def __str__(self) -> str:
        value = self.value
        match self.kind:
            case Kind.EVERY:
                return f"every {ORDINALS.get(str(value), f'{value}th')} increment"
            case Kind.AFTER:
                return f"increments after {value} s"
            case Kind.HALF:
                return f"virtual fields in the {value} half"
            case Kind.LAST | Kind.RANDOM:
                return f"{100 * float(value or 0.0):g} % of the increments, {'the last' if self.kind == Kind.LAST else 'at random'}"
        return "nothing"

    def increments(self, experiment: Experiment) -> Mask:
        """Increments (t,) that are used for fitting; all for the kind 'half'. Raises `ConfigError` where none or all would be."""
        fitted = self.fitted(experiment)
        if not fitted.any():
            raise errors.ConfigError(
                f"{experiment.name}: holding out {self} leaves nothing to fit{_span(experiment)}; use none, or another rule"
            )
        if fitted.all() and self.kind not in (Kind.NONE, Kind.HALF):
            raise errors.ConfigError(
                f"{experiment.name}: of {experiment.n_increments} increments, holding out {self} holds out nothing{_span(experiment)}; "
                "use every:N with a smaller N, an earlier time, or none where nothing has to be judged"
            )
        return fitted

    def fitted(self, experiment: Experiment) -> Mask:
        """The same where none or all may be; between pictures those whose pictures are. Raises `ConfigError` without the time that the rule needs."""
        if experiment.interpolated is not None:
            of_pictures = self.fitted(experiment.select(experiment.pictures))
            return np.asarray(((experiment.interpolated > 0) <= of_pictures).all(axis=1))
        n = experiment.n_increments
        fitted = np.ones(n, bool)
        match self.kind:
            case Kind.EVERY:
                fitted[_every(int(self.value or 0), n) :: int(self.value or 0)] = False
            case Kind.AFTER:
                if experiment.time is None:
                    raise errors.ConfigError(f"{experiment.name}: --hold-out after:SECONDS needs a time; use every:N")
                fitted[experiment.time > float(self.value or 0.0)] = False
            case Kind.LAST | Kind.RANDOM:
                fitted[self._share(n)] = False
        return fitted

    def training(self, system: Equilibrium) -> Mask:
        """Equations (t, 2 v) that are used for fitting. Raises `ConfigError` when none or all are left."""
        mask = np.repeat(self.increments(system.experiment)[:, None], system.loads.shape[1], axis=1)
        mask |= system.level_equation  # without it, no stiffness at all meets the others best
        if self.kind != Kind.HALF:
            return mask
        mask[:, np.tile(self._half(system), 2)] = False
        if not mask.any() or mask.all():
            raise errors.ConfigError(
                f"{system.experiment.name}: holding out {self} leaves nothing to fit, or nothing to hold out; "
                "use none, or another rule"
            )
        return mask

    def _share(self, n: int) -> NDArray[np.int_]:
        """Numbers of the last increments, or of random ones; at least one is left on either side. Raises `ConfigError`."""
        if n < 2:
            raise errors.ConfigError("--hold-out needs at least 2 increments; this experiment has 1")
        size = min(max(round(float(self.value or 0.0) * n), 1), n - 1)
        if self.kind == Kind.LAST:
            return np.arange(n - size, n)
        return np.random.default_rng(self.seed).permutation(n)[:size]

    def _half(self, system: Equilibrium) -> Mask:
        """Virtual fields (v,) without a load in one half of the specimen."""
        points = system.experiment.points
        axis = 0 if self.value in ("left", "right") else 1
        weight = system.fields.values / np.asarray(system.fields.values.sum(axis=0)).ravel()
        place = weight.T @ points[:, axis] - 0.5 * (points[:, axis].min() + points[:, axis].max())
        away = (place < 0) == (self.value in ("left", "bottom"))
        return np.asarray(away & (system.fields.boundary < 0))


def _value(kind: Kind, text: str) -> int | float | str | None:
    """What follows the colon. Raises ValueError."""
    match kind:
        case Kind.EVERY if int(text) > 1:
            return int(text)
        case Kind.AFTER if np.isfinite(float(text)):
            return float(text)
        case Kind.HALF if text in SIDES:
            return text
        case Kind.LAST | Kind.RANDOM if not text or 0 < float(text) < 1:
            return float(text) if text else SHARE
        case Kind.NONE if not text:
            return None
    raise ValueError(text)


def _every(value: int, n: int) -> int:
    """First increment held out of each `value`; the last one, often the largest, is used."""
    first = value - 2
    return (first + 1) % value if (n - 1 - first) % value == 0 else first


def _span(experiment: Experiment) -> str:
    """' (its times are 1.4 to 37.8 s)'; nothing where it has none."""
    time = experiment.time
    return "" if time is None else f" (its times are {time[0]:.4g} to {time[-1]:.4g} s)"
