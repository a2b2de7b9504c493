"""The chain from measured displacements to the residual of every virtual-work equation, differentiable in everything.

In: an Experiment, virtual fields, a base model as spline coefficients, and effects with their amplitudes and shapes.
Out: residual (t, 2 v): internal virtual work minus measured force, N, rows ordered as in `Equilibrium`, and its
derivatives by amplitudes, shapes and displacements.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from calibrate.effects.chain import noise_spread, readings
from calibrate.effects.chain.addition import Addition, Additions, place_of
from calibrate.effects.chain.block_run import OF_INCREMENTS, BlockRun
from calibrate.effects.chain.blocks import Block, blocks, whole
from calibrate.effects.chain.linearisation import Constants, Linearisation, Memory, Quantities, Stage
from calibrate.effects.chain.quantities import DISPLACEMENTS, LOADS, MEASURED, PLACES, STRESS, TIME, Base
from calibrate.effects.chain.seen_rows import SeenRows, by_measured
from calibrate.effects.chain.stages import (
    are_local,
    deformation_name,
    displacement_stages,
    gradients_stage,
    load_stages,
    local_stages,
    material_stages,
    motion_stages,
)
from calibrate.effects.effect import Effect
from calibrate.effects.support.effect_data import Data
from calibrate.effects.support.twin_kinematics import TwinKinematics
from calibrate.equations import kinematics
from calibrate.equations.basis import PlaneStrainBasis, SingleBasis, energy_basis, tangent_modulus
from calibrate.equations.equilibrium import Equilibrium
from calibrate.equations.noise_covariance import by_sources

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Chain:
    """One Experiment's chain with base functions of a single invariant.

    What holds at the nodes is run at once, what holds in the triangles block by block (`blocks`). prepared: its data, where not those of the
    Experiment; divided: its triangles in blocks, where they are known. memories: of each block, see `remembering`.
    """

    WORKED_OUT: ClassVar = ("divided", "memories")

    system: Equilibrium
    basis: SingleBasis | PlaneStrainBasis
    prepared: Data | None = None
    divided: tuple[Block, ...] | None = field(default=None, repr=False)
    memories: tuple[Memory, ...] | None = field(default=None, repr=False)

    @cached_property
    def data(self) -> Data:
        """The Experiment, prepared for effects."""
        return Data.of(self.system.experiment) if self.prepared is None else self.prepared

    @cached_property
    def read(self) -> Array:
        """Forces (t, 2, b) of the loaded boundaries, N; NaN where none was measured."""
        return self.system.loads.reshape(len(self.system.loads), 2, -1)[:, :, self.system.fields.boundary >= 0]

    @cached_property
    def measured(self) -> Any:
        """The same; zero where none was measured."""
        return jnp.asarray(np.nan_to_num(self.read))

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """The triangles."""
        if self.divided is not None:
            return self.divided
        return blocks(self.data, self.system.virtual_gradients)

    @cached_property
    def whole(self) -> tuple[Block, ...]:
        """All triangles in one block, for what is no matter of each for itself."""
        return whole(self.data, self.system.virtual_gradients)

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

    def constants(self, c: Any, block: Block | None = None) -> Constants:
        """What links read beside their inputs, for coefficients c (n,), of a block or of the whole."""
        data = self.data if block is None else block.of(self.data)
        return Constants(data, jnp.asarray(self.energy.top), jnp.asarray(c))

    def disturbed(self, noise: Array) -> Chain:
        """The same chain with noise (t, n, 2), mm, on the displacements."""
        return Chain(self.system, self.basis, replace(self.data, u=self.data.u + noise), self.blocks)

    def remembering(self) -> Chain:
        """The same chain, which keeps what it makes of its displacements without effects: as large as F and P of all increments."""
        if self.memories:
            return self
        memories = tuple(Memory(self.data.u) for _ in self.blocks)
        return replace(self, prepared=self.data, divided=self.blocks, memories=memories)

    def with_twin(self, twin: TwinKinematics | None) -> Chain:
        """The same chain with what a twin of the test knows of its kinematics."""
        return Chain(self.system, self.basis, replace(self.data, twin=twin), self.blocks)

    def with_doubted_formulas(self) -> Chain:
        """The same chain, in which effects are wrong by a standard deviation of what their formulas leave out."""
        return Chain(self.system, self.basis, replace(self.data, doubt=1.0), self.blocks)

    def with_mean_gradients(self) -> Chain:
        """The same chain, in which effects take means of the gradients around for those at the nodes."""
        return Chain(self.system, self.basis, self.data.with_mean_gradients(), self.blocks)

    def work(self, stress: Any) -> Array:
        """Virtual work (..., t, 2 v), N, of stresses (..., t, m, 2, 2)."""
        return self.system.internal_forces(stress)

    def spread(self, loads: Any) -> Array:
        """Right-hand sides (..., t, 2 v), N, of forces (..., t, 2, b) of the loaded boundaries."""
        given = np.asarray(loads)
        full = np.zeros((*given.shape[:-1], self.system.fields.n_fields))
        full[..., self.system.fields.boundary >= 0] = given
        return full.reshape(*given.shape[:-2], -1)

    def residual(self, c: Any, additions: Additions = ()) -> Array:
        """Residual (t, 2 v), N, of coefficients c (n,) and effects, in whatever order these are given."""
        work = np.zeros(self.system.loads.shape)
        for run in self._runs(c, additions):
            work[run.increments] += run.work(run.steps.quantities)
        return work - self.external(additions)

    def stress(self, c: Any, additions: Additions = ()) -> Array:
        """P (t, m, 2, 2), MPa, of coefficients c (n,) and the effects in the model."""
        found = np.zeros((*self.system.loads.shape[:1], len(self.system.areas), 2, 2))
        for run in self._runs(c, additions):
            own = run.block.places[: run.block.used]
            found[run.increments, own] = np.asarray(run.steps.quantities[STRESS])[run.first :, : run.block.used]
        return found

    def external(self, additions: Additions = ()) -> Array:
        """Loads (t, 2 v), N, as the effects correct them: minus the residual of a material without stiffness."""
        loads = self._run(load_stages(additions), (), {LOADS: self.measured}).quantities[LOADS]
        return self.spread(readings.of_pictures(loads, self.read, self.data, additions))

    def given(self, additions: Additions = ()) -> Array:
        """Readings (t, 2 v), N, that `external` corrects: zero where one is missing, interpolated in time beside effects of the clock."""
        return self.spread(readings.filled(self.measured, self.read, self.data, additions))

    def signature(self, c: Any, effect: Effect, shape: tuple[float, ...], others: Additions = ()) -> Array:
        """d residual / d amplitude at the null value, (p, t, 2 v), beside effects that are in the model already."""
        null = tuple(p.null for p in effect.amplitudes)
        return self.derivative(c, (*others, Addition(effect, null, shape)))

    def derivative(self, c: Any, additions: Additions) -> Array:
        """d residual / d amplitudes of the last addition, (p, t, 2 v), at the values they have."""
        return self._changes(c, additions, additions[-1:], with_shape=False)

    def jacobian(self, c: Any, additions: Additions) -> Array:
        """d residual / d amplitudes and shapes of all additions, (k, t, 2 v): of each its amplitudes, then its shapes."""
        return self._changes(c, additions, additions, with_shape=True)

    def noise_shift(self, c: Any, axes: Array, variances: Any = 1.0) -> Array:
        """Mean change (t, 2 v), N, that displacement noise brings into the residual: second order in the noise.

        axes (m, 2, 2): of the noise of gradients, see `kinematics.gradient_axes`; variances (t,): of each increment, over that of the axes.
        """
        shift = sum(
            block.work(noise_spread.stress_shift(self.base, self.constants(c, block), axes[block.places]))
            for block in self.blocks
        )
        return np.asarray(shift * np.reshape(variances, (-1, 1)))

    def pulled_back(self, c: Array, additions: Additions, forces: Array) -> Array:
        """K^T forces (t, n, 2) of forces (t, 2 v), N; K: tangent of base and effects in the material, at the displacements
        that additions correct."""
        correction, total = self._run(displacement_stages(additions), (), self._start), 0.0
        for block, gradients, stress in self._local_runs(correction, c, additions):
            total = total + gradients.pull(stress.pull({STRESS: jnp.asarray(block.dual(forces))[None]}))[DISPLACEMENTS]
        return by_measured(correction.pull({DISPLACEMENTS: total}))[0]

    def spread_of_noise(
        self, c: Array, additions: Additions, factor: sp.csr_array | Array, increments: Indices
    ) -> Iterator[Array]:
        """K B (2 v, 2 s), N, of one of some increments (k,) after the other, with B the factor (n, s) of the noise, see `by_sources`, and K as in
        `pulled_back`.

        What an increment has of the noise of others is taken for more of its own.
        """
        correction = self._run(displacement_stages(additions), (), self._start)
        seen = SeenRows(correction)
        for i, modulus in zip(increments, self._moduli(correction, c, additions, increments), strict=True):
            blocks = self.system.stiffness(modulus)
            rows = np.concatenate([np.stack([k.toarray() for k in row], axis=-1) for row in blocks])
            rows = seen(rows, int(i))
            yield by_sources([rows[..., k] for k in range(2)], factor)

    @property
    def _start(self) -> Quantities:
        """What is measured."""
        data = self.data
        found = {MEASURED: data.u, DISPLACEMENTS: data.u, PLACES: data.points, LOADS: self.measured}
        return found if data.time is None else found | {TIME: data.time}

    def _run(self, links: Sequence[Stage], c: Any, start: Quantities) -> Linearisation:
        return Linearisation.run(links, self.constants(c), start)

    def _runs(self, c: Any, additions: Additions, corrected: Linearisation | None = None) -> Iterator[BlockRun]:
        """From true displacements to P, part by part; corrected: the run to these, where it is known."""
        start = (corrected or self._run(motion_stages(additions), (), self._start)).quantities
        stages = material_stages(self.base, additions)
        if are_local(additions):
            for block, memory in zip(self.blocks, self.memories or [None] * len(self.blocks), strict=True):
                yield BlockRun(block, Linearisation.run(stages, self.constants(c, block), start, memory))
            return
        (block,), constants = self.whole, self.constants(c, self.whole[0])
        t = len(self.data.u)
        size = t if any(a.effect.remembers for a in additions) else min(t, int(np.ceil(t / len(self.blocks))))
        for first in range(0, t, size):
            some = slice(min(first, t - size), min(first, t - size) + size)
            of_some = {name: value[some] if name in OF_INCREMENTS else value for name, value in start.items()}
            twin = None if constants.data.twin is None else constants.data.twin.of_increments(some)
            there = replace(constants, data=replace(constants.data, u=self.data.u[some], twin=twin))
            yield BlockRun(block, Linearisation.run(stages, there, of_some), some, first - some.start)

    def _local_runs(
        self, correction: Linearisation, c: Any, additions: Additions
    ) -> Iterator[tuple[Block, Linearisation, Linearisation]]:
        """Block by block, from corrected displacements to F, and on to the stress of what holds at a place and its past."""
        name = deformation_name(self.base)
        stages = local_stages(self.base, additions)
        for block in self.blocks:
            constants = self.constants(c, block)
            gradients = Linearisation.run((gradients_stage(name),), constants, correction.quantities)
            yield block, gradients, Linearisation.run(stages, constants, gradients.quantities)

    def _moduli(
        self, correction: Linearisation, c: Array, additions: Additions, increments: Indices
    ) -> Iterator[Array]:
        """dP/dF (m, 2, 2, 2, 2), MPa, of one of some increments (k,) after the other, larger by what it has of the noise of others."""
        local = [a for a in additions if a.effect.in_material]
        if not local:
            u = np.asarray(correction.quantities[DISPLACEMENTS])[increments]
            for F in kinematics.deformation_gradients(self.system.gradient, u):
                yield tangent_modulus(self.basis, F, c)
            return
        remembers = any(one.effect.remembers for one in local)
        parts = [
            noise_spread.tangent_moduli(
                run, self.base, block.places, block.used, self.system.areas, increments, remembers
            )
            for block, _, run in self._local_runs(correction, c, additions)
        ]
        own, others = (sum(getattr(part, name) for part in parts) for name in ("own", "others"))
        for i, factor in enumerate(np.sqrt(1 + others / own)):
            yield np.concatenate([part.moduli[i] for part in parts]) * factor

    def _changes(self, c: Any, additions: Additions, of: Additions, with_shape: bool) -> Array:
        """d residual / d amplitudes of some additions, and shapes behind those of each, (k, t, 2 v)."""
        corrected = self._run(motion_stages(additions), (), self._start)
        loads = self._run(load_stages(additions), (), {LOADS: self.measured})
        places = [place_of(one, additions) for one in of]
        starts = [corrected.by_parameters(place, with_shape, {}) for place in places]
        shape = self.system.loads.shape
        total = [np.zeros((len(one.amplitudes) + with_shape * len(one.shape), *shape)) for one in of]
        stages = material_stages(self.base, additions)
        acting = [i for i, place in enumerate(places) if starts[i] or any(place in one.places for one in stages)]
        for run in self._runs(c, additions, corrected) if acting else ():
            for i in acting:
                changes = run.steps.by_parameters(places[i], with_shape, run.of_increments(starts[i]))
                if STRESS in changes:
                    total[i][:, run.increments] += run.work(changes)
        for i, place in enumerate(places):
            if readings.is_of_the_clock(of[i].effect):
                moves = readings.picture_weights_by_parameters(self.data, additions, of[i], with_shape)
                total[i] -= self.spread(readings.at_pictures(moves, loads.quantities[LOADS], self.read, self.data))
            changes = loads.by_parameters(place, with_shape, {})
            if LOADS in changes:
                total[i] -= self.spread(readings.of_pictures(changes[LOADS], self.read, self.data, additions))
        return np.concatenate(total)
