"""What is exported: the law of a material in three dimensions, with what is beside its energy, its valid range and its origin.

In: a model file of `calibrate` or `discover`, or a classical law by name. Out: `MaterialLaw`. Effects of camera, load cell and
specimen are left out by name; an effect of the material that no target can carry is refused.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate.effects.chain import Addition, ordered
from calibrate.equations.basis import SingleBasis, energy_basis
from calibrate.equations.deformation_modes import MODES, largest_stretch
from calibrate.fitting.calibrated_range import near
from calibrate.models.extended_model import ExtendedModel
from calibrate.models.network_model import Model
from forward.materials import ArrudaBoyce, Carroll, Material, MooneyRivlin, NeoHooke, Yeoh
from forward.materials.arruda_boyce import COEFFICIENTS
from forward.sheet.multiplicative_viscosity import MaxwellBranch
from studies.errors import ExportError
from studies.exporters.energy_terms import NetworkTerm, PowerTerm, SplineTerm, Term
from studies.exporters.reference import stress_of_energy, stress_of_extended
from studies.reports.model_remarks import model_remarks

Array = NDArray[np.float64]
STIFF = 1000.0  # bulk modulus over initial shear modulus where none was identified
WIDTH = 66  # of a line of a header
CLASSICAL_RANGE = 2.0  # stretch to which a law given by name is checked


@dataclass(frozen=True)
class Fibres:
    """k / (2 k2) (exp(k2 E^2) - 1), E = I4 - 1 + d (I1 - 3), d = kappa / (1 - 3 kappa), I4 = |F M|^2, M at `angle` (rad) to x in the plane of the sheet; k2 = 0: k / 2 E^2."""

    k: float
    angle: float
    k2: float
    kappa: float

    @property
    def d(self) -> float:
        """What I1 counts beside I4."""
        return self.kappa / (1 - 3 * self.kappa)


@dataclass(frozen=True)
class PronyBranch:
    """S gains g int exp(-(t - s) / tau) dS of the elastic stress; tau in s."""

    g: float
    tau: float


@dataclass(frozen=True)
class MaterialLaw:
    """terms: of W(I1, I2). bulk_modulus of kappa / 2 (J - 1)^2, None: incompressible.

    fibres, prony, maxwell, mullins (r, m, beta), payne (r, x0): what is beside the energy. top: largest (I1, I2) of the calibration; near: largest I1 near each mode, where the model states it.
    invariants_used: those that the range holds for. left_out: effects that are not of the material. origin: lines on the data.
    stress: P (t, n, 2, 2) of the model itself in plane stress, of histories F (t, n, 2, 2) at times (t,), s, as if incompressible,
    to be differentiated by JAX.
    """

    name: str
    unit: str
    terms: tuple[Term, ...]
    top: tuple[float, float]
    stress: Callable[[Any, Any], Any] = field(repr=False, compare=False)
    bulk_modulus: float | None = None
    fibres: tuple[Fibres, ...] = ()
    prony: tuple[PronyBranch, ...] = ()
    maxwell: tuple[MaxwellBranch, ...] = ()
    mullins: tuple[float, float, float] | None = None
    payne: tuple[float, float] | None = None
    left_out: tuple[str, ...] = ()
    origin: tuple[str, ...] = ()
    near: tuple[tuple[str, float], ...] = ()

    @property
    def beside(self) -> tuple[str, ...]:
        """Names of what is beside an isotropic hyperelastic energy."""
        found = (
            ("fibres", self.fibres),
            ("viscoelasticity", self.prony),
            ("finite viscoelasticity", self.maxwell),
            ("Mullins softening", self.mullins),
            ("Payne softening", self.payne),
        )
        return tuple(name for name, value in found if value)

    def largest_stretch(self, mode: str) -> float:
        """Largest stretch of a homogeneous mode within the range of the invariants of the energy."""
        return min(largest_stretch(mode, top, i) for i, top in enumerate(self.top) if np.isfinite(top))

    @property
    def stretches(self) -> dict[str, float]:
        """`largest_stretch` of every mode."""
        return {mode: self.largest_stretch(mode) for mode in MODES}

    @property
    def valid(self) -> dict[str, float]:
        """Largest stretch of every mode that the calibration has seen: within the range of the invariants, and near the mode."""
        ends = {mode: largest_stretch(mode, end) for mode, end in self.near}
        return {mode: min(end, ends.get(mode, end)) for mode, end in self.stretches.items()}


def law_of(model: Model | ExtendedModel | Material, name: str) -> MaterialLaw:
    """The law of a model or of a classical material. name: for headers. Raises `ExportError` for what no target can carry."""
    if isinstance(model, Material):
        return _of_material(model, name)
    if isinstance(model, Model):
        return _of_network(model, name)
    return _of_extended(model, name)


def _of_material(material: Material, name: str) -> MaterialLaw:
    kind = type(material)
    if kind not in _CLASSICAL:
        raise ExportError(f"{name}: no exporter writes the law '{material.name}'; give a model file or a classical law")
    ends = [float(CLASSICAL_RANGE**2 + 2 / CLASSICAL_RANGE)] * 2
    values = ", ".join(f"{key} = {value:g}" for key, value in material.to_dict().items() if key != "material")
    stress = partial(stress_of_energy, lambda pair: material.energy(pair[0], pair[1]))
    return MaterialLaw(
        name, material.unit, _CLASSICAL[kind](material), (ends[0], ends[1]), stress,
        origin=(f"classical law {material.name}: {values}; not calibrated here",),
    )  # fmt: skip


def _of_network(model: Model, name: str) -> MaterialLaw:
    # an invariant that the energy does not depend on limits nothing
    used = {k: v for k, v in model.calibrated_range.items() if k in model.architecture.inputs}
    top = tuple(used.get(k, (3.0, np.inf))[1] for k in ("I1", "I2"))
    if not np.isfinite(top).any():
        raise ExportError(f"{name}: states no calibrated range; calibrate it anew")
    experiment = model.provenance.get("experiment", "not stated")
    return MaterialLaw(
        name, model.unit, (NetworkTerm.of(model),), (top[0], top[1]), partial(stress_of_energy, model.energy),
        model.bulk_modulus, origin=(f"calibrated on {experiment}", *_fitness(model)), near=_near(model),
    )  # fmt: skip


def _of_extended(model: ExtendedModel, name: str) -> MaterialLaw:
    basis = energy_basis(model.basis)
    assert isinstance(basis, SingleBasis)
    material = tuple(a for a in ordered(model.additions) if a.effect.of_material and not a.is_null)
    c = model.c[: basis.n_functions]
    base = SplineTerm.of(basis, c)
    reach = (base.rest + base.top) ** (1.0 if base.invariant == 1 else 2 / 3)
    if base.invariant == 1:
        reach = min(reach, model.calibrated_range.get("I1", (3.0, reach))[1])
    top = (reach, np.inf) if base.invariant == 1 else (np.inf, reach)
    names = ", ".join(str(t["name"]) for t in model.training)
    law = MaterialLaw(
        name, model.unit, (base,), top, partial(stress_of_extended, basis, c, material),
        float(model.c[-1]) if model.plane == "strain" else None,
        left_out=tuple(a.effect.name for a in model.additions if not a.effect.of_material),
        origin=(f"found by a diagnosis of {names or 'tests that are not stated'}; verdict: {model.verdict or 'not stated'}", *_fitness(model), *_fibre_range(model)),
        near=_near(model),
    )  # fmt: skip
    unverified = [a.effect.name for a in material if a.effect.name not in ISOTROPIC]
    if unverified and model.plane == "strain":
        raise ExportError(
            f"{law.name}: '{unverified[0]}' of a model in plane strain acts on the isochoric part of the deformation, which no target carries; "
            f"diagnose again with --without '{unverified[0]}', or predict with `equigap predict --test`"
        )
    for addition in material:
        law = _with_addition(law, addition, unverified)
    return law


def _near(model: Model | ExtendedModel) -> tuple[tuple[str, float], ...]:
    """Largest I1 near each mode, of those that the file states."""
    known = model.calibrated_range
    return tuple((mode, known[near(mode)][1]) for mode in MODES if near(mode) in known)


def _fibre_range(model: ExtendedModel) -> tuple[str, ...]:
    """A line on what fibres were stretched by."""
    end = model.calibrated_range.get("I4")
    return () if end is None else (f"fibres were stretched by {np.sqrt(end[1]):.4g} at most in these tests",)


def _fitness(model: Model | ExtendedModel) -> tuple[str, ...]:
    """The verdict of the fit and a nominal level, as lines of a header."""
    return tuple(line for remark in model_remarks(model) for line in textwrap.wrap(remark.text, WIDTH))


def _with_addition(law: MaterialLaw, addition: Addition, beside: list[str]) -> MaterialLaw:
    """beside: effects beside which a finite bulk modulus is not carried. Raises `ExportError` naming an effect that no target carries."""
    name, a, shape = addition.effect.name, addition.amplitudes, addition.shape
    if name == "compressibility":
        if beside:
            raise ExportError(
                f"{law.name}: compressibility beside '{beside[0]}' has no verified export; diagnose again "
                "with --without for one of them"
            )
        return replace(law, bulk_modulus=1 / a[0])
    if name not in _ADDED:
        raise ExportError(
            f"{law.name}: no target carries '{name}'; diagnose again with --without '{name}', or predict with "
            "`equigap predict --test`"
        )
    changes: dict[str, Any] = _ADDED[name](law, a, shape)
    return replace(law, **changes)


ISOTROPIC = ("compressibility", "second invariant", "upturn")  # energies of the isochoric invariants, and the volume's
_ADDED: dict[str, Callable[..., dict[str, Any]]] = {
    "second invariant": lambda law, a, s: {"terms": (*law.terms, PowerTerm(a[0], 2))},
    "upturn": lambda law, a, s: {"terms": (*law.terms, PowerTerm(a[0], 1, 3.0))},
    "one fibre family": lambda law, a, s: {"fibres": (*law.fibres, Fibres(a[0], *s))},
    "two fibre families": lambda law, a, s: {
        "fibres": (*law.fibres, Fibres(a[0], s[0] + s[1], *s[2:]), Fibres(a[0], s[0] - s[1], *s[2:]))
    },
    "viscoelasticity": lambda law, a, s: {"prony": (*law.prony, PronyBranch(a[0], s[0]))},
    "second relaxation time": lambda law, a, s: {"prony": (*law.prony, PronyBranch(a[0], s[0]))},
    "finite viscoelasticity": lambda law, a, s: {"maxwell": (*law.maxwell, MaxwellBranch(a[0], s[0]))},
    "second finite relaxation time": lambda law, a, s: {"maxwell": (*law.maxwell, MaxwellBranch(a[0], s[0]))},
    "Mullins softening": lambda law, a, s: {"mullins": (a[0], *s)},
    "Payne softening": lambda law, a, s: {"payne": (a[0], s[0])},
}


def _arruda_boyce(m: ArrudaBoyce) -> tuple[Term, ...]:
    """The powers of I1, by the binomial theorem as powers of I1 - 3."""
    total = np.zeros(len(COEFFICIENTS) + 1)
    for k, c in enumerate(COEFFICIENTS, 1):
        for j in range(1, k + 1):
            total[j] += m.mu * c / m.N ** (k - 1) * comb(k, j) * 3.0 ** (k - j)
    return tuple(PowerTerm(float(value), 1, float(j)) for j, value in enumerate(total) if j)


_CLASSICAL: dict[type[Material], Callable[[Any], tuple[Term, ...]]] = {
    NeoHooke: lambda m: (PowerTerm(m.mu / 2),),
    MooneyRivlin: lambda m: (PowerTerm(m.c10), PowerTerm(m.c01, 2)),
    Yeoh: lambda m: tuple(PowerTerm(c, 1, float(j)) for j, c in enumerate(m.parameters, 1)),
    Carroll: lambda m: (PowerTerm(m.a), PowerTerm(m.b, 1, 4.0, 0.0), PowerTerm(m.c, 2, 0.5, 0.0)),
    ArrudaBoyce: _arruda_boyce,
}
