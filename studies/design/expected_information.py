r"""Fisher information that a pull is expected to give on a family of laws: a solved pull in, `Information` out.

Of the test itself (`test_information`), whatever method evaluates it, from the forward model's exact sensitivities:

    M = sum_t [ sum_p (du/dtheta)^T (du/dtheta) / (sigma^2 n_l) + sum_sides (dF/dtheta)^T (dF/dtheta) / sigma_F^2 ],

points p on a square grid. Noise with the covariance sigma^2 exp(-r^2 / (2 l^2)) is taken as white with the spectral density that it has at
long waves: its variance is n_l = sum_lattice exp(-r^2 / (2 l^2)) times as large. It is smaller at shorter waves, of which no camera's noise
is free, so that M is not overstated.

Of the equations that equigap calibrates with (`equation_information`): the virtual work of the stress that each parameter adds, at the
expected fields, whitened with the covariance K Sigma_u K^T + Sigma_F of the equations (`calibrate.equations.noise_covariance`). By the
implicit function theorem it is M if every node has a virtual field and the noise is the same; coarse virtual fields leave less, the
exact covariance of the noise leaves more.
"""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from calibrate.data.experiment import Experiment, Noise
from calibrate.equations.basis import basis_for
from calibrate.equations.equilibrium import equilibrium
from calibrate.equations.inputs import REFERENCE
from calibrate.equations.kinematics import invariants_and_derivatives
from calibrate.equations.noise_covariance import cholesky_factor
from calibrate.equations.reduction import assemble
from forward.materials import Material
from forward.sheet.sensitivities import sensitivities
from forward.solution import SurfaceSolution
from meshes import Mesh, Specimen, triangles
from meshes.errors import MeshQualityError
from studies.accuracy.metrics import MaterialDerivatives
from studies.design.design_plan import AXES, Plan
from studies.design.information import Information
from studies.design.law_family import LawFamily
from studies.design.pulls_within_limits import Pull, View
from studies.synthetic.camera import observe
from studies.synthetic.specimen_edges import inside

Array = NDArray[np.float64]
FEWEST = 150  # camera points of a specimen
MORE = (1.0, 1.15, 1.35, 1.6, 2.0)  # shares of points that are tried, where holes ask for more


def force_std(plan: Plan) -> float:
    """Relative standard deviation of a force, of the uniform distribution that the plan states."""
    return plan.machine.force_noise / float(np.sqrt(3))


def test_information(pull: Pull, law: Material, family: LawFamily, plan: Plan) -> Information:
    """Of the recorded displacements and forces. Raises `ForwardError`."""
    found = sensitivities(pull.quarter, law, pull.loading, varied=family.varied)
    points = quadrant_points(pull.specimen, pull.view.pitch)
    rates = found.evaluate(points).transpose(1, 0, 2, 3).reshape(family.size, -1)
    variance = pull.view.std**2 * correlated_neighbours(pull.view)
    fisher = 4 * rates @ rates.T / variance  # four quadrants alike
    for side, force in pull.forces.items():
        change = 2 * found.reactions[side][..., AXES[side]] / (force_std(plan) * np.abs(force))[:, None]
        fisher += change.T @ change
    return Information(fisher, family.prior)


def equation_information(pull: Pull, family: LawFamily, plan: Plan) -> Information:
    """Of the equations of `equigap calibrate` with both invariants. Raises `MeshError`, `EquigapError`."""
    system = equilibrium(clean_experiment(pull.quarter.mirrored(), pull.specimen, pull.view, plan))
    F = system.deformation_gradients
    basis = basis_for("I1I2", F.reshape(-1, 2, 2))
    inputs = np.maximum(np.nan_to_num(basis.site_inputs), 0.0) + REFERENCE
    sites = np.stack([inputs[:, 0], inputs[:, 1] ** (2 / 3)], axis=1)
    to_inputs = np.stack([np.ones(len(inputs)), 1.5 * np.sqrt(sites[:, 1])], axis=1)  # dI2 to d I2^(3/2)
    noise = assemble(system, basis).noise_at(
        basis.interpolation @ (MaterialDerivatives(family.base)(sites) / to_inputs).ravel()
    )
    values, slopes = map(np.asarray, invariants_and_derivatives(jnp.asarray(F)))
    hats, fisher = family.hats(values), np.zeros((family.size, family.size))
    for i, (hat, slope) in enumerate(zip(hats, slopes, strict=True)):
        rows = system.internal_forces(np.einsum("mak,maij->kmij", hat, slope))
        white = solve_triangular(cholesky_factor(noise.increment(i)), rows.T, lower=True)
        fisher += white.T @ white
    return Information(fisher, family.prior)


def clean_experiment(solution: SurfaceSolution, specimen: Specimen, view: View, plan: Plan) -> Experiment:
    """What the camera records of a whole specimen without noise, with the noise that it would have stated."""
    experiment = observe(solution, camera_mesh(specimen, view), name=specimen.name)
    return replace(experiment, noise=Noise(view.std, view.correlation_length, force_std(plan)))


def camera_mesh(specimen: Specimen, view: View) -> Mesh:
    """Triangles whose nodes are the camera's points, as many as it has on the specimen, or a few more. Raises `MeshQualityError`."""
    least = max(FEWEST, round(specimen.exact_area() / view.pitch**2))
    for more in MORE:
        try:
            return triangles(specimen, n_nodes=round(more * least))
        except MeshQualityError:
            if more == MORE[-1]:
                raise
    raise AssertionError


def quadrant_points(specimen: Specimen, pitch: float) -> Array:
    """Points (n, 2) of the first quadrant on a square grid, mm."""
    axes = [np.arange(pitch / 2, half, pitch) for half in specimen.half_extent]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    return grid[inside(specimen, grid)]


def correlated_neighbours(view: View) -> float:
    """n_l: sum of the correlation of a point with all points of the grid."""
    steps = np.arange(-200, 201) * view.pitch
    return float(np.exp(-(steps**2) / (2 * view.correlation_length**2)).sum() ** 2)
