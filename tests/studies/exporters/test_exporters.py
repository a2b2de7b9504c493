"""Exported code against the model itself: energy, stress, tangent, histories; what a target cannot carry is refused."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from calibrate.equations.basis import PlaneStrainBasis, SingleBasis
from calibrate.models import pann
from calibrate.models.extended_model import ExtendedModel
from calibrate.models.network_model import Model
from forward.materials import MATERIALS, Yeoh
from studies.errors import ExportError
from studies.exporters import target_named, targets
from studies.exporters.certificate import random_states, relative
from studies.exporters.fortran_code import compiler
from studies.exporters.material_law import law_of
from studies.exporters.python_function import namespace
from studies.exporters.target import volume_of
from studies.exporters.umat import differences, history_size, material_point, sheet_stress, solid

EFFECTS = {effect.name: effect for effect in CATALOGUE}
needs_gfortran = pytest.mark.skipif(compiler() is None, reason="gfortran is not installed")


def network(inputs="I1I2", layers=(8, 3)):
    architecture = pann.Architecture(inputs, layers, (0.5, 0.1), 0.4)
    parameters = np.asarray(architecture.random_start(jax.random.key(1)))
    return Model(architecture, parameters, calibrated_range={"I1": (3.0, 5.0), "I2": (3.0, 5.0)})


def extended(additions=(), k=0):
    basis = SingleBasis(k, 4.0, 12)
    c = (0.3, 0.04)[k] * (1 + 0.4 * basis.spline.sites**2 + 0.02 * np.sin(9 * basis.spline.sites))
    members = tuple(Addition(EFFECTS[name], a, shape) for name, a, shape in additions)
    deviations = tuple(tuple(0.0 for _ in a.amplitudes) for a in members)
    return ExtendedModel(basis, c, members, deviations, "MPa")


ENERGY = (("second invariant", (0.03,), ()), ("upturn", (0.001,), ()))
HISTORY = (
    ("two fibre families", (0.05,), (0.4, 0.2, 0.6, 0.1)),
    ("viscoelasticity", (0.3,), (2.0,)),
    ("second relaxation time", (0.2,), (0.3,)),
    ("Mullins softening", (0.2,), (0.05, 0.3)),
    ("Payne softening", (0.3,), (0.1,)),
)
SPRINGS = (
    ("finite viscoelasticity", (0.15,), (2.0,)),
    ("second finite relaxation time", (0.1,), (0.3,)),
)
LAWS = {
    "network": network(),
    "network of I2": network("I2", (1,)),
    "spline of I1 and two terms": extended(ENERGY),
    "spline of I2": extended(k=1),
    "carroll": MATERIALS["carroll"](),
    "arruda_boyce": MATERIALS["arruda_boyce"](),
}


SLOWER = ("network of I2", "spline of I2", "arruda_boyce")


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] if n in SLOWER else []) for n in LAWS])
def test_exported_energy_stress_and_tangent_are_those_of_the_model(name):
    law = law_of(LAWS[name], name)
    for target in ("python", "ufl", "uhyper"):
        errors = targets()[target].export(law).errors
        if errors is None:
            pytest.skip("gfortran is not installed")
        assert errors.stress < 1e-10 and errors.tangent < 1e-10, target
        assert errors.energy < 1e-8, target  # a quadrature over the kinks of splines


@needs_gfortran
@pytest.mark.parametrize(("k2", "kappa"), [(0.0, 0.0), (0.6, 0.0), (0.6, 0.1)])
def test_umat_at_a_material_point(k2, kappa):
    fibres = ("two fibre families", (0.05,), (0.4, 0.2, k2, kappa))
    errors = targets()["umat"].export(law_of(extended((fibres,)), "law")).errors
    assert errors.energy < 1e-9 and errors.stress < 1e-10 and errors.tangent < 1e-8


@needs_gfortran
@pytest.mark.parametrize("effects", [HISTORY, SPRINGS, (*HISTORY, *SPRINGS)], ids=["Prony", "springs", "both"])
def test_umat_follows_a_history_of_relaxation_and_softening_in_a_sheet(effects):
    law = law_of(extended(effects), "law")
    target = targets()["umat"]
    update = material_point(target.body(law, volume_of(law, 1e6)), history_size(law))
    stretch, time = np.array([1.2, 1.5, 1.7, 1.4, 1.2, 1.6]), np.array([0.5, 1.0, 1.5, 3.0, 4.0, 4.1])
    path = np.array([[[x, 0.1 * (x - 1)], [0.0, x**-0.3]] for x in stretch])
    expected = np.asarray(law.stress(jnp.asarray(path)[:, None], jnp.asarray(time)))[:, 0]
    history, found = np.zeros(history_size(law)), []
    for f, step in zip(path, np.diff(time, prepend=0.0), strict=True):
        F = solid(f)
        for _ in range(6):  # the thickness at which the faces are free
            stress, tangent, state, _ = update(F, history, step)
            F[2, 2] *= np.exp(-stress[2] / tangent[2, 2])
        assert relative(tangent, differences(update, F, history, step)) < 1e-7
        history = state
        found.append(sheet_stress(stress, f))
    assert relative(np.array(found), expected) < 1e-5  # the shear modulus over the bulk modulus of 1e6 MPa


@needs_gfortran
def test_volume_of_a_compressible_law():
    law = law_of(extended((("compressibility", (0.5,), ()),)), "law")
    body = targets()["umat"].body(law, volume_of(law, None))
    stress, *_ = material_point(body, 1)(1.1 * np.eye(3), np.zeros(1), 1.0)
    np.testing.assert_allclose(stress[:3], 2.0 * (1.1**3 - 1), rtol=1e-12)  # kappa (J - 1), kappa = 1 / beta


def test_python_tangent_of_a_sheet_is_the_derivative_of_its_stress():
    law = law_of(network(), "law")
    code = namespace(targets()["python"].export(law).text)
    F = np.moveaxis(random_states(law, 5), 0, -1)
    A = code["plane_stress"](F)[1]
    for k, m in np.ndindex(2, 2):
        step = np.zeros_like(F)
        step[k, m] = 1e-6
        slope = (code["plane_stress"](F + step)[0] - code["plane_stress"](F - step)[0]) / 2e-6
        np.testing.assert_allclose(A[:, :, k, m], slope, atol=1e-7)


def test_what_a_target_cannot_carry_is_refused_by_name():
    law = law_of(extended(HISTORY), "law")
    for target in ("uhyper", "python", "ufl"):
        with pytest.raises(ExportError, match="viscoelasticity"):
            targets()[target].export(law)
    with pytest.raises(ExportError, match="permanent set"):
        law_of(extended((("permanent set", (0.1,), ()),)), "law")
    left = law_of(extended((("force gain", (0.1,), ()),)), "law")
    assert left.left_out == ("force gain",)
    assert "force gain" in targets()["python"].export(left).text


def test_export_command(equigap, tmp_path):
    file = tmp_path / "model.json"
    network().save(file)
    said = equigap("export", file, "--to", "python", "-o", tmp_path / "law")
    assert said.code == 0
    text = (tmp_path / "law" / "law.py").read_text()
    assert "Valid range" in text and (tmp_path / "law" / "law.json").exists()
    assert law_of(Yeoh(), "yeoh").beside == ()


def test_the_range_of_a_law_is_that_of_its_own_invariants():
    """A network of I1 alone is not limited by I2, which its range states, too."""
    ranges = {"I1": (3.0, 5.0), "I2": (3.0, 3.2)}
    narrow, wide = (law_of(replace(network(inputs), calibrated_range=ranges), "law") for inputs in ("I1I2", "I1"))
    assert wide.top == (5.0, np.inf)
    assert narrow.top == (5.0, 3.2)
    assert wide.largest_stretch("equibiaxial") > narrow.largest_stretch("equibiaxial")


@pytest.mark.parametrize(("asked", "name"), [("UHYPER", "uhyper"), ("MAT_181", "mat181"), ("Card", "card")])
def test_targets_are_named_as_their_programs_spell_them(asked: str, name: str) -> None:
    assert target_named(asked).name.replace("_", "") == name
    with pytest.raises(ExportError, match="choose from"):
        target_named("abaqus")


def test_a_law_in_plane_strain_carries_nothing_that_its_targets_do_otherwise():
    """There fibres, softening and relaxation act on the isochoric part, in a UMAT on the whole deformation."""

    def strained(additions):
        model = extended(additions)
        basis = PlaneStrainBasis(model.basis)
        return replace(model, basis=basis, c=np.append(model.c, 2.0))

    assert law_of(strained(ENERGY), "law").bulk_modulus == 2.0
    for one in HISTORY:
        with pytest.raises(ExportError, match=f"'{one[0]}' of a model in plane strain"):
            law_of(strained((one,)), "law")


def test_a_header_says_what_was_seen_of_each_mode_and_of_fibres():
    seen = {"I1": (3.0, 5.0), "I1 near equi-biaxial": (3.0, 3.0), "I1 near pure shear": (3.0, 3.3), "I4": (1.0, 1.21)}
    law = law_of(replace(extended(HISTORY[:1]), calibrated_range=seen), "law")
    assert law.valid["equibiaxial"] == pytest.approx(1.0) and law.valid["uniaxial"] == law.largest_stretch("uniaxial")
    assert 1.0 < law.valid["pure_shear"] < law.largest_stretch("pure_shear")
    assert any("stretched by 1.1 at most" in line for line in law.origin)
