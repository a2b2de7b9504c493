"""`equigap predict`: curves of a model whose stress is known in closed form."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from discoveries import sheet
from skip_network import MU, neo_hooke

from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from calibrate.equations.basis import SingleBasis
from calibrate.equations.deformation_modes import MODES
from calibrate.equations.equilibrium import neo_hooke as neo_hooke_coefficients
from calibrate.models.diagnosed_law import DiagnosedLaw
from calibrate.models.extended_model import ExtendedModel
from calibrate.models.fitness import Fitness, Use
from calibrate.models.model_uncertainty import ModelUncertainty
from calibrate.models.parameter_covariance import Uncertainty
from studies import cli
from studies.output.manifest import file_hash
from studies.reports.prediction import predicted_curves as prediction
from studies.reports.prediction.predicted_forces import forecast

STRETCH = np.linspace(1.0, 2.5, 31)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    neo_hooke().save(tmp_path / "model.json")
    return tmp_path / "model.json"


@pytest.mark.parametrize("mode", MODES)
def test_curves_are_those_of_the_closed_form(mode: str) -> None:
    curve = {c.mode: c for c in prediction.predict(neo_hooke(), 2.5, 31)}[mode]
    power = {"uniaxial": -2, "equibiaxial": -5, "pure_shear": -3}[mode]
    assert curve.stretch == pytest.approx(STRETCH)
    assert curve.stress == pytest.approx(MU * (STRETCH - STRETCH**power), abs=1e-12)


def test_the_calibrated_range_ends_where_the_invariant_does() -> None:
    # pure shear: I1 = x^2 + 1 + x^-2 = 6, so x^2 = (5 + sqrt(21)) / 2
    limit = prediction.calibrated_stretch(neo_hooke(), "pure_shear")
    assert limit == pytest.approx(np.sqrt((5 + np.sqrt(21)) / 2), abs=2e-3)
    curve = prediction.predict(neo_hooke())[2]
    assert curve.stretch[-1] == pytest.approx(1 + 1.25 * (limit - 1))
    assert 0 < curve.calibrated.mean() < 1


def test_a_mode_that_the_data_do_not_hold_is_an_extrapolation() -> None:
    """Up to the stretch that they hold it to; the curve goes on to the strains of the other modes, and its band is wider there."""
    end = 2 * 1.2**2 + 1.2**-4
    ranges = {"I1": (3.0, 6.0), "I1 near uniaxial": (3.0, 6.0), "I1 near equi-biaxial": (3.0, end), "I1 near pure shear": (3.0, 3.0)}  # fmt: skip
    model = replace(neo_hooke(), calibrated_range=ranges)
    found = {c.mode: c for c in prediction.predict(model)}
    assert found["uniaxial"].limit == prediction.calibrated_stretch(neo_hooke(), "uniaxial")
    assert found["equibiaxial"].limit == pytest.approx(1.2) and found["pure_shear"].limit == 1.0
    assert [found[mode].by_mode for mode in ("uniaxial", "equibiaxial", "pure_shear")] == [False, True, True]
    np.testing.assert_array_equal(found["equibiaxial"].calibrated, found["equibiaxial"].stretch <= 1.2 + 1e-12)
    sentences = [c.finding.text for c in found.values()]
    assert "no states near this mode beyond a stretch of 1.2" in sentences[1]
    assert "the data have no states near this mode. From there" in sentences[2]
    basis = SingleBasis(0, 6.0)
    spread = ModelUncertainty(np.zeros((basis.n, 1)))
    told = [
        ExtendedModel(
            basis, neo_hooke_coefficients(basis, MU), (), (), "MPa", calibrated_range=given, uncertainty=spread
        )
        for given in ({"I1": (3.0, 6.0)}, ranges)
    ]
    before, after = ({c.mode: c for c in prediction.predict(DiagnosedLaw(one))} for one in told)
    assert not (after["equibiaxial"].deviation < before["equibiaxial"].deviation).any()
    assert after["pure_shear"].deviation_at(1.5) > before["pure_shear"].deviation_at(1.5) == 0
    np.testing.assert_allclose(after["uniaxial"].deviation, before["uniaxial"].deviation, rtol=1e-9)
    assert after["equibiaxial"].limit == pytest.approx(1.2) and after["equibiaxial"].by_mode


def test_a_model_without_range_is_drawn_to_stretch_two() -> None:
    curve = prediction.predict(neo_hooke(top=None))[0]
    assert curve.limit == prediction.LARGEST
    assert curve.stretch[-1] == 2.0
    assert curve.calibrated.all()


def test_a_law_in_mpa_is_not_drawn_beside_a_model_in_newtons_per_millimetre(tmp_path: Path, capsys) -> None:
    path = tmp_path / "thin.json"
    replace(neo_hooke(), unit="N/mm").save(path)
    words = ["predict", str(path), "-o", str(tmp_path / "out"), "--points", "5"]
    assert cli.main([*words, "--against", "arruda_boyce"]) == 2
    assert "N/mm" in capsys.readouterr().err
    assert (
        cli.main([*words, "--against", "neo_hooke", "--parameter", f"mu={MU}"]) == 0
    )  # stated in the unit of the model


def test_simulate_says_that_it_has_no_law_for_a_model_of_discover(tmp_path: Path, capsys) -> None:
    basis = SingleBasis(0, 5.0)
    ExtendedModel(basis, neo_hooke_coefficients(basis, MU), (), (), "MPa").save(tmp_path / "model.json")
    assert cli.main(["simulate", "--material", str(tmp_path / "model.json"), "-o", str(tmp_path / "out")]) == 2
    assert "model of `equigap discover`" in capsys.readouterr().err


SMALL = "--quick --specimen strip --displacement 1 --increments 1 --size-factor 6 --nodes 100 --no-noise"


@pytest.mark.parametrize(
    "words",
    [
        ["predict", "model.json", "--points", "5"],
        ["predict", "model.json", "--test", "test.npz"],
        ["export", "model.json", "--to", "python"],
        pytest.param(["simulate", "--material", "model.json", *SMALL.split()], marks=pytest.mark.slow),
        pytest.param(["replay", "test.npz", "model.json", "--skip-mesh-check"], marks=pytest.mark.slow),
    ],
    ids=["curves", "forces", "export", "simulate", "replay"],
)
def test_whatever_reads_a_model_repeats_its_verdict(words: list[str], tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    reason, ranges = "forces are missed by 34 %", {"I1": (3.0, 6.0), "I2": (3.0, 6.0)}
    useless = replace(neo_hooke(), fitness=Fitness(Use.NOT, (reason,)), level_is_nominal=True, calibrated_range=ranges)
    useless.save(tmp_path / "model.json")
    sheet().save(tmp_path / "test.npz")
    assert cli.main([*words, "-o", "out"]) == 0
    said = capsys.readouterr().out
    assert "do not use" in said and reason in said and "Only ratios" in said
    written = [path.read_text() for path in (tmp_path / "out").iterdir() if path.suffix in (".html", ".py")]
    assert written and all("do not use" in text for text in written)


def test_nothing_is_said_of_a_model_that_is_usable(tmp_path: Path, capsys) -> None:
    replace(neo_hooke(), fitness=Fitness(Use.USABLE)).save(tmp_path / "model.json")
    assert cli.main(["predict", str(tmp_path / "model.json"), "-o", str(tmp_path / "out"), "--points", "5"]) == 0
    assert "verdict" not in capsys.readouterr().out


def test_the_command_leaves_table_figure_report_and_manifest(file: Path, tmp_path: Path) -> None:
    words = ["predict", str(file), "-o", str(tmp_path / "out"), "--points", "21"]
    assert cli.main([*words, "--against", "neo_hooke", "--parameter", f"mu={MU}"]) == 0
    lines = (tmp_path / "out" / "curves.csv").read_text().splitlines()
    rows = list(csv.DictReader(lines[1:]))
    assert len(rows) == 63
    for row in rows:
        assert float(row["nominal_stress_MPa"]) == pytest.approx(float(row["compared"]), abs=1e-9)
    manifest = json.loads((tmp_path / "out" / "curves.json").read_text())
    assert set(manifest["outputs"]) == {"curves.png", "curves.csv"}
    assert manifest["results"]["unit"] == "MPa"
    assert (tmp_path / "out" / "report.html").stat().st_size < 5_000_000


def test_bands_are_those_of_the_model_file(tmp_path: Path) -> None:
    """Standard deviation 0.002 of mu / 2 alone: that of P is 0.004 (x - x^-n), and the 95 % band 1.96 of it."""
    factor = np.zeros((4, 1))
    factor[-1] = 0.002
    model = replace(neo_hooke(), uncertainty=Uncertainty(factor, 1.0, 1.0, True))
    model.save(tmp_path / "model.json")
    assert cli.main(["predict", str(tmp_path / "model.json"), "-o", str(tmp_path / "out"), "--points", "21"]) == 0
    rows = list(csv.DictReader((tmp_path / "out" / "curves.csv").read_text().splitlines()[1:]))
    power = {"uniaxial": -2, "equibiaxial": -5, "pure_shear": -3}
    for row in rows:
        x, stress = float(row["stretch"]), float(row["nominal_stress_MPa"])
        std = 0.004 * (x - x ** power[row["mode"]])
        assert float(row["standard_deviation_MPa"]) == pytest.approx(std, abs=1e-9)
        assert float(row["low_95_MPa"]) == pytest.approx(stress - 1.96 * std, abs=1e-6)
        assert float(row["high_95_MPa"]) == pytest.approx(stress + 1.96 * std, abs=1e-6)
    assert {row["calibrated"] for row in rows} == {"0", "1"}


def test_a_model_without_uncertainty_gets_no_bands(file: Path, tmp_path: Path) -> None:
    assert cli.main(["predict", str(file), "-o", str(tmp_path / "out"), "--points", "3", "--stretch", "1.2"]) == 0
    table = (tmp_path / "out" / "curves.csv").read_text()
    assert "standard_deviation" not in table
    assert {row["calibrated"] for row in csv.DictReader(table.splitlines()[1:])} == {"1"}


def test_without_a_thickness_curves_are_in_force_per_width(tmp_path: Path) -> None:
    neo_hooke("N/mm", None).save(tmp_path / "model.json")
    cli.main(["predict", str(tmp_path / "model.json"), "-o", str(tmp_path / "out")])
    assert "N/mm" in (tmp_path / "out" / "curves.csv").read_text().splitlines()[0]


@pytest.mark.parametrize(
    ("words", "key"),
    [
        (["--stretch", "0.9"], "0.9"),
        (["--stretch", "nan"], "nan"),
        (["--points", "0"], "--points"),
        (["--against", "neo_hook"], "neo_hooke?"),
        (["--parameter", "mu=1"], "--parameter"),
        (["--against", "neo_hooke", "--parameter", "nu=1"], "mu"),
        (["--against", "neo_hooke", "--parameter", "mu=x"], "NAME=VALUE"),
    ],
)
def test_wrong_options_are_named(file: Path, refused, words: list[str], key: str) -> None:
    refused("predict", file, *words, key=key)


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"format": "equigap-model", "version": 9}'])
def test_what_is_no_model_file_is_named(tmp_path: Path, refused, text: str) -> None:
    (tmp_path / "m.json").write_text(text)
    refused("predict", tmp_path / "m.json", key="m.json")


def test_another_model_is_not_written_over_the_first(file: Path, tmp_path: Path, refused) -> None:
    out = ["-o", str(tmp_path / "out")]
    assert cli.main(["predict", str(file), *out]) == 0
    neo_hooke(top=5.0).save(file)
    refused("predict", file, key="--overwrite")
    assert cli.main(["predict", str(file), *out, "--overwrite"]) == 0


def test_the_model_that_is_drawn_beside_belongs_to_the_run(file: Path, tmp_path: Path, refused) -> None:
    """Its curves are drawn, its hash is in the manifest, and with another content it is another run."""
    other = tmp_path / "other.json"
    neo_hooke(top=5.0).save(other)
    words = ["predict", str(file), "--points", "5", "--against", str(other)]
    assert cli.main([*words, "-o", str(tmp_path / "out")]) == 0
    manifest = json.loads((tmp_path / "out" / "curves.json").read_text())
    assert manifest["inputs"][str(other)] == file_hash(other)
    rows = csv.DictReader((tmp_path / "out" / "curves.csv").read_text().splitlines()[1:])
    for row in (one for one in rows if one["mode"] == "uniaxial"):
        x = float(row["stretch"])
        assert float(row["compared"]) == pytest.approx(MU * (x - x**-2), abs=1e-9)
    neo_hooke(top=4.0).save(other)
    refused(*words, key="--overwrite")


def spline_twin(mu: float = MU) -> ExtendedModel:
    """The same energy as an extended model without effects."""
    basis = SingleBasis(0, 20.0)
    return ExtendedModel(basis, neo_hooke_coefficients(basis, mu), (), (), "MPa")


def test_network_and_spline_of_one_energy_predict_the_same_forces_of_a_test(tmp_path: Path) -> None:
    quiet = replace(sheet(), noise=replace(sheet().noise, displacement_std=1e-9))
    quiet.save(tmp_path / "test.npz")
    neo_hooke().save(tmp_path / "pann.json")
    spline_twin().save(tmp_path / "spline.json")
    rows = []
    for name in ("pann", "spline"):
        words = ["predict", str(tmp_path / f"{name}.json"), "--test", str(tmp_path / "test.npz")]
        assert cli.main([*words, "-o", str(tmp_path / name)]) == 0
        rows.append(list(csv.DictReader((tmp_path / name / "forces.csv").read_text().splitlines()[1:])))
    boundary = quiet.loaded[0].name
    assert len(rows[0]) == quiet.n_increments
    for i, (a, b) in enumerate(zip(*rows, strict=True)):
        assert float(a[f"{boundary}_x_measured"]) == pytest.approx(quiet.loaded[0].force[i, 0], rel=1e-6)
        assert float(a[f"{boundary}_x_predicted"]) == pytest.approx(float(b[f"{boundary}_x_predicted"]), rel=1e-6)


def test_a_test_that_was_fitted_with_an_effect_of_its_edges_is_predicted_without_what_the_replay_told(
    tmp_path: Path,
) -> None:
    """Of another test the effect is left out."""
    strip = next(effect for effect in CATALOGUE if effect.name == "unmeasured strip")
    other = replace(spline_twin(), additions=(Addition(strip, (0.1,)),), errors=((0.01,),))
    own = replace(other, training=({"name": "sheet", "fingerprint": sheet().fingerprint},))
    found = {}
    for name, one in (("own", own), ("other", other)):
        one.save(tmp_path / f"{name}.json")
        found[name] = forecast(tmp_path / f"{name}.json", sheet())
    assert (found["own"].without_twin, found["own"].left_out) == ((strip.name,), ())
    assert (found["other"].without_twin, found["other"].left_out) == ((), (strip.name,))


def test_beyond_the_calibrated_range_and_with_a_bulk_modulus_that_plane_stress_does_not_use(
    tmp_path: Path, equigap
) -> None:
    sheet().save(tmp_path / "test.npz")
    replace(neo_hooke(top=3.05), bulk_modulus=2.0).save(tmp_path / "model.json")
    said = equigap("predict", tmp_path / "model.json", "--test", tmp_path / "test.npz", "-o", tmp_path / "out")
    assert said.code == 0 and "2 MPa" in said.out
    manifest = json.loads((tmp_path / "out" / "forces.json").read_text())
    assert 0 < manifest["results"]["outside"] < 1


@pytest.mark.parametrize(
    ("unit", "more", "key"),
    [("N/mm", [], "thickness"), ("MPa", ["--stretch", "2"], "--test"), ("MPa", ["--points", "7"], "--points")],
)
def test_what_does_not_go_with_a_test_is_refused(unit: str, more: list[str], key: str, tmp_path: Path, refused) -> None:
    sheet().save(tmp_path / "test.npz")
    neo_hooke(unit).save(tmp_path / "model.json")
    refused("predict", tmp_path / "model.json", "--test", tmp_path / "test.npz", *more, key=key)
