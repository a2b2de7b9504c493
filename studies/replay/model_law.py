"""The law of a model file, as the forward model solves it.

In: a model of `equigap calibrate` or `equigap discover`, and the test to replay. Out: a `Sheet`, and the effects that are left out
because they belong to the measurement or to other tests.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from calibrate.data.experiment import Experiment, Noise
from calibrate.effects.chain import Addition, Additions
from calibrate.effects.chain.true_surface import is_expressed, true_surface
from calibrate.equations.basis import SingleBasis
from calibrate.equations.splines import pieces_of
from calibrate.errors import ConfigError
from calibrate.models.extended_model import ExtendedModel
from calibrate.models.network_model import Model
from forward.materials import Material, Pann
from forward.materials.spline_energy import SplineEnergy
from forward.sheet import additions as laws
from forward.sheet.thin_sheet import Sheet
from studies.errors import OptionError
from studies.output.findings import Finding
from studies.reports.model_remarks import model_remarks
from studies.synthetic import effect_laws

FIELD, STRIP = "stiffness field", "unmeasured strip"


@dataclass(frozen=True)
class Law:
    """sheet: what is solved. title: of the model. effects: that are solved for; taken_out: of the measurement of this test, to be taken out of it;
    left_out: of the measurement of other tests, or neither solved for nor taken out. remarks: what the model file says of its own model. noise: that a diagnosis found in this test; None where it is not the one that was fitted. strip: width, mm, of what the camera does not see beside free edges."""

    sheet: Sheet
    title: str
    effects: tuple[str, ...] = ()
    taken_out: Additions = ()
    left_out: tuple[str, ...] = ()
    remarks: tuple[Finding, ...] = ()
    noise: Noise | None = None
    strip: float = 0.0

    @property
    def needs_time(self) -> bool:
        """Whether the law has a time of its own."""
        return self.sheet.relaxes


def law_of(model: Model | ExtendedModel, experiment: Experiment) -> Law:
    """The law of a model for a test. Raises `ConfigError` for another unit or plane, a time that is unknown, an effect without a law."""
    if experiment.plane != "stress":
        raise ConfigError(
            f"{experiment.name}: a replay solves thin sheets in plane stress, not plane {experiment.plane}"
        )
    if experiment.stress_unit != model.unit:
        raise ConfigError(
            f"{experiment.name}: its stresses are in {experiment.stress_unit}, the model's in {model.unit}; give the "
            "thickness to both, or to none"
        )
    if isinstance(model, Model):
        law = material_law(Pann.from_dict(model.to_dict()), f"network of {model.architecture.inputs}", experiment)
    else:
        law = _extended(model, experiment)
    if law.needs_time and experiment.time is None:
        raise ConfigError(f"{experiment.name}: has no time, which viscoelasticity needs; import it with its times")
    return replace(law, remarks=tuple(model_remarks(model)), noise=_noise_found(model, experiment))


def _noise_found(model: Model | ExtendedModel, experiment: Experiment) -> Noise | None:
    fitted = model.training if isinstance(model, ExtendedModel) else ()
    own = next((one for one in fitted if experiment.is_of(one["fingerprint"]) and one.get("noise")), None)
    return None if own is None else Noise(**own["noise"])


def material_law(material: Material, title: str, experiment: Experiment) -> Law:
    """A hyperelastic sheet of the test's thickness."""
    return Law(Sheet(material, _thickness(experiment)), title)


def _extended(model: ExtendedModel, experiment: Experiment) -> Law:
    held = model.for_test(experiment)
    solved = [a for a in held if is_solved(a.effect.name)]
    taken_out = tuple(a for a in held if a not in solved and is_expressed(a.effect) and not a.is_null)
    beyond = [a.effect.name for a in held if a not in solved and a.effect.of_material]
    if beyond:
        raise OptionError(
            f"{', '.join(beyond)}: the forward model has no law for it, so that this model cannot be replayed"
        )
    places = true_surface(experiment, taken_out).points
    low, high = places.min(axis=0), places.max(axis=0)
    fields = [
        laws.CosineField((*low.tolist(), *(high - low).tolist()), a.amplitudes)
        for a in solved
        if a.effect.name == FIELD
    ]
    extent = effect_laws.Extent(float((high - low).max()), tuple(((low + high) / 2).tolist()))
    effects = [_named(a) for a in solved if a.effect.name not in (FIELD, STRIP)]
    strip = sum(a.amplitudes[0] for a in solved if a.effect.name == STRIP)
    sheet = effect_laws.sheet(spline_law(model), _thickness(experiment), effects, extent, fields)
    names = tuple(a.effect.name for a in solved)
    rest = tuple(a.effect.name for a in model.additions if a not in (*solved, *taken_out) and not a.is_null)
    return Law(sheet, " + ".join(["spline of I1", *names]), names, taken_out, rest, strip=strip)


def is_solved(name: str) -> bool:
    """Whether the forward model has a law for an effect of that name, or its mesh holds it."""
    return name in effect_laws.SOLVED or name in (FIELD, STRIP)


def _named(addition: Addition) -> effect_laws.Law:
    """Name, amplitudes and shape by name."""
    effect = addition.effect
    amplitudes = {p.name: float(v) for p, v in zip(effect.amplitudes, addition.amplitudes, strict=True)}
    shape = {p.name: float(v) for p, v in zip(effect.shapes, addition.shape, strict=True)}
    return effect.name, amplitudes, shape


def spline_law(model: ExtendedModel) -> SplineEnergy:
    """The base of a diagnosis as a material. Raises `ConfigError` for one of plane strain."""
    basis = model.basis
    if not isinstance(basis, SingleBasis):
        raise ConfigError("the model is one of plane strain; a replay solves thin sheets in plane stress")
    return SplineEnergy(basis.top, tuple(map(tuple, pieces_of(model.c[: basis.n]).tolist())))


def _thickness(experiment: Experiment) -> float:
    return 1.0 if experiment.thickness is None else experiment.thickness
