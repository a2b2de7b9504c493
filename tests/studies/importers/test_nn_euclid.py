"""NN-EUCLID's layout: a small folder written here, and the published data where EQUIGAP_NN_EUCLID names a clone."""

import os
from pathlib import Path

import numpy as np
import pytest

from calibrate import errors
from calibrate.equations.basis import basis_for
from calibrate.equations.equilibrium import best_neo_hooke, equilibrium, neo_hooke
from calibrate.fitting.calibration import Options, calibrate
from studies.commands.import_data import import_data, import_experiment
from studies.importers import SheetOptions
from studies.importers.printed_sheets import grid_triangles

SHEAR, BULK = 1.0, 3.0
STEPS = {5: (1.05, 1.0), 10: (1.1, 1.25), 15: (1.3, 1.1), 20: (1.4, 1.4)}
CLONE = Path(os.environ.get("EQUIGAP_NN_EUCLID", "/nonexistent"))


def nominal_stress(a, b):
    """P11, P22 of neo-Hooke mu / 2 (J^(-2/3) I1 - 3) + kappa / 2 (J - 1)^2 at F = diag(a, b, 1), closed form."""
    J, I1 = a * b, a * a + b * b + 1
    return [SHEAR * J ** (-2 / 3) * (s - I1 / (3 * s)) + BULK * (J - 1) * J / s for s in (a, b)]


def write_table(path, header, rows):
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.16g")


@pytest.fixture
def folder(tmp_path):
    """A unit square pulled biaxially, in the published layout: sides 1 left, 2 right, 3 bottom, 4 top."""
    n, rng = 11, np.random.default_rng(1)
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, n)))
    bcx, bcy = 1 * (x == 0) + 2 * (x == 1), 3 * (y == 0) + 4 * (y == 1)
    triangles = grid_triangles(n, n)
    for step, (a, b) in STEPS.items():
        place = tmp_path / "noise=low" / "Neo" / str(step)
        place.mkdir(parents=True)
        clean = np.column_stack([(a - 1) * x, (b - 1) * y])
        noisy = clean + rng.normal(0, 2e-5, clean.shape)
        rows = np.column_stack([np.arange(n * n), x, y, noisy, bcx, bcy, clean])
        write_table(place / "output_nodes.csv", "id,x,y,ux,uy,bcx,bcy,ux_orig,uy_orig", rows)
        write_table(place / "output_elements.csv", "node1,node2,node3", triangles[:, ::-1])
        p, q = nominal_stress(a, b)
        write_table(place / "output_reactions.csv", "forces", [[-p], [p], [-q], [q]])
        (place / "output_integrator.csv").write_text("qpWeight\n0\n")
    return tmp_path / "noise=low" / "Neo"


def test_sides_slide_and_share_their_corners(folder):
    experiment = import_experiment(folder)
    held = {b.name: b.held for b in experiment.loaded}
    assert held == {"left": (True, False), "right": (True, False), "bottom": (False, True), "top": (False, True)}
    assert np.intersect1d(experiment.loaded[0].nodes, experiment.loaded[2].nodes).size == 1
    assert experiment.force_imbalance[0] == pytest.approx(0, abs=1e-14)
    assert experiment.plane == "strain"
    assert experiment.time is None
    assert experiment.n_increments == len(STEPS)
    assert experiment.loaded[1].force[-1] == pytest.approx([nominal_stress(1.4, 1.4)[0], 0])


def test_prescribed_displacements_are_clean_and_the_others_are_not(folder):
    experiment = import_experiment(folder)
    right = experiment.loaded[1].nodes
    moved = experiment.displacements[:, right]
    assert moved[..., 0] == pytest.approx(
        np.repeat([[s[0] - 1] for s in STEPS.values()], right.size, axis=1), abs=1e-15
    )
    assert np.ptp(moved[..., 1] - moved[..., 1].mean()) > 0


def test_the_command_reads_it_and_its_equations_give_the_moduli(folder, tmp_path):
    imported = import_data(str(folder), output=tmp_path / "imported")
    system = equilibrium(imported.experiment)
    basis = basis_for("I1", system.deformation_gradients.reshape(-1, 2, 2), plane="strain")
    found = best_neo_hooke(system, basis)
    assert found == pytest.approx(neo_hooke(basis, SHEAR, BULK), rel=1e-3, abs=1e-3)


@pytest.mark.slow
def test_a_calibration_finds_the_law(folder):
    model = calibrate(import_experiment(folder), Options(starts=1)).model
    stretches = np.array([s for s in STEPS.values() if s[1] > 1])
    found = model.nominal_stress(np.einsum("ki,ij->kij", stretches, np.eye(2)), "strain")
    truth = np.array([nominal_stress(*s) for s in stretches])
    assert found[:, [0, 1], [0, 1]] == pytest.approx(truth, rel=0.01)
    assert model.bulk_modulus == pytest.approx(BULK, rel=0.01)


def test_what_is_missing_or_does_not_fit_is_named(folder):
    with pytest.raises(errors.ConfigError, match="--record"):
        import_experiment(folder, record=folder / "machine.csv")
    with pytest.raises(errors.ConfigError, match="--scale"):
        import_experiment(folder, sheet=SheetOptions(scale=2.0))
    reactions = folder / "10" / "output_reactions.csv"
    reactions.write_text("forces\n1.0\n")
    with pytest.raises(errors.MeshMismatchError, match="1 reactions for 4 sides"):
        import_experiment(folder)
    (folder / "5" / "output_integrator.csv").unlink()
    with pytest.raises(errors.DataNotFoundError, match="output_integrator"):
        import_experiment(folder)


def test_load_steps_of_different_meshes_are_refused(folder):
    nodes = folder / "15" / "output_nodes.csv"
    table = np.loadtxt(nodes, delimiter=",", skiprows=1)
    table[:, 1] *= 1.01
    write_table(nodes, "id,x,y,ux,uy,bcx,bcy,ux_orig,uy_orig", table)
    with pytest.raises(errors.MeshMismatchError, match="share a mesh"):
        import_experiment(folder)


@pytest.mark.slow
@pytest.mark.skipif(not CLONE.is_dir(), reason="EQUIGAP_NN_EUCLID names no clone of NN-EUCLID")
@pytest.mark.parametrize("noise", ["low", "high"])
def test_published_ogden_data_give_its_bulk_modulus(noise):
    """Truth: kappa / 2 = 1.5 (Thakolkaran et al. 2022, Table 1)."""
    experiment = import_experiment(CLONE / "fem-data" / f"noise={noise}" / "Ogden")
    assert experiment.force_imbalance[0] < 1e-9
    assert calibrate(experiment, Options(starts=3)).model.bulk_modulus == pytest.approx(3.0, rel=0.03)
