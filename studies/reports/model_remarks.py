"""What a model file says of its own model, which whatever reads it repeats: a model in, findings out."""

from __future__ import annotations

from pathlib import Path

from calibrate.models.extended_model import ExtendedModel
from calibrate.models.fitness import Use
from calibrate.models.model_file import load_model
from calibrate.models.network_model import Model
from studies.output.findings import Finding, Macro


class ModelRemark(Macro):
    """Macros of ``templates/prediction.txt``."""

    FITNESS = "fitness"
    NOMINAL_LEVEL = "nominal_level"


def model_remarks(model: Model | ExtendedModel) -> list[Finding]:
    """The verdict of the fit, where it is not plainly usable, and a nominal level."""
    found = []
    fitness = model.fitness
    if fitness is not None and fitness.verdict is not Use.USABLE:
        data = {"verdict": fitness.verdict, "reasons": list(fitness.reasons)}
        found.append(Finding("prediction", ModelRemark.FITNESS, data, fitness.verdict is Use.NOT))
    if model.level_is_nominal:
        found.append(Finding("prediction", ModelRemark.NOMINAL_LEVEL))
    return found


def remarks_of_file(name: str) -> list[Finding]:
    """Of a model file, or none of the name of a known material. Raises `DataNotFoundError`, `ModelFileError`."""
    return model_remarks(load_model(Path(name))) if name.endswith(".json") else []
