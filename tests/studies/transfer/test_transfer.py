"""A model on another specimen: factors, a map of stiffness that counts only where it predicts, files, and what is refused."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
from pulled_sheets import MU, SIZE, TIME, layered, material, read_as, section_forces, uniaxial

from calibrate import errors
from calibrate.data.experiment import Noise
from calibrate.diagnosis.hold_out import HoldOut
from calibrate.effects.chain import Addition
from calibrate.effects.lens_distortion import LensDistortion
from calibrate.effects.second_invariant import SecondInvariant
from calibrate.effects.viscosity import Viscosity
from studies import cli
from studies.transfer import report
from studies.transfer.transferred import AS_IT_IS, MAP, NEO_HOOKE, RELAXATION, STIFFNESS, transfer

AFTER = HoldOut.parse("after:10")


def noisy(e, std=2e-3, seed=0):
    """Displacements with noise, mm, forces with a thousandth."""
    rng = np.random.default_rng(seed)
    moved = e.displacements + rng.normal(0.0, std, e.displacements.shape)
    return replace(e, displacements=moved, noise=Noise(std, 0.0, 0.0, 1e-3))


def test_section_forces_of_a_uniform_sheet():
    e = uniaxial()
    pull = np.abs(e.loaded[-1].force[:, 1])
    found = section_forces(e, material())
    assert found == pytest.approx(np.repeat(pull[:, None], found.shape[1], axis=1), rel=2e-3)


def test_a_material_is_transferred_with_one_factor():
    found = transfer(uniaxial(), material(mu=0.5 * MU), AFTER, 12.0)
    assert found.row(STIFFNESS).stiffness == pytest.approx(2.0, rel=5e-3)
    assert found.row(STIFFNESS).held_out.force < 5e-3
    assert found.row(AS_IT_IS).held_out.force == pytest.approx(0.5, abs=5e-3)
    assert found.row(NEO_HOOKE).held_out.force < 5e-3
    assert section_forces(uniaxial(), found.model).mean() == pytest.approx(
        section_forces(uniaxial(), material()).mean(), rel=5e-3
    )


def test_neo_hooke_and_a_neo_hookean_model_are_fitted_alike():
    """Noise stretches the sheet in the mean; what it adds to the forces is taken off both."""
    found = transfer(noisy(uniaxial(), std=0.1), material(), AFTER, 12.0)
    model, reference = found.row(STIFFNESS), found.row(NEO_HOOKE)
    assert model.over_increments == pytest.approx(reference.over_increments, abs=1e-5)


def test_what_moves_along_a_sliding_edge_is_no_error_of_the_fields():
    """The sheet contracts freely, so that its edges may as well slide; the model is the one that it is made of."""
    slides = tuple(replace(b, held=(False, True)) for b in uniaxial().loaded)
    found = transfer(replace(uniaxial(), loaded=slides), material(), AFTER, 12.0)
    for name in (AS_IT_IS, STIFFNESS, MAP):
        assert found.row(name).held_out.field < 1e-6
    assert "T802" not in {one.alert.code for one in report.findings(found)}


def unread(e, missing):
    """Without the readings {side: increments}."""
    return replace(e, loaded=tuple(replace(b, force=_without(b.force, missing[b.name])) for b in e.loaded))


def _without(force, increments):
    found = force.copy()
    found[increments] = np.nan
    return found


def test_a_reading_that_is_missing_leaves_the_others():
    """One of each side, and all of an increment."""
    found = transfer(unread(uniaxial(), {"top": [1, 2], "bottom": [2, 7]}), material(mu=0.5 * MU), AFTER, 12.0)
    row = found.row(STIFFNESS)
    assert row.stiffness == pytest.approx(2.0, rel=5e-3)
    assert row.held_out.force < 5e-3
    np.testing.assert_array_equal(np.isnan(row.over_increments), np.arange(len(TIME)) == 2)


@pytest.mark.parametrize(("missing", "said"), [(range(5), "no factor can be found"), (range(5, 10), "held out")])
def test_no_force_to_fit_to_or_to_judge_by_is_said(missing, said):
    e = unread(uniaxial(), {"top": list(missing), "bottom": list(missing)})
    with pytest.raises(errors.FitError, match=said):
        transfer(e, material(), AFTER, 12.0)


def test_the_strength_of_relaxation_has_its_own_factor():
    """A force with twice the overstress that was learnt; factors are fitted to what is not held out alone."""
    learnt = material(Addition(Viscosity(), (0.2,), (3.0,)))
    e = read_as(uniaxial(), learnt.scaled(1.5, 2.0))
    found = transfer(e, learnt, AFTER, 12.0)
    row = found.row(RELAXATION)
    assert (row.stiffness, row.relaxation) == (pytest.approx(1.5, rel=2e-2), pytest.approx(2.0, rel=2e-2))
    spoilt = [replace(b, force=np.where((TIME > 10)[:, None], 3 * b.force, b.force)) for b in e.loaded]
    again = transfer(replace(e, loaded=tuple(spoilt)), learnt, AFTER, 12.0)
    assert again.row(RELAXATION).stiffness == pytest.approx(row.stiffness, rel=1e-6)
    assert again.row(RELAXATION).held_out.force > 0.5


@pytest.mark.parametrize("missing", [[], [1, 3]])
def test_the_stiffer_half_is_located(missing):
    sheet = unread(layered(), {"top": missing, "bottom": missing[:1]})
    found = transfer(sheet, material(), AFTER, 8.0)
    e, values = found.experiment, found.map.values * found.final.stiffness
    y = e.points[:, 1]
    inner = np.abs(e.points[:, 0] - SIZE / 2) < SIZE / 4
    assert np.median(values[inner & (y < 0.3 * SIZE)]) == pytest.approx(1.0, abs=0.1)
    assert np.median(values[inner & (y > 0.7 * SIZE)]) == pytest.approx(2.0, abs=0.2)
    assert found.map.is_real
    assert found.best is found.row(MAP)
    assert found.best.held_out.field < 0.2 * found.final.held_out.field
    assert found.best.fitted.force < found.final.fitted.force + 1e-3


def test_an_even_sheet_has_no_map():
    """With noise; more of them in the slow test below."""
    alarms = sum(transfer(noisy(uniaxial(), seed=seed), material(), AFTER, 8.0).map.is_real for seed in range(4))
    assert alarms == 0


@pytest.mark.slow
def test_none_of_many_even_sheets_has_a_map():
    """As docs/transfer.md states; the largest gain is half of what counts."""
    gains = [transfer(noisy(uniaxial(), seed=seed), material(), AFTER, 8.0).map.gain for seed in range(200)]
    assert max(gains) < 0.03


def test_effects_of_another_test_are_left_out():
    learnt = material(Addition(LensDistortion(), (0.01,), (0.0, 0.0)))
    found = transfer(uniaxial(), learnt, AFTER, 12.0)
    assert found.left_out == ("lens distortion",)
    assert found.row(STIFFNESS).held_out.force < 5e-3
    assert "T805" in {one.alert.code for one in report.findings(found)}


def test_a_model_on_its_own_test_is_no_prediction():
    own = ({"name": "sheet", "fingerprint": uniaxial().fingerprint, "spacing": None},)
    said = {
        training: {
            one.alert.code
            for one in report.findings(transfer(uniaxial(), replace(material(), training=tests), AFTER, 12.0))
        }
        for training, tests in (("own", own), ("another", ()))
    }
    assert "T806" in said["own"]
    assert "T806" not in said["another"]


def test_what_predicts_worse_than_neo_hooke_is_said():
    """A second invariant that this sheet does not have bends the curve; neo-Hooke is what it is made of."""
    for learnt, worse in ((material(Addition(SecondInvariant(), (2 * MU,))), True), (material(mu=2 * MU), False)):
        found = transfer(uniaxial(), learnt, HoldOut.parse("after:5"), 12.0)
        assert (found.row(STIFFNESS).held_out.force > 2 * found.row(NEO_HOOKE).held_out.force + 0.01) is worse
        assert ("T802" in {one.alert.code for one in report.findings(found)}) is worse


@pytest.mark.parametrize(
    ("change", "rule", "said"),
    [
        ({}, "none", "no increment is held out"),
        ({}, "after:0.5", "leaves nothing to fit"),
        ({"time": None}, "after:10", "needs a time"),
        ({"thickness": None}, "after:10", "give the thickness"),
    ],
)
def test_what_does_not_go_together_is_refused(change, rule, said):
    with pytest.raises(errors.ConfigError, match=said):
        transfer(replace(uniaxial(), **change), material(), HoldOut.parse(rule), 12.0)


def test_a_sheet_without_forces_is_refused():
    e = uniaxial()
    unknown = tuple(replace(b, force=np.full_like(b.force, np.nan)) for b in e.loaded)
    with pytest.raises(errors.EquigapError, match="force"):
        transfer(replace(e, loaded=unknown), material(), AFTER, 12.0)


def test_the_command_writes_what_it_says(tmp_path, capsys):
    material(mu=0.5 * MU).save(tmp_path / "model.json")
    noisy(layered()).save(tmp_path / "sheet.npz")
    files = [str(tmp_path / name) for name in ("model.json", "sheet.npz")]
    out = tmp_path / "out"
    assert cli.main(["transfer", *files, "--hold-out", "after:10", "--spacing", "8", "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert "T801" in said and "T803" in said
    content = json.loads((out / "transfer.json").read_text())
    assert [row["name"] for row in content["models"]] == [NEO_HOOKE, AS_IT_IS, STIFFNESS, MAP]
    assert len(content["fitted_increments"]) == (TIME <= 10).sum()
    rows = list(csv.reader((out / "stiffness.csv").read_text().splitlines()))
    assert len(rows) - 1 == len(layered().points)
    assert {"report.html", "report.json", "stiffness.png", "forces.png", "model.json", "errors.csv"} <= {
        p.name for p in out.iterdir()
    }
    assert cli.main(["predict", str(out / "model.json"), "--test", files[1], "-o", str(tmp_path / "predicted")]) == 0
