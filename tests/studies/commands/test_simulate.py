"""`equigap simulate` and `equigap specimens`: small runs, and wrong options."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from calibrate.data.experiment import Experiment
from studies import cli

SMALL = ["--specimen", "strip", "--size-factor", "2", "--increments", "2", "--nodes", "300", "--quick"]


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulate") / "out"
    assert cli.main(["simulate", *SMALL, "-o", str(folder), "--seed", "4"]) == 0
    return folder


def test_leaves_an_experiment_with_its_record(simulated: Path) -> None:
    experiment = Experiment.load(simulated / "experiment.npz")
    assert {b.name for b in experiment.loaded} == {"left", "right"}
    assert experiment.n_increments == 2
    assert experiment.noise is not None
    assert experiment.noise.displacement_std == pytest.approx(0.1)
    manifest = json.loads((simulated / "experiment.json").read_text())
    assert manifest["seed"] == 4
    assert manifest["settings"]["material"]["material"] == "arruda_boyce"
    assert not (simulated / "checkpoint.npz").exists()
    assert (simulated / "report.html").read_text().count("data:image/png") == 2


def test_the_grips_are_in_balance_and_pull_outward(simulated: Path) -> None:
    force = {b.name: b.force for b in Experiment.load(simulated / "experiment.npz").loaded}
    assert force["left"] == pytest.approx(-force["right"])
    assert (force["right"][:, 0] > 0).all()


def test_the_noise_can_be_left_out(simulated: Path, tmp_path: Path) -> None:
    cli.main(["simulate", *SMALL, "--no-noise", "-o", str(tmp_path / "clean")])
    clean, noisy = (Experiment.load(p / "experiment.npz") for p in (tmp_path / "clean", simulated))
    assert clean.noise is None
    # the clamped ends move by 60 mm each, exactly
    right = next(b for b in clean.loaded if b.name == "right")
    assert clean.displacements[-1, right.nodes, 0] == pytest.approx(60.0)
    assert 0.05 < np.std(noisy.displacements - clean.displacements) < 0.15


@pytest.mark.parametrize(
    ("words", "key"),
    [
        (["--specimen", "crss"], "cross?"),
        (["--specimen", "square"], "cross"),
        (["--material", "arruda"], "arruda_boyce?"),
        (["--material", "absent.json"], "absent.json"),
        (["--material", "absent.json", "--parameter", "mu=1"], "--parameter"),
        (["--parameter", "mu=-1"], "mu"),
        (["--thickness", "0"], "--thickness"),
        (["--increments", "1.5"], "--increments"),
        (["--nodes", "-5"], "--nodes"),
        (["--nodes", "15"], "15"),
        (["--relative-noise", "-1"], "relative_noise"),
    ],
)
def test_wrong_options_are_named(refused, words: list[str], key: str) -> None:
    refused("simulate", "--quick", *words, key=key)


def test_specimens_are_drawn_with_changed_dimensions(tmp_path: Path) -> None:
    words = ["specimens", "--quick", "-o", str(tmp_path / "out"), "--only", "strip", "plate_with_hole"]
    assert cli.main([*words, "--set", "half_width=25"]) == 0
    record = json.loads((tmp_path / "out" / "specimens.json").read_text())
    assert record["settings"]["strip"]["half_width"] == 25.0
    assert {p.name for p in (tmp_path / "out").glob("*.png")} == {
        f"{name}_{kind}.png" for name in ("strip", "plate_with_hole") for kind in ("quads", "triangles")
    }


@pytest.mark.parametrize(
    ("words", "key"),
    [
        (["--only", "cros"], "cross?"),
        (["--set", "half_widht=3"], "half_width?"),
        (["--set", "half_width"], "NAME=VALUE"),
        (["--only", "strip", "--set", "half_width=-3"], "half_width = -3"),
        (["--only", "cross", "--set", "half_width=120"], "half_width"),
    ],
)
def test_wrong_specimens_are_named(refused, words: list[str], key: str) -> None:
    refused("specimens", *words, key=key)
