"""Homogeneous curves through `equigap calibrate`: parameters come back, other units and words too, and wrong tables are named."""

from __future__ import annotations

import numpy as np
import pytest
from sheets import write

from calibrate import errors
from calibrate.models.model_file import load_model
from studies.commands.calibrate import Fit, calibrate
from studies.importers.curve_file import read_curves

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


def test_a_classical_law_comes_back_and_the_model_is_one_of_any_calibration(tmp_path):
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
        ("mode,stretch,stress_MPa\nut,1.1,0.1\n", errors.FileFormatError, "one row is no curve"),
    ],
)
def test_wrong_tables_are_named(tmp_path, text, kind, message):
    write(tmp_path / "a.csv", text)
    with pytest.raises(kind, match=message):
        read_curves(tmp_path / "a.csv")


@pytest.mark.parametrize(
    "head", ["mode,true_strain,stress_MPa", "mode,stretch,Cauchy stress_MPa", "mode,log strain,stress_MPa"]
)
def test_measures_that_are_not_nominal_are_refused(tmp_path, head):
    write(tmp_path / "a.csv", f"{head}\nut,0.1,0.1\nut,0.2,0.2\n")
    with pytest.raises(errors.FileFormatError, match="nominal ones are needed"):
        read_curves(tmp_path / "a.csv")
