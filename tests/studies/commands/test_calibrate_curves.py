"""Homogeneous curves through `equigap calibrate`: parameters come back, other units and words too, and wrong tables are named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sheets import write

from calibrate import errors
from calibrate.models.model_file import load_model
from studies.commandline.outcome import Complete
from studies.commands.calibrate import Fit, calibrate
from studies.importers.curve_file import read_curves
from studies.reports.prediction.predicted_curves import predict
from studies.reports.supervised.curve_calibration import calibrate_curves

C10, C01, NOISE = 0.1, 0.03, 0.005
ROOM = "mode;strain [%];stress [kPa]"


def stress_of(mode, x):
    power = {"uniaxial": -2, "equibiaxial": -5, "pure_shear": -3}[mode]
    other = {"uniaxial": 1 / x, "equibiaxial": x**2, "pure_shear": np.ones_like(x)}[mode]
    return 2 * (C10 + C01 * other) * (x - x**power)


def table(path, noise=NOISE):
    rng, rows = np.random.default_rng(1), ["mode,stretch,stress_MPa"]
    for mode in ("uniaxial", "equibiaxial", "pure_shear"):
        x = np.linspace(1.05, 2.0, 15)
        P = stress_of(mode, x) * (1 + noise * rng.standard_normal(len(x)))
        rows += [f"{mode},{a:.6f},{b:.8f}" for a, b in zip(x, P, strict=True)]
    write(path, "\n".join(rows) + "\n")
    return path


def test_a_classical_law_comes_back_and_the_model_is_one_of_any_calibration(tmp_path, monkeypatch):
    found = calibrate(table(tmp_path / "ab.csv"), fit=Fit(layers=(2,), starts=2), output=tmp_path / "out")
    laws = {c.name: c.fit for c in found.found.laws.laws}
    mooney = laws["Mooney-Rivlin"]
    for name, truth in (("c10", C10), ("c01", C01)):
        k = list(mooney.values).index(name)
        assert abs(mooney.values[name] - truth) < 4 * mooney.deviations(found.found.laws.scale)[k]
    assert found.found.laws.converged[0].name in ("Mooney-Rivlin", "two-term Ogden")
    assert found.found.laws.converged[-1].criterion > 100  # of one constant
    model, x = load_model(tmp_path / "out" / "model.json"), np.linspace(1.1, 1.9, 9)
    assert model.fitness is not None and model.fitness.verdict == "usable with reservations"  # I1 alone misses c01
    np.testing.assert_allclose(model.homogeneous("uniaxial", x), found.found.fit.model.homogeneous("uniaxial", x))
    assert 0.05 < max(found.found.errors.values()) < 0.2
    assert (tmp_path / "out" / "report.json").is_file()
    with pytest.raises(errors.ConfigError, match="--hold-out: not for curves"):
        calibrate(tmp_path / "ab.csv", fit=Fit(hold_out="last"), output=tmp_path / "other")
    with pytest.raises(errors.ConfigError, match="--scaling: not for curves"):
        calibrate(tmp_path / "ab.csv", fit=Fit(scaling="dependent"), output=tmp_path / "other")
    monkeypatch.chdir(tmp_path)  # the same file, named otherwise
    assert isinstance(calibrate(Path("ab.csv"), fit=Fit(layers=(2,), starts=2), output=tmp_path / "out"), Complete)


def test_what_curves_of_one_mode_leave_unseen_is_an_extrapolation():
    """Compression to 0.4 is equi-biaxial tension to 0.4^-0.5; data of Mooney and Rivlin, of which I1 alone mistakes the other modes."""
    x = np.linspace(0.4, 1.0, 13)
    curves = {"uniaxial": (x, stress_of("uniaxial", x))}
    found = calibrate_curves("push", curves, "I1", (1,), 1, 0)
    drawn = {curve.mode: curve for curve in predict(found.fit.model)}
    assert drawn["uniaxial"].limit == drawn["pure_shear"].limit == 1.0
    assert drawn["equibiaxial"].limit == pytest.approx(0.4**-0.5, abs=1e-3) and not drawn["equibiaxial"].by_mode
    assert drawn["uniaxial"].by_mode and not drawn["uniaxial"].calibrated[1:].any()


def test_every_mode_of_curves_is_calibrated_to_its_own_end():
    ends = {"uniaxial": 3.0, "equibiaxial": 1.8, "pure_shear": 2.5}
    curves = {mode: (x := np.linspace(1, end, 8), stress_of(mode, x)) for mode, end in ends.items()}
    drawn = predict(calibrate_curves("three", curves, "I1", (1,), 1, 0).fit.model)
    assert {curve.mode: curve.limit for curve in drawn} == pytest.approx(ends, abs=1e-3)


def test_curves_that_a_law_made_are_no_better_than_readings():
    """Chi-square of the network over that of errors of 1e-4 of the loads, however exact the law of the curves is."""
    x = np.linspace(1.05, 2.0, 12)
    found = calibrate_curves("exact", {"uniaxial": (x, stress := stress_of("uniaxial", x))}, "I1", (1,), 1, 0)
    mooney = next(law for law in found.laws.laws if law.name == "Mooney-Rivlin")
    left, size = found.errors["uniaxial"], np.sqrt(np.mean(stress**2)) / stress.max()
    assert mooney.chi_square == pytest.approx(-len(x) * (left / (1e-4 * size)) ** 2, rel=1e-3)


def test_strain_in_percent_kilopascals_and_decimal_commas(tmp_path):
    rows = [f"EB;{5 * k},5;{k}00,5" for k in range(1, 5)]
    write(tmp_path / "a.csv", "\n".join([ROOM, *rows]) + "\n")
    stretch, stress = read_curves(tmp_path / "a.csv")["equibiaxial"]
    np.testing.assert_allclose(stretch, [1.055, 1.105, 1.155, 1.205])
    np.testing.assert_allclose(stress, [0.1005, 0.2005, 0.3005, 0.4005])


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        ("mode,stretch,stress\nut,1.1,0.1\nut,1.2,0.2\n", errors.UnitsError, "not stated"),
        ("mode,stretch,stress_MPa\nut,1.1,0.1\nshear,1.2,0.2\n", errors.FileFormatError, "row 2 .*'shear'"),
        ("stretch,stress_MPa\n1.1,0.1\n1.2,0.2\n", errors.FileFormatError, "no column of mode"),
        ("mode,stretch,stress_MPa\nut,1.1,0.1\nut,nan,0.2\n", errors.FileFormatError, "row 2"),
        (
            "mode,stretch,stress_MPa\nuniaxial,1.1,0.1\nuniaxial,1.2,abc\n",
            errors.FileFormatError,
            "row 2 .*'stress_MPa': 'abc'",
        ),
        ("mode,stretch\nuniaxial,1.1\nuniaxial,1.2\n", errors.FileFormatError, "stress"),
        ("mode,stretch,stress_MPa\nut,110,0.1\nut,120,0.2\n", errors.UnitsError, "give ratios"),
        ("mode,stretch,stress_MPa\nut,1.1,0.1\nut,1.2,-0.2\n", errors.FileFormatError, "row 2 .*-0.2 MPa .*wrong sign"),
        ("mode,stretch,stress_MPa\nut,0.9,0.1\nut,1.2,0.2\n", errors.FileFormatError, "row 1 .*wrong sign"),
        (
            "mode,stretch,stress_MPa\nut,1.1,0.1\nbiaxial,1.2,0.2\n",
            errors.FileFormatError,
            "row 2 .*name it equibiaxial",
        ),
        ("mode,stretch,stress_MPa\nut,1.1,0.1\n", errors.FileFormatError, "one row is no curve"),
    ],
)
def test_wrong_tables_are_named(tmp_path, text, kind, message):
    write(tmp_path / "a.csv", text)
    with pytest.raises(kind, match=message):
        read_curves(tmp_path / "a.csv")


def written(path, mode, stretches):
    rows = [f"{mode},{x:.6f},{float(stress_of(mode, np.array(x))):.8f}" for x in stretches]
    write(path, "\n".join(["mode,stretch,stress_MPa", *rows]) + "\n")
    return path


UP, DOWN = np.linspace(1.0, 2.0, 11), np.linspace(1.9, 1.0, 10)


@pytest.mark.parametrize(
    ("stretches", "row"),
    [
        ([*UP, *DOWN], 12),
        ([*UP, *DOWN[:3]], 12),
        ([1.0, 1.5, 2.0, 1.5, 1.0], 4),
        ([*DOWN, *UP], 12),
        ([*UP, *UP, *DOWN], 23),
        ([1.0, 0.7, 0.4, 0.7, 1.0], 4),
    ],
)
def test_the_way_back_is_not_averaged_with_the_way_there(tmp_path, stretches, row):
    with pytest.raises(errors.FileFormatError, match=rf"a.csv, row {row} .*turns back.*Leave out the way back"):
        read_curves(written(tmp_path / "a.csv", "uniaxial", stretches))


@pytest.mark.parametrize(
    "stretches",
    [
        UP,
        UP[::-1],
        [*UP, *UP],
        [*UP[1:], *UP[2:]],
        np.linspace(0.4, 2.0, 17),
        [*UP, *np.linspace(1.0, 0.4, 7)],
        [*np.linspace(0.9, 0.4, 6), *UP[1:]],
        UP + 0.004 * np.cos(np.arange(11)),
        [1.0, 1.001, 1.0005, *UP[1:]],
    ],
)
def test_pulls_that_begin_anew_and_noise_are_no_way_back(tmp_path, stretches):
    found = read_curves(written(tmp_path / "a.csv", "uniaxial", stretches))["uniaxial"][0]
    np.testing.assert_allclose(found, np.sort(stretches), atol=1e-6)


@pytest.mark.parametrize(
    "head", ["mode,true_strain,stress_MPa", "mode,stretch,Cauchy stress_MPa", "mode,log strain,stress_MPa"]
)
def test_measures_that_are_not_nominal_are_refused(tmp_path, head):
    write(tmp_path / "a.csv", f"{head}\nut,0.1,0.1\nut,0.2,0.2\n")
    with pytest.raises(errors.FileFormatError, match="nominal ones are needed"):
        read_curves(tmp_path / "a.csv")
