"""`equigap replay`: a test from another mesh is met, a history is that of the forward model, and what cannot be is named."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from functools import cache

import numpy as np
import pytest

from calibrate import errors
from calibrate.data.experiment import Experiment, Noise
from calibrate.effects import CATALOGUE
from calibrate.effects.chain import Addition
from calibrate.equations.basis import SingleBasis
from calibrate.equations.equilibrium import neo_hooke as neo_hooke_coefficients
from calibrate.models.extended_model import ExtendedModel
from forward.loading import Loading
from forward.materials import ArrudaBoyce, NeoHooke
from forward.sheet.additions import MooneyPart
from forward.sheet.inelastic import solve_history
from forward.sheet.plane_stress import solve
from forward.sheet.sheet_run import Options
from forward.sheet.thin_sheet import Prony, Sheet
from meshes import quads, triangles
from meshes.known_specimens import SPECIMENS
from studies import cli
from studies.errors import OptionError
from studies.replay import replayed_experiment
from studies.replay.model_law import law_of, material_law
from studies.replay.replayed_experiment import mesh_effect, named_edges, replay
from studies.synthetic import camera, effect_laws

PLATE = SPECIMENS["plate_with_hole"]()
BY_NAME = {effect.name: effect for effect in CATALOGUE}
PULL = Loading.clamped(PLATE.loaded, 20.0)


@cache
def solution():
    return solve(quads(PLATE, quarter=True, size_factor=0.5), ArrudaBoyce(), PULL, 2).mirrored()


@cache
def experiment(nodes: int) -> Experiment:
    return camera.observe(solution(), triangles(PLATE, n_nodes=nodes), name="plate")


def extended(*additions: Addition, unit: str = "MPa") -> ExtendedModel:
    """psi = 0.1 MPa (I1 - 3) and effects."""
    basis = SingleBasis(0, 20.0)
    deviations = tuple((0.0,) * len(a.amplitudes) for a in additions)
    return ExtendedModel(basis, neo_hooke_coefficients(basis, 0.2), additions, deviations, unit)


def test_the_true_law_meets_a_test_of_another_mesh_the_better_the_finer_the_camera():
    found = [
        replay(experiment(n), material_law(ArrudaBoyce(), "", experiment(n)), check_mesh=False) for n in (120, 1000)
    ]
    coarse, fine = (one.field_error[-1] for one in found)
    assert (
        fine < 0.4 * coarse
    )  # the hole is a circle, but for the fourth order; stresses are singular at the ends of the grips
    assert fine < 1e-3  # mm, of 20
    assert found[1].force_error < 1e-4
    assert found[1].force_error < found[0].force_error


def test_a_smaller_imbalance_changes_nothing_that_could_be_measured():
    plate = experiment(250)
    law = material_law(ArrudaBoyce(), "", plate)
    found, exact = replay(plate, law, check_mesh=False), replay(plate, law, check_mesh=False, options=Options(1e-12))
    np.testing.assert_allclose(found.displacements, exact.displacements, rtol=0, atol=1e-8 * 20.0)
    for name, force in exact.forces.items():
        np.testing.assert_allclose(found.forces[name], force, rtol=0, atol=1e-8 * np.abs(force).max())


def test_a_hole_is_no_polygon(monkeypatch):
    """A sheet whose holes are polygons is too stiff, by an error of second order in the distance of the points."""
    plate = experiment(250)
    law = material_law(ArrudaBoyce(), "", plate)
    curved = replay(plate, law, check_mesh=False)
    monkeypatch.setattr(replayed_experiment, "HIGHEST", 0.0)
    straight = replay(plate, law, check_mesh=False)
    assert curved.field_error[-1] < 0.3 * straight.field_error[-1]
    assert curved.force_error < 0.3 * straight.force_error
    assert np.linalg.norm(straight.forces["right"]) > np.linalg.norm(straight.measured["right"])


def test_another_law_leaves_a_residual():
    found = replay(experiment(250), material_law(NeoHooke(0.4), "", experiment(250)), check_mesh=False)
    assert found.force_error > 0.05


def test_points_of_grips_and_unmeasured_rims_move_as_measured():
    plate = experiment(250)
    hidden = plate.points[:, 1] > 29.9
    cut = replace(plate, free_nodes=plate.free_nodes[~hidden[plate.free_nodes]])
    edges = named_edges(cut)
    assert len(edges["rim"]) and not len(named_edges(plate)["rim"])
    found = replay(cut, material_law(NeoHooke(0.4), "", cut), check_mesh=False)
    held = ~found.judged
    np.testing.assert_allclose(found.residual[:, held], 0.0, atol=1e-12)
    assert set(np.unique(edges["rim"])) <= set(np.flatnonzero(held))
    assert np.abs(found.residual[-1, found.judged]).max() > 0.01


def test_an_extended_model_is_solved_with_its_effects():
    """Second invariant and relaxation: the sheet of the forward model on the same mesh, but for the table of the base."""
    mesh = triangles(SPECIMENS["strip"](), n_nodes=250)
    pull = Loading.clamped(SPECIMENS["strip"].loaded, 15.0)
    times = np.array([1.0, 4.0, 9.0])
    sheet = Sheet(NeoHooke(0.2), 1.0, (MooneyPart(0.03),), (Prony(0.4, 3.0),))
    true = solve_history(quads(SPECIMENS["strip"]()), sheet, pull, [0.3, 1.0, 1.0], times, substeps=3)
    test = camera.observe(true, mesh, name="strip")
    model = extended(Addition(BY_NAME["second invariant"], (0.03,)), Addition(BY_NAME["viscoelasticity"], (0.4,), (3.0,)),
                     Addition(BY_NAME["force offset"], (0.1, 0.0)))  # fmt: skip
    law = law_of(model, test)
    assert law.effects == ("second invariant", "viscoelasticity")
    assert law.left_out == ("force offset",)
    found = replay(test, law, check_mesh=False)
    assert found.force_error < 2e-3
    assert found.field_error[-1] < 0.02
    without = replay(test, law_of(extended(), test), check_mesh=False)
    assert without.force_error > 0.1


def test_a_test_that_was_fitted_has_the_noise_that_the_diagnosis_found():
    """Of the file of another test it is that of the test."""
    plate = replace(experiment(120), noise=Noise(0.3)).select([1])
    training = ({"name": "a", "fingerprint": plate.fingerprint, "spacing": None, "noise": asdict(Noise(0.03, 2.0, pattern_std=0.04))},)  # fmt: skip
    for model, known in ((replace(extended(), training=training), 0.05), (extended(), 0.3)):
        assert replay(plate, law_of(model, plate), check_mesh=False).noise == pytest.approx(known)
    other = plate.select([0])
    assert law_of(replace(extended(), training=training), replace(other, points=other.points + 1e-9)).noise is None


@pytest.mark.slow
def test_the_mesh_is_refined_where_it_matters_more_than_the_noise():
    plate = experiment(250)
    law = material_law(ArrudaBoyce(), "", plate)
    effect = mesh_effect(plate, law)
    noisy, exact = (replace(plate.select([1]), noise=Noise(factor * effect.field)) for factor in (2.0, 0.5))
    assert replay(noisy, law).refined == 0
    found = replay(exact, law)
    assert found.refined == 1
    assert len(found.solution.mesh.cells) > 4 * len(plate.triangles) > len(replay(noisy, law).solution.mesh.cells)


def test_what_does_not_go_together_is_named(monkeypatch):
    plate = experiment(250)
    slow = Addition(BY_NAME["viscoelasticity"], (0.4,), (3.0,))
    with pytest.raises(errors.ConfigError, match="N/mm"):
        law_of(extended(unit="N/mm"), plate)
    with pytest.raises(errors.ConfigError, match="time"):
        law_of(extended(slow), replace(plate, time=None))
    monkeypatch.setattr(effect_laws, "SOLVED", frozenset({"viscoelasticity"}))
    with pytest.raises(OptionError, match="upturn"):
        law_of(extended(slow, Addition(BY_NAME["upturn"], (0.01,))), plate)


def test_the_command_writes_fields_forces_and_maps(tmp_path, capsys):
    replace(experiment(250), noise=Noise(5e-3)).save(tmp_path / "plate.npz")
    words = ["replay", str(tmp_path / "plate.npz"), "arruda_boyce", "--skip-mesh-check", "-o", str(tmp_path / "out")]
    assert cli.main(words) == 2  # a material without a number would be one that nobody stated
    assert "--parameter" in capsys.readouterr().err
    assert cli.main([*words, "--parameter", f"mu={ArrudaBoyce().mu}"]) == 0
    told = capsys.readouterr().out
    assert "Forces" in told
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"replay.npz", "replay.vtu", "forces.csv", "fields.csv", "maps.png", "maps.json", "report.html"} <= names
    manifest = json.loads((tmp_path / "out" / "maps.json").read_text())
    assert manifest["results"]["force_error"] < 2e-3
    with np.load(tmp_path / "out" / "replay.npz") as file:
        assert file["displacements"].shape == experiment(250).displacements.shape
    assert cli.main(["replay", str(tmp_path / "plate.npz"), "model.txt"]) == 2
    assert "model.txt" in capsys.readouterr().err
