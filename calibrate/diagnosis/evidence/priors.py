"""Priors of amplitudes: a table that users can edit, in the units of a test.

In: a TOML file (`priors.toml` here), an Experiment, the shear modulus of the base. Out: a standard deviation for every amplitude.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.data.experiment import Experiment
from calibrate.effects import CATALOGUE, Effect
from meshes.mesh import spacing_of

Array = NDArray[np.float64]
FILE = Path(__file__).with_name("priors.toml")
FAR = 3.0  # standard deviations that no amplitude should be beyond
SHEET = 2.0  # mm, where the thickness is unknown
KEYS = {"std", "of", "why"}


@dataclass(frozen=True)
class Prior:
    """std: standard deviation, in units of `of` ('' is the unit of the amplitude). why: where it comes from."""

    std: float
    of: str
    why: str


@dataclass(frozen=True)
class Scales:
    """What priors may be multiples of, in one test: MPa, N, mm, s; duration is NaN without times."""

    modulus: float
    force: float
    spacing: float
    thickness: float
    duration: float

    @classmethod
    def of_test(cls, experiment: Experiment, modulus: float) -> Scales:
        """modulus: shear modulus of the base, MPa."""
        spacing = spacing_of(experiment.points)
        forces = np.concatenate([np.abs(boundary.force).ravel() for boundary in experiment.loaded])
        force = float(np.nanmax(forces)) if np.isfinite(forces).any() else np.nan
        duration = np.nan if experiment.time is None or not experiment.time[-1] > 0 else float(experiment.time[-1])
        return cls(modulus, force, spacing, experiment.thickness or SHEET, duration)

    def size(self, of: str) -> float:
        """One of what priors may be multiples of."""
        return self._sizes[of]

    @property
    def _sizes(self) -> dict[str, float]:
        return {
            "": 1.0,
            "modulus": self.modulus,
            "1/modulus": 1 / self.modulus,
            "force": self.force,
            "spacing": self.spacing,
            "spacing^2": self.spacing**2,
            "thickness^2/12": self.thickness**2 / 12,
            "duration": self.duration,
            "1/duration": 1 / self.duration,
            "force/duration": self.force / self.duration,
        }


UNITS = {
    "modulus": "MPa", "1/modulus": "1/MPa", "force": "N", "force/duration": "N/s", "spacing": "mm", "spacing^2": "mm^2", "thickness^2/12": "mm^2",
    "duration": "s", "1/duration": "1/s",
}  # fmt: skip
Priors = Mapping[str, Prior]


def read_priors(path: str | Path | None = None) -> dict[str, Prior]:
    """{name of an effect: its prior}; what a file does not name is as in `priors.toml`.

    Raises `DataNotFoundError`, and `ConfigError` with file and key for what is no prior.
    """
    standard = _table(FILE)
    return standard if path is None else standard | _table(Path(path))


def _table(path: Path) -> dict[str, Prior]:
    if not path.is_file():
        wrong = "is a folder" if path.is_dir() else "no such file"
        raise errors.DataNotFoundError(f"{path}: {wrong}; copy {FILE} and edit it")
    try:
        table = tomllib.loads(path.read_text())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise errors.ConfigError(f"{path}: no TOML file ({error})") from None
    return {name: _prior(path, name, entry) for name, entry in table.items()}


def _prior(path: Path, name: str, entry: object) -> Prior:
    known = {effect.name: effect for effect in CATALOGUE}
    if name not in known:
        raise errors.ConfigError(f"{path}: no effect is named '{name}'; choose from {', '.join(sorted(known))}")
    if not isinstance(entry, dict) or set(entry) - KEYS:
        raise errors.ConfigError(
            f"{path}: ['{name}'] may have the keys {', '.join(repr(key) for key in sorted(KEYS))}, and no others"
        )
    if "std" not in entry:
        raise errors.ConfigError(f"{path}: ['{name}'] has no std; give its standard deviation")
    std, of = entry["std"], entry.get("of", "")
    if isinstance(std, bool) or not isinstance(std, int | float) or not 0 < std < np.inf:
        raise errors.ConfigError(f"{path}: ['{name}'] std = {std!r} is not a positive number")
    if of and of not in UNITS:
        raise errors.ConfigError(f"{path}: ['{name}'] of = {of!r} is none of {', '.join(sorted(UNITS))}")
    unit = known[name].amplitudes[0].unit
    if of and UNITS[of] != unit:
        fitting = ", ".join(f"of = {one!r}" for one in UNITS if UNITS[one] == unit) or "no 'of'"
        raise errors.ConfigError(
            f"{path}: ['{name}'] of = {of!r} is in {UNITS[of]}, its amplitude in {unit}; give {fitting}"
        )
    return Prior(float(std), of, str(entry.get("why", "")))


def deviations(effect: Effect, priors: Priors, scales: Iterable[Scales]) -> Array:
    """Standard deviation of every amplitude (p,), the largest of several tests; that of a strong effect where nothing is known of it."""
    typical = np.array([parameter.typical for parameter in effect.amplitudes])
    prior = priors.get(effect.name)
    if prior is None:
        return typical
    sizes = np.array([one.size(prior.of) for one in scales])
    size = float(np.nanmax(sizes)) if np.isfinite(sizes).any() else np.nan
    return np.full(len(typical), prior.std * size) if np.isfinite(size) and size > 0 else typical
