"""What a target is: a law in, the text of a file out, with a certificate in its header."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from importlib import metadata
from typing import ClassVar

import jinja2
import numpy as np

from calibrate.equations.deformation_modes import TITLES
from studies.errors import ExportError
from studies.exporters.certificate import Errors
from studies.exporters.material_law import STIFF, MaterialLaw
from studies.exporters.reference import point_tangent
from studies.output.words import percent


@dataclass(frozen=True)
class Volume:
    """Bulk modulus of kappa / 2 (J - 1)^2, and whether the test identified it."""

    bulk_modulus: float
    identified: bool


@dataclass(frozen=True)
class Exported:
    """A file's text, and how far it is from the model; errors is None where the code could not be run here."""

    text: str
    errors: Errors | None


class Target(ABC):
    """Base of the targets. name: of --to; file_name: of what is written; carries: what may be beside an energy of I1 and I2."""

    name: ClassVar[str]
    file_name: ClassVar[str]
    summary: ClassVar[str]
    comment: ClassVar[str]
    carries: ClassVar[frozenset[str]] = frozenset()
    compressible: ClassVar[bool] = True

    @abstractmethod
    def body(self, law: MaterialLaw, volume: Volume) -> str:
        """The file without its header."""

    @abstractmethod
    def errors(self, law: MaterialLaw, volume: Volume, body: str) -> Errors | None:
        """How far the written code is from the model; None where it cannot be run here."""

    def export(self, law: MaterialLaw, bulk_modulus: float | None = None) -> Exported:
        """The file. bulk_modulus: where none was identified (default: `STIFF` shear moduli). Raises `ExportError`."""
        self.refuse(law)
        volume = volume_of(law, bulk_modulus)
        body = self.body(law, volume)
        errors = self.errors(law, volume, body)
        head = "".join(f"{self.comment} {line}".rstrip() + "\n" for line in self.header(law, volume, errors))
        return Exported(head + body, errors)

    def refuse(self, law: MaterialLaw) -> None:
        """Raises `ExportError` naming what the target cannot carry."""
        wrong = [name for name in law.beside if name not in self.carries]
        if wrong:
            raise ExportError(
                f"{law.name}: '{self.name}' cannot carry {', '.join(wrong)}; {'export' if self.name != 'umat' else 'use'} --to umat, which does"
            )
        if law.bulk_modulus is not None and not self.compressible:
            raise ExportError(f"{law.name}: '{self.name}' cannot carry compressibility; export --to umat, which does")

    def header(self, law: MaterialLaw, volume: Volume, errors: Errors | None) -> list[str]:
        """Lines of the certificate."""
        return render(
            "exported_certificate.txt", law=law, volume=volume, errors=errors, target=self, version=version(),
            titles=TITLES, with_volume=self.compressible,
        ).splitlines()  # fmt: skip


def volume_of(law: MaterialLaw, bulk_modulus: float | None) -> Volume:
    """The bulk modulus to be written. Raises `ExportError` where one is given beside that of the model."""
    if law.bulk_modulus is not None:
        if bulk_modulus is not None:
            raise ExportError(
                f"{law.name}: has a bulk modulus of its own, {law.bulk_modulus:.4g} {law.unit}; leave out --bulk-modulus"
            )
        return Volume(law.bulk_modulus, True)
    return Volume(bulk_modulus or STIFF * initial_shear_modulus(law), False)


def initial_shear_modulus(law: MaterialLaw) -> float:
    """Of simple shear next to rest, in the unit of the law."""
    return float(point_tangent(law.stress, np.eye(2)[None] * (1 + 1e-6))[0, 0, 1, 0, 1])


def render(template: str, **values: object) -> str:
    """Text of a template of code."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("studies"), undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True,
    )  # fmt: skip
    environment.filters.update(percent=percent, fortran=fortran)
    environment.tests.update(
        power=lambda t: type(t).__name__ == "PowerTerm", spline=lambda t: type(t).__name__ == "SplineTerm"
    )
    return environment.get_template(template).render(**values)


def fortran(value: float) -> str:
    """A double-precision constant with every digit."""
    return f"{float(value):.17e}".replace("e", "D")


def version() -> str:
    """Of this package."""
    try:
        return metadata.version("equigap")
    except metadata.PackageNotFoundError:
        return "not installed"
