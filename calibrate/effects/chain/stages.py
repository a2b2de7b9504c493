"""Which links a chain has, in the order of nature.

    places and displacements as the camera saw them -> true ones, at the times of the forces -> mean over the thickness
    -> F by the true places of the reference -> [thickness: mean deformation] -> [volume at which the faces are free of stress]
    -> energies -> chains formed anew -> stiffness, softening, relaxation -> P -> [mean over the thickness] -> [strip]
    -> P by the measured places;        measured loads -> as effects correct them

An effect changes one of them, and every other one sees the change: where the volume is to be found, and in the strip beside the
measured region, the whole material is run again. In plane strain the material acts on the isochoric part, as in an
incompressible sheet; the bulk modulus is the last coefficient (`calibrate.equations.isochoric`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from calibrate.effects.chain import links
from calibrate.effects.chain.addition import Addition, Additions, ordered
from calibrate.effects.chain.linearisation import Stage
from calibrate.effects.chain.link import Link
from calibrate.effects.chain.links import (
    CURVED,
    CURVED_BESIDE,
    DEFORMATION,
    ELASTIC,
    GRADIENTS,
    STRESS,
    STRESS_BESIDE,
    VOLUME,
    Base,
)
from calibrate.effects.effect import Effect

Stages = tuple[Stage, ...]
Names = Mapping[str, str]
SWEEPS = 4  # of the volume ratio


def stages(base: Base, additions: Additions) -> Stages:
    """All stages of a chain, additions in whatever order these are given."""
    return (*stress_stages(base, additions), *load_stages(additions))


def displacement_stages(additions: Additions) -> Stages:
    """Those that correct displacements, the correlation's first, the mean over the thickness last."""
    camera = _backwards(links.CorrectedDisplacements, "displacements", additions)
    return (*camera, *_backwards(links.MeanDisplacements, "of_the_mean", additions))


def load_stages(additions: Additions) -> Stages:
    """Those that correct loads, the load cell's first."""
    return _backwards(links.CorrectedLoads, "loads", additions)


def gradients_stage(name: str) -> Stage:
    """From displacements to F, under a name."""
    return Stage(links.DeformationGradients(), names={GRADIENTS: name})


def deformation_name(base: Base) -> str:
    """What a deformation gradient is called that goes into the material as it is."""
    return CURVED if base.plane_strain else DEFORMATION


def local_stages(base: Base, additions: Additions) -> Stages:
    """Those from F, called `deformation_name`, to P that hold at a place and its past."""
    local = tuple(a for a in additions if a.effect.in_material)
    return _plane_strain(base, local) if base.plane_strain else _laws(base, local, {}, (0,))


def stress_stages(base: Base, additions: Additions) -> Stages:
    """Those from what is measured to P."""
    places = _backwards(links.CorrectedPlaces, "places", additions)
    moved = (*places, *displacement_stages(additions), *_backwards(links.CorrectedTime, "time", additions))
    thick, strip = _acting("of_the_mean", additions), _acting("beyond", additions)
    curved = CURVED if base.plane_strain or _acting("volume", additions) else DEFORMATION
    names = {CURVED: curved, ELASTIC: ELASTIC if thick else curved}
    found = [*moved, gradients_stage(GRADIENTS if places else names[ELASTIC])]
    if places:
        found.append(Stage(links.ElasticGradients(), names=names))
    for place, a in thick:
        found.append(Stage(links.Thinning(a.effect), names=names))
        found.append(Stage(links.MeanDeformation(a.effect), (a,), (place,), names))
    found += _material(base, additions, names, ())
    found += [Stage(links.MeanStress(a.effect), (a,), (place,), names) for place, a in thick]
    for place, a in strip:
        found += _strip(base, additions, place, a, names)
    return (*found, *([Stage(links.MeasuredReference())] if places else []))


def _strip(base: Base, additions: Additions, place: int, strip: Addition, names: Names) -> Stages:
    """The material in the strip beside the measured region, and what it carries."""
    compressible = names[CURVED] == CURVED
    inside = {
        CURVED: CURVED_BESIDE,
        VOLUME: f"{VOLUME} of the strip",
        DEFORMATION: f"{DEFORMATION} of the strip" if compressible else CURVED_BESIDE,
        STRESS: STRESS_BESIDE,
    }
    return (
        Stage(links.StripDeformation(strip.effect), (strip,), (place,), names),
        *_material(base, additions, inside, ("strip",)),
        Stage(links.WithStrip(strip.effect), (strip,), (place,)),
    )


def _material(base: Base, additions: Additions, names: Names, turn: tuple[str, ...]) -> Stages:
    """From the mean deformation to its stress."""
    compressible = _acting("volume", additions)
    if base.plane_strain:
        return _plane_strain(base, additions)
    if not compressible:
        return _laws(base, additions, names, (*turn, 0))
    place, a = compressible[0]
    sweeps = 1 if a.is_null else SWEEPS  # one is exact for the derivative, and its laws are those without the effect
    found = [Stage(links.Incompressible(), names=names, turn=turn)]
    for k in range(sweeps + 1):
        now = (*turn, 0 if a.is_null else k)
        found.append(Stage(links.FreeOfVolume(), names=names, turn=now))
        found += _laws(base, additions, names, now)
        if k < sweeps:
            found.append(Stage(links.VolumeRatio(a.effect, base), (a,), (place,), names, now))
    return (*found, Stage(links.StressAtVolume(), names=names, turn=turn))


def _plane_strain(base: Base, additions: Additions) -> Stages:
    """From F to P in plane strain."""
    return Stage(links.IsochoricPart()), *_laws(base, additions, {}, (0,)), Stage(links.PlaneStrainStress())


def _laws(base: Base, additions: Additions, names: Names, turn: tuple[Any, ...]) -> Stages:
    """The stress of an incompressible sheet, with its history."""
    found = [Stage(links.BaseStress(base), names=names, turn=turn)]
    acting = _acting("stress", additions) + _acting("reformed", additions)
    energies = [(place, a) for place, a in acting if a.effect.stage == "energy"]
    relaxing = [(place, a) for place, a in acting if a.effect.stage == "relaxation"]
    for place, a in sorted(acting, key=lambda both: both[0]):
        if a.effect.stage == "set":
            together = [(place, a), *energies]
            link: Link = links.FormedAnew(a.effect, tuple(one.effect for _, one in energies), base)
        elif a.effect.stage == "relaxation":
            continue
        else:
            together, link = [(place, a)], links.ChangedStress(a.effect)
        found.append(_together(link, together, names, turn))
    if relaxing:
        found.append(_together(links.RelaxedStress(tuple(a.effect for _, a in relaxing)), relaxing, names, turn))
    return tuple(found)


def _together(link: Link, acting: list[tuple[int, Addition]], names: Names, turn: Any) -> Stage:
    return Stage(link, tuple(a for _, a in acting), tuple(place for place, _ in acting), names, turn)


def _backwards(link: type[links.OfEffect], hook: str, additions: Additions) -> Stages:
    """A link for every effect that overrides a method, from the camera and the load cell to the material."""
    return tuple(Stage(link(a.effect), (a,), (place,)) for place, a in reversed(_acting(hook, additions)))


def _acting(hook: str, additions: Additions) -> list[tuple[int, Addition]]:
    """Additions that override a method of `Effect`, with their places in the order of all."""
    plain = getattr(Effect, hook)
    return [(i, a) for i, a in enumerate(ordered(additions)) if getattr(type(a.effect), hook) is not plain]
