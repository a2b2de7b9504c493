"""Energies of the materials, and the network material against the formula it is documented with."""

import json

import numpy as np
import pytest
from forward_helpers import MATERIALS, MODEL, energy_derivatives, nominal_stresses

from forward import ArrudaBoyce, Loading, MooneyRivlin, NeoHooke, Pann, material_from_dict
from forward.errors import MaterialError
from forward.sheet.plane_stress import solve
from meshes import SquareSheet, Strip, quads


@pytest.mark.parametrize("material", MATERIALS.values(), ids=MATERIALS)
def test_energy_at_rest_and_its_slope(material):
    assert material.energy(3.0, 3.0) == pytest.approx(0, abs=1e-15)
    step = 1e-4
    for I1 in (3.1, 8.0, 15.0):
        p1, p2 = energy_derivatives(material, I1)
        slope1 = (material.energy(I1 + step, 5.0) - material.energy(I1 - step, 5.0)) / (2 * step)
        slope2 = (material.energy(I1, 5.0 + step) - material.energy(I1, 5.0 - step)) / (2 * step)
        assert slope1 == pytest.approx(p1, rel=1e-7)
        assert slope2 == pytest.approx(p2, rel=1e-7, abs=1e-12)
    assert material.shear_modulus == pytest.approx(2 * sum(energy_derivatives(material, 3.0)), rel=1e-12)


@pytest.mark.parametrize("material", [*MATERIALS.values(), Pann.from_dict(MODEL)], ids=[*MATERIALS, "pann"])
def test_dictionary(material):
    assert material_from_dict(json.loads(json.dumps(material.to_dict()))) == material


@pytest.mark.parametrize(
    ("make", "key"),
    [
        (lambda: NeoHooke(np.nan), "finite"),
        (lambda: MooneyRivlin(0.1, -0.2), "positive"),
        (lambda: material_from_dict({"material": "rubber"}), "arruda_boyce"),
        (lambda: material_from_dict({"material": "neo_hooke", "nu": 0.3}), "nu"),
    ],
)
def test_bad_materials(make, key):
    with pytest.raises(MaterialError, match=key):
        make()


def network_energy(I1, I2):
    """The documented formula of the network, written with matrices."""
    rest = np.array([3.0, 3.0**1.5])

    def value(J):
        x = np.array(MODEL["scales"]) * (J - rest)
        z = x
        for layer in MODEL["hidden"]:
            z = np.log1p(np.exp(np.array(layer["weights"]) @ z + layer["biases"]))
        return np.dot(MODEL["output"], z) + np.dot(MODEL["skip"], x)

    return MODEL["energy_scale"] * (value(np.array([I1, I2**1.5])) - value(rest))


def test_network_energy():
    material = Pann.from_dict(MODEL)
    for I1, I2 in ((3.0, 3.0), (4.0, 3.8), (20.0, 12.0)):
        assert material.energy(I1, I2) == pytest.approx(network_energy(I1, I2), rel=1e-13, abs=1e-15)


def test_network_of_the_calibration_package(tmp_path):
    """The model file that `calibrate` writes means the same here."""
    from calibrate.models import network_model, pann

    for inputs, layers in (("I1", (1,)), ("I2", (8,)), ("I1I2", (4, 4))):
        architecture = pann.Architecture(inputs, layers, (0.2, 0.05), 0.3)
        parameters = np.random.default_rng(1).uniform(0, 0.5, architecture.n_parameters)
        written = network_model.Model(architecture, parameters)
        written.save(tmp_path / "model.json")
        read = Pann.from_file(tmp_path / "model.json")
        for I in ((3.5, 3.4), (9.0, 6.0)):
            assert read.energy(*I) == pytest.approx(float(written.energy(np.array(I))), rel=1e-12)


def test_network_in_the_forward_model():
    """A network with only its skip connections is a polynomial in I1 and I2^(3/2); stretched biaxially."""
    skip_only = {**MODEL, "output": [0.0, 0.0]}
    sheet = SquareSheet(10.0, 10.0, far_size=10.0)
    loading = Loading({"right": (8.0, None), "top": (None, 4.0)})
    solution = solve(quads(sheet, quarter=True), Pann.from_dict(skip_only), loading, 2)
    a, b = 1.8, 1.4
    I2 = a**2 * b**2 + (a**2 + b**2) / (a * b) ** 2
    p1, p2 = 0.7 * 0.2 * 0.5, 0.7 * 0.05 * 0.1 * 1.5 * I2**0.5
    stress = 2 * (p1 + b**2 * p2) * (a - 1 / (a**3 * b**2))
    assert solution.reactions["right"][-1, 0] == pytest.approx(stress * 10.0, rel=1e-8)


def test_network_stretched_uniaxially():
    """Reaction against the slope of the documented energy along the uniaxial path."""
    strip = Strip(30.0, 10.0, far_size=10.0)
    solution = solve(quads(strip, quarter=True), Pann.from_dict(MODEL), Loading({"right": (30.0, None)}), 2)

    def energy(a):
        return network_energy(a**2 + 2 / a, 2 * a + 1 / a**2)

    slope = (energy(2 + 1e-5) - energy(2 - 1e-5)) / 2e-5
    assert solution.reactions["right"][-1, 0] == pytest.approx(slope * 10.0, rel=1e-7)


def test_bad_model_files(tmp_path):
    path = tmp_path / "model.json"
    with pytest.raises(MaterialError, match="model.json"):
        Pann.from_file(path)
    for change, message in (
        ({"format": "else"}, "'equigap-model'"),
        ({"inputs": "I3"}, "I3"),
        ({"output": [1.0]}, "needed"),
        ({"layers": [2, 2]}, "layers"),
        ({"skip": [np.nan, 1.0]}, "finite"),
        ({"unit": "psi"}, "unit 'psi'"),
        ({"output": [0.0, 0.0], "skip": [0.0, 0.0]}, "stiffness"),
    ):
        path.write_text(json.dumps({**MODEL, **change}))
        with pytest.raises(MaterialError, match=message):
            Pann.from_file(path)


def test_model_without_thickness_is_solved_with_thickness_one():
    material, sheet = Pann.from_dict({**MODEL, "unit": "N/mm"}), SquareSheet(far_size=50.0)
    with pytest.raises(MaterialError, match="thickness 1"):
        solve(quads(sheet, quarter=True), material, Loading.clamped(["right"], 1.0), thickness=2.0)


def test_closed_form_of_the_helper():
    """The closed forms the other tests lean on: uniaxial neo-Hooke is mu (a - a^-2)."""
    assert nominal_stresses(NeoHooke(0.3), 2.0, 2.0**-0.5)[0] == pytest.approx(0.3 * 1.75)
    assert ArrudaBoyce(0.3, 1e9).shear_modulus == pytest.approx(0.3)
