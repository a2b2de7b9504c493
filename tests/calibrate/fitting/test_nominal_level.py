"""A window in a larger body: equilibrium inside it gives ratios of stiffness, whatever the recorded forces are."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from synthetic import ArrudaBoyce, derivatives, plate_experiment, with_noise

from calibrate.data.experiment import Experiment, Noise
from calibrate.diagnosis.base_fit import prepare
from calibrate.diagnosis.distillation import distil
from calibrate.diagnosis.effect_fit import refit
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.diagnosis.misfit import misfit
from calibrate.diagnosis.problem import all_rows, level_factor
from calibrate.diagnosis.score_tests import Status, score
from calibrate.effects import CATALOGUE
from calibrate.equations.deformation_modes import nominal_stress
from calibrate.equations.equilibrium import equilibrium
from calibrate.errors import FitError
from calibrate.fitting.calibrated_range import calibrated_range
from calibrate.fitting.calibration import Options, calibrate
from calibrate.models.model_file import load_model
from studies.reports.calibration.fit_review import review, section_shares
from studies.reports.prediction.predicted_forces import forecast

FAST = Options(layers=(3,), starts=4)
NOISE = Noise(0.005, 3.0, 1e-3, 1e-3)
SOFT_FIRST = ArrudaBoyce(0.27, 4.0)  # stiffens plainly


@cache
def whole() -> Experiment:
    return with_noise(plate_experiment(SOFT_FIRST, 30.0, n_increments=4), NOISE, 1)


def window(factors=(1.0, 1.0, 1.0, 1.0)) -> Experiment:
    """The same with forces that are not the section's; its free edges are kept, as the plate has no other side."""
    loaded = tuple(replace(b, force=b.force * np.reshape(factors, (-1, 1))) for b in whole().loaded)
    return replace(whole(), loaded=loaded, provenance={"rim": True})


def shape(model, stretch=(1.1, 1.3, 1.5)) -> np.ndarray:
    """Stress at stretches over that at the first."""
    stress = model.homogeneous("uniaxial", np.array(stretch))
    return stress / stress[0]


@cache
def fitted():
    return calibrate(window(), FAST)


def test_one_equation_has_a_force_the_others_none():
    system = equilibrium(window())
    loaded = np.tile(system.fields.boundary >= 0, 2)
    assert np.isfinite(system.loads[:, loaded]).sum() == system.level_equation.sum() == 1
    assert np.abs(system.loads[system.level_equation]) == np.nanmax(np.abs(system.recorded))
    assert not equilibrium(whole()).level_equation.any()


def test_ratios_of_stiffness_are_those_of_the_material():
    truth = nominal_stress(lambda i: derivatives(SOFT_FIRST, i), "uniaxial", np.array([1.1, 1.3, 1.5]))
    assert shape(fitted().model) == pytest.approx(truth / truth[0], rel=0.03)


def test_recorded_forces_change_nothing_but_the_level():
    """Three times as large, and otherwise over the increments: the same model, three times as stiff."""
    other = calibrate(window((1.0, 0.3, 2.0, 3.0)), FAST).model
    assert shape(other) == pytest.approx(shape(fitted().model), rel=1e-3)
    level = other.homogeneous("uniaxial", np.array([1.3])) / fitted().model.homogeneous("uniaxial", np.array([1.3]))
    assert level == pytest.approx(3.0, rel=1e-3)


def test_the_level_is_that_of_its_increment():
    found = review(calibrate(window((1.0, 0.5, 1.0, 1.0)), FAST))
    shares = section_shares(found)
    assert shares["right"][0] == pytest.approx(1.0, rel=0.05)
    assert shares["right"][1] == pytest.approx(2.0, rel=0.05)
    carried, recorded = (
        np.array([forces[name][-1, 0] for name in ("left", "right")]) for forces in (found.forces, found.measured)
    )
    assert carried @ recorded == pytest.approx(recorded @ recorded, rel=1e-6)  # along the pull


def test_a_model_file_says_that_its_level_is_nominal(tmp_path):
    fitted().model.save(tmp_path / "model.json")
    assert load_model(tmp_path / "model.json").level_is_nominal
    own = forecast(tmp_path / "model.json", window())
    for name, force in fitted().predicted_forces.items():  # one model, one force, whatever is recorded
        assert own.forces[name] == pytest.approx(force, abs=1e-12)
    found = forecast(tmp_path / "model.json", replace(whole(), loaded=tuple(replace(b, force=5 * b.force) for b in whole().loaded)))  # fmt: skip
    assert found.factor == pytest.approx(5.0, rel=0.05)
    assert found.error < 0.05


def test_sections_that_pull_against_the_record_are_refused():
    system = fitted().system
    with pytest.raises(FitError, match="in the other direction.*drop_points"):
        system.share_carried(-system.recorded)


@pytest.mark.slow
def test_a_model_of_a_diagnosis_has_the_nominal_level_and_the_range_of_the_area(tmp_path):
    rule = HoldOut.parse("every:2")
    problem, base = prepare([window()], [rule.training])
    fit = refit(problem, base.c, ())
    network, level = distil(problem, fit).network, level_factor(problem, fit.c, ())
    system = problem.parts[0].system
    stress = network.nominal_stress(system.deformation_gradients)
    assert system.share_carried(system.internal_forces(stress)) == pytest.approx(1.0, rel=0.02)
    spline = level * (problem.parts[0].own_residual(fit.c) + np.nan_to_num(system.loads))
    assert system.share_carried(spline) == pytest.approx(1.0, rel=1e-9)
    assert network.calibrated_range["I1"][1] < 3 + problem.parts[0].chain.energy.top
    assert network.calibrated_range["I1"] == pytest.approx(
        calibrated_range(system, problem.parts[0].train.rows.any(axis=1))["I1"]
    )


def test_a_diagnosis_holds_the_level_and_judges_no_force():
    rule = HoldOut.parse("every:2")
    problem, base = prepare([window()], [rule.training])
    part = problem.parts[0]
    assert part.train.rows[part.system.level_equation].all()
    assert problem.level_is_nominal
    for held in (False, True):
        found = misfit(problem, base.c, (), held)
        assert np.isnan(found.force) and 0 < found.field < 0.05


def test_beside_a_test_whose_forces_are_measured_a_window_fixes_no_level():
    problem, base = prepare([window((5.0, 5.0, 5.0, 5.0)), whole()], [all_rows, all_rows])
    assert [part.system.level_equation.any() for part in problem.parts] == [False, False]
    alone, reference = prepare([whole()], [all_rows])
    assert not problem.level_is_nominal
    F = problem.parts[1].system.deformation_gradients[-1]
    one, other = (p.parts[-1].system.matrix(p.basis, F) @ f.c for p, f in ((problem, base), (alone, reference)))
    assert one == pytest.approx(other, abs=0.02 * np.abs(other).max())


def test_effects_of_a_load_cell_need_forces_that_are_used():
    problem, base = prepare([window()], [all_rows])
    chosen = [effect for effect in CATALOGUE if effect.of_forces]
    assert chosen
    assert not {one.status for one in score(problem, base, chosen)} & {Status.TESTED, Status.ABSORBED}
