"""History files: a test that is loaded, held and unloaded in a law that the inverse side does not have, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from calibrate.data.experiment import Experiment
from forward import NeoHooke
from forward.sheet.damage_and_dispersion import DispersedFibres, OgdenRoxburgh
from forward.sheet.multiplicative_viscosity import MaxwellBranch
from forward.sheet.thin_sheet import PermanentSet, Prony, Sheet
from studies import cli
from studies.errors import OptionError
from studies.synthetic.history_file import read_history, sheet_of

START = "times = [4, 9, 12]\nfactors = [1.0, 1.0, 0.5]\n"
BRANCH = """
[[branch]]
mu = 0.2
tau = 2.0
"""
LAW = (
    BRANCH
    + """
[[addition]]
law = "Ogden-Roxburgh"
r = 2
m = 0.05
[[addition]]
law = "dispersed fibres"
k1 = 0.05
k2 = 0.5
kappa = 0.1
angles = [0.6, -0.6]
"""
)


def written(folder: Path, text: str) -> str:
    path = folder / "history.toml"
    path.write_text(text)
    return str(path)


def test_every_part_of_a_sheet_is_read(tmp_path: Path) -> None:
    path = written(
        tmp_path, START + "substeps = 3\n" + LAW + "[viscosity]\ng = 0.3\ntau = 5\n[permanent_set]\na = 0.02\n"
    )
    history = read_history(path)
    assert (history.times, history.factors, history.substeps) == ((4, 9, 12), (1.0, 1.0, 0.5), 3)
    additions = (OgdenRoxburgh(2.0, 0.05), DispersedFibres(0.05, 0.5, 0.1, (0.6, -0.6)))
    expected = Sheet(
        NeoHooke(), 1.5, additions, (Prony(0.3, 5.0),), PermanentSet(0.02), None, (MaxwellBranch(0.2, 2.0),)
    )
    assert sheet_of(path, history, NeoHooke(), 1.5) == expected


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("times = [1]\nfactor = [1]\n", "factors"),
        ("times = [1\n", "TOML"),
        (START + "substeps = 0\n", "substeps"),
        ("times = [4, 9]\nfactors = [1.0]\nsubsteps = 2\n", "times: 2 times, but 1 factors"),
        (START + '[[addition]]\nlaw = "mullins"\n', "Mullins"),
        (START + '[[addition]]\nlaw = "Mullins"\n', "r must be given"),
        (START + '[[addition]]\nlaw = "Mullins"\nr = [1, 2]\n', "a number"),
        (START + '[[addition]]\nlaw = "Mullins"\nr = 0.3\nm = 0.1\n', "m and beta together"),
        (START + '[[addition]]\nlaw = "fibres"\nk = 0.1\nangles = 0.3\n', "a list"),
        (START + "[[branch]]\nmu = 1.0\ntu = 2.0\n", "tau"),
        (START + "[[branch]]\nmu = 1.0\ntau = -2.0\n", "tau = -2"),
        (START + "bulk_modulus = 10.0\n[[branch]]\nmu = 1.0\ntau = 2.0\n", "compressible"),
    ],
)
def test_what_does_not_fit_is_named_with_the_file(tmp_path: Path, text: str, key: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(OptionError, match=key) as caught:
        sheet_of(path, read_history(path), NeoHooke(), 1.0)
    assert path in str(caught.value)


def test_simulate_records_a_history(tmp_path: Path) -> None:
    """Force falls while the grips rest; half the way back it is far less than half."""
    path, folder = written(tmp_path, START + BRANCH), tmp_path / "out"
    words = [
        "--specimen",
        "strip",
        "--size-factor",
        "4",
        "--nodes",
        "200",
        "--displacement",
        "30",
        "--no-noise",
        "--quick",
    ]
    assert cli.main(["simulate", *words, "--material", "neo_hooke", "--history", path, "-o", str(folder)]) == 0
    experiment = Experiment.load(folder / "experiment.npz")
    np.testing.assert_allclose(experiment.time, [4, 9, 12])
    force = next(b.force[:, 0] for b in experiment.loaded if b.name == "right")
    assert force[0] > 1.05 * force[1] > 2.2 * force[2] > 0
    settings = json.loads((folder / "experiment.json").read_text())["settings"]
    assert settings["sheet"]["branches"] == [{"mu": 0.2, "tau": 2.0}]
    assert settings["history"]["times"] == [4, 9, 12]


def test_increments_and_a_history_exclude_each_other(refused, tmp_path: Path) -> None:
    refused("simulate", "--history", written(tmp_path, START), "--increments", "3", key="--increments")
