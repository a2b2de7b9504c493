"""A perforated sheet in CalculiX with the exported card alone: its force against that of the forward model with the same law."""

import shutil
import subprocess

import numpy as np
import pytest

from forward import Loading
from forward.materials import Yeoh
from forward.sheet.plane_stress import solve
from meshes import quads
from meshes.known_specimens import SPECIMENS
from studies.exporters import targets
from studies.exporters.material_law import law_of

DECK = """*NODE, NSET=ALL
{nodes}
*ELEMENT, TYPE=CPS8, ELSET=E
{cells}
{card}*SOLID SECTION, ELSET=E, MATERIAL=EQUIGAP
1.0
*NSET, NSET=RIGHT
{right}
*BOUNDARY
{held}
*STEP, NLGEOM, INC=100
*STATIC
0.25, 1.0
*BOUNDARY
RIGHT, 1, 1, {u}
*NODE PRINT, NSET=RIGHT, FREQUENCY=1000, TOTALS=ONLY
RF
*END STEP
"""


def rows(values):
    return "\n".join(", ".join(map(str, row)) for row in values)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")
def test_calculix_gives_the_force_of_the_forward_model(tmp_path):
    specimen, law, u = SPECIMENS["plate_with_hole"](), Yeoh(), 15.0
    mesh = quads(specimen, quarter=True, size_factor=2.0)
    used = np.unique(mesh.cells[:, :8])
    right = [i + 1 for i in mesh.boundary_nodes("right")]
    held = [
        (i + 1, axis)
        for name, axis in (("symmetry_x", 1), ("symmetry_y", 2), ("right", 2))
        for i in mesh.boundary_nodes(name)
    ]
    deck = DECK.format(
        nodes=rows((i + 1, *map(float, mesh.points[i]), 0.0) for i in used), right=",\n".join(map(str, right)), u=u,
        cells=rows((k, *(cell[:8] + 1)) for k, cell in enumerate(mesh.cells, 1)), held=rows((i, k, k) for i, k in held),
        card=targets()["yeoh"].export(law_of(law, "yeoh")).text,
    )  # fmt: skip
    (tmp_path / "sheet.inp").write_text(deck)
    done = subprocess.run(["ccx", "sheet"], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    force = float((tmp_path / "sheet.dat").read_text().split()[-3]) if (tmp_path / "sheet.dat").exists() else np.nan
    ours = solve(mesh, law, Loading.clamped(specimen.loaded, u), n_increments=4).reactions["right"][-1, 0]
    assert force == pytest.approx(ours, rel=2e-3), done.stdout[-800:]
