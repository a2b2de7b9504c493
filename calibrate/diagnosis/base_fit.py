"""The start of a diagnosis: equations of every Experiment, weights that follow the base, and the fit without effects.

In: Experiments and the equations used for fitting. Out: `Problem` and the base `Fit`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.data.experiment import Experiment
from calibrate.diagnosis import base_functions, weighted_fit
from calibrate.diagnosis.effect_fit import Fit, refit
from calibrate.diagnosis.model_weights import weighted_part
from calibrate.diagnosis.problem import Mask, Problem, Rows, Unweighted, all_rows, mean_of_noise, residual
from calibrate.diagnosis.residual_tests import rough_dispersion
from calibrate.effects.chain import Chain
from calibrate.equations import reduction
from calibrate.equations.basis import PlaneStrainBasis, SingleBasis, basis_for, energy_basis
from calibrate.equations.equilibrium import Equilibrium, equilibrium
from calibrate.equations.reduction import Assembled, Quadratic
from calibrate.equations.weights import weights_of
from calibrate.fitting.calibrated_range import WEAK_SIGNAL
from calibrate.fitting.least_squares import bounded

Array = NDArray[np.float64]
PASSES, MOST_PASSES = 12, 48  # of updates by half; in all, by less and less, where these do not settle
TOLERANCE = 0.05  # relative change of the base between the last two passes
# see `reduction.corrected`: with more noise in the change of volume, p-values in plane strain no longer hold
RELIABLE = 0.9


@dataclass(frozen=True, eq=False)
class _Test:
    """One Experiment with training rows, before it has weights."""

    system: Equilibrium
    chain: Chain
    assembled: Assembled
    mask: Mask

    @property
    def held(self) -> Mask:
        """Rows that are held out."""
        return all_rows(self.system) & ~self.mask


def prepare(
    experiments: Sequence[Experiment],
    train: Sequence[Rows],
    spacing: float | None = None,
    with_discrepancy: bool = True,
    base: str = "positive",
) -> tuple[Problem, Fit]:
    """Problem and base fit. train: for each experiment, the equations to be used; the others are held out.

    base: 'positive' (psi_1 >= 0), 'convex' (psi_1 does not fall with I1 either, as in a PANN; rubber that softens
    before it stiffens then shows up in the errors of the base, not as an effect) or 'neo-Hooke' (psi_1
    constant). All but the last have a prior about neo-Hooke, see `base_functions`.

    spacing: of the virtual fields, mm (None: from the noise). Weights follow the base in `PASSES` passes. Raises
    `FitError` when it does not converge (`WeakStrainError` where that is for noise in the strain), or noise hides what it needs; `ConfigError` where nothing is left to fit, or
    tests in plane stress and in plane strain come together; and the errors of `calibrate.equations.equilibrium.equilibrium`.
    """
    systems = [equilibrium(e, spacing) for e in experiments]
    systems = _with_one_level(
        systems, [bool(function(system).any()) for function, system in zip(train, systems, strict=True)]
    )
    masks = [function(system) & all_rows(system) for function, system in zip(train, systems, strict=True)]
    if not any(mask.any() for mask in masks):
        raise errors.ConfigError("every equation is held out; leave some to fit")
    basis = _basis(experiments, systems)
    tests = [
        _Test(system, Chain(system, basis), reduction.assemble(system, basis), mask)
        for system, mask in zip(systems, masks, strict=True)
    ]
    used = [test for test in tests if test.mask.any()]
    start = base_functions.first_guess([(test.assembled, test.mask) for test in used])
    top = max(base_functions.trained_top(test.system, test.mask) for test in used)
    cone = base_functions.base_cone(basis, base, top, 1 if base == "neo-Hooke" else base_functions.SPLINES)
    bulk = basis.n_functions - energy_basis(basis).n_functions
    stiffness = float(start[: basis.n_functions - bulk].max())

    def prior(c: Array) -> Array:
        return base_functions.on_cone(base_functions.prior_rows(basis, c, top, stiffness), cone)

    c, heavy = _base(used, basis, start, cone, prior)
    parts = [
        weighted_part(Unweighted(t.chain, t.assembled), basis, heavy, t.mask, t.held, with_discrepancy) for t in tests
    ]
    noise_is_known = all(test.assembled.noise_is_known for test in tests)
    problem = Problem(
        tuple(parts),
        basis,
        cone,
        prior(c) if cone.shape[1] > 1 + bulk else prior(c)[:0],
        1.0,
        noise_is_known,
        with_discrepancy,
        heavy,
    )
    problem = replace(problem, dispersion=rough_dispersion(problem, residual(problem, c, ())))
    fit = refit(problem, c, ())
    return weighted_fit.refitted(problem, fit) if noise_is_known else (problem, fit)


def _with_one_level(systems: Sequence[Equilibrium], fitted: Sequence[bool]) -> list[Equilibrium]:
    """Windows in larger bodies fix no level beside a test whose forces are measured, nor beside another window."""
    used = [system for system, one in zip(systems, fitted, strict=True) if one]
    measured = any(not system.experiment.level_is_nominal for system in used)
    return [replace(s, fixes_level=bool(not measured and used and s is used[0])) for s in systems]


def _basis(experiments: Sequence[Experiment], systems: Sequence[Equilibrium]) -> SingleBasis | PlaneStrainBasis:
    """Splines of I1 that cover all deformation gradients. Raises `ConfigError` for tests in different planes."""
    planes = {e.plane for e in experiments}
    if len(planes) > 1:
        raise errors.ConfigError(
            "experiments in plane stress and in plane strain cannot be fitted together; fit one kind"
        )
    F = np.concatenate([s.deformation_gradients.reshape(-1, 2, 2) for s in systems])
    basis = basis_for("I1", F, plane=planes.pop())
    assert isinstance(basis, SingleBasis | PlaneStrainBasis)
    return basis


def _base(
    tests: Sequence[_Test],
    basis: SingleBasis | PlaneStrainBasis,
    start: Array,
    cone: Array,
    prior: Callable[[Array], Array],
) -> tuple[Array, Array]:
    """Coefficients (n,) of the base, and those that its weights belong to, found in passes. Raises `FitError`. prior: its rows at coefficients."""
    c, heavy, spread, change = start, start, 1.0, np.inf
    assembled, masks = [test.assembled for test in tests], [test.mask for test in tests]
    n = cone.shape[1]
    for count in range(MOST_PASSES):
        quadratic, A, d = _weighted(tests, basis, heavy)
        weights = bounded(A @ cone, d, np.zeros(n), np.full(n, np.inf), np.sqrt(spread) * prior(c) @ cone)
        previous, c = c, cone @ weights
        spread = max(1.0, quadratic.loss(c) / len(d))
        if not c.any():
            raise errors.FitError("the data do not constrain the material: forces or displacements are all noise")
        c = reduction.corrected(quadratic, c, heavy, assembled, masks, RELIABLE)
        share = 1.0
        if count > 1:  # weights and fit may answer each other in turn
            share = 0.5 ** (1 + max(count - PASSES, 0) // PASSES)
            c = (1 - share) * previous + share * c
        heavy = quadratic.coefficients_of_weights(c, start)
        change = float(np.linalg.norm(A @ (c - previous)) / np.linalg.norm(A @ c)) * max(0.5 / share, 1.0)
        if change < (0.2 if count < PASSES - 1 else 1.0) * TOLERANCE:
            return c, heavy
    raise _not_converged([test.system.experiment for test in tests], change)


def _not_converged(experiments: Sequence[Experiment], change: float) -> errors.FitError:
    """What is wrong with the data, where that can be seen, and what can be done."""
    text = f"the base model has not converged (its forces still change by {change:.1%} when the weights are updated); "
    signals = [(e.strain_signal, e.name) for e in experiments]
    signal, name = min(signals, key=lambda pair: pair[0].ratio)
    if signal.ratio < WEAK_SIGNAL:
        return errors.WeakStrainError(
            text
            + f"the strain of {name} is {signal.strain:.1%} and scatters by {signal.scatter:.1%} between neighbouring triangles, so that "
            "the weights follow the noise: fit the frame with the largest strain alone, mask spurious points at import (docs/ugly_data.md), "
            "or take --base neo-Hooke"
        )
    return errors.FitError(
        text + "a diagnosis of it would be one of the fit: check forces, units and free edges, or take --base neo-Hooke"
    )


def _weighted(
    tests: Sequence[_Test], basis: SingleBasis | PlaneStrainBasis, c: Array
) -> tuple[Quadratic, Array, Array]:
    """Loss, whitened columns (N, n) and loads (N,) of the base, with the weights of coefficients c (n,)."""
    columns, loads = [], []
    for test in tests:
        weights = weights_of(test.assembled.noise_at(c), test.mask)
        columns.append(weights(np.moveaxis(np.array(test.assembled.matrices), -1, 0)).T)
        shift = mean_of_noise(test.chain, test.assembled, c)
        loads.append(weights(np.nan_to_num(test.system.loads) + shift))
    A, d = np.concatenate(columns), np.concatenate(loads)
    return Quadratic(basis, A.T @ A, A.T @ d, float(d @ d), len(d)), A, d
