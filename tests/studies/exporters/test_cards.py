"""Material cards: a Yeoh law is found again, and CalculiX computes our stress from the written file alone."""

import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from calibrate.equations.deformation_modes import MODES, largest_stretch, mode_invariants, stretches_to_gradient
from forward.materials import ArrudaBoyce, MooneyRivlin, Yeoh
from studies.errors import ExportError
from studies.exporters import cards, targets
from studies.exporters.material_law import law_of
from studies.exporters.nearest_law import nearest, seen_curves

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


def test_each_law_is_its_own_nearest_and_the_best_card_takes_it():
    chains, mooney = law_of(ArrudaBoyce(), "arruda_boyce"), law_of(MooneyRivlin(c10=0.1, c01=0.03), "mooney_rivlin")
    np.testing.assert_allclose(nearest(chains, "Arruda-Boyce").parameters, [0.2698, 1 / 21.49], rtol=1e-7)
    # as Ogden: terms of exponents 2 and -2 with twice the constants
    np.testing.assert_allclose(nearest(mooney, "two-term Ogden").parameters, [0.2, 2.0, 0.06, -2.0], rtol=1e-5)
    best = targets()["card"]
    assert (best.found(chains).law.name, best.found(mooney).law.name) == ("Arruda-Boyce", "two-term Ogden")
    errors = [nearest(mooney, name).worst for name in best.laws]
    assert errors[1] < 1e-6 and min(errors[0], errors[2]) > 0.02


def test_a_marlow_table_holds_a_law_of_the_first_invariant_and_states_what_it_makes_of_the_second():
    of_first = targets()["marlow"].mode_errors(law_of(ArrudaBoyce(), "arruda_boyce"))
    assert max(of_first.values()) < 1e-3
    law = MooneyRivlin(c10=0.1, c01=0.03)
    found, x = targets()["marlow"].mode_errors(law_of(law, "mooney_rivlin")), 2.0
    assert found["uniaxial"] < 1e-3
    end = law_of(law, "mooney_rivlin").largest_stretch("equibiaxial")
    same = largest_stretch("uniaxial", 2 * end**2 + end**-4)
    marlow = 2 * (0.1 + 0.03 / same) * (end - end**-5)  # psi_1 of the uniaxial test at the same I1
    assert same < x + 1e-9
    true = 2 * (0.1 + 0.03 * end**2) * (end - end**-5)
    assert found["equibiaxial"] == pytest.approx(1 - marlow / true, rel=0.02)
    text = targets()["marlow"].export(law_of(law, "mooney_rivlin")).text
    rows = text.split("*UNIAXIAL TEST DATA\n")[1].split("*VOLUMETRIC")[0].split()
    table = np.array(rows, dtype=str).reshape(-1, 2)
    stress, strain = (np.array([float(v.strip(",")) for v in column]) for column in table.T)
    np.testing.assert_allclose(stress, 2 * (0.1 + 0.03 / (1 + strain)) * (1 + strain - (1 + strain) ** -2), atol=1e-9)


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed")
@pytest.mark.parametrize("target", ["yeoh", "ogden", "arruda-boyce"])
def test_calculix_pulls_a_cube_with_the_card(tmp_path, target):
    law, stretch = law_of(ArrudaBoyce(), "arruda_boyce"), 1.5
    card = targets()[target].export(law).text
    nodes = "\n".join(f"{i}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(CORNERS, 1))
    held = "\n".join(f"{i}, {k + 1}" for i, x in enumerate(CORNERS, 1) for k in range(3) if x[k] == 0)
    (tmp_path / "cube.inp").write_text(CUBE.format(nodes=nodes, card=card, held=held, u=stretch - 1))
    done = subprocess.run(["ccx", "cube"], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    rows = [line.split() for line in (tmp_path / "cube.dat").read_text().splitlines() if len(line.split()) == 4]
    force = sum(float(r[1]) for r in rows[-8:] if CORNERS[int(r[0]) - 1][0] == 1)
    found = targets()[target].found(law)
    ours = found.law.stress(stretches_to_gradient("uniaxial", np.array([stretch])), found.parameters)[0, 0, 0]
    assert force == pytest.approx(ours, rel=2e-3), done.stdout[-500:]


def test_a_mat181_table_holds_a_separable_law_and_states_what_it_makes_of_another():
    """Mooney-Rivlin is separable in the principal stretches, a chain model is not (Kolling et al. 2007); biaxial tension is
    uniaxial compression."""
    law = law_of(MooneyRivlin(c10=0.1, c01=0.03), "mooney_rivlin")
    assert max(targets()["mat181"].mode_errors(law).values()) < 2e-4
    chains = targets()["mat181"].mode_errors(law_of(ArrudaBoyce(N=3.0), "arruda_boyce"))
    assert max(chains["uniaxial"], chains["equibiaxial"]) < 2e-4 < chains["pure_shear"]
    text = targets()["mat181"].export(law).text
    strain, stress = np.array([row.split() for row in text.split("*DEFINE_CURVE")[1].splitlines()[3:-1]], float).T
    x = 1 + strain
    np.testing.assert_allclose(stress, 2 * (0.1 + 0.03 / x) * (x - x**-2), atol=1e-9)
    assert x[0] == pytest.approx(law.largest_stretch("equibiaxial") ** -2) and 0 in strain
    assert all(len(line) <= 80 for line in text.split("*MAT_")[1].splitlines())


def test_the_best_card_is_of_the_laws_that_are_found(monkeypatch):
    law = law_of(ArrudaBoyce(), "arruda_boyce")

    def lost(law, name):
        if name in missing:
            raise ExportError(f"no {name}")
        return nearest(law, name)

    monkeypatch.setattr(cards, "nearest", lost)
    missing = {"Arruda-Boyce"}
    assert cards.BestCard().found(law).law.name in ("Yeoh", "two-term Ogden")
    missing = {"Yeoh", "two-term Ogden", "Arruda-Boyce"}
    with pytest.raises(ExportError, match="Arruda-Boyce"):
        cards.BestCard().found(law)


def test_a_nearest_law_is_fitted_and_judged_where_the_data_have_been():
    """One mode that was seen to a stretch of 1.5: no other has an error, and the law is nearer there than one that is fitted to all modes and further."""
    whole = law_of(MooneyRivlin(0.1, 0.1), "mooney")
    end = float(mode_invariants("uniaxial", np.array([1.5]))[0, 0])
    seen = replace(whole, near=(("uniaxial", end), ("equibiaxial", 3.0), ("pure_shear", 3.0)))
    curves = seen_curves(seen)
    assert list(curves) == ["uniaxial"] == list(nearest(seen, "neo-Hooke").errors)
    assert curves["uniaxial"][0][-1, 0, 0] == pytest.approx(1.5)
    F, stress = curves["uniaxial"]
    own, other = (
        np.abs(one.law.stress(F, one.parameters)[:, 0, 0] - stress).max()
        for one in (nearest(seen, "neo-Hooke"), nearest(whole, "neo-Hooke"))
    )
    assert own < 0.5 * other
    assert list(seen_curves(replace(whole, near=tuple((mode, 3.0) for mode in MODES)))) == list(MODES)
