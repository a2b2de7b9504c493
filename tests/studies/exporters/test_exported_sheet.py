"""A perforated specimen solved in felupe with the exported Python file alone gives the forces of the forward model."""

import felupe
import forward_felupe
import jax
import numpy as np
import pytest

from calibrate.models import pann
from calibrate.models.network_model import Model
from forward import Loading
from forward.materials import Pann
from forward.sheet.plane_stress import solve
from meshes import Cross, quads
from studies.exporters import targets
from studies.exporters.material_law import law_of
from studies.exporters.python_function import namespace


@pytest.mark.slow
def test_felupe_with_the_exported_law_gives_our_forces(monkeypatch):
    architecture = pann.Architecture("I1I2", (4, 4), (0.3, 0.1), 0.3)
    parameters = np.asarray(architecture.random_start(jax.random.key(2)))
    model = Model(architecture, parameters, calibrated_range={"I1": (3.0, 6.0), "I2": (3.0, 6.0)})
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
