"""How far the data of a test reach, against the quantile of single triangles."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from synthetic import MooneyRivlin, plate_experiment

from calibrate.diagnosis.distillation import fibre_ranges
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from calibrate.effects.fibres import fibre_angles
from calibrate.equations.deformation_modes import MODES, mode_invariants, stretches_to_gradient
from calibrate.equations.equilibrium import equilibrium
from calibrate.fitting.calibrated_range import calibrated_range, curve_ranges, largest_fibre_stretch, mode_ranges, near


def test_fibres_are_stretched_most_along_the_pull():
    system = equilibrium(plate_experiment(MooneyRivlin(), n_increments=3))
    every, F = np.ones(3, bool), system.deformation_gradients
    along = {angle: largest_fibre_stretch(system, every, angle, 1.0) for angle in (0.0, np.pi / 4, np.pi / 2)}
    for angle, found in along.items():
        M = np.array([np.cos(angle), np.sin(angle)])
        assert found == pytest.approx(max(float((f @ M) @ (f @ M)) for f in F.reshape(-1, 2, 2)), rel=1e-12)
    assert max(along.values()) > 1.1 * min(along.values())
    last = np.array([False, False, True])
    assert largest_fibre_stretch(system, last, 0.0, 0.5) <= along[0.0]
    assert calibrated_range(system, quantile=1.0)["I1"][1] > 3.0


def test_every_family_of_a_model_has_a_range_of_its_own():
    """In the order of the file, effects without an amplitude among them."""
    known = {effect.name: effect for effect in CATALOGUE}
    two, one = (known[name] for name in ("two fibre families", "one fibre family"))
    additions = (Addition(two, (0.0,), (0.3, 0.2, 1.0, 0.0)), Addition(one, (0.1,), (1.2, 1.0, 0.0)))
    assert fibre_angles(additions) == {"I4": pytest.approx(0.5), "I4, 2": pytest.approx(0.1), "I4, 3": 1.2}
    system = equilibrium(plate_experiment(MooneyRivlin(), n_increments=2))
    part = SimpleNamespace(system=system, train=SimpleNamespace(rows=np.ones(system.loads.shape, bool)))
    found = fibre_ranges(SimpleNamespace(trained=(part,)), additions)
    every = np.ones(2, bool)
    assert {name: end for name, (_, end) in found.items()} == {
        name: max(1.0, largest_fibre_stretch(system, every, angle)) for name, angle in fibre_angles(additions).items()
    }


@pytest.mark.parametrize("mode", MODES)
def test_a_homogeneous_test_is_near_its_own_mode_alone(mode):
    """Also where it is stretched along y."""
    F = stretches_to_gradient(mode, np.array([1.2, 1.5]))[:, None] * np.ones((1, 3, 1, 1))
    for turned in (F, F[..., ::-1, ::-1]):
        system = SimpleNamespace(isochoric_gradients=turned, areas=np.ones(3), experiment=SimpleNamespace(strain_signal=SimpleNamespace(ratio=100.0)))  # fmt: skip
        found = mode_ranges(system)
        assert found.pop(near(mode)) == pytest.approx((3.0, mode_invariants(mode, np.array([1.5]))[0, 0]))
        assert set(found.values()) == {(3.0, 3.0)}


def test_a_sheet_under_compression_is_one_under_tension_along_its_other_axes():
    """Uniaxial compression to 0.49 stretches the other two axes by 0.49^-0.5; each mode of curves ends where its own data do."""
    F = np.concatenate(
        [stretches_to_gradient("uniaxial", np.array([0.49, 1.0])), stretches_to_gradient("pure_shear", np.array([1.3]))]
    )
    found = curve_ranges(F)
    I1 = mode_invariants("equibiaxial", np.array([0.49**-0.5]))[0, 0]
    assert found["I1"] == found["I1 near equi-biaxial"] == pytest.approx((3.0, I1))
    assert found["I1 near pure shear"] == pytest.approx((3.0, 1.3**2 + 1 + 1.3**-2))
    assert found["I1 near uniaxial"] == (3.0, 3.0)


def test_the_ranges_near_modes_are_within_that_of_all():
    """A plate under tension has hardly any equi-biaxial states."""
    system = equilibrium(plate_experiment(MooneyRivlin(), n_increments=3))
    whole, found = calibrated_range(system)["I1"][1], mode_ranges(system)
    ends = {mode: found[near(mode)][1] for mode in MODES}
    assert ends["uniaxial"] <= whole and max(ends.values()) >= 3 + 0.8 * (whole - 3)
    assert ends["equibiaxial"] - 3 < 0.2 * (whole - 3)
