"""Supervised fit: recovers known materials, reads the classical data, refuses what is no test."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path

import numpy as np
import pytest

from calibrate import errors
from calibrate.fitting.homogeneous.sobolev_fit import fit_supervised
from calibrate.models.network_model import Model
from studies.accuracy import metrics
from studies.importers import homogeneous_curves
from studies.reports.supervised import supervised_fits as fits

DATA = os.environ.get("EQUIGAP_DATA")
needs_data = pytest.mark.skipif(
    not DATA or not Path(DATA, "chongran_zhao_homogeneous").is_dir(),
    reason="EQUIGAP_DATA names no folder with the homogeneous data",
)


@pytest.mark.slow
def test_one_neuron_with_skip_connection_is_arruda_boyce():
    result = fits.run(fits.Case("arruda-boyce", "I1", (1,)), starts=2)
    assert min(result.r2.values()) > 0.9999
    assert set(result.r2) == set(metrics.MODES)
    # also away from the points it was fitted to
    for agreement in metrics.agreement(result.model, metrics.ArrudaBoyceTruth(), 20.0):
        assert agreement.r2 > 0.9999
        assert abs(agreement.bias) < 1e-3


def linear_energy(c1, c2):
    """{mode: (stretch, stress)} of psi = c1 I1 + c2 I2^(3/2), which a PANN contains through its skip connection."""
    stretch = np.linspace(1.0, 2.5, fits.TRUTH_POINTS)
    slopes = lambda i: np.stack([np.full(i.shape[:-1], c1), 1.5 * c2 * np.sqrt(i[..., 1])], axis=-1)  # noqa: E731
    return {mode: (stretch, metrics.nominal_stress(slopes, mode, stretch)) for mode in metrics.MODES}


@pytest.mark.slow
def test_energies_linear_in_the_inputs_are_recovered():
    places = np.array([[3.0, 3.0], [8.0, 5.0]])
    found = fit_supervised(linear_energy(0.2, 0.0), "I1", (1,), n_starts=2)
    np.testing.assert_allclose(found.model.derivatives(places), [[0.2, 0.0]] * 2, rtol=1e-4)
    both = fit_supervised(linear_energy(0.2, 0.02), "I1I2", (1,), n_starts=2)
    expected = [[0.2, 0.03 * 3**0.5], [0.2, 0.03 * 5**0.5]]
    np.testing.assert_allclose(both.model.derivatives(places), expected, rtol=1e-2)


def test_same_seed_same_result_and_bounds_hold():
    curves = {"uniaxial": (np.linspace(1, 2, 8), 0.4 * (np.linspace(1, 2, 8) - np.linspace(1, 2, 8) ** -2.0))}
    a, b = (fit_supervised(curves, "I1", (1,), n_starts=2, seed=3) for _ in range(2))
    np.testing.assert_array_equal(a.model.parameters, b.model.parameters)
    assert (a.model.parameters[a.model.architecture.nonnegative] >= 0).all()
    assert a.loss == np.nanmin(a.losses)
    assert a.model.calibrated_range["I1"][1] == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("curves", "kind"),
    [
        ({}, errors.ExperimentError),
        ({"torsion": (np.ones(3), np.ones(3))}, errors.ConfigError),
        ({"uniaxial": (np.ones(3), np.ones(4))}, errors.ExperimentError),
        ({"uniaxial": (np.ones(3), np.array([1.0, np.nan, 1.0]))}, errors.ExperimentError),
        ({"uniaxial": (np.array([0.0, 50.0, 100.0]), np.ones(3))}, errors.UnitsError),
        ({"uniaxial": (np.linspace(1, 2, 3), np.zeros(3))}, errors.ExperimentError),
    ],
)
def test_data_that_no_test_gives(curves, kind):
    with pytest.raises(kind):
        fit_supervised(curves)


def test_unknown_collection():
    with pytest.raises(errors.ConfigError, match="'treloar'"):
        homogeneous_curves.load("treloar")


@needs_data
@pytest.mark.parametrize("name", list(homogeneous_curves.COLLECTIONS))
def test_collections_are_ordered_as_named(name):
    """At the same moderate stretch rubber needs more stress equi-biaxially than in pure shear than uniaxially."""
    curves = homogeneous_curves.load(name)
    at = {mode: np.interp(1.8, *curve) for mode, curve in curves.items()}
    assert at["uniaxial"] < at["pure_shear"] < at["equibiaxial"]
    for stretch, stress in curves.values():
        assert (np.diff(stretch) >= 0).all()
        assert 0.5 < stress.max() < 10
        assert stretch.max() < 8


@needs_data
def test_two_transcriptions_of_treloar_agree():
    """To 1 % equi-biaxially and in pure shear above stretch 1.8; uniaxially they differ by up to 8 %."""
    a, b = homogeneous_curves.load("treloar-a"), homogeneous_curves.load("treloar-b")
    for mode in metrics.MODES:
        stretch = np.linspace(1.2, 4.0, 15)
        np.testing.assert_allclose(np.interp(stretch, *a[mode]), np.interp(stretch, *b[mode]), rtol=0.1)


@needs_data
def test_kawabata_biaxial_contains_its_uniaxial_rows():
    table = homogeneous_curves.kawabata_biaxial()
    assert table.shape == (117, 4)
    uniaxial = table[np.isclose(table[:, 3], 0.0)]
    np.testing.assert_allclose(uniaxial[:, 1], uniaxial[:, 0] ** -0.5, rtol=0.02)


@needs_data
@pytest.mark.parametrize("name", ["treloar-a", "treloar-b"])
def test_treloar_is_described_in_all_modes(name):
    result = fits.run(fits.Case(name, "I1", (1,)), starts=2)
    assert min(result.r2.values()) > 0.95


@pytest.mark.parametrize("words", [("--starts", 0), ("--layers", "x"), ("--layers", "4,0"), ("--data", "gent")])
def test_wrong_options_are_named(words, refused):
    refused("supervised", *words, key=str(words[1]))


def test_command_writes_table_figure_model_and_manifest(tmp_path, equigap):
    out, words = tmp_path / "out", "--data arruda-boyce --inputs I1 --layers 1 --starts 2"
    assert equigap("supervised", *words.split(), "-o", out).code == 0
    lines = [line for line in (out / "supervised.csv").read_text().splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    assert [r["mode"] for r in rows] == list(metrics.MODES)
    assert all(float(r["r2"]) > 0.9999 for r in rows)
    assert (out / "arruda-boyce.png").stat().st_size > 10_000
    assert Model.load(out / "models" / "arruda-boyce-I1-1.json").architecture.layers == (1,)
    assert "arruda-boyce-I1-1" in json.loads((out / "supervised.json").read_text())["results"]["r2"]
