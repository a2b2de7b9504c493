"""Material cards for Abaqus and CalculiX: the nearest Yeoh, Ogden or Arruda-Boyce law, with its stress error in every mode."""

from __future__ import annotations

from abc import abstractmethod
from functools import partial

import numpy as np

from calibrate.equations.deformation_modes import TITLES
from studies.errors import ExportError
from studies.exporters.certificate import Errors, errors_of_stress
from studies.exporters.material_law import MaterialLaw
from studies.exporters.nearest_law import Nearest, nearest
from studies.exporters.target import Target, Volume


class Card(Target):
    """Card of the nearest law of the names in `laws`: of several, the one whose worst mode has the least error."""

    comment = "**"

    @property
    @abstractmethod
    def laws(self) -> tuple[str, ...]:
        """Names in `calibrate.models.classical_laws`."""

    def body(self, law: MaterialLaw, volume: Volume) -> str:
        found = self.found(law)
        head = [f"** {found.law.name} law; stress error over the largest stress of the mode"]
        head += [f"**   {TITLES[mode]}: {share:.2e}" for mode, share in found.errors.items()]
        return "\n".join([*head, "*MATERIAL, NAME=EQUIGAP", *_keyword(found, 2 / volume.bulk_modulus), ""])

    def errors(self, law: MaterialLaw, volume: Volume, body: str) -> Errors | None:
        found = self.found(law)
        stress = partial(found.law.stress, parameters=found.parameters)
        return errors_of_stress(law, stress, f"of the {found.law.name} law itself")

    def found(self, law: MaterialLaw) -> Nearest:
        """The law that is written: the nearest of those that are found. Raises `ExportError` where none is."""
        found: list[Nearest] = []
        for name in self.laws:
            try:
                found.append(nearest(law, name))
            except ExportError:
                if name == self.laws[-1] and not found:
                    raise
        return min(found, key=lambda one: one.worst)


class YeohCard(Card):
    """C10, C20, C30."""

    name, file_name = "yeoh", "yeoh.inp"
    laws = ("Yeoh",)
    summary = "material card (Abaqus, CalculiX): the nearest Yeoh law, with its error"


class OgdenCard(Card):
    """Two terms, mu and alpha each."""

    name, file_name = "ogden", "ogden.inp"
    laws = ("two-term Ogden",)
    summary = "the same with an Ogden law of two terms"


class ArrudaBoyceCard(Card):
    """mu and the locking stretch, the root of N."""

    name, file_name = "arruda-boyce", "arruda_boyce.inp"
    laws = ("Arruda-Boyce",)
    summary = "the same with an Arruda-Boyce law of five terms"


class BestCard(Card):
    """The nearest of the three."""

    name, file_name = "card", "card.inp"
    laws = ("Yeoh", "two-term Ogden", "Arruda-Boyce")
    summary = "the one of these three laws that is nearest in its worst mode"


def _keyword(found: Nearest, D: float) -> tuple[str, str]:
    """Keyword line and data line. D: 2 / bulk modulus, 1/MPa."""
    p = found.parameters
    if found.law.name == "Yeoh":
        return "*HYPERELASTIC, YEOH", _line(*p, D, 0.0, 0.0)
    if found.law.name == "Arruda-Boyce":
        return "*HYPERELASTIC, ARRUDA-BOYCE", _line(p[0], 1 / np.sqrt(p[1]), D)
    return "*HYPERELASTIC, OGDEN, N=2", _line(*p, D, 0.0)


def _line(*values: float) -> str:
    return ", ".join(f"{x:.12g}" for x in values)
