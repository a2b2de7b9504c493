"""Thickness report: judgements against made-up numbers, densities and borders against closed forms, a whole report."""

import dataclasses
import json
import re
import shutil

import numpy as np
import pytest
import thickness_stand_in as stand_in
from study_stand_in import neo_hooke, results_with, runs_with

from forward.solid.solid_solution import SolidSolution
from meshes import Cross
from studies.errors import DamagedFileError, WorkflowError
from studies.grid import convergence, convergence_report, convergence_runs, report
from studies.grid.axes import PLANE, Loss
from studies.grid.claims import ClaimVerdict, Statement, claim_rows
from studies.grid.presets import (
    thickness_claims,
    thickness_figures,
    thickness_models,
    thickness_study,
    thickness_tables,
)
from studies.grid.presets.thickness_results import Line, ThicknessResults, lines
from studies.reports import solid_pictures


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    return ThicknessResults(stand_in.fill(tmp_path_factory.mktemp("thickness")), stand_in.SETTINGS)


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
    assert thickness_models.energy_error(neo_hooke(1.05), near_rest) == pytest.approx(5.0, abs=1e-3)


def test_lines_start_on_rims_and_stay_in_the_specimen():
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
    assert line.half_length() == pytest.approx(3 * np.log(2), abs=0.01)


def test_verdicts_follow_the_definition(results):
    judged = thickness_tables.trusts(results, Loss.WEIGHTED, True)
    assert [v.condition for v in judged] == [PLANE, "10", "40"]
    assert [v.ok for v in judged] == [True, True, False]
    assert thickness_tables.trusted(judged) == "10"
    assert judged[-1].stress == pytest.approx(100 * 0.03 + 1 + 20 * 0.03)
    assert not any(v.ok for v in thickness_tables.trusts(results, Loss.FROZEN, True))
    reach = {tuple(row[:2]): row[2:] for row in thickness_tables.reach_rows(results)}
    assert reach["weighted", "noisy"] == [3, "10 mm", "40 mm"] and reach["weighted", "clean"] == [1, "10 mm", "40 mm"]
    assert reach["paper-frozen", "noisy"] == [3, None, "2D reference"]


def test_a_failure_in_between_ends_the_trust(results):
    one = thickness_tables.trust(results, "10", Loss.WEIGHTED, True)
    bad = dataclasses.replace(one, condition="15", bias=-2.0)
    assert thickness_tables.trusted([one, bad, dataclasses.replace(one, condition="20")]) == "10"
    assert thickness_tables.trusted([bad]) is None
    assert one.ok and not dataclasses.replace(one, largest=6.0).ok


def test_the_correction_is_set_beside_the_default(results):
    """Half of the bias remains; the 2D reference is its own correction."""
    assert thickness_tables.correction_rows(results) == []

    def corrected(result):
        if result.case.thickness == PLANE:
            return result
        fit = result.losses[Loss.WEIGHTED]
        inside = tuple(dataclasses.replace(score, bias=score.bias / 2) for score in fit.inside)
        return dataclasses.replace(
            result, losses={**result.losses, Loss.CORRECTED: dataclasses.replace(fit, inside=inside)}
        )

    settings = dataclasses.replace(results.settings, losses=tuple(Loss))
    found = results_with(ThicknessResults, results.folder, settings, [*map(corrected, results.cases)])
    assert found.fitted(PLANE, Loss.CORRECTED, True) == found.fitted(PLANE, Loss.WEIGHTED, True)
    rows = {tuple(row[:2]): row[2:] for row in thickness_tables.correction_rows(found)}
    bias = thickness_tables.trust(results, "40", Loss.WEIGHTED, False).bias
    assert rows["40 mm", "clean"][:2] == [pytest.approx(bias), pytest.approx(bias / 2)]
    assert len(rows) == 4 and not any("2D" in condition for condition, _ in rows)


def test_claims_carry_numbers_and_verdicts(results):
    found = {(c.statement, c.loss, c.noisy): c for c in thickness_claims.claims(results)}
    little = found[Statement.LITTLE_INFLUENCE, Loss.WEIGHTED, True]
    assert little.verdict is ClaimVerdict.CONFIRMED
    assert little.found == {"10 mm": pytest.approx(0.2, abs=0.005), "40 mm": pytest.approx(3.0, abs=0.01)}
    larger = [c for c in found.values() if c.statement is Statement.LARGER_ERRORS]
    assert len(larger) == 4 and all(c.verdict is ClaimVerdict.NOT_STUDIED for c in larger)
    failed = found[Statement.LITTLE_INFLUENCE, Loss.FROZEN, True]
    assert failed.verdict is ClaimVerdict.OPEN and failed.reference_bias == pytest.approx(-90, abs=0.5)
    severe = found[Statement.SEVERE_DEFORMATION, None, False]
    field = results.fields["40"]
    assert severe.found["40 mm"] == field.statistics(field.near_holes(5.0)).p95
    assert len(claim_rows([*found.values()])) == len(found)
    assert json.dumps([c.to_dict() for c in found.values()])


@pytest.mark.parametrize(("ratio", "verdict"), [(1.6, ClaimVerdict.CONFIRMED), (1.4, ClaimVerdict.REFUTED)])
def test_larger_stress_errors_are_a_ratio(results, monkeypatch, ratio, verdict):
    sizes = {"10": 1.0, "15": ratio}
    judged = [thickness_tables.Trust(c, Loss.WEIGHTED, False, 0.0, "", -s, "P11", 0.0) for c, s in sizes.items()]
    monkeypatch.setattr(thickness_claims, "trusts", lambda *_: judged)
    claim = thickness_claims.larger_errors(results, Loss.WEIGHTED, False)
    assert claim.verdict is verdict and claim.found == {"10 mm": 1.0, "15 mm": ratio}


def test_the_losses_are_compared_on_the_same_data(results):
    changes = dict(thickness_claims.change_rows(results))
    assert changes[Loss.WEIGHTED] == pytest.approx(3.0, abs=0.01)
    assert changes[Loss.FROZEN] == pytest.approx(0.0, abs=1e-9)


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


@pytest.mark.slow
def test_report_is_written_with_figures_tables_and_manifests(results):
    path = report.write(results, thickness_study.page(results))
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
    assert "nan" not in re.sub('base64,[^"]*', "", html).lower().split()


def test_a_solid_file_is_read_back(results):
    assert isinstance(results.solid("10"), SolidSolution)


@pytest.mark.parametrize(("error", "met"), [(1e-4, True), (0.1, False)])
def test_convergence_targets_judge_the_last_refinement(error, met):
    study = convergence_runs.series(quick=False)
    judged = convergence_report.targets(study, runs_with(study, error))
    assert len(judged) == 5 and all(row[-1] is met for row in judged)
    rows = convergence_report.table(study, runs_with(study, error))
    change = 100 * ((1 + error) / (1 + 0.7 * error) - 1)  # along y, with two layers
    own = [row for row in rows if row[0].startswith("in-plane") and row[1].startswith("1.20")]
    assert own[0][5] == pytest.approx(change)


def test_convergence_runs_only_what_is_missing(tmp_path, monkeypatch):
    started = []

    def start(folder, run):
        started.append(run)
        (row,) = runs_with([convergence_runs.Series("", [run], str)], 1e-3).values()
        convergence_runs.result_path(folder, run).parent.mkdir(exist_ok=True)
        convergence_runs.result_path(folder, run).write_text(json.dumps(row.to_dict()))

    monkeypatch.setattr(convergence, "start", start)
    path = convergence.run_convergence(tmp_path / "out", quick=True)
    n = len(started)
    assert n == len(set(started)) > 5
    convergence_runs.result_path(tmp_path / "out", started[0]).unlink()
    assert convergence.run_convergence(tmp_path / "out", quick=True) == path
    assert started[n:] == started[:1]
    assert "In-plane size" in (tmp_path / "out" / "convergence.md").read_text()
    assert path.exists()


def test_a_convergence_run_that_fails_names_its_log(tmp_path):
    with pytest.raises(WorkflowError, match="convergence.log"):
        convergence_runs.start(tmp_path, convergence_runs.Run(10.0, size_factor=-1.0))


@pytest.mark.slow
def test_a_convergence_run_measures_a_coarse_cross(tmp_path):
    """The force of plane stress within 1 %, and the same edge length as the mesh: 1.69 mm."""
    row = convergence_runs.measure(tmp_path, convergence_runs.Run(10.0, size_factor=4.0, layers=1))
    plane = convergence_runs.plane_solution(tmp_path, convergence_runs.Run(10.0, size_factor=4.0), None)
    assert row.force_x == pytest.approx(10 * 2 * plane.reactions["right"][-1, 0], rel=0.01)
    assert row.edge == pytest.approx(1.69, abs=0.1)
    assert 0 < row.p95_inner < row.max_inner <= row.max and row.memory > 100


@pytest.mark.parametrize(
    "name",
    [
        "cases/cross/10_100_0.1_0.json",
        "epsilon/cross_10.npz",
        "states/cross.npz",
        "solids/cross_10.npz",
        "forward/cross_2D.npz",
    ],
)
def test_damaged_files_are_named(results, tmp_path, name):
    """Half of a file is not read as data, and the message says what to delete."""
    folder = tmp_path / "copy"
    shutil.copytree(results.folder, folder)
    path = folder / name
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    broken = dataclasses.replace(results, folder=folder)
    with pytest.raises(DamagedFileError, match=name):
        _ = broken.cases, broken.plane, broken.fields, broken.states, broken.solid("10")
