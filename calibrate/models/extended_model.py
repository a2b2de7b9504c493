"""Model file of a diagnosis: a base energy of I1 and the effects that were added to it, as one documented JSON.

Keys: ``format`` = "equigap-extended-model", ``version`` = 1; ``unit`` ("MPa", or "N/mm" where the thickness was unknown);
``base`` {"k", "top", "n", "coefficients" [n]}: d psi / d I1 as a cubic B-spline with n functions on uniform knots of
sqrt((I1 - 3) / top) (`calibrate.equations.basis.SingleBasis`), in plane strain also "bulk_modulus" and
"bulk_modulus_deviation" (`calibrate.equations.isochoric`); ``additions`` [{"effect", "formula", "of_material", "amplitudes"
[{"name", "unit", "value", "standard_deviation"}], "shape" [{"name", "unit", "value"}]}]; ``training`` [{"name",
"fingerprint", "spacing" of the virtual fields, mm, or null, optional "noise" that it was fitted with}]; ``hold_out`` (words); ``held_out`` [names]; ``verdict``; ``groups`` {effect: [those it cannot be told
from]}; ``network``: a model file of a PANN distilled from the base, or null; ``network_loss``: how good it is;
``provenance`` (free JSON); ``calibrated_range`` {"I1": [min, max]}, of fibres also "I4" and "I4, 2"; optional ``replay``: what replays of base and final model came to, with the level that is in the file
(`calibrate.diagnosis.replayed.checked_replay`); optional ``uncertainty`` (`calibrate.models.model_uncertainty`); optional ``level`` "nominal" where only ratios of stiffness are known, and ``fitness`` (`calibrate.models.fitness`). The spline is the base; the network stands in for it where programs read networks only.

An effect that is not one of the material belongs to the tests that were fitted and is left out for any other.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibrate import errors
from calibrate.data.experiment import Experiment, Noise
from calibrate.effects.chain import Additions, Chain
from calibrate.equations import kinematics, noise_covariance
from calibrate.equations.basis import PlaneStrainBasis, SingleBasis, energy_basis
from calibrate.equations.equilibrium import equilibrium
from calibrate.equations.kinematics import invariants_and_derivatives
from calibrate.models.addition_json import addition_from_dict, addition_to_dict
from calibrate.models.fitness import Fitness
from calibrate.models.json_file import (
    MEASURED,
    NOMINAL,
    Format,
    check_level,
    check_range,
    check_unit,
    read_model,
    write_model,
)
from calibrate.models.model_uncertainty import ModelUncertainty, scaled_addition, stiffness_factors
from calibrate.models.network_model import Model

FORMAT, VERSION = "equigap-extended-model", 1
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Prediction:
    """forces: what the load cells should read, N (t, 2) each boundary. residuals (t, 2 v), N: internal virtual work minus
    load. left_out: effects that belong to other tests. outside: share of area and increments beyond the fitted I1."""

    forces: dict[str, Array]
    residuals: Array = field(repr=False)
    left_out: tuple[str, ...]
    outside: float


@dataclass(frozen=True, eq=False)
class Applied:
    """A model on a test. model: with the effects that hold for it; chain: the test; shift (t, 2 v), N: the mean that noise brings into the work
    of the base."""

    model: ExtendedModel
    chain: Chain
    shift: Array

    def residual(self, factor: float = 1.0, strength: float = 1.0) -> Array:
        """Internal virtual work minus load (t, 2 v), N, of the model `scaled` by a factor and a strength of its relaxation."""
        scaled = self.model if factor == strength == 1 else self.model.scaled(factor, strength)
        return self.chain.residual(scaled.c, scaled.additions) - factor * self.shift


@dataclass(frozen=True, eq=False)
class ExtendedModel:
    """Base coefficients c (n,), in `unit`, and additions, each with a standard deviation for each amplitude (errors).

    training: {"name", "fingerprint", "spacing", "noise"} of the Experiments fitted. network, network_loss: see `calibrate.diagnosis.distillation`.
    """

    basis: SingleBasis | PlaneStrainBasis
    c: Array = field(repr=False)
    additions: Additions
    errors: tuple[tuple[float, ...], ...]
    unit: str
    training: tuple[dict[str, Any], ...] = ()
    hold_out: str = "nothing"
    held_out: tuple[str, ...] = ()
    verdict: str = ""
    groups: dict[str, tuple[str, ...]] = field(default_factory=dict)
    network: Model | None = field(default=None, repr=False)
    network_loss: dict[str, Any] = field(default_factory=dict)
    provenance: dict[str, Any] = field(default_factory=dict, repr=False)
    bulk_modulus_deviation: float | None = None
    level_is_nominal: bool = False
    fitness: Fitness | None = None
    calibrated_range: dict[str, tuple[float, float]] = field(default_factory=dict)
    replay: dict[str, Any] = field(default_factory=dict, repr=False)
    uncertainty: ModelUncertainty | None = field(default=None, repr=False)

    @property
    def plane(self) -> str:
        """'stress' or 'strain', of the tests that it was fitted to and may be applied to."""
        return "strain" if isinstance(self.basis, PlaneStrainBasis) else "stress"

    def for_test(self, experiment: Experiment) -> Additions:
        """The additions that hold for an Experiment: all if it was fitted, else those of the material."""
        fitted = any(experiment.is_of(t["fingerprint"]) for t in self.training)
        return tuple(a for a in self.additions if fitted or a.effect.of_material)

    def only(self, additions: Additions) -> ExtendedModel:
        """The same with some of its additions, whose uncertainty is another one."""
        pairs = [(a, d) for a, d in zip(self.additions, self.errors, strict=True) if a in additions]
        kept, spread = tuple(a for a, _ in pairs), tuple(d for _, d in pairs)
        return replace(self, additions=kept, errors=spread, uncertainty=None)

    def applied_to(self, experiment: Experiment, spacing: float | None = None) -> Applied:
        """The model with the effects that hold for a test, and the virtual fields of the test.

        spacing: of the virtual fields, mm (None: as in the fit of this test, or from the noise). Raises `ConfigError` where the thickness is known to
        one of test and model only, the time that the model needs is unknown, or the test is in another plane; TypeError
        for what is no Experiment; and the errors of `calibrate.equations.equilibrium.equilibrium`.
        """
        if not isinstance(experiment, Experiment):
            raise TypeError(f"an Experiment is needed, not {experiment!r}; Experiment.load(path) reads one")
        if experiment.stress_unit != self.unit:
            raise errors.ConfigError(
                f"{experiment.name}: its stresses are in {experiment.stress_unit}, the model's in {self.unit}; give "
                "the thickness to both, or to none"
            )
        if experiment.plane != self.plane:
            raise errors.ConfigError(
                f"{experiment.name} is in plane {experiment.plane}, the model was fitted in plane {self.plane}; fit one to such tests"
            )
        fitted = next((t for t in self.training if experiment.is_of(t["fingerprint"])), {})
        system = equilibrium(experiment, spacing or fitted.get("spacing"))
        chain, additions = Chain(system, self.basis), self.for_test(experiment)
        for addition in additions:
            lacking = addition.effect.missing(chain.data) or ""
            if lacking.startswith("time"):
                raise errors.ConfigError(
                    f"{experiment.name}: has no {lacking}, which {addition.effect.name} needs; import it with times that begin at 0 for the picture before the loading"
                )
        noise = Noise(**fitted["noise"]) if fitted.get("noise") else experiment.noise
        if noise is None or not noise.displacement_std > 0:  # a stand-in would shift forces by its mean
            return Applied(self.only(additions), chain, np.zeros(system.loads.shape))
        variances = np.diag(noise_covariance.between_increments(experiment, noise))
        factor = noise_covariance.noise_factor(experiment, noise)
        shift = chain.noise_shift(self.c, kinematics.gradient_axes(system.gradient, factor), variances)
        return Applied(self.only(additions), chain, shift)

    def predict(self, experiment: Experiment, spacing: float | None = None) -> Prediction:
        """Forces and residuals of an Experiment from its measured displacements.

        The one definition of the forces of such a model: internal virtual work minus the mean that noise brings into the base, with the
        effects that hold for the test. The report of a diagnosis shows them too, less the discretisation error where a replay told it.
        spacing, errors: see `applied_to`.
        """
        applied = self.applied_to(experiment, spacing)
        chain, system, additions = applied.chain, applied.chain.system, applied.model.additions
        residuals = applied.residual()
        n, readings = system.fields.n_fields, residuals + chain.given(additions)
        forces = {}
        for v in np.flatnonzero(system.fields.boundary >= 0):
            boundary = experiment.loaded[system.fields.boundary[v]]
            forces[boundary.name] = readings[:, [v, n + v]] * boundary.held
        I1 = np.asarray(invariants_and_derivatives(system.isochoric_gradients)[0])[..., 0]
        end = self.calibrated_range.get("I1", (3.0, 3 + chain.energy.top))[1]
        beyond = (system.areas * (end < I1)).sum() / (system.areas.sum() * len(I1))
        names = {a.effect.name for a in additions}
        left_out = tuple(a.effect.name for a in self.additions if a.effect.name not in names)
        return Prediction(forces, residuals, left_out, float(beyond))

    def to_dict(self) -> dict[str, Any]:
        """Content of a model file, see the module; `from_dict` reads it."""
        energy = energy_basis(self.basis)
        assert isinstance(energy, SingleBasis)
        base = {"k": energy.k, "top": energy.top, "n": energy.n, "coefficients": self.c[: energy.n].tolist()}
        if self.plane == "strain":
            base["bulk_modulus"] = float(self.c[-1])
            base["bulk_modulus_deviation"] = self.bulk_modulus_deviation
        return {
            "format": FORMAT,
            "version": VERSION,
            "unit": self.unit,
            "base": base,
            "additions": [addition_to_dict(a, d, self.unit) for a, d in zip(self.additions, self.errors, strict=True)],
            "training": list(self.training),
            "hold_out": self.hold_out,
            "held_out": list(self.held_out),
            "verdict": self.verdict,
            "groups": {name: list(group) for name, group in self.groups.items()},
            "network": None if self.network is None else self.network.to_dict(),
            "network_loss": self.network_loss,
            "provenance": self.provenance,
            **({"level": NOMINAL} if self.level_is_nominal else {}),
            **({} if self.fitness is None else {"fitness": self.fitness.to_dict()}),
            **({"replay": self.replay} if self.replay else {}),
            **({} if self.uncertainty is None else {"uncertainty": self.uncertainty.to_dict(self.unit)}),
            "calibrated_range": {name: list(ends) for name, ends in self.calibrated_range.items()},
        }

    def save(self, path: str | Path) -> None:
        """Write the JSON atomically."""
        write_model(path, self.to_dict())

    def with_network(self, network: Model, loss: dict[str, Any]) -> ExtendedModel:
        """The same with a network and how good it is."""
        return replace(self, network=network, network_loss=loss)

    @property
    def relaxes(self) -> bool:
        """Whether it holds a branch of viscoelasticity."""
        return any(a.effect.stage == "relaxation" for a in self.additions)

    def scaled(self, factor: float, strength: float = 1.0) -> ExtendedModel:
        """Stiffer by a factor: amplitudes in MPa follow, those in 1/MPa go the other way; relaxation by its own `strength`.

        For another batch of the same material; what does not scale with stiffness stays.
        """
        factors = [stiffness_factors(a, factor, strength) for a in self.additions]
        spreads = zip(factors, self.errors, strict=True)
        return replace(
            self,
            c=factor * self.c,
            additions=tuple(scaled_addition(a, factor, strength) for a in self.additions),
            errors=tuple(tuple(f * d for f, d in zip(*pair, strict=True)) for pair in spreads),
            network=None,
            network_loss={},
            uncertainty=self.uncertainty and self.uncertainty.scaled(factor, self.additions, strength),
            bulk_modulus_deviation=None
            if self.bulk_modulus_deviation is None
            else factor * self.bulk_modulus_deviation,
        )

    @classmethod
    def load(cls, path: str | Path) -> ExtendedModel:
        """Read a file of `save`. Raises `DataNotFoundError`, `ModelFileError` naming the key that is wrong."""
        return read_model(path, cls.file_format())

    @classmethod
    def file_format(cls) -> Format[ExtendedModel]:
        """What a file of `save` says of itself."""
        return Format(FORMAT, VERSION, "equigap discover", cls.from_dict)

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> ExtendedModel:
        """From the content of a file, or from `to_dict`. Raises KeyError, TypeError or ValueError."""
        unit = check_unit(content["unit"])
        base = content["base"]
        energy = SingleBasis(int(base["k"]), float(base["top"]), int(base["n"]))
        c = np.asarray(base["coefficients"], float)
        if c.shape != (energy.n,) or not np.isfinite(c).all() or not energy.top > 0:
            raise ValueError(f"base: need {energy.n} finite coefficients and a positive top")
        basis: SingleBasis | PlaneStrainBasis = energy
        if "bulk_modulus" in base:
            basis, c = PlaneStrainBasis(energy), np.append(c, float(base["bulk_modulus"]))
            if not 0 < c[-1] < np.inf:
                raise ValueError(f"base: bulk_modulus {c[-1]} is not a positive number")
        both = [addition_from_dict(a) for a in content["additions"]]
        additions, spread = tuple(a for a, _ in both), content.get("uncertainty")
        return cls(
            basis,
            c,
            additions,
            tuple(d for _, d in both),
            unit,
            tuple(map(_trained, content["training"])),
            str(content["hold_out"]),
            tuple(map(str, content["held_out"])),
            str(content["verdict"]),
            {str(name): tuple(map(str, group)) for name, group in content["groups"].items()},
            None if content["network"] is None else Model.from_dict(content["network"]),
            dict(content["network_loss"]),
            dict(content["provenance"]),
            None if base.get("bulk_modulus_deviation") is None else float(base["bulk_modulus_deviation"]),
            check_level(content.get("level", MEASURED)) == NOMINAL,
            Fitness.from_dict(content.get("fitness")),
            check_range(content.get("calibrated_range", {})),
            dict(content.get("replay", {})),
            None if spread is None else ModelUncertainty.from_dict(spread, len(c), additions),
        )


def _trained(content: dict[str, Any]) -> dict[str, Any]:
    spacing = content.get("spacing")
    return {
        "name": str(content["name"]),
        "fingerprint": str(content["fingerprint"]),
        "spacing": None if spacing is None else float(spacing),
        "noise": asdict(Noise(**content["noise"])) if content.get("noise") else None,
    }
