"""The solid when a step fails, a run is cut off, a disk is full, a solver is missing, or the input makes no sense."""

import errno
import os
import signal
import subprocess
import sys
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from interrupted import interrupted
from solid_helpers import PANN

from forward import ArrudaBoyce, Loading, NeoHooke, SolidSolution
from forward.errors import (
    CheckpointError,
    ConvergenceError,
    LinearSolverError,
    LoadingError,
    MaterialError,
    SolutionError,
)
from forward.run import Record  # noqa: F401  (of the killed process)
from forward.solid.solid_model import Options, default_layers, solve
from forward.solid.solid_problem import Outcome, SolidProblem
from forward.stepping import REST, State, predict, proportional
from meshes import PlateWithHole, extrude, quads

ROOT = Path(__file__).parents[3]
PLATE = PlateWithHole()
LOADING = Loading.clamped(PLATE.loaded, 20.0, dimension=3)
SOLVERS = ["pardiso", "mumps"]
INCREMENTS = 4


@pytest.fixture(scope="module")
def mesh():
    return extrude(quads(PLATE, quarter=True, size_factor=4.0), 10.0, 1)


def run(mesh, checkpoint=None, solver="pardiso", loading=LOADING, **more):
    return solve(
        mesh, ArrudaBoyce(), loading, INCREMENTS, options=Options(solver=solver, **more), checkpoint=checkpoint
    )


@pytest.fixture(scope="module")
def references(mesh):
    return {solver: run(mesh, solver=solver) for solver in SOLVERS}


def check_same(found, expected, tolerance):
    for name in ("displacements", "pressure", "energy"):
        value = getattr(expected, name)
        np.testing.assert_allclose(getattr(found, name), value, atol=tolerance * np.abs(value).max(), err_msg=name)
    np.testing.assert_array_equal(found.time, expected.time)
    for side, force in expected.reactions.items():
        np.testing.assert_allclose(found.reactions[side], force, atol=tolerance * np.abs(force).max())


# runs that are cut off


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("reached", range(INCREMENTS + 1))
def test_resume_after_a_kill(mesh, references, tmp_path, solver, reached):
    """Cut off while working on any increment, or after the last, a run goes on to the same result."""
    path = tmp_path / "run.npz"
    with interrupted(reached) if reached < INCREMENTS else nullcontext():
        run(mesh, path, solver)
    assert len(SolidSolution.load(path).time) == reached
    resumed = run(mesh, path, solver)
    check_same(resumed, references[solver], 1e-12)
    np.testing.assert_array_equal(resumed.iterations, references[solver].iterations)
    assert [p.name for p in tmp_path.iterdir()] == ["run.npz"]


@pytest.mark.slow
def test_resume_after_the_process_died(mesh, references, tmp_path):
    """A real SIGKILL in the middle of the third increment."""
    path = tmp_path / "run.npz"
    command = f"""
import os, signal, sys
sys.path[:0] = ["tests/forward/solid", "tests/fixtures"]
import test_solid_robustness as case
add = case.Record.add
def killed(record, increment):
    if record.reached == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    add(record, increment)
case.Record.add = killed
case.run(case.extrude(case.quads(case.PLATE, quarter=True, size_factor=4.0), 10.0, 1), {str(path)!r})
"""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
    done = subprocess.run([sys.executable, "-c", command], cwd=ROOT, env=environment, timeout=120, check=False)
    assert done.returncode == -signal.SIGKILL
    assert len(SolidSolution.load(path).time) == 2
    check_same(run(mesh, path), references["pardiso"], 1e-12)


# steps that fail


def poisoned(problem, load_factor):
    problem.u = np.full_like(problem.u, np.nan)
    problem.q = np.full_like(problem.q, np.nan)
    return Outcome(False, 3, "poisoned")


def test_a_failed_step_is_rolled_back_and_halved(mesh, references, monkeypatch):
    """It leaves no trace in displacement or pressure: the half step starts from what was known before it."""
    solve_step, starts = SolidProblem.solve, []

    def fails_once(problem, load_factor):
        starts.append((load_factor, *problem.unknowns))
        if len(starts) == 3:
            return poisoned(problem, load_factor)
        return solve_step(problem, load_factor)

    monkeypatch.setattr(SolidProblem, "solve", fails_once)
    found, expected = run(mesh), references["pardiso"]
    check_same(found, expected, 1e-7)
    assert [start[0] for start in starts] == [0.25, 0.5, 0.75, 0.625, 0.75, 1.0]
    assert found.iterations[2] >= expected.iterations[2] + 3
    at_rest = State(REST, (np.zeros_like(mesh.points), np.zeros((len(mesh.cells), 4))))
    known = [at_rest, *(State(proportional(4)[i], (found.displacements[i], found.pressure[i])) for i in range(2))]
    for at, field, predicted in zip(starts[3][1:], ("u", "q"), predict(known, 0.625), strict=True):
        np.testing.assert_allclose(at, predicted, atol=1e-12 * np.abs(predicted).max(), err_msg=field)


@pytest.mark.parametrize("step", [lambda du: None, lambda du: np.full_like(du, np.nan), lambda du: 1e4 * du])
def test_a_linear_solver_that_fails_once(mesh, references, monkeypatch, step):
    """A broken factor, numbers that are none, and a step that turns hexes inside out."""
    make, calls = SolidProblem._linear_solver, []

    def fragile(problem, name):
        linear = make(problem, name)
        sound = linear.step

        def fails_once(*arguments, **options):
            calls.append(0)
            du = sound(*arguments, **options)
            return step(du) if len(calls) == 5 else du

        linear.step = fails_once
        return linear

    monkeypatch.setattr(SolidProblem, "_linear_solver", fragile)
    found = run(mesh)
    assert len(calls) == found.iterations.sum() > references["pardiso"].iterations.sum()
    check_same(found, references["pardiso"], 1e-7)


def test_steps_that_always_fail_leave_the_last_good_state(mesh, references, tmp_path, monkeypatch):
    solve_step, problems = SolidProblem.solve, []

    def fails_late(problem, load_factor):
        problems.append(problem)
        return poisoned(problem, load_factor) if load_factor > 0.5 else solve_step(problem, load_factor)

    monkeypatch.setattr(SolidProblem, "solve", fails_late)
    path = tmp_path / "run.npz"
    with pytest.raises(ConvergenceError, match=r"0\.5 .*poisoned") as caught:
        run(mesh, path, max_bisections=2)
    assert str(path) in str(caught.value)
    u, q = problems[-1].unknowns
    np.testing.assert_array_equal(u, references["pardiso"].displacements[1])
    np.testing.assert_array_equal(q, references["pardiso"].pressure[1])
    monkeypatch.undo()
    check_same(run(mesh, path, max_bisections=2), references["pardiso"], 1e-12)


def test_impossible_load(mesh, tmp_path):
    """Grips 120 mm apart cannot each move in by 70 mm; what was reached is saved and the error tells what to try."""
    path = tmp_path / "run.npz"
    options = Options(max_iterations=8, max_bisections=2)
    with pytest.raises(ConvergenceError) as caught:
        loading = Loading.clamped(PLATE.loaded, -70.0, dimension=3)
        solve(mesh, ArrudaBoyce(), loading, 10, options=options, checkpoint=path)
    solution = caught.value.solution
    assert 0 < len(solution.time) < 10
    saved = SolidSolution.load(path)
    np.testing.assert_array_equal(saved.displacements, solution.displacements)
    np.testing.assert_array_equal(saved.pressure, solution.pressure)
    assert str(path) in str(caught.value)


def test_not_a_number_is_refused(mesh):
    held, values = LOADING.on(mesh).prescribed(mesh)
    for solver in SOLVERS:
        problem = SolidProblem(mesh, ArrudaBoyce(), 1e3, held, values, 1e-8, 1e-9, 5, solver)
        u, q = problem.unknowns
        problem.unknowns = (u * np.nan, q)
        assert not problem.solve(0.1).converged
        problem.unknowns = (u, q * np.nan)
        assert not problem.solve(0.1).converged
        problem.unknowns = (u, q)
        assert problem.solve(0.1).converged


# files


FULL = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def half_a_file(file, **arrays):
    file.write(b"half of an archive")
    raise FULL


def no_replace(*arguments):
    raise FULL


@pytest.mark.parametrize(
    ("module", "name", "broken"), [(np, "savez_compressed", half_a_file), (os, "replace", no_replace)]
)
def test_full_disk(mesh, references, tmp_path, monkeypatch, module, name, broken):
    """The checkpoint before is whole, nothing half written stays, and with space again the run goes on."""
    path, sound, calls = tmp_path / "run.npz", getattr(module, name), []

    def full_at_the_fourth(*arguments, **arrays):
        calls.append(0)
        return (broken if len(calls) == 4 else sound)(*arguments, **arrays)

    monkeypatch.setattr(module, name, full_at_the_fourth)
    with pytest.raises(CheckpointError, match="No space left"):
        run(mesh, path)
    monkeypatch.undo()
    assert [p.name for p in tmp_path.iterdir()] == ["run.npz"]
    assert len(SolidSolution.load(path).time) == 2
    check_same(run(mesh, path), references["pardiso"], 1e-12)


def test_unwritable_folder(mesh, tmp_path, monkeypatch):
    """Told before anything is computed."""
    (tmp_path / "file").touch()
    monkeypatch.setattr(SolidProblem, "solve", None)
    with pytest.raises(CheckpointError, match=r"below\.npz"):
        run(mesh, tmp_path / "file" / "below.npz")


def test_foreign_checkpoints(mesh, references, tmp_path, monkeypatch):
    """A checkpoint of any other problem, and a file that is none, are refused and left as they are."""
    path = tmp_path / "run.npz"
    references["pardiso"].save(path)
    before = path.read_bytes()
    options = Options(solver="pardiso")
    thicker = extrude(mesh.plane, 12.0, 1)
    coarser = extrude(mesh.plane, 10.0, 2)
    farther = Loading.clamped(PLATE.loaded, 21.0, dimension=3)
    for changed in (
        {"material": NeoHooke()},
        {"mesh": thicker},
        {"mesh": coarser},
        {"loading": farther},
        {"n_increments": 5},
        {"bulk_modulus": 99.0},
        {"options": replace(options, tolerance=1e-9)},
    ):
        case = {"mesh": mesh, "material": ArrudaBoyce(), "loading": LOADING, "n_increments": INCREMENTS}
        with pytest.raises(SolutionError, match="another"):
            solve(**{**case, "options": options, **changed}, checkpoint=path)
    references["pardiso"].surface().save(path)
    with pytest.raises(SolutionError, match="equigap-solid"):
        run(mesh, path)
    path.write_bytes(before[: len(before) // 2])
    with pytest.raises(SolutionError, match="equigap-solid"):
        run(mesh, path)
    assert path.read_bytes() == before[: len(before) // 2]


# solvers


def test_both_solvers_give_the_same(references):
    check_same(references["mumps"], references["pardiso"], 1e-9)


def test_without_pardiso_mumps_is_used(mesh, references, monkeypatch):
    names, make = [], SolidProblem._linear_solver

    def noted(problem, name):
        linear = make(problem, name)
        names.append(linear.name)
        return linear

    monkeypatch.setattr(SolidProblem, "_linear_solver", noted)
    run(mesh, solver="fastest")
    monkeypatch.setitem(sys.modules, "pypardiso", None)
    check_same(run(mesh, solver="fastest"), references["pardiso"], 1e-9)
    assert names == ["pardiso", "mumps"]
    with pytest.raises(LinearSolverError, match="pypardiso"):
        run(mesh, solver="pardiso")
    with pytest.raises(LinearSolverError, match="fastest, pardiso, mumps"):
        run(mesh, solver="superlu")


# input


@pytest.mark.parametrize(
    ("error", "changed"),
    [
        (LoadingError, {"n_increments": 0}),
        (LoadingError, {"loading": Loading({"right": (1.0, 0.0)})}),
        *((MaterialError, {"bulk_modulus": kappa}) for kappa in (0.0, -1.0, np.nan, np.inf)),
        (MaterialError, {"material": replace(PANN, unit="N/mm")}),
    ],
)
def test_wrong_input(mesh, error, changed):
    with pytest.raises(error):
        solve(**{"mesh": mesh, "material": ArrudaBoyce(), "loading": LOADING, **changed})


def test_a_plane_mesh_is_refused(mesh):
    with pytest.raises(LoadingError):
        solve(mesh.plane, ArrudaBoyce(), LOADING)


def test_default_layers():
    assert [default_layers(h) for h in (1.0, 10.0, 15.0, 20.0, 30.0, 40.0)] == [2, 2, 2, 3, 4, 5]
