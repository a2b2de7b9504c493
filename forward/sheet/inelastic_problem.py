r"""One step of a sheet with a history: the committed state and a step of time in, equilibrium out.

Plane stress as in `plane_stress_problem`, with what a `Sheet` may have beside its material. State variables live at the
Gauss points:

- largest: the largest x = I1 - 3 so far; largest_energy: that of the stored energy without its volume;
- S_iso and Q of viscosity with their 33 components (Simo 1987). Between two steps S_iso is linear in time, so that with z = dt / tau
  Q = exp(-z) Q_old + g (1 - exp(-z)) / z (S_iso - S_iso,old); P33 = 0 leaves S + Q - C33 Q33 C^-1 in the plane. What is elastic in
  the step adds its part of S itself, since S_iso condenses to S; the rest is the derivative of (K : C + K33 C33) / 2;
- F of the last step, and A and A33 of permanent set (Tobolsky 1960): shares of the chains formed anew, times C^-1 and
  1 / C33 of the state they were formed in, which is the mean of a step's ends, so that their energy is
  mu / 2 (tr(C A) + C33 A33), but for a constant; those of a step carry stress from the next one on;
- branch_i: in-plane Ci^-1 of a branch with a multiplicative split, whose stress and tangent are fields (`overstress_fields`);
- F33 of a compressible sheet, from P33 = 0 by Newton's method at each point, condensed from the tangent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forward._dolfinx import MPI, QUADRATURE_DEGREE, dolfinx, ufl
from forward.sheet.overstress_fields import OverstressFields
from forward.sheet.plane_stress_problem import Outcome, PlaneStressProblem, to_second_order, weakly
from forward.sheet.quadrature_fields import (
    evaluate,
    get_values,
    quadrature_expression,
    quadrature_function,
    set_values,
)
from forward.sheet.thin_sheet import Sheet
from meshes import Mesh

Array = NDArray[np.float64]
THICKNESS_STEPS, THICKNESS_TOLERANCE = 30, 1e-13


@dataclass(frozen=True)
class _Point:
    """Kinematics of a Gauss point in UFL: in-plane F (2, 2), F33, C = F^T F and the invariants that psi depends on."""

    F: Any
    F33: Any
    C: Any
    I1: Any
    I2: Any

    @classmethod
    def of(cls, F: Any, F33: Any = None) -> _Point:
        """F33: of a compressible sheet, whose invariants are those of the volume-preserving part; None: 1 / det F."""
        C, thinning = F.T * F, 1 / ufl.det(F) if F33 is None else F33
        I1, I2 = ufl.tr(C) + thinning**2, ufl.det(C) + ufl.tr(C) * thinning**2
        if F33 is not None:
            J = ufl.det(F) * F33
            I1, I2 = J ** (-2 / 3) * I1, J ** (-4 / 3) * I2
        return cls(F, thinning, C, I1, I2)

    @property
    def J(self) -> Any:
        return ufl.det(self.F) * self.F33


class InelasticProblem(PlaneStressProblem):
    """A sheet whose components `held` move by `values`; `step` in time, then `commit` its state.

    Its energy is that of base, additions and change of volume, without softening, viscosity, branches and chains formed anew.
    """

    def __init__(
        self, mesh: Mesh, sheet: Sheet, held: Any, values: Array, tolerance: float, max_iterations: int, comm: Any
    ) -> None:
        self.sheet, self.symmetric = sheet, _has_symmetric_tangent(sheet)
        self._variables: dict[str, Any] = {}
        self._decays: list[Any] = []
        self._gains: list[Any] = []
        super().__init__(mesh, sheet, sheet.thickness, held, values, tolerance, max_iterations, comm)
        self._cells = np.asarray(self.domain.topology.original_cell_index)
        if sheet.bulk_modulus is not None or sheet.branches:
            self.problem.solver.setFunction(weakly(self._residual), self.problem.b)

    @property
    def history(self) -> dict[str, Array]:
        """State variables (m, q, ...) in the order of the mesh, on every rank."""
        owned = self.domain.topology.index_map(2).size_local
        history = {}
        for name, function in self._variables.items():
            values = get_values(function)
            history[name] = np.zeros((len(self.mesh.cells), *values.shape[1:]))
            history[name][self._cells[:owned]] = values[:owned]
            self.comm.Allreduce(MPI.IN_PLACE, history[name], op=MPI.SUM)
        return history

    @history.setter
    def history(self, values: dict[str, Array]) -> None:
        """Take state variables (m, q, ...)."""
        for name, variable in values.items():
            set_values(self._variables[name], variable[self._cells])

    def step(self, load_factor: float, duration: float) -> Outcome:
        """Equilibrium after `duration`, s, from the committed state."""
        for one, decay, gain in zip(self.sheet.prony, self._decays, self._gains, strict=True):
            z = duration / one.tau
            decay.value = np.exp(-z)
            gain.value = one.g * -np.expm1(-z) / z
        if self._overstress is not None:
            self._overstress.duration = duration
        return self.solve(load_factor)

    def commit(self) -> None:
        """Take the present state as the past of the next step."""
        if self.sheet.softens:
            before = self._get("largest")
            self._set("largest", np.maximum(before, self._at_points(self._x)))
            if self.sheet.permanent_set is not None:
                self._commit_permanent_set(self.sheet.permanent_set.a, before)
        if self.sheet.softens_by_energy:
            self._set("largest_energy", np.maximum(self._get("largest_energy"), self._at_points(self._W)))
        if self.sheet.prony:
            for overstress, stress, now in (("Q", "S", self._S), ("Q33", "S33", self._S33)):
                S = self._at_points(now).reshape(self._get(stress).shape)
                change = S - self._get(stress)
                for k, (decay, gain) in enumerate(zip(self._decays, self._gains, strict=True)):
                    name = f"{overstress}_{k}"
                    self._set(name, float(decay.value) * self._get(name) + float(gain.value) * change)
                self._set(stress, S)
        if self._overstress is not None:
            self._overstress.commit()

    def _commit_permanent_set(self, a: float, before: Array) -> None:
        """Form the chains anew that broke in the step; before (cells, q): the largest x at its start."""
        broken = np.exp(-a * before) - np.exp(-a * self._get("largest"))
        now = self._at_points(self._F).reshape(*before.shape, 2, 2)
        mean = (self._get("F") + now) / 2
        C = np.swapaxes(mean, -1, -2) @ mean
        self._set("A", self._get("A") + broken[..., None, None] * np.linalg.inv(C))
        self._set("A33", self._get("A33") + broken * np.linalg.det(C))
        self._set("F", now)

    def _forms(self, sheet: Any, thickness: float) -> tuple[Any, Any, Any]:
        additions = [self._constant(a.values) for a in sheet.additions]
        dx = ufl.dx(domain=self.domain, metadata={"quadrature_degree": QUADRATURE_DEGREE})
        h = self._constant(thickness)
        point = self._kinematics(sheet.bulk_modulus is not None)
        W = self._energy_density(sheet, point, additions)
        P = self._stress(sheet, point, W, additions)
        test, step = ufl.TestFunction(self.V), ufl.TrialFunction(self.V)
        forces = h * ufl.inner(P, ufl.grad(test)) * dx
        tangent = ufl.derivative(forces, self.u, step)
        if sheet.bulk_modulus is not None:
            P33 = ufl.diff(W, point.F33)
            stiffness = ufl.diff(P33, point.F33)
            self._thinning = quadrature_expression(ufl.as_vector([P33, stiffness]), self.domain)
            change = -ufl.inner(ufl.diff(P33, point.F), ufl.grad(step)) / stiffness
            tangent += h * ufl.inner(ufl.diff(P, point.F33), ufl.grad(test)) * change * dx
        if self._overstress is not None:
            s = sheet.field(ufl.SpatialCoordinate(self.domain), additions)
            tangent += h * s * ufl.inner(self._overstress.change(ufl.grad(step)), ufl.grad(test)) * dx
        return h * W * dx, forces, tangent

    def _kinematics(self, compressible: bool) -> _Point:
        F33 = self._variable("F33", (), 1.0) if compressible else None
        present = dolfinx.fem.Function(self.V, self.u.x)  # the values of u, which no derivative reaches
        self._present = _Point.of(_gradient(present), F33)
        return _Point.of(ufl.variable(_gradient(self.u)), ufl.variable(F33) if compressible else None)

    def _energy_density(self, sheet: Sheet, point: _Point, additions: list[Any]) -> Any:
        """Of base, additions and change of volume, MPa."""
        W = self._stored(sheet, point, additions)
        X = ufl.SpatialCoordinate(self.domain)
        if sheet.bulk_modulus is not None:
            W += sheet.field(X, additions) * self._constant(sheet.bulk_modulus) / 2 * (point.J - 1) ** 2
        return W

    def _stored(self, sheet: Sheet, point: _Point, additions: list[Any]) -> Any:
        """Of base and additions alone, MPa."""
        material = self._constant(sheet.material.parameters)
        base = to_second_order(
            lambda I1, I2: sheet.material.energy(I1, I2, material),
            (point.I1, point.I2),
            (self._present.I1, self._present.I2),
        )
        return sheet.energy(base, point.I1, point.I2, point.C, ufl.SpatialCoordinate(self.domain), additions)

    def _stress(self, sheet: Sheet, point: _Point, W: Any, additions: list[Any]) -> Any:
        """First Piola-Kirchhoff stress (2, 2), MPa: that of energy and new chains, softened, then with its overstress."""
        elastic, field = ufl.diff(W, point.F), sheet.field(ufl.SpatialCoordinate(self.domain), additions)
        if sheet.softens:
            x = point.I1 - 3
            self._x = quadrature_expression(x, self.domain)
            largest = ufl.max_value(self._variable("largest", ()), x)
            if sheet.permanent_set is not None:
                whole = ufl.exp(-self._constant(sheet.permanent_set.a) * largest)
                elastic = whole * elastic + field * self._stress_of_new_chains(sheet, point)
            elastic *= sheet.factor(x, largest, additions)
        if sheet.softens_by_energy:
            elastic *= self._damage(sheet, point, additions)
        P = elastic
        if sheet.prony:
            P = self._viscous(elastic, point)
        self._overstress = None
        if sheet.branches:
            self._overstress = OverstressFields(sheet.branches, point.F, self.domain, self._variable)
            P += field * self._overstress.stress
        return P

    def _damage(self, sheet: Sheet, point: _Point, additions: list[Any]) -> Any:
        """Factor on the stress by the stored energy, without that of the volume, and its largest value so far."""
        W = self._stored(sheet, point, additions)
        self._W = quadrature_expression(W, self.domain)
        return sheet.factor_of_energy(W, ufl.max_value(self._variable("largest_energy", ()), W), additions)

    def _viscous(self, elastic: Any, point: _Point) -> Any:
        """F times in-plane S + Q - C33 Q33 C^-1 at the end of the step, Q that of all branches."""
        self._decays, self._gains = ([self._constant(0.0) for _ in self.sheet.prony] for _ in range(2))
        S, inverse_C, C33 = ufl.inv(point.F) * elastic, ufl.inv(point.C), point.F33**2
        trace = ufl.inner(S, point.C) / 3
        self._S = quadrature_expression(S - trace * inverse_C, self.domain)
        self._S33 = quadrature_expression(-trace / C33, self.domain)
        gain = sum(self._gains)
        K, K33 = -gain * self._variable("S", (2, 2)), -gain * self._variable("S33", ())
        for k, decay in enumerate(self._decays):
            K += decay * self._variable(f"Q_{k}", (2, 2))
            K33 += decay * self._variable(f"Q33_{k}", ())
        return (1 + gain) * elastic + point.F * (K - C33 * K33 * inverse_C)

    def _stress_of_new_chains(self, sheet: Sheet, point: _Point) -> Any:
        A, A33 = self._variable("A", (2, 2)), self._variable("A33", ())
        self._variable("F", (2, 2), np.eye(2))
        self._F = quadrature_expression(point.F, self.domain)
        mu = self._constant(sheet.material.shear_modulus)
        return ufl.diff(mu / 2 * (ufl.tr(point.C * A) + point.F33**2 * A33), point.F)

    def _constant(self, value: Any) -> Any:
        return dolfinx.fem.Constant(self.domain, np.asarray(value, float))

    def _variable(self, name: str, shape: tuple[int, ...], start: Any = 0.0) -> Any:
        """A new state variable at the Gauss points."""
        function = self._variables[name] = quadrature_function(self.domain, shape)
        set_values(function, np.broadcast_to(start, get_values(function).shape))
        return function

    def _get(self, name: str) -> Array:
        return get_values(self._variables[name])

    def _set(self, name: str, values: Array) -> None:
        set_values(self._variables[name], values)

    def _at_points(self, expression: Any) -> Array:
        return evaluate(expression, self.domain)

    def _residual(self, snes: Any, x: Any, b: Any) -> None:
        """Nodal forces at the displacements x, each point as thick as P33 = 0 asks for and its branches where the step takes them."""
        dolfinx.fem.petsc.assign(x, self.u)
        self.u.x.scatter_forward()
        if self.sheet.bulk_modulus is not None:
            self._find_thickness()
        if self._overstress is not None:
            self._overstress.update()
        problem = self.problem
        dolfinx.fem.petsc.assemble_residual(
            snes, x, b, self.u, problem.F, problem.J, [support.bc for support in self.supports]
        )

    def _find_thickness(self) -> None:
        """F33 at the Gauss points, by Newton's method from where it was; from 1 where a step that was given up has left no number."""
        last = self._get("F33")
        self._set("F33", np.where(np.isfinite(last), last, 1.0))
        for _ in range(THICKNESS_STEPS):
            values = self._at_points(self._thinning)
            with np.errstate(divide="ignore", invalid="ignore"):  # of a step that is given up
                change = -values[..., 0] / values[..., 1]
            before = self._get("F33")
            self._set("F33", np.maximum(before + change, before / 2))
            if not np.abs(change).max() > THICKNESS_TOLERANCE:
                break


def _gradient(u: Any) -> Any:
    """Deformation gradient (2, 2)."""
    return ufl.Identity(2) + ufl.grad(u)


def _has_symmetric_tangent(sheet: Sheet) -> bool:
    """Not with damage, whose factor multiplies a stress; nor with branches, whose step of second order has no potential; nor with overstress in a compressible sheet, as C33 in S + Q - C33 Q33 C^-1 then is no function of
    the C in the plane, so that this has no potential."""
    return not (
        sheet.softens
        or sheet.softens_by_energy
        or sheet.branches
        or (sheet.bulk_modulus is not None and bool(sheet.prony))
    )
