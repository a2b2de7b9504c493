"""The preset of `equigap generalise`."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

from studies.grid.generalise.generalise_results import GeneraliseResults
from studies.grid.generalise.generalise_settings import MEASURED, MIDDLE, GeneraliseSettings
from studies.grid.generalise.report import page
from studies.grid.study import Preset

DEFAULT = GeneraliseSettings()
QUICK = replace(
    DEFAULT, truths=("carroll",), seeds=(0,), sets=("UT", "PS", "TTd", "UT+TTd"), sizes=((1,), MIDDLE), starts=4, nodes=800,
    increments=5, forward_size=1.0, as_width=False,
)  # fmt: skip
GENERALISE = Preset(DEFAULT, QUICK, page, GeneraliseResults, Path(__file__).with_name("generalise.smk"))


def measured(settings: GeneraliseSettings, specimens: Collection[str]) -> GeneraliseSettings:
    """The same study of tests that were measured: sets of these specimens, one seed (of the starts)."""
    sets = tuple(tests for tests in settings.sets if set(tests.split("+")) <= set(specimens))
    return replace(settings, truths=(MEASURED,), seeds=(0,), sets=sets)
