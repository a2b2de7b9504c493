"""One front for model files of every kind: the network of a calibration, or the extended model of a diagnosis."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from calibrate.models.extended_model import ExtendedModel
from calibrate.models.json_file import Format, read_model
from calibrate.models.network_model import Model


def load_model(path: str | Path) -> Model | ExtendedModel:
    """The model in a file, by its 'format'. Raises `DataNotFoundError`, `ModelFileError` naming the key that is wrong."""
    formats: tuple[Format[Any], ...] = (Model.file_format(), ExtendedModel.file_format())
    return read_model(path, *formats)
