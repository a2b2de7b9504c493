"""Exported laws in finite-element programs: a perforated specimen in felupe, a homogeneous state in DOLFINx."""

import felupe
import forward_felupe
import jax
import numpy as np
import pytest

from calibrate.equations.basis import SingleBasis
from calibrate.equations.inputs import INPUT_SETS
from calibrate.models import pann
from calibrate.models.extended_model import ExtendedModel
from calibrate.models.network_model import Model
from forward import Loading
from forward._dolfinx import MPI, dolfinx, ufl
from forward.compilation import compiled_form
from forward.materials import Pann
from forward.sheet.plane_stress import solve
from meshes import Cross, quads
from studies.exporters import reference, targets
from studies.exporters.material_law import law_of
from studies.exporters.python_function import namespace


@pytest.mark.slow
def test_felupe_with_the_exported_law_gives_our_forces(monkeypatch):
    model = a_network("I1I2")
    code = namespace(targets()["python"].export(law_of(model, "network")).text)
    law = Pann.from_dict(model.to_dict())
    mesh = quads(Cross(), quarter=True, size_factor=3.0)

    def sheet(mesh, material):
        region = felupe.RegionBiQuadraticQuad(felupe.Mesh(mesh.points, mesh.cells, "quad9"))
        field = felupe.FieldContainer([felupe.Field(region, dim=2)])
        exported = felupe.Material(
            stress=lambda x: [code["plane_stress"](x[0])[0], x[-1]],
            elasticity=lambda x: [code["plane_stress"](x[0])[1]],
        )
        return field, felupe.SolidBody(exported, field)

    monkeypatch.setattr(forward_felupe, "sheet", sheet)
    theirs = forward_felupe.solve(mesh, law, 20.0, 3)
    ours = solve(mesh, law, Loading.clamped(Cross().loaded, 20.0), n_increments=3)
    assert ours.reactions["right"][-1, 0] == pytest.approx(theirs.right, rel=1e-7)
    np.testing.assert_allclose(ours.displacements[-1], theirs.displacements, atol=1e-5)


def a_network(inputs):
    architecture = pann.Architecture(inputs, (4, 4), (0.3, 0.1)[: len(INPUT_SETS[inputs])], 0.3)
    parameters = np.asarray(architecture.random_start(jax.random.key(2)))
    return Model(architecture, parameters, calibrated_range={"I1": (3.0, 6.0), "I2": (3.0, 6.0)})


def a_spline():
    basis = SingleBasis(0, 4.0, 8)
    return ExtendedModel(basis, 0.1 + 0.05 * np.linspace(0, 1, 8) ** 2, (), (), "MPa")


@pytest.mark.slow
@pytest.mark.parametrize("model", [a_network("I1"), a_network("I1I2"), a_spline()], ids=["I1", "I1I2", "spline"])
def test_dolfinx_with_the_exported_law_gives_energy_and_stress_of_the_model(model):
    """A unit square moved homogeneously: stored energy, and the work of the nodal forces on homogeneous motions."""
    law, F = law_of(model, "law"), np.array([[1.4, 0.1], [0.05, 0.9]])
    code = namespace(targets()["ufl"].export(law).text)
    domain = dolfinx.mesh.create_unit_square(MPI.COMM_SELF, 1, 1)
    V = dolfinx.fem.functionspace(domain, ("Lagrange", 1, (2,)))
    u, points = dolfinx.fem.Function(V), V.tabulate_dof_coordinates()[:, :2]
    u.x.array[:] = (points @ (F - np.eye(2)).T).ravel()
    psi = code["plane_stress_energy"](ufl.Identity(2) + ufl.grad(u)) * ufl.dx
    forces = dolfinx.fem.assemble_vector(compiled_form(ufl.derivative(psi, u, ufl.TestFunction(V)))).array
    stress = [[forces @ np.outer(points[:, j], np.eye(2)[i]).ravel() for j in range(2)] for i in range(2)]
    W, P = reference.point_energy_and_stress(law.stress, F[None])
    assert dolfinx.fem.assemble_scalar(compiled_form(psi)) == pytest.approx(float(W[0]), rel=1e-8)
    np.testing.assert_allclose(stress, P[0], rtol=1e-10)
