"""Model files: what is written comes back, and what is not a model is refused by name."""

import json

import jax
import numpy as np
import pytest
from synthetic import random_gradients

from calibrate import errors
from calibrate.models import pann
from calibrate.models.network_model import Model


@pytest.fixture
def model():
    architecture = pann.Architecture("I1I2", (3, 2), (0.2, 0.04), 0.6)
    return Model(
        architecture,
        np.asarray(architecture.random_start(jax.random.key(2))),
        "N/mm",
        {"I1": (3.0, 7.5), "I2": (3.0, 5.0)},
        {"loss": 1.25},
        {"experiment": "plate"},
    )


@pytest.fixture
def content(model):
    return json.loads(json.dumps(model.to_dict()))


def written(path, content):
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_round_trip(model, tmp_path):
    path = tmp_path / "new" / "model.json"
    model.save(path)
    back = Model.load(path)
    assert back.architecture == model.architecture
    np.testing.assert_array_equal(back.parameters, model.parameters)
    assert back.to_dict() == model.to_dict()
    F = random_gradients(5)
    np.testing.assert_array_equal(back.nominal_stress(F), model.nominal_stress(F))
    assert [p.name for p in path.parent.iterdir()] == ["model.json"]


def test_file_holds_the_documented_keys(content):
    assert set(content) == {
        "format", "version", "kind", "inputs", "layers", "scales", "energy_scale", "hidden", "output", "skip",
        "unit", "calibrated_range", "fit", "provenance",
    }  # fmt: skip
    assert (content["format"], content["version"], content["kind"]) == ("equigap-model", 1, "pann")
    assert np.shape(content["hidden"][0]["weights"]) == (3, 2)


def test_energy_by_hand_from_the_file(model, content):
    """The formula of `calibrate.models.pann`, in NumPy, from the JSON alone."""
    I1, I2 = 5.0, 4.2
    softplus = lambda z: np.log1p(np.exp(z))  # noqa: E731

    def network(x):
        z = x
        for layer in content["hidden"]:
            z = softplus(np.array(layer["weights"]) @ z + layer["biases"])
        return np.dot(content["output"], z) + np.dot(content["skip"], x)

    x = np.array(content["scales"]) * [I1 - 3, I2**1.5 - 3**1.5]
    expected = content["energy_scale"] * (network(x) - network(0 * x))
    assert float(model.energy(np.array([I1, I2]))) == pytest.approx(expected, rel=1e-12)


def test_range(model):
    inside = model.in_range(np.array([[3.0, 3.0], [7.0, 4.9], [7.6, 4.0], [7.0, 5.1]]))
    np.testing.assert_array_equal(inside, [True, True, False, False])


def test_missing_file(tmp_path):
    with pytest.raises(errors.DataNotFoundError):
        Model.load(tmp_path / "none.json")


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", '"equigap-model"', "\x00\x01", "null"], ids=repr)
def test_files_that_are_not_json_objects(tmp_path, text):
    with pytest.raises(errors.ModelFileError):
        Model.load(written(tmp_path / "model.json", text))


def test_binary_file(tmp_path):
    (tmp_path / "model.json").write_bytes(b"\xff\xfe\x93NUMPY")
    with pytest.raises(errors.ModelFileError):
        Model.load(tmp_path / "model.json")


@pytest.mark.parametrize(
    "key",
    ["format", "version", "kind", "inputs", "layers", "scales", "energy_scale", "hidden", "output", "skip", "unit",
     "calibrated_range"],
)  # fmt: skip
def test_every_needed_key(tmp_path, content, key):
    del content[key]
    with pytest.raises(errors.ModelFileError, match=key):
        Model.load(written(tmp_path / "model.json", content))


BAD_VALUES = {
    "another format": {"format": "equigap-experiment"},
    "future version": {"version": 2},
    "another kind": {"kind": "spline"},
    "unknown inputs": {"inputs": "J"},
    "inputs of a wrong type": {"inputs": ["I1"]},
    "no layers": {"layers": []},
    "layers not numbers": {"layers": ["a"]},
    "layers not a list": {"layers": 4},
    "layers do not match": {"layers": [4, 4]},
    "layers swapped": {"layers": [2, 3]},
    "one scale": {"scales": [0.1]},
    "negative scale": {"scales": [0.1, -0.1]},
    "scale that overflows": {"scales": [1e300, 1e300]},
    "energy scale of no material": {"energy_scale": 1e300},
    "unknown verdict": {"fitness": {"verdict": "fine", "reasons": []}},
    "zero energy scale": {"energy_scale": 0.0},
    "negative energy scale": {"energy_scale": -1.0},
    "energy scale not a number": {"energy_scale": "big"},
    "hidden not a list": {"hidden": 3},
    "hidden without weights": {"hidden": [{"biases": [0.0]}]},
    "ragged weights": {"hidden": [{"weights": [[1, 2], [3]], "biases": [0, 0, 0]}]},
    "output too short": {"output": [0.1]},
    "negative output": {"output": [0.1, -0.1]},
    "negative skip": {"skip": [-0.1, 0.1]},
    "not finite": {"skip": [float("nan"), 0.1]},
    "unknown unit": {"unit": "psi"},
    "range without a maximum": {"calibrated_range": {"I1": [3.0]}},
    "range not a table": {"calibrated_range": [3.0, 4.0]},
    "range reversed": {"calibrated_range": {"I1": [5.0, 3.0]}},
}


@pytest.mark.parametrize("change", BAD_VALUES.values(), ids=BAD_VALUES)
def test_bad_values(tmp_path, content, change):
    with pytest.raises(errors.ModelFileError, match=r"model\.json"):
        Model.load(written(tmp_path / "model.json", content | change))


def test_transposed_weights(tmp_path, content):
    content["hidden"][0]["weights"] = np.transpose(content["hidden"][0]["weights"]).tolist()
    with pytest.raises(errors.ModelFileError, match="layer 1"):
        Model.load(written(tmp_path / "model.json", content))
