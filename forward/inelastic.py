"""Sheets with a history: mesh, sheet, loading and its factors in time in; a `SurfaceSolution` in seconds out.

Plane stress as in `forward.problem`, with the additions of `forward.effects`. State variables live at the Gauss points:

- the largest x = I1 - 3 so far;
- S and Q of viscosity. Between two steps S is linear in time, so that with z = dt / tau
  Q = exp(-z) Q_old + g (1 - exp(-z)) / z (S - S_old);
- F33 of a compressible sheet, from P33 = 0 by Newton's method at each point, condensed from the tangent.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forward._dolfinx import JIT_OPTIONS, MPI, QUADRATURE_DEGREE, basix, compiler_needed, dolfinx, ufl, versions
from forward.effects import Sheet
from forward.errors import ConvergenceError, LoadingError
from forward.loading import SYMMETRY, Loading
from forward.plane_stress import Options
from forward.problem import Outcome, PlaneStressProblem
from forward.solution import SurfaceSolution
from forward.stepping import HISTORY, State, predict
from meshes import Mesh

Array = NDArray[np.float64]
THICKNESS_STEPS, THICKNESS_TOLERANCE = 30, 1e-13


class InelasticProblem(PlaneStressProblem):
    """A sheet whose components `held` move to load_factor * `values`; `solve` a step of time, then `commit` its state."""

    def __init__(self, mesh: Mesh, sheet: Sheet, held: Any, values: Array, options: Options, comm: Any) -> None:
        self.sheet, self.symmetric = sheet, not sheet.softens
        super().__init__(mesh, sheet, sheet.thickness, held, values, options.tolerance, options.max_iterations, comm)
        if sheet.bulk_modulus is not None:
            self.problem.solver.setFunction(self._residual, self.problem.b)

    def step(self, load_factor: float, duration: float) -> Outcome:
        """Equilibrium after `duration`, s, from the committed state."""
        if self.sheet.prony is not None:
            z = duration / self.sheet.prony.tau
            self._decay.value = np.exp(-z)
            self._gain.value = self.sheet.prony.g * -np.expm1(-z) / z
        return self.solve(load_factor)

    def commit(self) -> None:
        """Take the present state as the past of the next step."""
        if self.sheet.softens:
            _set(self._largest, np.maximum(_get(self._largest), self._at_points(self._x)))
        if self.sheet.prony is not None:
            S = self._at_points(self._S)
            Q = float(self._decay.value) * _get(self._Q) + float(self._gain.value) * (S - _get(self._S_old))
            _set(self._Q, Q)
            _set(self._S_old, S)

    def _forms(self, sheet: Any, thickness: float) -> tuple[Any, Any, Any]:
        domain, constant = self.domain, dolfinx.fem.Constant
        material = constant(domain, np.array(sheet.material.parameters))
        additions = [constant(domain, np.array(a.values)) for a in sheet.additions]
        dx = ufl.dx(domain=domain, metadata={"quadrature_degree": QUADRATURE_DEGREE})
        h = constant(domain, float(thickness))
        F = ufl.variable(ufl.Identity(2) + ufl.grad(self.u))
        C = F.T * F
        compressible = sheet.bulk_modulus is not None
        self._F33 = self._function(())
        F33 = ufl.variable(self._F33) if compressible else 1 / ufl.det(F)
        J = ufl.det(F) * F33
        I1 = ufl.tr(C) + F33**2
        I2 = ufl.det(C) + ufl.tr(C) * F33**2
        if compressible:
            I1, I2 = J ** (-2 / 3) * I1, J ** (-4 / 3) * I2
        X = ufl.SpatialCoordinate(domain)
        W = sheet.energy(I1, I2, C, X, material, additions)
        if compressible:
            kappa = constant(domain, float(sheet.bulk_modulus))
            W += sheet.field(X, additions) * kappa / 2 * (J - 1) ** 2
        elastic = ufl.diff(W, F)
        if sheet.softens:
            self._largest, x = self._function(()), I1 - 3
            self._x = self._expression(x)
            elastic *= sheet.factor(x, ufl.max_value(self._largest, x), additions)
        P = elastic
        if sheet.prony is not None:
            self._decay, self._gain = constant(domain, 0.0), constant(domain, 0.0)
            self._Q, self._S_old = self._function((2, 2)), self._function((2, 2))
            self._S = self._expression(ufl.inv(F) * elastic)
            P = (1 + self._gain) * elastic + F * (self._decay * self._Q - self._gain * self._S_old)
        test, step = ufl.TestFunction(self.V), ufl.TrialFunction(self.V)
        forces = h * ufl.inner(P, ufl.grad(test)) * dx
        tangent = ufl.derivative(forces, self.u, step)
        if compressible:
            P33 = ufl.diff(W, F33)
            stiffness = ufl.diff(P33, F33)
            self._thinning = self._expression(ufl.as_vector([P33, stiffness]))
            change = -ufl.inner(ufl.diff(P33, F), ufl.grad(step)) / stiffness
            tangent += h * ufl.inner(ufl.diff(P, F33), ufl.grad(test)) * change * dx
            self._F33.x.array[:] = 1.0
        return h * W * dx, forces, tangent

    def _function(self, shape: tuple[int, ...]) -> Any:
        """A function (zero) of values of `shape` at the Gauss points."""
        element = basix.ufl.quadrature_element("quadrilateral", shape, degree=QUADRATURE_DEGREE)
        return dolfinx.fem.Function(dolfinx.fem.functionspace(self.domain, element))

    def _expression(self, value: Any) -> Any:
        """Compiled `value` at the Gauss points."""
        points, _ = basix.make_quadrature(basix.CellType.quadrilateral, QUADRATURE_DEGREE)
        return dolfinx.fem.Expression(value, points, jit_options=JIT_OPTIONS)

    def _at_points(self, expression: Any) -> Array:
        """Values (cells, 9, ...) of a compiled expression."""
        return expression.eval(self.domain, np.arange(len(self.domain.geometry.dofmaps[0]), dtype=np.int32))

    def _residual(self, snes: Any, x: Any, b: Any) -> None:
        """Nodal forces at the displacements x, each point as thick as P33 = 0 asks for."""
        dolfinx.fem.petsc.assign(x, self.u)
        self.u.x.scatter_forward()
        self._find_thickness()
        problem = self.problem
        dolfinx.fem.petsc.assemble_residual(
            snes, x, b, self.u, problem.F, problem.J, [support.bc for support in self.supports]
        )

    def _find_thickness(self) -> None:
        """F33 at the Gauss points, by Newton's method from where it was."""
        for _ in range(THICKNESS_STEPS):
            values = self._at_points(self._thinning)
            change = -values[..., 0] / values[..., 1]
            old = _get(self._F33)
            _set(self._F33, np.maximum(old + change, old / 2))
            if not np.abs(change).max() > THICKNESS_TOLERANCE:
                break


@dataclass(frozen=True)
class _Moment:
    """A time, s, and the load factor then."""

    time: float
    factor: float


def solve_history(
    mesh: Mesh,
    sheet: Sheet,
    loading: Loading,
    factors: Sequence[float] | Array,
    times: Sequence[float] | Array,
    substeps: int = 1,
    options: Options = Options(),
    comm: Any = MPI.COMM_WORLD,
) -> SurfaceSolution:
    """Load by `factors` (t,) of `loading` at `times` (t,), s, from rest at time 0; straight lines between.

    substeps: steps of an increment, at least. Raises `LoadingError` and `ConvergenceError`, whose `solution` holds the
    increments reached.
    """
    moments = _moments(factors, times, substeps)
    loading = loading.on(mesh)
    supports = loading.prescribed(mesh)
    with compiler_needed():
        problem = InelasticProblem(mesh, sheet, *supports, options, comm)
    kept = _Kept(problem, sheet, {n: mesh.boundary_nodes(n) for n in loading.displacements if n not in SYMMETRY})
    kept.description = {**sheet.to_dict(), "loading": loading.to_dict(), "substeps": substeps, **versions()}
    try:
        for moment, iterations in _march(problem, moments, substeps, options.max_bisections):
            kept.add(moment, iterations)
    except ConvergenceError as error:
        raise ConvergenceError(str(error), kept.solution()) from error
    return kept.solution()


class _Kept:
    """The increments reached."""

    def __init__(self, problem: InelasticProblem, sheet: Sheet, sides: dict[str, NDArray[np.int64]]) -> None:
        self.problem, self.sheet, self.sides = problem, sheet, sides
        self.description: dict[str, Any] = {}
        self.moments: list[_Moment] = []
        self.displacements: list[Array] = []
        self.forces: dict[str, list[Array]] = {side: [] for side in sides}
        self.energies: list[float] = []
        self.iterations: list[int] = []

    def add(self, moment: _Moment, iterations: int) -> None:
        forces = self.problem.nodal_forces()
        for side, nodes in self.sides.items():
            self.forces[side].append(forces[nodes].sum(axis=0))
        self.displacements.append(self.problem.displacements)
        self.energies.append(self.problem.energy())
        self.moments.append(moment)
        self.iterations.append(iterations)

    def solution(self) -> SurfaceSolution:
        mesh = self.problem.mesh
        return SurfaceSolution(
            mesh,
            np.array(self.displacements).reshape(-1, *mesh.points.shape),
            {side: np.array(force).reshape(-1, 2) for side, force in self.forces.items()},
            np.array([m.time for m in self.moments]),
            np.array(self.energies),
            np.array(self.iterations, np.int64),
            self.sheet.thickness,
            {**self.description, "load_factors": [m.factor for m in self.moments]},
        )


def _moments(factors: Sequence[float] | Array, times: Sequence[float] | Array, substeps: int) -> list[_Moment]:
    if len(factors) != len(times) or not len(times) or substeps < 1:
        raise LoadingError(f"{len(factors)} load factors at {len(times)} times in {substeps} substeps; give one each")
    if not (np.isfinite(factors).all() and np.isfinite(times).all() and (np.diff(times, prepend=0.0) > 0).all()):
        raise LoadingError("load factors and times must be finite, and times rise from above 0 s")
    return [_Moment(float(t), float(f)) for f, t in zip(factors, times, strict=True)]


def _march(
    problem: InelasticProblem, moments: Sequence[_Moment], substeps: int, max_bisections: int
) -> Iterator[tuple[_Moment, int]]:
    """Solve from moment to moment, each step halved where Newton's method fails."""
    known = [State(0.0, problem.unknowns)]
    last = _Moment(0.0, 0.0)
    for target in moments:
        part, smallest = 1.0 / substeps, 0.5**max_bisections / substeps
        done, iterations = 0.0, 0
        while done < 1.0:
            share = 1.0 if done + part > 1 - 1e-12 else done + part
            factor = last.factor + share * (target.factor - last.factor)
            problem.unknowns = predict(known, factor)
            outcome = problem.step(factor, (share - done) * (target.time - last.time))
            iterations += outcome.iterations
            if outcome.converged:
                known = _distinct([*known, State(factor, problem.unknowns)])
                done = share
                if done == 1.0:
                    yield target, iterations  # before the state is committed, which changes the forces
                problem.commit()
                continue
            problem.unknowns = known[-1].unknowns
            part /= 2
            if part < smallest * (1 - 1e-9):
                raise ConvergenceError(
                    f"no equilibrium after {last.time + done * (target.time - last.time):.4g} s: {outcome.text}. Load "
                    "less, use more increments, refine the mesh or check the material"
                )
        last = target


def _distinct(states: list[State]) -> list[State]:
    """The last states, three at most, at different load factors, through which a polynomial can be laid."""
    kept: list[State] = []
    for state in reversed(states):
        if len(kept) < HISTORY and all(abs(state.load_factor - k.load_factor) > 1e-6 for k in kept):
            kept.insert(0, state)
    return kept


def _get(function: Any) -> Array:
    """Values (cells, 9, ...) of a function at the Gauss points."""
    shape = (*function.function_space.dofmap.list.shape, *function.ufl_shape)
    values = function.x.array.reshape(-1, function.function_space.dofmap.bs)
    return values[function.function_space.dofmap.list].reshape(shape)


def _set(function: Any, values: Array) -> None:
    """Give a function at the Gauss points its values (cells, 9, ...)."""
    bs = function.function_space.dofmap.bs
    function.x.array.reshape(-1, bs)[function.function_space.dofmap.list.ravel()] = values.reshape(-1, bs)
