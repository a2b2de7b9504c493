"""Explanations that a test could not tell apart: a ``discovery.json`` in, `Rivals` out."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calibrate import errors
from calibrate.diagnosis.evidence.explanations import TIE, UNKNOWN
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Additions
from calibrate.models.addition_json import addition_from_dict
from studies.output.words import Words

WORDS = Words("decide")
AGAIN = "run equigap discover again with this version"


@dataclass(frozen=True, eq=False)
class Rivals:
    """truth: effects as they were fitted, taken as right; others: names of those that could as well be; either may be no effect at all. now: ln evidence of the one against the other in
    the test that was made, None where the other was not weighed."""

    truth: Additions
    others: tuple[str, ...]
    now: float | None

    @property
    def names(self) -> tuple[str, ...]:
        """Of what is taken as right."""
        return tuple(a.effect.name for a in self.truth)

    @property
    def text(self) -> str:
        """'viscoelasticity against lag between force and image'."""
        return WORDS.rivals(names=self.names, others=self.others)


@dataclass(frozen=True, eq=False)
class Undecided:
    """What a diagnosis left open. modulus: shear modulus of its base, MPa or N/mm; duration: of its longest test, s, None without times; unknown: whether
    something in no catalogue is the most probable."""

    rivals: tuple[Rivals, ...]
    modulus: float
    duration: float | None
    unknown: bool = False


def read(path: Path) -> Undecided:
    """Of the ``discovery.json`` of `equigap discover`, or of the folder that holds it.

    Raises `DataNotFoundError`, `FileFormatError` for another file, `ConfigError` where the explanations were not fitted.
    """
    path = path / "discovery.json" if path.is_dir() else path
    if not path.is_file():
        raise errors.DataNotFoundError(
            f"{path}: no such file; give the folder of equigap discover, or its discovery.json"
        )
    try:
        content = json.loads(path.read_text())
        if content["format"] != "equigap-discovery":
            raise KeyError("format")
        evidence, modulus, duration = content["evidence"], float(content["modulus"]), content["duration_s"]
        if evidence is not None and evidence["fitted"]:
            return Undecided(tuple(_rivals(evidence)), modulus, duration, evidence["not_in_catalogue"] > UNKNOWN)
    except (ValueError, KeyError, TypeError, UnicodeDecodeError) as error:
        raise errors.FileFormatError(f"{path}: no discovery.json of this version ({error!r}); {AGAIN}") from None
    if content["verdict"] == "nothing significant":
        return Undecided((), modulus, duration)
    raise errors.ConfigError(f"{path}: its explanations were not fitted; run equigap discover without --quick")


def _rivals(evidence: Mapping[str, Any]) -> Iterator[Rivals]:
    """Pairs of explanations of more than `TIE`, then effects that lie in the span of another; each pair once for either taken as right."""
    known = {effect.name for effect in CATALOGUE}
    likely = [one for one in evidence["explanations"] if not one["not_in_catalogue"] and one["probability"] > TIE]
    seen = set()
    for one in likely:
        truth = tuple(addition_from_dict(a)[0] for a in one["additions"])
        if one["effects"] and not truth:
            continue
        others = [
            (tuple(other["effects"]), one["log_evidence"] - other["log_evidence"])
            for other in likely
            if other is not one
        ]
        names = tuple(a.effect.name for a in truth)
        for name in names:
            alike = (like for like in evidence["spanned_by"].get(name, ()) if like in known and like not in names)
            others += [(tuple(like if n == name else n for n in names), None) for like in alike]
        for other, now in others:
            key = (frozenset(names), frozenset(other))
            if key not in seen:
                seen.add(key)
                yield Rivals(truth, other, now)
