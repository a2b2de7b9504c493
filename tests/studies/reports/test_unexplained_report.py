"""The whole report of a test whose effect is in no catalogue: a second invariant, beside a catalogue without it. Every model that was replayed is drawn, written and said."""

from __future__ import annotations

import json
from functools import cache

import pytest
from discoveries import sheet

from calibrate.diagnosis.discovery import discover
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.replayed.few_effects import FewEffects
from calibrate.diagnosis.selection import Discovery, Verdict
from calibrate.effects import CATALOGUE
from calibrate.models.extended_model import ExtendedModel
from studies.output import Manifest
from studies.replay.replay_check import FiniteElementCheck
from studies.reports.discovery import report
from studies.reports.discovery.discovery_findings import remarks
from studies.reports.discovery.model_files import extended, unexplained
from studies.reports.discovery.view import View

NAMES = {"stiffness gradient", "compressibility", "image rotation"}
RECORD = dict.fromkeys(("command", "settings", "inputs", "versions", "revision"), "of a test")


@cache
def unknown() -> Discovery:
    """Of a plate whose c01 is as large as its c10."""
    effects = [effect for effect in CATALOGUE if effect.name in NAMES]
    return discover([sheet(0.1)], HoldOut("every", 3), effects=effects, check=FiniteElementCheck())


def test_no_effect_is_named_and_few_effects_have_the_probability_of_none():
    """None of the three does what the second invariant does."""
    found = unknown()
    assert found.verdict is Verdict.NOT_EXPLAINED and found.named == ()
    assert isinstance(found.few, FewEffects) and found.few.best is None
    assert sum(p for _, p in found.few.sets) == pytest.approx(1.0, abs=0.05)
    assert max(found.few.inclusion.values()) < 0.5


def test_every_replayed_model_is_drawn_and_written(tmp_path):
    found = unknown()
    view, models = View(found, "every third increment"), unexplained(found, "every:3", RECORD)
    assert set(models) == {"model_few_effects.json", "model_neo_hooke.json"}
    path = report.write(tmp_path, view, extended(found, "every:3", RECORD), Manifest(0, {}), models)
    assert "Few effects by the fields of replays" in path.read_text()
    assert (tmp_path / "replayed_forces.png").exists()
    assert "few effects" in (tmp_path / "replayed_forces.csv").read_text()
    record = json.loads((tmp_path / "discovery.json").read_text())["few_effects"]
    assert record["inclusion"] == pytest.approx(found.few.inclusion)
    model = ExtendedModel.load(tmp_path / "model_few_effects.json")
    assert model.additions == () and model.c[0] == pytest.approx(record["models"][0]["replay"]["final"]["level"] * found.few.models[0].usable.c[0])  # fmt: skip
    assert "R619" in {one.alert.code for one in remarks(view)}
