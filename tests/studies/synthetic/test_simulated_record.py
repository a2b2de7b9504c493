"""The machine record of a simulated history: from rest to the last picture, read by the same load cell as the forces at the pictures."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from calibrate.data.experiment import Experiment
from forward import Loading, NeoHooke
from forward.sheet.inelastic import solve_history
from forward.sheet.thin_sheet import Prony, Sheet
from meshes import quads, triangles
from meshes.known_specimens import SPECIMENS
from studies import cli
from studies.synthetic import camera
from studies.synthetic.history_file import History

STRIP = SPECIMENS["strip"]()
HISTORY = History(times=(2.0, 10.0), factors=(1.0, 1.0), substeps=4)


@cache
def solution():
    sheet, pull = Sheet(NeoHooke(0.2), 1.0, (), (Prony(0.8, 0.5),)), Loading.clamped(STRIP.loaded, 10.0)
    mesh = quads(STRIP, size_factor=3.0)
    return solve_history(mesh, sheet, pull, HISTORY.factors, HISTORY.times, 4, readings=HISTORY.readings)


def observed(seed: int | None = None, **options: float) -> Experiment:
    return camera.observe(solution(), triangles(STRIP, n_nodes=250), camera.Camera(**options), seed)


def test_the_load_cell_is_read_at_every_step():
    assert HISTORY.readings == [(0.5, 0.25), (1.0, 0.5), (1.5, 0.75), (4.0, 1.0), (6.0, 1.0), (8.0, 1.0)]
    e = observed()
    np.testing.assert_allclose(e.record.time, [0, 0.5, 1, 1.5, 2, 4, 6, 8, 10])
    np.testing.assert_allclose(e.record.crosshead, [0, 0.25, 0.5, 0.75, 1, 1, 1, 1, 1])
    np.testing.assert_array_equal(e.record.at(e.time), [b.force for b in e.loaded])
    pull = e.record.force[[b.name for b in e.loaded].index("right"), :, 0]
    assert pull[0] == 0
    assert (np.diff(pull[:5]) > 0).all()
    assert (np.diff(pull[4:]) < 0).all()  # it relaxes while it is held
    np.testing.assert_allclose(e.record.progress(e.time, e.record.time[1:5]), [0.25, 0.5, 0.75, 1.0])


def test_readings_have_the_noise_of_the_load_cell_and_those_at_pictures_are_the_same():
    clean, seen = observed(), observed(3, force_noise=0.01, relative_noise=0.0)
    np.testing.assert_array_equal(seen.record.at(seen.time), [b.force for b in seen.loaded])
    ratio = seen.record.force[:, 1:, 0] / clean.record.force[:, 1:, 0]
    assert 0 < np.abs(ratio - 1).max() <= 0.01
    assert len(np.unique(np.round(ratio[0], 12))) == 8  # each reading by itself
    np.testing.assert_allclose(ratio[0], ratio[1], rtol=1e-12)  # opposite sides share their load cell
    part = camera.record(clean.select([1]), camera.Camera(force_noise=0.01), 3)
    assert part.record.time.size == clean.record.time.size


def test_an_elastic_test_has_none():
    plain = replace(solution(), readings={}, reading_times=np.zeros(0))
    assert camera.observe(plain, triangles(STRIP, n_nodes=250)).record is None


def test_simulate_writes_it(tmp_path, capsys):
    (tmp_path / "h.toml").write_text(
        "times = [1, 3]\nfactors = [1, 1]\nsubsteps = 2\n[viscosity]\ng = 0.5\ntau = 0.4\n"
    )
    assert cli.main([
        "simulate", "--quick", "--specimen", "strip", "--material", "neo_hooke", "--history", str(tmp_path / "h.toml"),
        "--nodes", "250", "--displacement", "5", "-o", str(tmp_path / "out"),
    ]) == 0  # fmt: skip
    record = Experiment.load(tmp_path / "out" / "experiment.npz").record
    np.testing.assert_allclose(record.time, [0, 0.5, 1, 2, 3])
    assert record.force.shape == (2, 5, 2)
    assert pytest.approx(0.0) == record.force[:, 0].max()
