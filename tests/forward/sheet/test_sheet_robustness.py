"""What happens when a step fails, when a run is cut off, and when the input makes no sense."""

import os
import subprocess
import sys
import weakref
from pathlib import Path

import numpy as np
import pytest
from interrupted import interrupted

from forward import ArrudaBoyce, Loading, NeoHooke, SurfaceSolution
from forward._dolfinx import MPI
from forward.errors import ConvergenceError, LoadingError, SolutionError
from forward.sheet.inelastic_problem import InelasticProblem
from forward.sheet.plane_stress import Options, solve
from forward.sheet.plane_stress_problem import PlaneStressProblem
from forward.sheet.thin_sheet import Sheet
from forward.stepping import REST, Elastic, Moment, State, predict, steps
from meshes import Cross, Strip, quads, triangles

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def mesh():
    return quads(Cross(), quarter=True, size_factor=4.0)


@pytest.fixture(scope="module")
def reference(mesh):
    return solve(mesh, ArrudaBoyce(), Loading.clamped(Cross.loaded, 20.0), 4)


AT_REST = (np.zeros((1, 2)), np.zeros(1))


def at(*load_factors):
    return [Moment(t, t) for t in load_factors]


class FailsAbove(Elastic):
    """A problem u = t, p = -t whose solver only manages steps up to a limit."""

    def __init__(self, limit, wall=np.inf):
        self.unknowns, self.at, self.limit, self.wall, self.tried = AT_REST, 0.0, limit, wall, []

    def nodal_forces(self):
        return np.full((1, 2), 3 * self.at)

    def energy(self):
        return self.at**2

    def solve(self, load_factor):
        self.tried.append(load_factor)
        converged = load_factor - self.at <= self.limit and load_factor <= self.wall
        if converged:
            self.at = load_factor
            self.unknowns = (np.full((1, 2), load_factor), np.array([-load_factor]))
        else:
            self.unknowns = (np.full((1, 2), np.nan), np.array([np.nan]))
        return type("Outcome", (), {"converged": converged, "iterations": 2, "text": "too far"})()


def test_failed_steps_are_rolled_back_and_halved():
    problem = FailsAbove(0.3)
    states = [i.state for i in steps(problem, at(0.5, 1.0), [State(REST, AT_REST)], 4)]
    assert problem.tried == [0.5, 0.25, 0.5, 1.0, 0.75, 1.0]
    assert [s.moment.load_factor for s in states] == [0.5, 1.0]
    assert [s.iterations for s in states] == [6, 6]
    np.testing.assert_array_equal(states[-1].unknowns[0], 1.0)
    np.testing.assert_array_equal(states[-1].unknowns[1], -1.0)


def test_bisection_ends_with_a_named_error():
    problem = FailsAbove(1.0, wall=0.6)
    walk = steps(problem, at(0.5, 1.0), [State(REST, AT_REST)], 3)
    next(walk)
    with pytest.raises(ConvergenceError, match=r"0\.5625 .*too far"):
        next(walk)
    np.testing.assert_array_equal(problem.unknowns[0], 0.5625)
    np.testing.assert_array_equal(problem.unknowns[1], -0.5625)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_the_prediction_continues_polynomials(degree):
    """With as many states as the degree asks for, at uneven steps, it is exact in every unknown."""
    times = [0.1, 0.2, 0.45][2 - degree :]
    known = [State(Moment(t, t), (np.array([1 + t**degree]), np.array([3 * t**degree]))) for t in times]
    first, second = predict(known, 0.5)
    assert first[0] == pytest.approx(1 + 0.5**degree, rel=1e-14)
    assert second[0] == pytest.approx(3 * 0.5**degree, rel=1e-14)


def test_a_step_starts_from_reported_states_alone():
    """So a run resumed from the reported states predicts what an uninterrupted one does."""
    cut, whole = FailsAbove(0.3), FailsAbove(0.3)
    start = [State(REST, AT_REST)]
    all_states = list(steps(whole, at(0.5, 1.0), start, 4))
    (first,) = steps(cut, at(0.5), start, 4)
    cut.at = 0.5
    (second,) = steps(cut, at(1.0), [*start, first.state], 4)
    assert cut.tried == whole.tried
    np.testing.assert_array_equal(second.state.unknowns[0], all_states[-1].state.unknowns[0])


def test_bisection_reaches_the_same_state(mesh, reference):
    """Three Newton iterations are not enough for the whole load; smaller steps are."""
    loading, options = Loading.clamped(Cross.loaded, 20.0), Options(max_iterations=3, tolerance=1e-9)
    solution = solve(mesh, ArrudaBoyce(), loading, 1, options=options)
    assert solution.iterations[0] > 3
    np.testing.assert_allclose(solution.displacements[-1], reference.displacements[-1], atol=1e-7)


def test_impossible_load_names_the_error_and_keeps_the_last_state(mesh, tmp_path):
    """Opposite arm ends, 200 mm apart, cannot each move in by 110 mm."""
    path = tmp_path / "run.npz"
    options = Options(max_iterations=8, max_bisections=2)
    with pytest.raises(ConvergenceError) as caught:
        solve(mesh, ArrudaBoyce(), Loading.clamped(Cross.loaded, -110.0), 10, options=options, checkpoint=path)
    reached = len(caught.value.solution.time)
    assert 0 < reached < 10
    assert str(path) in str(caught.value)
    np.testing.assert_array_equal(SurfaceSolution.load(path).displacements, caught.value.solution.displacements)


def test_resume_after_a_kill(mesh, reference, tmp_path):
    path, loading = tmp_path / "run.npz", Loading.clamped(Cross.loaded, 20.0)
    with interrupted(2):
        solve(mesh, ArrudaBoyce(), loading, 4, checkpoint=path)
    assert len(SurfaceSolution.load(path).time) == 2
    resumed = solve(mesh, ArrudaBoyce(), loading, 4, checkpoint=path)
    np.testing.assert_allclose(resumed.displacements, reference.displacements, atol=1e-10)
    np.testing.assert_allclose(resumed.reactions["right"], reference.reactions["right"], rtol=1e-10)
    again = solve(mesh, ArrudaBoyce(), loading, 4, checkpoint=path)
    np.testing.assert_array_equal(again.displacements, resumed.displacements)
    with pytest.raises(SolutionError, match="another"):
        solve(mesh, NeoHooke(), loading, 4, checkpoint=path)
    assert [p.name for p in tmp_path.iterdir()] == ["run.npz"]


def test_solve_refuses_what_it_cannot_do(mesh):
    loading = Loading.clamped(Cross.loaded, 1.0)
    with pytest.raises(LoadingError, match="quads"):
        solve(triangles(Cross(), size_factor=4.0), ArrudaBoyce(), loading)
    for wrong in ({"thickness": -1.0}, {"n_increments": 0}):
        with pytest.raises(LoadingError, match="positive"):
            solve(mesh, ArrudaBoyce(), loading, **wrong)


def test_a_missing_compiler_is_named(tmp_path):
    """Forms that are not in the cache, and a compiler that fails."""
    command = (
        "from forward.sheet.plane_stress import *\n"
        "mesh = quads(Cross(), quarter=True, size_factor=4.0)\n"
        "solve(mesh, ArrudaBoyce(), Loading.clamped(Cross.loaded, 1.0), 1)\n"
    )
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "CC": "no-such-compiler", "PYTHONPATH": str(ROOT)}
    run = subprocess.run([sys.executable, "-c", command], env=environment, capture_output=True, text=True, check=False)
    assert run.returncode != 0
    assert "MissingSolverError" in run.stderr and "gcc" in run.stderr


def test_a_problem_is_freed_with_its_solver():
    """What PETSc holds of it must not keep it: each has some fifteen communicators, and MPI ends a process at two thousand."""
    mesh = quads(Strip(), quarter=True, size_factor=4.0)
    held, values = Loading.clamped(["left", "right"], 5.0).on(mesh).prescribed(mesh)
    compressible = Sheet(NeoHooke(0.3), bulk_modulus=100.0)
    for make in (
        lambda: PlaneStressProblem(mesh, NeoHooke(0.3), 1.0, held, values, 1e-8, 20),
        lambda: InelasticProblem(mesh, compressible, held, values, 1e-8, 20, MPI.COMM_SELF),
    ):
        problem = make()
        assert problem.solve(1.0).converged
        alive = weakref.ref(problem)
        del problem
        assert alive() is None


@pytest.mark.slow
def test_many_problems_in_one_process():
    """A solve takes 15 communicators of the 2046 that MPI has; before they were freed, the 136th ended the process."""
    mesh = quads(Strip(), quarter=True, size_factor=4.0)
    loading = Loading.clamped(["left", "right"], 5.0)
    forces = [solve(mesh, NeoHooke(0.3), loading, 1).reactions["right"][-1, 0] for _ in range(140)]
    np.testing.assert_allclose(forces, forces[0], rtol=1e-9)
