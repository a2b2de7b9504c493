"""Histories whose steps fail or whose runs are cut off: state variables go with the checkpoint."""

from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from interrupted import interrupted

from forward import Loading, NeoHooke, SurfaceSolution
from forward._dolfinx import MPI
from forward.errors import ConvergenceError, SolutionError
from forward.sheet.additions import MooneyPart, Mullins, Patch
from forward.sheet.damage_and_dispersion import SquircularInclusion
from forward.sheet.inelastic import solve_history
from forward.sheet.inelastic_problem import InelasticProblem
from forward.sheet.multiplicative_viscosity import MaxwellBranch
from forward.sheet.sheet_run import Options
from forward.sheet.thin_sheet import PermanentSet, Prony, Sheet
from meshes import PlateWithHole, quads

SHEETS = {
    "softening": Sheet(NeoHooke(0.4), 1.2, (MooneyPart(0.03), Mullins(0.3)), (Prony(0.3, 2.0),), PermanentSet(0.05)),
    "compressible": Sheet(NeoHooke(0.4), 1.2, (MooneyPart(0.03),), (Prony(0.2, 1.0),), bulk_modulus=10.0),
}
LOADING = Loading.clamped(PlateWithHole.loaded, 20.0)
FACTORS, TIMES = [0.5, 1.0, 1.0, 0.2], [1.0, 2.0, 4.0, 5.0]


def run(mesh, sheet, checkpoint=None, times=TIMES, **options):
    return solve_history(mesh, sheet, LOADING, FACTORS, times, 2, Options(**options), checkpoint=checkpoint)


@pytest.fixture(scope="module")
def mesh():
    return quads(PlateWithHole(), quarter=True, size_factor=4.0)


@pytest.fixture(scope="module", params=SHEETS.values(), ids=SHEETS)
def case(request, mesh):
    return request.param, run(mesh, request.param)


def check_same(found, expected):
    for name in ("displacements", "time", "energy", "iterations"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)
    np.testing.assert_array_equal(found.reactions["right"], expected.reactions["right"])
    assert found.description == expected.description
    assert found.history.keys() == expected.history.keys()
    for name, values in expected.history.items():
        np.testing.assert_array_equal(found.history[name], values, err_msg=name)


ALL_KINDS = {
    **SHEETS,
    "of branches": Sheet(NeoHooke(0.4), 1.2, branches=(MaxwellBranch(0.3, 0.5),)),
    "viscous": Sheet(NeoHooke(0.4), 1.2, (MooneyPart(0.03),), (Prony(0.9, 2.0),)),
    "compressible and elastic": Sheet(NeoHooke(0.4), 1.2, (MooneyPart(0.03),), bulk_modulus=2.0),
    "compressible and viscous": Sheet(NeoHooke(0.4), 1.2, (MooneyPart(0.03),), (Prony(0.9, 2.0),), bulk_modulus=2.0),
}


@pytest.mark.parametrize("sheet", ALL_KINDS.values(), ids=ALL_KINDS)
def test_the_solver_knows_whether_the_tangent_is_symmetric(mesh, sheet):
    """With the wrong answer Newton's method converges slowly, or not at all."""
    held, values = LOADING.on(mesh).prescribed(mesh)
    problem = InelasticProblem(mesh, sheet, held, values, 1e-8, 20, MPI.COMM_SELF)
    assert problem.step(0.5, 1.0).converged
    problem.commit()
    assert problem.step(1.0, 1.0).converged
    A = sp.csr_array(problem.problem.A.getValuesCSR()[::-1])
    off = abs(A - A.T).max() / abs(A).max()
    assert bool(off < 1e-10) is problem.symmetric
    assert problem.symmetric or off > 1e-6


@pytest.mark.parametrize("reached", range(len(TIMES) + 1))
def test_resume_after_a_kill(mesh, case, tmp_path, reached):
    """Cut off on any increment, or after the last, a run goes on to exactly the same result."""
    (sheet, expected), path = case, tmp_path / "run.npz"
    with interrupted(reached) if reached < len(TIMES) else nullcontext():
        run(mesh, sheet, path)
    assert len(SurfaceSolution.load(path).time) == reached
    check_same(run(mesh, sheet, path), expected)
    check_same(SurfaceSolution.load(path), expected)
    assert [p.name for p in tmp_path.iterdir()] == ["run.npz"]


def test_a_field_of_stiffness_scales_all_that_the_stress_is_of(mesh, case):
    """New chains, softening and overstress, too: the same everywhere, it leaves the displacements as they are."""
    sheet, expected = case
    if sheet.bulk_modulus is not None:
        sheet = replace(sheet, bulk_modulus=None)
        expected = run(mesh, sheet)
    found = run(mesh, replace(sheet, additions=(*sheet.additions, Patch(0.5, 0.0, 0.0, 1e6))))
    np.testing.assert_allclose(found.reactions["right"], 1.5 * expected.reactions["right"], rtol=1e-7)
    np.testing.assert_allclose(found.displacements, expected.displacements, atol=1e-7)


def test_a_checkpoint_of_another_history_is_refused(mesh, case, tmp_path):
    sheet, solution = case
    solution.save(tmp_path / "run.npz")
    with pytest.raises(SolutionError):
        run(mesh, sheet, tmp_path / "run.npz", times=[1.0, 2.0, 4.0, 5.5])


def test_a_failed_step_is_halved_from_the_committed_state(mesh, monkeypatch):
    """An increment whose one step fails is that of two substeps."""
    sheet = SHEETS["softening"]
    solve, tried = InelasticProblem.solve, []

    def fails_on_the_whole_step(problem, load_factor):
        tried.append(load_factor)
        if len(tried) == 1:
            problem.u.x.array[:] = np.nan
            return type("Outcome", (), {"converged": False, "iterations": 3, "text": "poisoned"})()
        return solve(problem, load_factor)

    expected = solve_history(mesh, sheet, LOADING, [0.5], [1.0], 2)
    monkeypatch.setattr(InelasticProblem, "solve", fails_on_the_whole_step)
    found = solve_history(mesh, sheet, LOADING, [0.5], [1.0])
    assert tried == [0.5, 0.25, 0.5]
    assert found.iterations[0] == expected.iterations[0] + 3
    np.testing.assert_array_equal(found.displacements, expected.displacements)
    for name, values in expected.history.items():
        np.testing.assert_array_equal(found.history[name], values, err_msg=name)


def test_a_place_without_stiffness_has_no_equilibrium(mesh):
    """A tangent that cannot be factorised is a named error, and is not solved with in the next step."""
    sheet = Sheet(NeoHooke(0.4), 1.0, (SquircularInclusion(-1.0, 15.0, 10.0, 8.0, 6.0, 0.0),))
    with pytest.raises(ConvergenceError, match="linear solve"):
        solve_history(mesh, sheet, LOADING, [0.5], [1.0])


def test_no_equilibrium_keeps_what_was_reached(mesh, case, tmp_path, monkeypatch):
    (sheet, expected), path, solve = case, tmp_path / "run.npz", InelasticProblem.solve

    def fails_late(problem, load_factor):
        if load_factor > 0.8:
            return type("Outcome", (), {"converged": False, "iterations": 3, "text": "poisoned"})()
        return solve(problem, load_factor)

    with monkeypatch.context() as patched:
        patched.setattr(InelasticProblem, "solve", fails_late)
        with pytest.raises(ConvergenceError) as caught:
            run(mesh, sheet, path, max_bisections=2)
    np.testing.assert_array_equal(caught.value.solution.displacements, expected.displacements[:1])
    assert caught.value.solution.description["load_factors"] == FACTORS[:1]
    np.testing.assert_array_equal(run(mesh, sheet, path, max_bisections=2).displacements, expected.displacements)


def test_a_thickness_that_a_failed_step_left_without_number_is_found_again(mesh, monkeypatch):
    """Nearly incompressible: a trial with inverted elements leaves NaN, and the substep after it does not begin there."""
    sheet, failed = Sheet(NeoHooke(0.4), 1.2, bulk_modulus=100.0), []
    expected = solve_history(mesh, sheet, LOADING, [0.05, 0.1], [0.5, 1.0], 2)
    solve = InelasticProblem.solve

    def fails_at_first(problem, load_factor):
        outcome = solve(problem, load_factor)
        if failed:
            return outcome
        failed.append(load_factor)
        variable = problem._variables["F33"]
        variable.x.array[:] = np.nan
        return replace(outcome, reason=-9)

    monkeypatch.setattr(InelasticProblem, "solve", fails_at_first)
    found = solve_history(mesh, sheet, LOADING, [0.1], [1.0], 2)
    assert failed
    np.testing.assert_allclose(found.displacements[-1], expected.displacements[-1], atol=1e-7)
    np.testing.assert_allclose(found.history["F33"], expected.history["F33"], rtol=1e-7)
