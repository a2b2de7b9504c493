"""Derivatives of an equilibrium to the parameters of its law: against central differences of solutions, and scaling."""

from dataclasses import replace

import numpy as np
import pytest

from forward import ArrudaBoyce, Loading, MooneyRivlin, NeoHooke
from forward.errors import SolutionError
from forward.materials.tabulated import Tabulated
from forward.sheet.plane_stress import solve
from forward.sheet.sensitivities import sensitivities
from meshes import Cross, PlateWithHole, quads

CROSS = quads(Cross(), quarter=True, size_factor=4.0)
PULLED = Loading.clamped(Cross.loaded, 40.0)
INCREMENTS = 2
TABLE = Tabulated((0.0, 0.5, 2.0), (0.15, 0.15, 0.15), (0.0, 1.0), (0.03, 0.03))


def differences(material, k, step, mesh=CROSS, loading=PULLED):
    """Central differences of displacements and reactions to the k-th parameter."""
    names = [name for name in material.to_dict() if name != "material"]

    def changed(sign):
        if isinstance(material, Tabulated):
            values = np.array(material.parameters)
            values[k] += sign * step
            n = len(material.knots_1)
            other = replace(material, slopes_1=tuple(values[:n]), slopes_2=tuple(values[n:]))
        else:
            other = replace(material, **{names[k]: getattr(material, names[k]) + sign * step})
        return solve(mesh, other, loading, INCREMENTS)

    above, below = changed(1), changed(-1)
    forces = {s: (above.reactions[s] - below.reactions[s]) / (2 * step) for s in above.reactions}
    return (above.displacements - below.displacements) / (2 * step), forces


@pytest.mark.parametrize(
    ("material", "step"), [(MooneyRivlin(), 1e-5), (TABLE, 1e-5)], ids=["mooney_rivlin", "tabulated"]
)
def test_central_differences(material, step):
    found = sensitivities(solve(CROSS, material, PULLED, INCREMENTS), material, PULLED)
    for k in range(len(material.parameters)):
        moved, forces = differences(material, k, step)
        assert found.displacements[:, k] == pytest.approx(moved, abs=1e-6 * np.abs(moved).max())
        for side, force in forces.items():
            assert found.reactions[side][:, k] == pytest.approx(force, abs=1e-6 * np.abs(force).max())


def test_a_law_imagined_beside_the_material():
    """Mooney-Rivlin without its second term, the second term being varied, is neo-Hooke with it beside."""
    base, whole = NeoHooke(0.3), MooneyRivlin(0.15, 0.0)
    beside = sensitivities(solve(CROSS, base, PULLED, INCREMENTS), base, PULLED, varied=TABLE)
    own = sensitivities(solve(CROSS, whole, PULLED, INCREMENTS), whole, PULLED)
    assert beside.displacements[:, 3:].sum(axis=1) == pytest.approx(own.displacements[:, 1], abs=1e-7)
    assert beside.reactions["top"][:, 3:].sum(axis=1) == pytest.approx(own.reactions["top"][:, 1], abs=1e-7)


def test_stiffness_moves_nothing_and_multiplies_forces():
    """psi -> s psi leaves u as it is: du/dmu = 0, dF/dmu = F / mu."""
    material = ArrudaBoyce()
    solution = solve(CROSS, material, PULLED, INCREMENTS)
    found = sensitivities(solution, material, PULLED)
    assert found.displacements[:, 0] == pytest.approx(0, abs=1e-8)
    assert found.reactions["right"][:, 0] == pytest.approx(solution.reactions["right"] / material.mu, rel=1e-9)


def test_mirrored_and_whole_specimen():
    material, plate = MooneyRivlin(), PlateWithHole(far_size=10.0, hole_size=4.0)
    loading = Loading.clamped(plate.loaded, 20.0)
    quarter, whole = (quads(plate, quarter=q) for q in (True, False))
    mirrored = sensitivities(solve(quarter, material, loading, 1), material, loading).mirrored()
    direct = sensitivities(solve(whole, material, loading, 1), material, loading)
    points = np.array([[-40.0, 20.0], [30.0, -12.0], [15.0, 5.0], [-55.0, -25.0]])
    assert mirrored.evaluate(points) == pytest.approx(direct.evaluate(points), abs=1e-6)
    for side in ("left", "right"):
        assert mirrored.reactions[side] == pytest.approx(direct.reactions[side], abs=1e-6)


def test_of_another_solution():
    solution = solve(CROSS, NeoHooke(), PULLED, 1)
    for other, material in ((solution, MooneyRivlin()), (solution.mirrored(), NeoHooke())):
        with pytest.raises(SolutionError, match="solved"):
            sensitivities(other, material, PULLED)
