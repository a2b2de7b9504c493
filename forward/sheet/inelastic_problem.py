"""One step of a sheet with a history: the committed state and a step of time in, equilibrium out.

Plane stress as in `forward.sheet.plane_stress_problem`, with the additions of `forward.sheet.additions`. State variables live at the Gauss points:

- the largest x = I1 - 3 so far;
- S and Q of viscosity. Between two steps S is linear in time, so that with z = dt / tau
  Q = exp(-z) Q_old + g (1 - exp(-z)) / z (S - S_old);
- F of the last step, and A and A33 of permanent set: shares of the chains formed anew, times C^-1 and 1 / C33 of the state
  they were formed in, which is the mean of a step's ends, so that their energy is mu / 2 (tr(C A) + C33 A33), but for a
  constant; those of a step carry stress from the next one on;
- F33 of a compressible sheet, from P33 = 0 by Newton's method at each point, condensed from the tangent.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from forward._dolfinx import JIT_OPTIONS, QUADRATURE_DEGREE, basix, dolfinx, ufl
from forward.sheet.additions import Sheet
from forward.sheet.plane_stress_problem import Outcome, PlaneStressProblem, weakly
from meshes import Mesh

Array = NDArray[np.float64]
THICKNESS_STEPS, THICKNESS_TOLERANCE = 30, 1e-13


class InelasticProblem(PlaneStressProblem):
    """A sheet whose components `held` move to load_factor * `values`; `step` in time, then `commit` its state.

    Its energy is that of base, additions and change of volume, without softening, viscosity and chains formed anew.
    """

    def __init__(
        self, mesh: Mesh, sheet: Sheet, held: Any, values: Array, tolerance: float, max_iterations: int, comm: Any
    ) -> None:
        self.sheet, self.symmetric = sheet, not sheet.softens
        super().__init__(mesh, sheet, sheet.thickness, held, values, tolerance, max_iterations, comm)
        if sheet.bulk_modulus is not None:
            self.problem.solver.setFunction(weakly(self._residual), self.problem.b)

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
            old = _get(self._largest)
            _set(self._largest, np.maximum(old, self._at_points(self._x)))
            if self.sheet.permanent_set is not None:
                a = self.sheet.permanent_set.a
                broken = np.exp(-a * old) - np.exp(-a * _get(self._largest))
                now = self._at_points(self._F).reshape(*old.shape, 2, 2)
                mean = (_get(self._F_old) + now) / 2
                C = np.swapaxes(mean, -1, -2) @ mean
                _set(self._A, _get(self._A) + broken[..., None, None] * np.linalg.inv(C))
                _set(self._A33, _get(self._A33) + broken * np.linalg.det(C))
                _set(self._F_old, now)
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
            largest = ufl.max_value(self._largest, x)
            elastic *= sheet.factor(x, largest, additions)
        P = elastic
        if sheet.prony is not None:
            self._decay, self._gain = constant(domain, 0.0), constant(domain, 0.0)
            self._Q, self._S_old = self._function((2, 2)), self._function((2, 2))
            self._S = self._expression(ufl.inv(F) * elastic)
            P = (1 + self._gain) * elastic + F * (self._decay * self._Q - self._gain * self._S_old)
        if sheet.permanent_set is not None:
            self._A, self._A33, self._F_old = self._function((2, 2)), self._function(()), self._function((2, 2))
            _set(self._F_old, np.broadcast_to(np.eye(2), (*_get(self._A33).shape, 2, 2)))
            self._F = self._expression(F)
            a = constant(domain, float(sheet.permanent_set.a))
            mu = constant(domain, float(sheet.material.shear_modulus))
            P = ufl.exp(-a * largest) * P + ufl.diff(mu / 2 * (ufl.tr(C * self._A) + F33**2 * self._A33), F)
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


def _get(function: Any) -> Array:
    """Values (cells, 9, ...) of a function at the Gauss points."""
    shape = (*function.function_space.dofmap.list.shape, *function.ufl_shape)
    values = function.x.array.reshape(-1, function.function_space.dofmap.bs)
    return values[function.function_space.dofmap.list].reshape(shape)


def _set(function: Any, values: Array) -> None:
    """Give a function at the Gauss points its values (cells, 9, ...)."""
    bs = function.function_space.dofmap.bs
    function.x.array.reshape(-1, bs)[function.function_space.dofmap.list.ravel()] = values.reshape(-1, bs)
