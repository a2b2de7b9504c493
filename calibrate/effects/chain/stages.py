"""Which links a chain has, in the order of nature.

    places and displacements as the camera saw them -> true ones -> mean over the thickness
    -> F by the true places of the reference -> [thickness: mean deformation] -> [volume at which the faces are free of stress]
    -> energies -> chains formed anew -> stiffness, softening, relaxation -> P -> [mean over the thickness] -> [strip]
    -> P by the measured places -> virtual work;        measured loads -> as effects correct them -> those at the times of the pictures (`readings`)

An effect changes one of them, and every other one sees the change: where the volume is to be found, and in the strip beside the
measured region, the whole material is run again. In plane strain the material acts on the isochoric part, as in an
incompressible sheet; the bulk modulus is the last coefficient (`calibrate.equations.isochoric`).
"""

from __future__ import annotations

from collections.abc import Mapping

from calibrate.effects.chain import links_of_motion as motion
from calibrate.effects.chain import links_of_stress as stress
from calibrate.effects.chain.addition import Addition, Additions, ordered
from calibrate.effects.chain.linearisation import Stage
from calibrate.effects.chain.link import Link
from calibrate.effects.chain.quantities import (
    CURVED,
    CURVED_BESIDE,
    DEFORMATION,
    ELASTIC,
    ELASTIC_BESIDE,
    GRADIENTS,
    STRESS,
    STRESS_BESIDE,
    VOLUME,
    Base,
)
from calibrate.effects.compressibility import Compressibility
from calibrate.effects.effect import Effect
from calibrate.effects.finite_thickness import Thickness
from calibrate.effects.permanent_set import PermanentSet
from calibrate.effects.unmeasured_strip import UnmeasuredStrip

Stages = tuple[Stage, ...]
Names = Mapping[str, str]
SWEEPS = 5  # of the volume ratio


def displacement_stages(additions: Additions) -> Stages:
    """Those that correct displacements, the correlation's first, the mean over the thickness last."""
    camera = _backwards(motion.CorrectedDisplacements, "displacements", additions)
    thick = _of(Thickness, additions)
    return (*camera, *(Stage(motion.MeanDisplacements(effect), (a,), (place,)) for place, a, effect in thick))


def load_stages(additions: Additions) -> Stages:
    """Those that correct loads, the load cell's first."""
    return _backwards(motion.CorrectedLoads, "loads", additions)


def gradients_stage(name: str) -> Stage:
    """From displacements to F, under a name."""
    return Stage(motion.DeformationGradients(), names={GRADIENTS: name})


def deformation_name(base: Base) -> str:
    """What a deformation gradient is called that goes into the material as it is."""
    return CURVED if base.plane_strain else DEFORMATION


def local_stages(base: Base, additions: Additions) -> Stages:
    """Those from F, called `deformation_name`, to P that hold at a place and its past."""
    local = tuple(a for a in additions if a.effect.in_material)
    return _plane_strain(base, local) if base.plane_strain else _laws(base, local, {})


def law_stages(base: Base, additions: Additions) -> tuple[str, Stages]:
    """Name of F, and the stages from it to P, far from edges: of a base in plane stress and effects of the material."""
    name = CURVED if _of(Compressibility, additions) else DEFORMATION
    return name, _material(base, additions, {CURVED: name})


def motion_stages(additions: Additions) -> Stages:
    """Those from what is measured to true places and displacements, both at the nodes."""
    places = _backwards(motion.CorrectedPlaces, "places", additions)
    return (*places, *displacement_stages(additions))


def material_stages(base: Base, additions: Additions) -> Stages:
    """Those from what `motion_stages` leave to P."""
    moved_places = bool(_acting("places", additions))
    thick = _of(Thickness, additions)
    curved = CURVED if base.plane_strain or _of(Compressibility, additions) else DEFORMATION
    names = {CURVED: curved, ELASTIC: ELASTIC if thick else curved}
    found = [gradients_stage(GRADIENTS if moved_places else names[ELASTIC])]
    if moved_places:
        found.append(Stage(motion.ElasticGradients(), names=names))
    for place, a, effect in thick:
        found.append(Stage(motion.Thinning(effect), names=names))
        found.append(Stage(motion.MeanDeformation(effect), (a,), (place,), names))
    found += _material(base, additions, names)
    found += [Stage(stress.MeanStress(effect), (a,), (place,), names) for place, a, effect in thick]
    for one in _of(UnmeasuredStrip, additions):
        found += _strip(base, additions, names, *one)
    return (*found, *([Stage(stress.MeasuredReference())] if moved_places else []))


def are_local(additions: Additions) -> bool:
    """Whether `material_stages` act in every triangle for itself, as all do but those of the thickness."""
    return not _of(Thickness, additions)


def _strip(base: Base, additions: Additions, names: Names, place: int, a: Addition, strip: UnmeasuredStrip) -> Stages:
    """The load of the strip beside the measured region: the same sheet at the deformation there."""
    beside = _inside_strip(names)
    found = [Stage(motion.StripDeformation(strip), (a,), (place,), names), *_material(base, additions, beside)]
    for of_thickness, thick, effect in _of(Thickness, additions):
        elastic = {CURVED: ELASTIC, CURVED_BESIDE: ELASTIC_BESIDE}
        found.append(Stage(motion.StripDeformation(strip), (a,), (place,), elastic))
        found.append(Stage(stress.MeanStress(effect), (thick,), (of_thickness,), {**beside, ELASTIC: ELASTIC_BESIDE}))
    return (*found, Stage(stress.WithStrip(strip), (a,), (place,)))


def _inside_strip(names: Names) -> Names:
    """What quantities are called in the strip beside the measured region."""
    compressible = names[CURVED] == CURVED
    return {
        CURVED: CURVED_BESIDE,
        VOLUME: f"{VOLUME} of the strip",
        DEFORMATION: f"{DEFORMATION} of the strip" if compressible else CURVED_BESIDE,
        STRESS: STRESS_BESIDE,
    }


def _material(base: Base, additions: Additions, names: Names) -> Stages:
    """From the mean deformation to its stress."""
    compressible = _of(Compressibility, additions)
    if base.plane_strain:
        return _plane_strain(base, additions)
    if not compressible:
        return _laws(base, additions, names)
    place, a, effect = compressible[0]
    sweeps = 1 if a.is_null else SWEEPS  # one is exact for the derivative, and its laws are those without the effect
    found = [Stage(motion.Incompressible(), names=names), Stage(motion.FreeOfVolume(), names=names)]
    for _ in range(sweeps):
        found += _laws(base, additions, names)
        found.append(Stage(stress.VolumeRatio(effect, base), (a,), (place,), names))
        found.append(Stage(motion.FreeOfVolume(), names=names))
    return (*found, *_laws(base, additions, names), Stage(stress.StressAtVolume(), names=names))


def _plane_strain(base: Base, additions: Additions) -> Stages:
    """From F to P in plane strain."""
    return Stage(motion.IsochoricPart()), *_laws(base, additions, {}), Stage(stress.PlaneStrainStress())


def _laws(base: Base, additions: Additions, names: Names) -> Stages:
    """The stress of an incompressible sheet, with its history."""
    found = [Stage(stress.BaseStress(base), names=names)]
    acting = _acting("stress", additions)
    energies, relaxing = (
        [both for both in acting if both[1].effect.stage == stage] for stage in ("energy", "relaxation")
    )
    factors = [both for both in acting if both not in energies + relaxing]

    def add(link: Link, *together: tuple[int, Addition]) -> None:
        places, some = zip(*together, strict=True)
        found.append(Stage(link, some, places, names))

    for one in energies:
        add(stress.ChangedStress(one[1].effect), one)
    for place, a, effect in _of(PermanentSet, additions):
        add(stress.FormedAnew(effect, tuple(one.effect for _, one in energies), base), (place, a), *energies)
    for one in factors:
        add(stress.ChangedStress(one[1].effect), one)
    if relaxing:
        springs = any(a.effect.has_spring for _, a in relaxing)
        fields = [both for both in factors if springs and both[1].effect.stage == "stiffness"]
        effects = (tuple(a.effect for _, a in some) for some in (relaxing, fields))
        add(stress.RelaxedStress(*effects), *relaxing, *fields)
    return tuple(found)


def _backwards(link: type[motion.OfEffect], hook: str, additions: Additions) -> Stages:
    """A link for every effect that overrides a method, from the camera and the load cell to the material."""
    return tuple(Stage(link(a.effect), (a,), (place,)) for place, a in reversed(_acting(hook, additions)))


def _of[Kind: Effect](kind: type[Kind], additions: Additions) -> list[tuple[int, Addition, Kind]]:
    """Additions of a kind of effect, with their places in the order of all."""
    return [(i, a, a.effect) for i, a in enumerate(ordered(additions)) if isinstance(a.effect, kind)]


def _acting(hook: str, additions: Additions) -> list[tuple[int, Addition]]:
    """Additions that override a method of `Effect`, with their places in the order of all."""
    plain = getattr(Effect, hook)
    return [(i, a) for i, a in enumerate(ordered(additions)) if getattr(type(a.effect), hook) is not plain]
