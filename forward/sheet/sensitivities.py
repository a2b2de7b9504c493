r"""How a sheet's equilibrium changes with the parameters of its law: solution and law in, du/dtheta and dF/dtheta out.

With the nodal forces f(u, theta) = dE/du of the stored energy E = h int psi(I1, I2; theta) dA, equilibrium is f = 0 at the free
nodes, whatever theta is. By the implicit function theorem

.. math:: K \frac{du}{d\theta} = -\frac{\partial f}{\partial\theta}, \qquad
          \frac{dF}{d\theta} = \sum_{side} \Big(K \frac{du}{d\theta} + \frac{\partial f}{\partial\theta}\Big),

du/dtheta = 0 where displacements are prescribed: one extra solve a parameter with the factor of the tangent K = df/du at the
equilibrium (direct differentiation; Michaleris, Tortorelli and Vidal 1994, Int. J. Numer. Meth. Eng. 37). Exact for the discrete
problem up to the tolerance of the equilibrium.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from forward import interpolation
from forward._dolfinx import MPI, QUADRATURE_DEGREE, dolfinx, ufl
from forward.compilation import compiled_form
from forward.errors import SolutionError
from forward.loading import SYMMETRY, Loading
from forward.materials import Material
from forward.sheet.plane_stress_problem import PlaneStressProblem, invariants
from forward.solution import SurfaceSolution
from meshes import Mesh

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Derivatives of a solution to k parameters, each in the unit of the solution per unit of its parameter.

    displacements (n_inc, k, n, 2) at the nodes of `mesh`, mm; reactions: side to (n_inc, k, 2), N.
    """

    mesh: Mesh
    displacements: Array
    reactions: dict[str, Array]

    def evaluate(self, points: Array) -> Array:
        """Derivatives of the displacements (n_inc, k, p, 2) at reference points (p, 2), mm. Raises `SolutionError` far outside."""
        return interpolation.values_at(self.mesh, interpolation.locate(self.mesh, points), self.displacements)

    def mirrored(self) -> Sensitivities:
        """Of the full specimen, from those of a quarter; see `SurfaceSolution.mirrored`. Raises `SolutionError` if this is no quarter."""
        if "symmetry_x" not in self.mesh.boundaries or "symmetry_y" not in self.mesh.boundaries:
            raise SolutionError("cannot mirror: these are no sensitivities of a quarter")
        mesh, source, signs = self.mesh.mirrored()
        reactions: dict[str, Array] = {}
        for side, opposite, axis in (("right", "left", 0), ("top", "bottom", 1)):
            if side in self.reactions:
                force = np.zeros_like(self.reactions[side])
                force[..., axis] = 2 * self.reactions[side][..., axis]
                reactions |= {opposite: -force, side: force}
        return Sensitivities(mesh, self.displacements[:, :, source] * signs, reactions)


def sensitivities(
    solution: SurfaceSolution,
    material: Material,
    loading: Loading,
    varied: Material | None = None,
    comm: Any = MPI.COMM_WORLD,
) -> Sensitivities:
    """Of a plane-stress solution of `forward.sheet.plane_stress.solve`, to all parameters of its law, in their order.

    material, loading: as solved; the solution must not be mirrored. varied: a law whose energy is imagined beside the material's,
    to whose parameters the derivatives are taken instead (of weight zero where it is linear in them). Raises `SolutionError` for
    another material, plane strain or a mirrored solution, `LoadingError` for a loading of another mesh.
    """
    described = solution.description
    if (
        described.get("mirrored")
        or described.get("plane") == "strain"
        or described.get("material") != material.to_dict()
    ):
        raise SolutionError(
            "sensitivities need the plane-stress solution of this material as it was solved, before it is mirrored"
        )
    loading = loading.on(solution.mesh)
    sides = [name for name in loading.displacements if name not in SYMMETRY]
    problem = _Linearised(solution, material, loading, varied or material, comm)
    displacements: list[Array] = []
    reactions: dict[str, list[Array]] = {side: [] for side in sides}
    for u in solution.displacements:
        rates, forces = zip(*problem.derivatives(u), strict=True)
        displacements.append(np.array(rates))
        for side in sides:
            nodes = solution.mesh.boundary_nodes(side)
            reactions[side].append(np.array([f[nodes].sum(axis=0) for f in forces]))
    return Sensitivities(solution.mesh, np.array(displacements), {s: np.array(r) for s, r in reactions.items()})


class _Linearised(PlaneStressProblem):
    """The problem of a solution, with the forces that a unit of each parameter adds."""

    def __init__(
        self, solution: SurfaceSolution, material: Material, loading: Loading, varied: Material, comm: Any
    ) -> None:
        held, values = loading.prescribed(solution.mesh)
        super().__init__(solution.mesh, material, solution.thickness, held, values, 1e-10, 25, comm)
        self.direction = dolfinx.fem.Constant(self.domain, np.zeros(len(varied.parameters)))
        self._change = compiled_form(self._parameter_forces(varied, solution.thickness))
        self._whole = dolfinx.fem.petsc.create_matrix(self.problem.J)
        self._held = self._held_entries()

    def _parameter_forces(self, varied: Material, thickness: float) -> Any:
        """UFL form of df/dtheta along `direction`; one compiled form serves all parameters."""
        values = dolfinx.fem.Constant(self.domain, np.array(varied.parameters))
        parameters = [ufl.variable(values[k]) for k in range(len(varied.parameters))]
        h = dolfinx.fem.Constant(self.domain, float(thickness))
        dx = ufl.dx(domain=self.domain, metadata={"quadrature_degree": QUADRATURE_DEGREE})
        psi = varied.energy(*invariants(ufl.Identity(2) + ufl.grad(self.u)), parameters)
        change = sum(self.direction[k] * ufl.diff(psi, p) for k, p in enumerate(parameters))
        return ufl.derivative(h * change * dx, self.u, ufl.TestFunction(self.V))

    def derivatives(self, u: Array) -> Iterator[tuple[Array, Array]]:
        """du/dtheta (n, 2), mm, and the derivative of the nodal forces (n, 2), N, of each parameter, at the equilibrium u (n, 2)."""
        self.unknowns = (u,)
        petsc = dolfinx.fem.petsc
        for matrix, supports in ((self.problem.A, [s.bc for s in self.supports]), (self._whole, [])):
            matrix.zeroEntries()
            petsc.assemble_matrix(matrix, self.problem.J, bcs=supports)
            matrix.assemble()
        solver = self.problem.solver.getKSP()
        solver.setOperators(self.problem.A)
        right, rate, force = (self.problem.b.duplicate() for _ in range(3))
        for k in range(len(self.direction.value)):
            self.direction.value[:] = np.eye(len(self.direction.value))[k]
            change = petsc.assemble_vector(self._change)
            change.ghostUpdate(addv=petsc.PETSc.InsertMode.ADD, mode=petsc.PETSc.ScatterMode.REVERSE)
            change.copy(right)
            right.scale(-1.0)
            right.getArray()[self._held] = 0.0
            solver.solve(right, rate)
            self._whole.mult(rate, force)
            force.axpy(1.0, change)
            yield self._nodal(rate), self._nodal(force)

    def _nodal(self, vector: Any) -> Array:
        local = np.zeros_like(self.u.x.array)
        local[: vector.getLocalSize()] = vector.getArray(readonly=True)
        return self._gather(local)
