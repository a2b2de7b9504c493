"""The design file: machine, sheet, camera, law and specimens as TOML in, a checked `Plan` out (docs/design.md).

Unknown keys are refused with the nearest known one. Lengths in mm, forces in N, stresses in MPa.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PositiveFloat,
    PositiveInt,
    ValidationError,
    field_validator,
    model_validator,
)

from calibrate.equations.deformation_modes import MODES
from forward.errors import MaterialError
from forward.materials import MATERIALS, Material, material_from_dict
from forward.materials.network_energy import Pann
from meshes import Specimen, specimen_from_dict
from meshes.errors import SpecimenError
from meshes.known_specimens import SPECIMENS
from studies.commandline.option_types import nearest
from studies.errors import DesignError

OPTIMISED = "optimised"  # the result of a search
STRETCHES = {"uniaxial": 2.0, "equibiaxial": 1.6, "pure_shear": 1.9}
Range = Annotated[tuple[float, float], Field(strict=False)]
AXES = {"left": 0, "right": 0, "bottom": 1, "top": 1}


def file_name(title: str) -> str:
    """A title as part of a file name."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in title)


class Table(BaseModel):
    """A table of the TOML file: no other keys, and no value is converted but a whole number to a float."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class MachineTable(Table):
    """[machine]: axes: 1 of a tensile, 2 of a biaxial machine. largest_force_N: of a grip. largest_displacement_mm: of each grip.
    force_noise: half width of the uniform relative error of a force. clamped_mm: length that a grip holds."""

    axes: Literal[1, 2] = 2
    largest_force_N: PositiveFloat = 100.0
    largest_displacement_mm: PositiveFloat = 100.0
    force_noise: PositiveFloat = 1e-3
    clamped_mm: PositiveFloat = 20.0


class SheetTable(Table):
    """[sheet]: what is cut. largest_stretch: at which the material tears. least_ligament_mm: between holes and edges."""

    thickness_mm: PositiveFloat = 1.0
    largest_stretch: float = Field(default=3.5, gt=1)
    least_ligament_mm: PositiveFloat = 3.0


class CameraTable(Table):
    """[camera]: it zooms until the stretched specimen fills its square field. noise and correlation_length: of the displacements, over
    the side of the field. points: in the whole field. pictures: of a test. smallest_field_mm, largest_field_mm: what the lens allows."""

    noise: PositiveFloat = 5e-4
    correlation_length: PositiveFloat = 0.02
    points: PositiveInt = 5000
    pictures: PositiveInt = 8
    smallest_field_mm: PositiveFloat = 40.0
    largest_field_mm: PositiveFloat = 400.0


class LawTable(Table):
    """[law]: expected. material: by name, or a model file. parameters: others than the material's usual ones. deviation: standard deviation,
    in shares of half the shear modulus, by which the energy's derivatives may differ from it (the prior). correlation_length: of these
    differences, over the range of sqrt(I - 3). knots: of each invariant."""

    material: str = "arruda_boyce"
    parameters: dict[str, float] = Field(default_factory=dict)
    deviation: PositiveFloat = 0.5
    correlation_length: PositiveFloat = 0.3
    knots: int = Field(default=14, ge=2)

    def read(self) -> Material:
        """The expected law. Raises `MaterialError`, `DesignError`."""
        if self.material.endswith(".json"):
            return Pann.from_file(self.material)
        if self.material not in MATERIALS:
            raise DesignError(
                f"[law] material '{self.material}' is unknown; choose from {', '.join(MATERIALS)} or a model .json"
            )
        return material_from_dict({"material": self.material, **self.parameters})


class SpecimenTable(Table):
    """[[specimen]]: kind: as in `equigap specimens`; dimensions: others than its usual ones, mm. tested: its data exist already, so
    that all others are judged by what they add."""

    kind: str
    name: str = ""
    dimensions: dict[str, Any] = Field(default_factory=dict)
    tested: bool = False

    @property
    def title(self) -> str:
        """By which it is called."""
        return self.name or self.kind

    def read(self) -> Specimen:
        """The specimen. Raises `SpecimenError`."""
        return specimen_from_dict({"specimen": self.kind, **self.dimensions})


class OptimiseTable(Table):
    """[optimise]: a kind of specimen, dimensions that are fixed, and ranges of those that are sought, {name: [low, high]}, mm or
    rad; 'perforation.0.y' is the y of the first hole. evaluations: at most."""

    kind: str
    dimensions: dict[str, Any] = Field(default_factory=dict)
    between: dict[str, Range]
    evaluations: PositiveInt = 80
    seed: int = 0

    @field_validator("between")
    @classmethod
    def _ranges(cls, between: dict[str, Range]) -> dict[str, Range]:
        for name, (low, high) in between.items():
            if not low < high:
                raise ValueError(f"{name}: {low:g} is not below {high:g}")
        if not between:
            raise ValueError("give at least one dimension with its range")
        return between


class ValidationTable(Table):
    """[validation]: truth: material of the simulated tests, by name, with its parameters; seeds: of the camera's noise."""

    truth: str = "carroll"
    parameters: dict[str, float] = Field(default_factory=dict)
    seeds: PositiveInt = 5

    def read(self) -> Material:
        """The true law. Raises `MaterialError`."""
        return material_from_dict({"material": self.truth, **self.parameters})


class Plan(Table):
    """The whole file. stretches: up to which the stress of each mode shall be predicted."""

    machine: MachineTable = MachineTable()
    sheet: SheetTable = SheetTable()
    camera: CameraTable = CameraTable()
    law: LawTable = LawTable()
    stretches: dict[str, float] = Field(default_factory=lambda: dict(STRETCHES))
    specimen: tuple[SpecimenTable, ...] = Field(strict=False)
    optimise: OptimiseTable | None = None
    validation: ValidationTable = ValidationTable()
    size_factor: PositiveFloat = 1.5

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        titles = [s.title for s in self.specimen]
        twice = {title for title in titles if titles.count(title) > 1}
        if twice:
            raise ValueError(f"specimen '{min(twice)}' is there twice; give each a name of its own")
        if not titles:
            raise ValueError("there is no [[specimen]] to choose from")
        files = {OPTIMISED: "the result of [optimise]"} if self.optimise else {}
        for title in titles:
            other = files.setdefault(file_name(title), f"'{title}'")
            if other != f"'{title}'":
                raise ValueError(f"specimen '{title}' would have the files of {other}; give it another name")
        if not self.stretches:
            raise ValueError(f"stretches: there is none; give stretches above 1 of {', '.join(MODES)}, or leave it out")
        for mode, stretch in self.stretches.items():
            if mode not in MODES or not stretch > 1:
                raise ValueError(f"stretches: {mode} = {stretch:g}; give stretches above 1 of {', '.join(MODES)}")
        for kind in [s.kind for s in self.specimen] + ([self.optimise.kind] if self.optimise else []):
            if kind not in SPECIMENS:
                raise ValueError(
                    f"specimen '{kind}' is unknown{nearest(kind, SPECIMENS)}; choose from {', '.join(SPECIMENS)}"
                )
        return self


def read_plan(path: str | Path) -> Plan:
    """Read a design file. Raises `DesignError` that names the file, the key and what is wrong with it."""
    try:
        content = tomllib.loads(Path(path).read_text())
    except OSError as error:
        raise DesignError(f"{path}: {error.strerror}; name a design file (docs/design.md has one)") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise DesignError(f"{path}: no valid TOML ({error})") from error
    return checked(content, str(path))


def checked(content: Mapping[str, Any], source: str) -> Plan:
    """A plan from the content of a design file. Raises `DesignError`."""
    try:
        plan = Plan.model_validate(content)
        plan.law.read()
        for specimen in plan.specimen:
            specimen.read()
    except ValidationError as error:
        raise DesignError(f"{source}: {'; '.join(_complaint(item) for item in error.errors())}") from error
    except SpecimenError as error:
        raise DesignError(f"{source}: {error}") from error
    try:
        plan.validation.read()
    except MaterialError as error:
        raise DesignError(f"{source}: [validation] truth: {error}") from error
    return plan


def _complaint(item: Mapping[str, Any]) -> str:
    """One of pydantic's errors in a line: where, what, and the nearest key."""
    place = ".".join(str(part) for part in item["loc"])
    if item["type"] != "extra_forbidden":
        return f"{place or 'file'}: {item['msg'].removeprefix('Value error, ')}"
    return f"{place}: unknown key{nearest(str(item['loc'][-1]), _keys())}"


def _keys() -> list[str]:
    tables = (Plan, MachineTable, SheetTable, CameraTable, LawTable, SpecimenTable, OptimiseTable, ValidationTable)
    return sorted({name for table in tables for name in table.model_fields})
