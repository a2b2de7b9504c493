"""A diagnosed trial against its label: the only place where both are open.

In: the folder of a trial. Out: `JudgedTrial`, which is kept as JSON and read back.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from calibrate.data.experiment import Experiment
from calibrate.data.triangulation import signed_areas
from calibrate.diagnosis.selection import Verdict
from calibrate.effects import CATALOGUE, Data
from calibrate.effects.support.stiffness_over_place import stiffness_over_place
from forward.sheet.damage_and_dispersion import TRIANGLE
from studies.errors import OptionError
from studies.trials.blind_case import GLOBAL_LIMIT
from studies.trials.blind_effects import ALSO
from studies.trials.foreign import FOREIGN, INCLUSION

Array = NDArray[np.float64]
DIGITS = 4  # of a probability that is kept
ALIKE = 0.9  # signatures above this correlation are look-alikes


@dataclass(frozen=True)
class JudgedAmplitude:
    """An effect that was hidden and is in the model. pulls: (fitted - true) / deviation of each amplitude."""

    true: dict[str, float]
    effect: str
    amplitudes: dict[str, float]
    deviations: dict[str, float]
    shape: dict[str, float]
    pulls: dict[str, float]


@dataclass(frozen=True)
class JudgedWithout:
    """The same test diagnosed without the hidden effect in the catalogue. partners: its look-alikes; wrong: other names. dominant: see `JudgedTrial`."""

    verdict: Verdict
    named: list[str]
    closest: list[str]
    wrong: list[str]
    partners: list[str]
    dominant: tuple[str, ...] = ()


@dataclass(frozen=True)
class JudgedTrial:
    """What was hidden beside what was said of it.

    hit, exact: of each hidden effect, whether its group, and it itself, is named; `blind_effects.ALSO` counts as its name. scores: of each before anything is found;
    beside: with the other one in the model. strong: the lesser of these is above `GLOBAL_LIMIT`. field: correlation of
    fitted and hidden stiffness over the specimen. probabilities: of every effect in the catalogue that has one above zero; None where explanations were not
    fitted. replaced: what the rounds had found before a more probable explanation took its place. seconds: CPU time. dominant: the dominant effect of what is not explained and those that leave little more.
    """

    trial: str
    hidden: list[str]
    verdict: Verdict
    named: list[str]
    closest: list[str]
    scores: dict[str, float]
    strong: bool
    hit: list[bool]
    exact: list[bool]
    amplitudes: list[JudgedAmplitude | None]
    field: list[float | None]
    seconds: float
    beside: dict[str, float] | None = None
    absent: JudgedWithout | None = None
    dominant: tuple[str, ...] = ()
    probabilities: dict[str, float] | None = None
    replaced: list[str] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Plain data, without what was not done."""
        return {k: v for k, v in asdict(self).items() if v is not None}


_LIST = TypeAdapter(list[JudgedTrial])


def read(path: Path) -> list[JudgedTrial]:
    """Judged trials of a JSON file. Raises `OSError`, `ValueError`."""
    return _LIST.validate_json(path.read_bytes())


def judge(home: Path) -> JudgedTrial:
    """Compare a diagnosis with its label."""
    label = json.loads((home / "sealed" / "label.json").read_text())
    content = json.loads((home / "diagnosis.json").read_text())
    full, hidden = content["full"], label["effects"]
    names = [h["name"] for h in hidden]
    first = full["rounds"][0]["scores"]
    scores = {n: first.get(n, {}).get("score", 0.0) for n in names}
    file = home / "sealed" / "beside.json"
    beside = json.loads(file.read_text()) if file.exists() else None
    groups = [set(_as_hidden([n, *full["groups"].get(n, [])], names)) for n in full["named"]]
    named = _as_hidden(full["named"], names)
    return JudgedTrial(
        trial=home.name,
        hidden=names,
        verdict=Verdict(full["verdict"]),
        named=named,
        closest=_as_hidden(full["closest"], names),
        scores=scores,
        beside=beside,
        strong=bool(names) and min((beside or scores).values()) > GLOBAL_LIMIT,
        hit=[any(n in group for group in groups) for n in names],
        exact=[n in named for n in names],
        amplitudes=[None if _is_foreign(h, label) else judged_amplitude(h, full["additions"]) for h in hidden],
        field=[_field(h, full["additions"], home) for h in hidden],
        seconds=content["seconds"],
        absent=_without(content["absent"], first.get(names[0], {}).get("like", {})) if "absent" in content else None,
        dominant=tuple(_as_hidden(_dominant(full), names)),
        probabilities=_probabilities(full.get("probabilities"), full.get("together", {}), names),
        replaced=None if full.get("replaced") is None else _as_hidden(full["replaced"], names),
    )


def _as_hidden(found: Sequence[str], hidden: Sequence[str]) -> list[str]:
    """Names with those that are as right as a hidden effect's under that one's name."""
    also = {other: name for name in hidden for other in ALSO.get(name, ())}
    return list(dict.fromkeys(also.get(name, name) for name in found))


def _probabilities(
    found: Mapping[str, float] | None, together: Mapping[str, float], hidden: Sequence[str]
) -> dict[str, float] | None:
    """By names as `_as_hidden` gives them. together: of one or another effect that counts under the name; where it was not kept, the largest of theirs."""
    if not found:
        return None
    result: dict[str, float] = {}
    for name, p in found.items():
        (known,) = _as_hidden([name], hidden)
        result[known] = max(result.get(known, 0.0), p)
    result |= {name: p for name, p in together.items() if name in hidden}
    return {name: round(p, DIGITS) for name, p in result.items() if round(p, DIGITS) > 0}


def _is_foreign(hidden: Mapping[str, Any], label: Mapping[str, Any]) -> bool:
    """Whether its form is none of the catalogue, so that amplitudes cannot be compared."""
    return label.get("foreign") is not None and hidden["name"] in FOREIGN


def _without(content: Mapping[str, Any], alike: Mapping[str, float]) -> JudgedWithout:
    partners = sorted(name for name, value in alike.items() if value > ALIKE)
    wrong = [name for name in content["named"] if name not in partners]
    return JudgedWithout(
        Verdict(content["verdict"]), content["named"], content["closest"], wrong, partners, _dominant(content)
    )


def _dominant(content: Mapping[str, Any]) -> tuple[str, ...]:
    """The dominant effect, then those that leave little more; none where there is none."""
    found = content.get("dominant")
    return () if found is None else (found["effect"], *found["like"])


def _field(hidden: Mapping[str, Any], additions: Sequence[Mapping[str, Any]], home: Path) -> float | None:
    """Correlation of fitted and hidden stiffness over the specimen, by area; a patch has no coefficients of cosines."""
    name = hidden["name"]
    fitted = next((a for a in additions if a["effect"] in (name, *ALSO.get(name, ()))), None)
    if fitted is None or "height" not in hidden["more"]:
        return None
    e = Experiment.load(home / "experiment.npz")
    effect = next(one for one in CATALOGUE if one.name == fitted["effect"])
    amplitudes, shape = (np.array(list(fitted[k].values())) for k in ("amplitudes", "shape"))
    seen = stiffness_over_place(Data.of(e), len(e.triangles), [(effect, amplitudes, shape)])
    true = hidden_stiffness(hidden["more"], e.points[e.triangles].mean(axis=1))
    spread = np.cov(np.asarray(seen), true, aweights=np.abs(signed_areas(e.points, e.triangles)))
    return float(spread[0, 1] / np.sqrt(spread[0, 0] * spread[1, 1]))


def hidden_stiffness(patch: Mapping[str, float], places: Array) -> Array:
    """Of a patch, or an inclusion in its place, beside the rest (m,) at places (m, 2), mm."""
    apart = places - [patch["x"], patch["y"]]
    if "aspect" in patch or "sides" in patch:
        raise OptionError(
            "the label has an elliptic or rectangular inclusion in the place of a field, which foreign trials no longer hide; judge it with the version that made it"
        )
    if "slender" not in patch:
        return patch["height"] * np.exp(-(apart**2).sum(axis=1) / (2 * patch["width"] ** 2))
    along, across = (
        apart @ [np.cos(patch["tip"]), np.sin(patch["tip"])],
        apart @ [-np.sin(patch["tip"]), np.cos(patch["tip"])],
    )
    long, short = (INCLUSION * patch["width"] * patch["slender"] ** power for power in (0.5, -0.5))
    sides = [np.cos(angle) * along / long + np.sin(angle) * across / short for angle in np.pi / 3 * np.array([1, 3, 5])]
    inside = np.asarray(np.max(sides, axis=0) <= TRIANGLE, float)
    return np.asarray(patch["height"] * inside)


def judged_amplitude(hidden: Mapping[str, Any], additions: Sequence[Mapping[str, Any]]) -> JudgedAmplitude | None:
    """Of an effect that is in the model, else None."""
    for addition in additions:
        if addition["effect"] == hidden["name"]:
            pulls = {
                name: (addition["amplitudes"][name] - true) / max(addition["deviations"][name], 1e-300)
                for name, true in hidden["amplitudes"].items()
                if name in addition["amplitudes"]
            }
            return JudgedAmplitude(true=hidden["amplitudes"], pulls=pulls, **addition)
    return None
