"""The chain from measured displacements to the residual of every virtual-work equation, differentiable in everything.

In: an Experiment, virtual fields, a base model as spline coefficients, and effects with their amplitudes and shapes.
Out: residual (t, 2 v): internal virtual work minus measured force, N, rows ordered as in `Equilibrium`, and its
derivatives by amplitudes, shapes and displacements.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.effects.chain import noise_spread
from calibrate.effects.chain.addition import Addition, Additions, ordered
from calibrate.effects.chain.linearisation import Constants, Linearisation, Quantities, Recent, Stage
from calibrate.effects.chain.quantities import DISPLACEMENTS, LOADS, MEASURED, PLACES, STRESS, TIME, Base
from calibrate.effects.chain.stages import (
    deformation_name,
    displacement_stages,
    gradients_stage,
    load_stages,
    local_stages,
    stages,
    stress_stages,
)
from calibrate.effects.effect import Effect
from calibrate.effects.support.effect_data import Data
from calibrate.equations.basis import PlaneStrainBasis, SingleBasis, energy_basis
from calibrate.equations.equilibrium import Equilibrium

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Chain:
    """One Experiment's chain with base functions of a single invariant.

    prepared: its data, where not those of the Experiment; recent: the linearisation that was last asked for.
    """

    system: Equilibrium
    basis: SingleBasis | PlaneStrainBasis
    prepared: Data | None = None
    recent: Recent = field(default_factory=Recent, repr=False)

    @cached_property
    def data(self) -> Data:
        """The Experiment, prepared for effects."""
        return Data.of(self.system.experiment) if self.prepared is None else self.prepared

    @cached_property
    def measured(self) -> Any:
        """Forces (t, 2, b) of the loaded boundaries, N; zero where none was measured."""
        loads = self.system.loads.reshape(len(self.system.loads), 2, -1)[:, :, self.system.fields.boundary >= 0]
        return jnp.asarray(np.nan_to_num(loads))

    @cached_property
    def virtual(self) -> Array:
        """(v, 2 m): thickness x area x gradient of each virtual field, mm^2."""
        return self.system.virtual_gradients.toarray()

    @property
    def energy(self) -> SingleBasis:
        """The functions of the invariant alone."""
        found = energy_basis(self.basis)
        assert isinstance(found, SingleBasis)
        return found

    @property
    def base(self) -> Base:
        """What compiled code depends on of the basis."""
        return Base(self.energy.k, self.energy.n, isinstance(self.basis, PlaneStrainBasis))

    def constants(self, c: Any) -> Constants:
        """What links read beside their inputs, for coefficients c (n,)."""
        return Constants(self.data, jnp.asarray(self.energy.top), jnp.asarray(c))

    def disturbed(self, noise: Array) -> Chain:
        """The same chain with noise (t, n, 2), mm, on the displacements."""
        return Chain(self.system, self.basis, replace(self.data, u=self.data.u + noise))

    def with_mean_gradients(self) -> Chain:
        """The same chain, in which effects take means of the gradients around for those at the nodes."""
        return Chain(self.system, self.basis, self.data.with_mean_gradients())

    def work(self, stress: Any) -> Array:
        """Virtual work (..., t, 2 v), N, of stresses (..., t, m, 2, 2)."""
        P = np.asarray(stress)
        flat = np.moveaxis(P, -2, -3).reshape(-1, P.shape[-3] * 2)
        return (flat @ self.virtual.T).reshape(*P.shape[:-3], -1)

    def spread(self, loads: Any) -> Array:
        """Right-hand sides (..., t, 2 v), N, of forces (..., t, 2, b) of the loaded boundaries."""
        given = np.asarray(loads)
        full = np.zeros((*given.shape[:-1], self.system.fields.n_fields))
        full[..., self.system.fields.boundary >= 0] = given
        return full.reshape(*given.shape[:-2], -1)

    def residual(self, c: Any, additions: Additions = ()) -> Array:
        """Residual (t, 2 v), N, of coefficients c (n,) and effects, in whatever order these are given."""
        return self.work(self.stress(c, additions)) - self.external(additions)

    def stress(self, c: Any, additions: Additions = ()) -> Array:
        """P (t, m, 2, 2), MPa, of coefficients c (n,) and the effects in the model."""
        return np.asarray(self._run(stress_stages(self.base, additions), c, self._start).quantities[STRESS])

    def external(self, additions: Additions = ()) -> Array:
        """Loads (t, 2 v), N, as the effects correct them: minus the residual of a material without stiffness."""
        return self.spread(self._run(load_stages(additions), (), {LOADS: self.measured}).quantities[LOADS])

    def signature(self, c: Any, effect: Effect, shape: tuple[float, ...], others: Additions = ()) -> Array:
        """d residual / d amplitude at the null value, (p, t, 2 v), beside effects that are in the model already."""
        null = tuple(p.null for p in effect.amplitudes)
        return self.derivative(c, (*others, Addition(effect, null, shape)))

    def derivative(self, c: Any, additions: Additions) -> Array:
        """d residual / d amplitudes of the last addition, (p, t, 2 v), at the values they have."""
        last, place = additions[-1], place_of(additions[-1], additions)
        if last.is_null:  # it changes nothing yet, so that the run without it is known
            run = self.linearised(c, additions[:-1]).with_null(stages(self.base, additions), place)
        else:
            run = self.linearised(c, additions)
        return self._change(run, last, place)

    def jacobian(self, c: Any, additions: Additions) -> Array:
        """d residual / d amplitudes and shapes of all additions, (k, t, 2 v): of each its amplitudes, then its shapes."""
        run = self.linearised(c, additions)
        changes = [self._change(run, one, place_of(one, additions), with_shape=True) for one in additions]
        return np.concatenate(changes)

    def linearised(self, c: Any, additions: Additions) -> Linearisation:
        """The run of the whole chain; the last one is kept."""
        c = np.asarray(c, float)
        return self.recent.get(
            (c.tobytes(), ordered(additions)), lambda: self._run(stages(self.base, additions), c, self._start)
        )

    def noise_shift(self, c: Any, factor: Any, variances: Any = 1.0) -> Array:
        """Mean change (t, 2 v), N, that displacement noise brings into the residual: second order in the noise.

        factor (n, s): noise as a map of independent normal numbers, see `noise_covariance.noise_factor`; variances (t,): of each increment,
        over that of the factor.
        """
        axes = noise_spread.gradient_axes(self.system.gradient, factor)
        shift = self.work(noise_spread.stress_shift(self.base, self.constants(c), jnp.asarray(axes)))
        return np.asarray(shift * np.reshape(variances, (-1, 1)))

    def pulled_back(self, c: Array, additions: Additions, forces: Array) -> Array:
        """K^T forces (t, n, 2) of forces (t, 2 v), N; K: tangent of base and effects in the material, at the displacements
        that additions correct."""
        deformation = self._deformation(additions)
        stress = self._run(local_stages(self.base, additions), c, deformation.quantities)
        t = len(forces)
        virtual = np.asarray(forces).reshape(t, 2, -1) @ self.virtual
        dual = jnp.asarray(virtual.reshape(t, 2, -1, 2).swapaxes(1, 2))
        found = deformation.pull(stress.pull({STRESS: dual[None]}))
        return _by_measured(found)[0]

    def spread_of_noise(self, c: Array, additions: Additions, factor: sp.csr_array) -> list[Array]:
        """K B (2 v, 2 s), N, of every increment, with B the factor (n, s) of the noise and K as in `pulled_back`.

        What an increment has of the noise of others is taken for more of its own.
        """
        deformation, local = self._deformation(additions), [a for a in additions if a.effect.in_material]
        gradients = np.asarray(deformation.steps[-1].output)
        if local:
            run = self._run(local_stages(self.base, additions), c, deformation.quantities)
            remembers = any(one.effect.remembers for one in local)
            moduli = noise_spread.tangent_moduli(run, self.base, self.system.areas, remembers)
            tangents = [self.system.stiffness(modulus) for modulus in moduli]
        else:
            tangents = [self.system.tangent(self.basis, F, c) for F in gradients]
        rows = np.array(
            [np.concatenate([np.stack([k.toarray() for k in row], axis=-1) for row in blocks]) for blocks in tangents]
        )
        correction = self._run(displacement_stages(additions), (), self._start)
        if correction.steps:
            rows = _by_measured(correction.pull({DISPLACEMENTS: jnp.asarray(rows.swapaxes(0, 1))})).swapaxes(0, 1)
        return [np.hstack([row[..., k] @ factor for k in range(2)]) for row in rows]

    @property
    def _start(self) -> Quantities:
        """What is measured."""
        data = self.data
        found = {MEASURED: data.u, DISPLACEMENTS: data.u, PLACES: data.points, LOADS: self.measured}
        return found if data.time is None else found | {TIME: data.time}

    @property
    def _gradients(self) -> Stage:
        return gradients_stage(deformation_name(self.base))

    @cached_property
    def _uncorrected(self) -> Linearisation:
        """From the measured displacements to their F."""
        return self._run((self._gradients,), (), self._start)

    def _run(self, links: Sequence[Stage], c: Any, start: Quantities) -> Linearisation:
        return Linearisation.run(links, self.constants(c), start)

    def _deformation(self, additions: Additions) -> Linearisation:
        """From the measured displacements to F at those that effects correct."""
        corrections = displacement_stages(additions)
        return self._run((*corrections, self._gradients), (), self._start) if corrections else self._uncorrected

    def _change(self, run: Linearisation, addition: Addition, place: int, with_shape: bool = False) -> Array:
        """d residual / d amplitudes of an addition, and shapes behind them, (p, t, 2 v)."""
        changes = run.by_parameters(place, with_shape)
        size = len(addition.amplitudes) + with_shape * len(addition.shape)
        result = np.zeros((size, *self.system.loads.shape))
        if STRESS in changes:
            result += self.work(changes[STRESS])
        if LOADS in changes:
            result -= self.spread(changes[LOADS])
        return result


def place_of(addition: Addition, additions: Additions) -> int:
    """Place of an addition among all in their order."""
    return next(i for i, one in enumerate(ordered(additions)) if one is addition)


def _by_measured(duals: Quantities) -> Array:
    """Duals (k, t, n, 2) of the measured displacements, which corrections read as such and start from."""
    found = np.asarray(duals[DISPLACEMENTS])
    return found + np.asarray(duals[MEASURED]) if MEASURED in duals else found
