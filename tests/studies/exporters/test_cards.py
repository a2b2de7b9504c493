"""Material cards: a Yeoh law is found again, and CalculiX computes our stress from the written file alone."""

import shutil
import subprocess

import numpy as np
import pytest

from forward.materials import ArrudaBoyce, Yeoh
from studies.exporters import targets
from studies.exporters.material_law import law_of

CUBE = """*NODE, NSET=ALL
{nodes}
*ELEMENT, TYPE=C3D8, ELSET=E
1, 1, 2, 3, 4, 5, 6, 7, 8
{card}*SOLID SECTION, ELSET=E, MATERIAL=EQUIGAP
*BOUNDARY
{held}
*STEP, NLGEOM, INC=100
*STATIC
0.1, 1.0
*BOUNDARY
2, 1, 1, {u}
3, 1, 1, {u}
6, 1, 1, {u}
7, 1, 1, {u}
*NODE PRINT, NSET=ALL, FREQUENCY=1000
RF
*END STEP
"""
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float)


def test_a_yeoh_law_is_found_again_and_another_states_its_error():
    law = Yeoh(c1=0.2, c2=-0.002, c3=0.0003)
    written = targets()["yeoh"].export(law_of(law, "yeoh"))
    values = [float(x) for x in written.text.splitlines()[-1].split(",")[:3]]
    np.testing.assert_allclose(values, law.parameters, rtol=1e-9)
    assert written.errors.stress < 1e-10
    assert 1e-12 < targets()["yeoh"].export(law_of(ArrudaBoyce(), "arruda_boyce")).errors.stress < 0.01


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")
def test_calculix_pulls_a_cube_with_the_card(tmp_path):
    law, stretch = law_of(Yeoh(), "yeoh"), 1.5
    card = targets()["yeoh"].export(law).text
    nodes = "\n".join(f"{i}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(CORNERS, 1))
    held = "\n".join(f"{i}, {k + 1}" for i, x in enumerate(CORNERS, 1) for k in range(3) if x[k] == 0)
    (tmp_path / "cube.inp").write_text(CUBE.format(nodes=nodes, card=card, held=held, u=stretch - 1))
    done = subprocess.run(["ccx", "cube"], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    rows = [line.split() for line in (tmp_path / "cube.dat").read_text().splitlines() if len(line.split()) == 4]
    force = sum(float(r[1]) for r in rows[-8:] if CORNERS[int(r[0]) - 1][0] == 1)
    slope = 0.15 - 2e-3 * (x := stretch**2 + 2 / stretch - 3) + 3e-4 * x**2
    assert force == pytest.approx(2 * slope * (stretch - stretch**-2), rel=2e-3), done.stdout[-500:]
