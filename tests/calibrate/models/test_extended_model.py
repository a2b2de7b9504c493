"""The model file of a diagnosis: reading gives back what was written, and predicts what the diagnosis did."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from discoveries import C01, explained, held, sheet
from synthetic import moved

from calibrate.data.experiment import Noise
from calibrate.diagnosis.distillation import distil, quadratic
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from calibrate.effects.effect import Parameter
from calibrate.effects.mullins import LINEAR
from calibrate.equations.basis import SingleBasis
from calibrate.equations.equilibrium import neo_hooke
from calibrate.errors import ConfigError, DataNotFoundError, ModelFileError
from calibrate.models import pann
from calibrate.models.addition_json import amplitude_unit
from calibrate.models.extended_model import ExtendedModel
from calibrate.models.model_file import load_model
from calibrate.models.network_model import Model
from studies.reports.discovery.model_files import extended
from studies.reports.discovery.view import forces, residual

RECORD = {"command": [], "settings": {}, "inputs": {}, "versions": {}, "revision": None}
BY_NAME = {effect.name: effect for effect in CATALOGUE}


@pytest.fixture(autouse=True)
def small_network(monkeypatch):
    monkeypatch.setattr("calibrate.diagnosis.distillation.distil", small)


def small(problem, fit, level=1.0):
    return distil(problem, fit, (2,), 2, level=level)


@cache
def model():
    return extended(explained(), "every third increment", RECORD)


def neo_hookean(*additions, unit="MPa"):
    """psi = 0.1 MPa (I1 - 3) and effects; fitted to no test."""
    basis = SingleBasis(0, 20.0)
    return ExtendedModel(
        basis, neo_hooke(basis, 0.2), additions, tuple((0.0,) * len(a.amplitudes) for a in additions), unit
    )


def test_reading_gives_back_what_was_written(tmp_path):
    path = tmp_path / "model.json"
    model().save(path)
    again = ExtendedModel.load(path)
    assert again.to_dict() == model().to_dict()
    assert again.additions == explained().final.additions
    assert again.errors == explained().final.deviations
    assert again.verdict == "explained"
    (training,) = again.training
    assert (training["name"], training["fingerprint"]) == ("plate", sheet().fingerprint)
    assert training["spacing"] == explained().problem.parts[0].system.fields.spacing


def test_file_states_amplitudes_with_units():
    (addition,) = model().to_dict()["additions"]
    (amplitude,) = addition["amplitudes"]
    assert (addition["effect"], amplitude["name"], amplitude["unit"]) == ("second invariant", "c01", "MPa")
    assert abs(amplitude["value"] - C01) < 3 * amplitude["standard_deviation"]


def test_prediction_is_that_of_the_diagnosis():
    # but for the mean of the noise (2e-4 N here), which a diagnosis holds at its first base
    found = model().predict(sheet())
    part = explained().problem.parts[0]
    assert found.residuals == pytest.approx(residual(part, explained().final), abs=1e-9)
    for name, (_, predicted, _) in forces(part, explained().final).items():
        assert found.forces[name] == pytest.approx(predicted, rel=1e-9, abs=1e-9)
    assert found.outside <= 1e-3  # the range ends at 99.9 % of the area
    assert found.left_out == ()


def test_forces_are_met_within_noise():
    found, boundary = model().predict(sheet()), sheet().loaded[1]
    error = np.linalg.norm((found.forces["right"] - boundary.force)[held(), 0])
    assert error < 0.01 * np.linalg.norm(boundary.force[held(), 0])


def as_fitted():
    """The test with the noise that it was fitted with, which need not be the stated one: the mean that noise brings is taken off."""
    return replace(sheet(), noise=Noise(**model().training[0]["noise"]))


def test_measured_forces_do_not_enter_a_prediction():
    """The load cells' readings are needed by no effect of the material."""
    scaled = replace(as_fitted(), loaded=tuple(replace(b, force=2 * b.force) for b in sheet().loaded))
    assert model().predict(scaled).forces["right"] == pytest.approx(model().predict(sheet()).forces["right"])


def test_prediction_turns_with_the_specimen():
    turned, straight = model().predict(moved(as_fitted(), 0.5)), model().predict(sheet())
    c, s = np.cos(0.5), np.sin(0.5)
    assert turned.forces["right"] == pytest.approx(straight.forces["right"] @ np.array([[c, s], [-s, c]]), abs=1e-6)


def test_effect_of_one_test_is_left_out_for_another():
    with_offset = neo_hookean(Addition(BY_NAME["force offset"], (0.5,)))
    other = with_offset.predict(sheet())
    own = replace(with_offset, training=({"name": "plate", "fingerprint": sheet().fingerprint},)).predict(sheet())
    assert other.left_out == ("force offset",)
    assert own.left_out == ()
    # what the cell reads is 0.5 N more along the last force
    difference = own.forces["right"] - other.forces["right"]
    assert np.linalg.norm(difference, axis=1) == pytest.approx(0.5)


def test_range_of_the_data_is_told():
    narrow = SingleBasis(0, 0.3)
    found = replace(neo_hookean(), basis=narrow, c=neo_hooke(narrow, 0.2)).predict(sheet())
    assert 0 < found.outside < 1


def test_network_meets_the_data_like_the_spline():
    problem, fit = explained().problem, explained().final
    loss = quadratic(problem, fit)
    assert loss.loss(fit.c) == pytest.approx(fit.loss)
    found = model()
    assert found.network.architecture.inputs == "I1"
    assert found.network_loss["spline"] == pytest.approx(fit.loss)
    assert found.network_loss["good"] == (found.network_loss["network"] - fit.loss <= max(4.0, 0.01 * fit.loss))
    # psi_1 of c10 (I1 - 3), which the second invariant's share was taken from
    assert found.network.derivatives(np.array([[4.0, 4.0]]))[0, 0] == pytest.approx(0.1, rel=0.05)


@pytest.mark.parametrize(
    ("key", "value", "named"),
    [
        ("format", "equigap-model", "'format'"),
        ("version", 9, "version 9"),
        ("unit", "psi", "unit 'psi'"),
        ("base", {"k": 0, "top": 2.0, "n": 32, "coefficients": [1.0]}, "32"),
        ("additions", [{"effect": "magic"}], "effect 'magic'"),
        ("training", None, "NoneType"),
    ],
)
def test_damaged_file_is_named(tmp_path, key, value, named):
    path = tmp_path / "model.json"
    path.write_text(json.dumps({**model().to_dict(), key: value}))
    with pytest.raises(ModelFileError, match=named) as caught:
        ExtendedModel.load(path)
    assert str(path) in str(caught.value)


def test_other_files_are_named(tmp_path):
    with pytest.raises(DataNotFoundError, match="absent.json"):
        ExtendedModel.load(tmp_path / "absent.json")
    (tmp_path / "text.json").write_text("hello")
    with pytest.raises(ModelFileError, match="text.json"):
        ExtendedModel.load(tmp_path / "text.json")


def test_amplitude_names_must_be_those_of_the_effect(tmp_path):
    content = json.loads(json.dumps(model().to_dict()))
    content["additions"][0]["amplitudes"][0]["name"] = "c10"
    (tmp_path / "model.json").write_text(json.dumps(content))
    with pytest.raises(ModelFileError, match="c10"):
        ExtendedModel.load(tmp_path / "model.json")


def test_unknown_thickness_or_time_is_refused():
    with pytest.raises(ConfigError, match="N/mm"):
        neo_hookean().predict(replace(sheet(), thickness=None))
    viscous = neo_hookean(Addition(BY_NAME["viscoelasticity"], (0.1,), (1.0,)))
    with pytest.raises(ConfigError, match="time"):
        viscous.predict(sheet())


def test_units_without_a_thickness():
    assert amplitude_unit(Parameter("k", "MPa"), "N/mm") == "N/mm"
    assert amplitude_unit(Parameter("beta", "1/MPa"), "N/mm") == "mm/N"
    assert amplitude_unit(Parameter("tau", "s"), "N/mm") == "s"


def test_commands_that_want_a_network_name_it(tmp_path):
    path = tmp_path / "model.json"
    neo_hookean().save(path)
    with pytest.raises(ModelFileError, match="model.json"):
        Model.load(path)


def test_one_front_reads_every_kind_of_model(tmp_path):
    network = Model(pann.Architecture("I1", (1,)), np.array([0.0, 0.0, 0.0, 0.1]))
    network.save(tmp_path / "network.json")
    neo_hookean().save(tmp_path / "extended.json")
    assert isinstance(load_model(tmp_path / "network.json"), Model)
    assert isinstance(load_model(tmp_path / "extended.json"), ExtendedModel)
    (tmp_path / "other.json").write_text('{"format": "other"}')
    with pytest.raises(ModelFileError, match="other.json"):
        load_model(tmp_path / "other.json")


def test_fibres_of_a_file_written_before_they_stiffened_or_dispersed_are_of_standard_reinforcement(tmp_path):
    path = tmp_path / "model.json"
    neo_hookean(Addition(BY_NAME["one fibre family"], (0.05,), (0.4, 0.7, 0.1))).save(path)
    content = json.loads(path.read_text())
    (addition,) = content["additions"]
    for known, shape in ((2, (0.4, 0.7, 0.0)), (1, (0.4, 0.0, 0.0))):
        addition["shape"] = addition["shape"][:known]
        path.write_text(json.dumps(content))
        assert ExtendedModel.load(path).additions[0].shape == shape
    addition["shape"] = []
    path.write_text(json.dumps(content))
    with pytest.raises(ModelFileError, match="angle"):
        ExtendedModel.load(path)


def test_softening_of_a_file_written_before_it_had_a_shape_is_the_linear_one(tmp_path):
    path = tmp_path / "model.json"
    neo_hookean(Addition(BY_NAME["Mullins softening"], (0.3,), LINEAR)).save(path)
    content = json.loads(path.read_text())
    content["additions"][0]["shape"] = []
    path.write_text(json.dumps(content))
    assert ExtendedModel.load(path).additions[0].shape == LINEAR
    stretch = np.array([1.1, 1.4, 1.2])
    F = np.stack([np.diag([s, s**-0.5]) for s in stretch])[:, None]
    P = BY_NAME["Mullins softening"].stress(None, F, np.ones_like(F), (0.3,), LINEAR)
    x = stretch**2 + 2 / stretch - 3
    np.testing.assert_allclose(P[:, 0, 0, 0], 1 - 0.3 * (1 - x / np.maximum.accumulate(x)), atol=1e-5)


def relaxing_test():
    """The sheet with times, and readings of which one is missing."""
    whole = replace(sheet(), time=np.arange(1.0, sheet().n_increments + 1))
    forces = [b.force.copy() for b in whole.loaded]
    for force in forces:
        force[2] = np.nan
    return whole, replace(whole, loaded=tuple(replace(b, force=f) for b, f in zip(whole.loaded, forces, strict=True)))


def test_a_missing_reading_is_predicted_beside_a_lag():
    """It is interpolated where the lag needs it, and no zero; where there is no lag it is not needed."""
    for lag in (0.0, 0.2):
        predicted = []
        for test in relaxing_test():
            model = neo_hookean(Addition(BY_NAME["lag between force and image"], (lag,), (0.0,)))
            own = replace(model, training=({"name": "plate", "fingerprint": test.fingerprint},))
            predicted.append(own.predict(test).forces["right"][:, 0])
        assert predicted[1][2] == pytest.approx(predicted[0][2], rel=0.02 if lag else 1e-9)


def test_times_of_a_clock_are_no_times_of_loading():
    viscous = neo_hookean(Addition(BY_NAME["viscoelasticity"], (0.5,), (1.0,)))
    whole, _ = relaxing_test()
    viscous.predict(whole)
    with pytest.raises(ConfigError, match="has no time counted from the start of loading"):
        viscous.predict(replace(whole, time=whole.time + 5000.0))


def test_a_noise_that_nobody_knows_shifts_no_force():
    quiet, unknown = (replace(sheet(), noise=noise) for noise in (Noise(1e-9, 2.0), None))
    known, found = (neo_hookean().predict(test, spacing=6.0).forces["right"] for test in (quiet, unknown))
    assert found == pytest.approx(known, rel=1e-9)
