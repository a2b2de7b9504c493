"""Thickness report: judgements against made-up numbers, densities and borders against closed forms, a whole report."""

import argparse
import dataclasses
import json
import re
import shutil

import numpy as np
import pytest
import thickness_stand_in as stand_in

from forward.solid.solid_solution import SolidSolution
from studies.grid import (
    thickness_convergence,
    thickness_convergence_report,
    thickness_figures,
    thickness_models,
    thickness_report,
    thickness_tables,
    thickness_words,
)
from studies.grid.thickness_results import Line, Results, lines
from studies.reports import solid_pictures


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    return Results(stand_in.fill(tmp_path_factory.mktemp("thickness")), stand_in.SETTINGS)


def test_density_of_normal_data_is_normal():
    x = np.linspace(-4, 4, 20001)
    grid = np.linspace(-3, 3, 1201)
    found = thickness_models.density(x, np.exp(-(x**2) / 2), grid)
    np.testing.assert_allclose(found, np.exp(-(grid**2) / 2) / np.sqrt(2 * np.pi), atol=0.005)


def test_admissible_borders_are_uniaxial_and_equibiaxial():
    stretch = np.array([1.1, 1.5, 2.2])
    low, _ = thickness_models.admissible(stretch**2 + 2 / stretch)
    np.testing.assert_allclose(low, 2 * stretch + stretch**-2, rtol=1e-6)
    _, high = thickness_models.admissible(2 * stretch**2 + stretch**-4)
    np.testing.assert_allclose(high, stretch**4 + 2 * stretch**-2, rtol=1e-6)


def test_energy_error_is_that_of_the_small_strain_stiffness():
    """psi of the truth is mu / 2 (I1 - 3) for I1 -> 3, mu its initial shear modulus."""
    near_rest = np.array([[3.0 + 1e-4, 3.0 + 1e-4]])
    assert thickness_models.energy_error(stand_in.neo_hooke(1.05), near_rest) == pytest.approx(5.0, abs=1e-3)


def test_lines_start_on_rims_and_stay_in_the_specimen():
    from meshes import Cross

    levels = np.array([[hole.level(points) for hole in Cross().holes()] for _, _, points in lines()])
    assert levels.min() >= 1 - 1e-12
    np.testing.assert_allclose(levels.min(axis=1)[:, 0], 1.0, atol=1e-12)
    assert all(np.abs(points).max() <= 100 and len(points) == len(distance) for _, distance, points in lines())


def test_a_pixel_shows_the_nearest_point_and_holes_are_empty():
    points = np.array([[10.0, 3.0], [30.0, 3.0]])
    found = thickness_figures.pixels(points, 40.0, 40)
    assert found[3, 9] == 0 and found[3, 30] == 1
    assert found[0, 0] == -1
    whole = thickness_figures.mirrored(found)
    assert whole.shape == (80, 80) and (whole == whole[::-1, ::-1]).all() and (whole[40:, 40:] == found).all()


def test_half_length_of_an_exponential():
    distance = np.linspace(0, 20, 2001)
    line = Line("", distance, np.exp(-distance / 3))
    assert thickness_words.half_length(line) == pytest.approx(3 * np.log(2), abs=0.01)


def test_verdicts_follow_the_definition(results):
    judged = thickness_tables.verdicts(results, "weighted", True)
    assert [v.condition for v in judged] == ["plane", "10", "40"]
    assert [v.ok for v in judged] == [True, True, False]
    assert thickness_tables.trusted(judged) == "10"
    assert judged[-1].stress == pytest.approx(100 * 0.03 + 1 + 20 * 0.03)
    assert not any(v.ok for v in thickness_tables.verdicts(results, "paper-frozen", True))


def test_a_failure_in_between_ends_the_trust(results):
    one = thickness_tables.verdict(results, "10", "weighted", True)
    bad = dataclasses.replace(one, condition="15", bias=-2.0)
    assert thickness_tables.trusted([one, bad, dataclasses.replace(one, condition="20")]) == "10"
    assert thickness_tables.trusted([bad]) is None
    assert one.ok and not dataclasses.replace(one, largest=6.0).ok


def test_the_correction_is_set_beside_the_default(results):
    """Half of the bias is left; the 2D reference is its own correction."""
    from studies.grid.thickness_case import CORRECTED

    assert thickness_words.extended(results) == []
    halves = [{**case, "losses": {**case["losses"], **({} if case["condition"] == "plane" else {
        CORRECTED: {**case["losses"]["weighted"], "inside": [{**s, "bias": s["bias"] / 2} for s in
                                                             case["losses"]["weighted"]["inside"]]}})}}
              for case in results.cases]  # fmt: skip
    corrected = dataclasses.replace(results)
    corrected.__dict__["cases"] = halves
    assert corrected.fits("plane", CORRECTED, True) == corrected.fits("plane", "weighted", True)
    texts = thickness_words.extended(corrected)
    clean = next(text for text in texts if "clean" in text)
    bias = thickness_tables.verdict(results, "40", "weighted", False).bias
    assert f"40 mm: {bias:+.2f} to {bias / 2:+.2f} % bias" in clean and len(texts) == 2
    assert "2D" not in clean


def test_answer_and_claims_carry_the_numbers(results):
    definition, noisy, clean, *paper, beyond, first, condition = thickness_words.answer(results)
    assert "1 %" in definition and "5 %" in definition
    for text in (noisy, clean):
        assert "trustworthy up to 10 mm, no longer at 40 mm" in text
    assert "(3 seeds)" in noisy
    assert len(paper) == 2 and all("already the 2D reference misses the definition" in text for text in paper)
    assert "outside the calibrated range" in beyond
    assert "goes wrong first at the holes: at 10 mm" in first
    assert "leave the thickness free" in condition
    rows = thickness_words.claims(results)
    little = {tuple(row[1:3]): row for row in rows if row[0].startswith("little")}
    assert little["weighted", "noisy"][4:] == ["10 mm +0.20 %, 40 mm +3.00 %", "agrees"]
    larger = [row for row in rows if "15 mm" in row[0]]
    assert len(larger) == 4 and all(row[4] == "not studied in this run" for row in larger)
    assert little["paper-frozen", "noisy"][5] == "not judged: the 2D reference is off by -90 %"
    field = results.fields["40"]
    assert f"40 mm {field.statistics(field.near_holes(5.0)).p95:.3f}" in rows[-1][4]
    assert "reduced run" in thickness_words.reservations(results)[0]


def test_larger_stress_errors_are_a_ratio(results, monkeypatch):
    thick = dataclasses.replace(results, settings=dataclasses.replace(results.settings, thicknesses=(10.0, 15.0)))
    sizes = {"10": 1.0, "15": 1.6}
    judged = [thickness_tables.Verdict(c, "weighted", False, 0.0, "", -s, "P11", 0.0) for c, s in sizes.items()]
    monkeypatch.setattr(thickness_words, "verdicts", lambda *_: judged)
    assert thickness_words._larger(thick, "weighted", False)[1:] == [
        "10 mm 1.00 %, 15 mm 1.60 %; 15 mm over 10 mm: 1.60",
        "agrees",
    ]


def test_reasons_compare_the_losses(results):
    text = thickness_words.reasons(results)[0]
    assert "+3.00 %" in text and "decides little" in text


def test_nothing_is_trusted_where_the_reference_fails(results, monkeypatch):
    monkeypatch.setattr(thickness_tables, "BIAS_LIMIT", 1e-6)
    assert "already the 2D reference" in thickness_words.answer(results)[1]


def test_forces_are_compared_per_thickness(results):
    rows = thickness_tables.force_rows(results)
    assert len(rows) == 4
    np.testing.assert_allclose([row[5] for row in rows], 1.0, atol=1e-9)


def test_epsilon_along_a_line_is_that_of_the_field(results):
    """Near the start of the first line: between the extreme Gauss values of its surroundings."""
    numbers, field = results.numbers["40"], results.fields["40"]
    near = np.linalg.norm(field.points - [7.5, 0.0], axis=1) < 1.5
    values = field.epsilon[-1][near]
    assert 0.5 * values.min() < numbers.lines[0].epsilon[5] < 2 * values.max()


def test_pressure_is_read_at_a_hex_and_jumps_show_a_checkerboard(results):
    solid = results.solid("10")
    cells = np.arange(5)
    centres = solid.mesh.points[solid.mesh.cells[cells, 17]][:, None]
    found = solid_pictures.pressure_at(solid, cells, centres)[:, 0]
    np.testing.assert_allclose(found, solid.pressure[-1, cells, 0], atol=1e-12)
    assert np.median(solid_pictures.pressure_jumps(solid)) < 0.15
    board = np.random.default_rng(0).choice([-1.0, 1.0], solid.pressure.shape[1])
    pressure = np.zeros_like(solid.pressure)
    pressure[-1, :, 0] = board
    jumps = solid_pictures.pressure_jumps(dataclasses.replace(solid, pressure=pressure))
    assert set(np.round(jumps, 12)) == {0.0, 1.0}


def test_skin_of_an_eighth_has_the_area_of_its_faces(results):
    """Rest, 40 mm: surface, cuts and sides; the flat quads follow the curved rims to 0.1 %."""
    solid = results.solid("40")
    rest = dataclasses.replace(solid, displacements=0 * solid.displacements)
    parts = solid_pictures.skin(rest)
    surface = solid_pictures._surface(rest, np.zeros(parts.faces.shape), (1, 1, 1), cuts=True)
    mesh = solid.mesh.plane
    edges = [e for name, e in mesh.boundaries.items() if name in ("free", "right", "top", "symmetry_x", "symmetry_y")]
    ends = np.concatenate(edges)
    lengths = sum(np.linalg.norm(mesh.points[ends[:, i]] - mesh.points[ends[:, 2]], axis=1).sum() for i in (0, 1))
    assert surface.area == pytest.approx(mesh.area() + 20.0 * lengths, rel=1e-3)


def test_report_is_written_with_figures_tables_and_manifests(results):
    path = thickness_report.write(results.folder, results.settings)
    html = path.read_text()
    names = ["maps", "lines", "growth", "forces", "contraction", "pressure"]
    names += [
        f"{kind}_{loss}" for kind in ("densities", "energies", "predictions") for loss in ("weighted", "paper-frozen")
    ]
    for name in names:
        picture = results.folder / "figures" / f"{name}.png"
        assert picture.stat().st_size > 5000, name
        assert json.loads(picture.with_suffix(".json").read_text())["outputs"]
    assert len(re.findall("<img", html)) == len(names)
    for name in ("fits", "fields", "forces", "verdicts"):
        assert (results.folder / f"{name}.csv").exists() and (results.folder / f"{name}.json").exists()
    assert "no longer at 40 mm" in html and "nan" not in re.sub('base64,[^"]*', "", html).lower().split()


def test_a_solid_file_is_read_back(results):
    assert isinstance(results.solid("10"), SolidSolution)


def fake_runs(study, error):
    """Results of a convergence study that converges: an error proportional to the size of the hexes."""
    rows = {}
    for part in study:
        for run in part.runs:
            off = error * run.size_factor / run.layers
            rows[run] = {
                **dataclasses.asdict(run), "edge": 1.2 * run.size_factor, "cells": 10, "unknowns": 100,
                "force_x": 10 * (1 + off), "force_y": 10 * (1 + 2 * off), "p95": 0.02 * (1 + 50 * off), "max": 0.1,
                "p95_inner": 0.02, "max_inner": 0.1, "mean_near": off / 2, "p95_near": off, "max_near": 2 * off, "pressure_jump": 0.01, "solves": 30, "seconds": 1.0,
                "memory": 100.0, "solver": "made up",
            }  # fmt: skip
    return rows


@pytest.mark.parametrize(("error", "met"), [(1e-4, True), (0.1, False)])
def test_convergence_targets_judge_the_last_refinement(error, met):
    study = thickness_convergence.series(quick=False)
    judged = thickness_convergence_report.targets(study, fake_runs(study, error))
    assert len(judged) == 5 and all(row[-1] is met for row in judged)
    rows = thickness_convergence_report.table(study, fake_runs(study, error))
    change = 100 * ((1 + error) / (1 + 0.7 * error) - 1)  # along y, with two layers
    own = [row for row in rows if row[0].startswith("in-plane") and row[1].startswith("1.20")]
    assert own[0][5] == pytest.approx(change)


def test_convergence_runs_only_what_is_missing(tmp_path, monkeypatch):
    started = []

    def start(folder, run):
        started.append(run)
        rows = fake_runs([thickness_convergence.Series("", [run], str)], 1e-3)
        thickness_convergence.result_path(folder, run).parent.mkdir(exist_ok=True)
        thickness_convergence.result_path(folder, run).write_text(json.dumps(rows[run]))

    monkeypatch.setattr(thickness_convergence, "start", start)
    arguments = argparse.Namespace(output=tmp_path / "out", overwrite=False, quick=True)
    assert thickness_convergence.main(arguments) == 0
    n = len(started)
    assert n == len(set(started)) > 5
    thickness_convergence.result_path(tmp_path / "out", started[0]).unlink()
    assert thickness_convergence.main(arguments) == 0
    assert started[n:] == started[:1]
    assert "In-plane size" in (tmp_path / "out" / "convergence.md").read_text()
    assert (tmp_path / "out" / "report.html").exists()


def test_a_convergence_run_that_fails_names_its_log(tmp_path):
    from studies.errors import WorkflowError

    with pytest.raises(WorkflowError, match="convergence.log"):
        thickness_convergence.start(tmp_path, thickness_convergence.Run(10.0, size_factor=-1.0))


@pytest.mark.slow
def test_a_convergence_run_measures_a_coarse_cross(tmp_path):
    """The force of plane stress within 1 %, and the same edge length as the mesh: 1.69 mm."""
    row = thickness_convergence.measure(tmp_path, thickness_convergence.Run(10.0, size_factor=4.0, layers=1))
    plane = thickness_convergence.plane_solution(tmp_path, thickness_convergence.Run(10.0, size_factor=4.0), None)
    assert row["force_x"] == pytest.approx(10 * 2 * plane.reactions["right"][-1, 0], rel=0.01)
    assert row["edge"] == pytest.approx(1.69, abs=0.1)
    assert 0 < row["p95_inner"] < row["max_inner"] <= row["max"] and row["memory"] > 100


@pytest.mark.parametrize("name", ["cases/10_0.json", "epsilon_10.npz", "states.npz", "solid_10.npz", "plane.npz"])
def test_damaged_files_are_named(results, tmp_path, name):
    """Half of a file is not read as data, and the message says what to delete."""
    from studies.errors import DamagedFileError

    folder = tmp_path / "copy"
    shutil.copytree(results.folder, folder)
    path = folder / name
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    broken = dataclasses.replace(results, folder=folder)
    with pytest.raises(DamagedFileError, match="damaged; delete it and run the same command again") as caught:
        _ = broken.cases, broken.plane, broken.fields, broken.states, broken.solid("10")
    assert name in str(caught.value)
