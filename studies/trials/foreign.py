"""Foreign trials: what is hidden has a form that is not in the catalogue, or only nearly, and the noise is not what is stated.

In: a trial as `blind_data.draw` makes it. Out: the same trial in foreign forms, its laws for the solver. A foreign form is drawn so that it
does about as much as the effect of the catalogue whose place it takes; its amplitudes are not comparable, its name is.

| effect | form |
| --- | --- |
| base | Gent 1996, in place of Arruda and Boyce's, Yeoh's and neo-Hooke |
| second invariant | a power of the principal stretches (Ogden 1972) |
| one fibre family | exponential, with dispersion (Gasser, Ogden and Holzapfel 2006) |
| viscoelasticity | two branches with a multiplicative split (Reese and Govindjee 1998) |
| Mullins softening | by the energy (Ogden and Roxburgh 1999) |
| stiffness field | a triangular inclusion with a sharp edge |
| inclusion | a rectangle, whose amplitude is compared |

Fibres and Mullins softening are nearly of the catalogue's form since that has an exponential with dispersion (in compression, too) and Ogden and Roxburgh's
error function (of I1 - 3 in place of the energy), the stiffness field since it has an inclusion, that since it may have corners, and viscoelasticity since it has branches with such a split: `NEARLY`. Others keep their form, on the foreign base, and a lens has its
centre of distortion up to a sixth of the extent from the middle of the specimen. Noise: of two correlation lengths, with a share that all pictures have in common; stated as it is,
half or twice as large, or not at all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibrate.data.experiment import Experiment, Noise
from calibrate.effects.inclusion import SHARP, half_axes
from forward.materials import Gent
from forward.sheet.additions import Addition
from forward.sheet.damage_and_dispersion import (
    DispersedFibres,
    OgdenPart,
    OgdenRoxburgh,
    RectangularInclusion,
    TriangularInclusion,
)
from forward.sheet.multiplicative_viscosity import MaxwellBranch
from studies.synthetic import effect_laws
from studies.synthetic.camera import GaussianField, stream
from studies.trials.blind_effects import Hidden, log_uniform
from studies.trials.blind_trial import FIELD_RESOLUTION, SPECIMENS, ForeignNoise, Trial

Array = NDArray[np.float64]
FORMS, FIELDS = 2, 3  # random streams, beside those of `blind_data`
SHORT, LONG, SHARE = (
    0.7,
    1.6,
    0.6,
)  # correlation lengths over that of the trial, and the share of the variance of the short one
COMMON = (0.0, 0.5, 0.9)  # shares of the variance that are common to all pictures
STATED = (1.0, 0.5, 2.0, None)  # stated noise over that which is there; None: none is stated
INCLUSION = 1.5  # radius of the circle of the area of an inclusion over the width of the patch that it replaces
FOREIGN = (
    "second invariant",
    "one fibre family",
    "viscoelasticity",
    "Mullins softening",
    "stiffness field",
)
NEARLY = (
    "one fibre family",
    "Mullins softening",
    "stiffness field",
    "inclusion",
    "viscoelasticity",
)  # of these the catalogue has nearly the form


def foreign(trial: Trial) -> Trial:
    """The trial with a Gent base, foreign forms of what has one, and foreign noise."""
    rng = stream(trial.seed, FORMS)
    stiffest = (
        trial.stretch**2 + 2 / trial.stretch - 3
    )  # I1 - 3 of the nominal stretch; at holes it is some times as large
    base = Gent(trial.material.shear_modulus, stiffest * log_uniform(rng, 30, 100))
    noise = ForeignNoise(float(rng.choice(COMMON)), STATED[int(rng.integers(len(STATED)))])
    draws = rng.uniform(0, 1, (len(trial.effects), 3))
    effects = tuple(_foreign(one, trial, own) for one, own in zip(trial.effects, draws, strict=True))
    return replace(trial, material=base, effects=effects, foreign=noise)


def _foreign(hidden: Hidden, trial: Trial, draws: Array) -> Hidden:
    """With the numbers of its foreign form in `more`; draws (3,): from 0 to 1."""
    a, b, c = map(float, draws)
    energy = trial.material.shear_modulus * (trial.stretch - 1) ** 2
    more: Mapping[str, Mapping[str, float]] = {
        "second invariant": {"alpha": -4 + 3 * a},
        "one fibre family": {"k2": 0.3 + 2 * a, "kappa": 0.05 + 0.15 * b},
        "viscoelasticity": {"share": 0.3 + 0.4 * a, "faster": 0.1 + 0.3 * b, "slower": 2 + 3 * c},
        "Mullins softening": {"m": energy * (0.05 + 0.3 * a), "beta": 0.1 * b},
        "stiffness field": {"slender": 0.7 + 0.8 * a, "tip": 2 * np.pi * b},
        # half a side of the rectangle of the area of an ellipse, over its half axis
        "inclusion": {"half": np.sqrt(np.pi) / 2},
    }
    if hidden.name == "lens distortion":  # of the catalogue's form, but for its base and noise
        return replace(hidden, shape={"x": 0.3 * a - 0.15, "y": 0.3 * b - 0.15})
    changed = replace(hidden, more={**hidden.more, **more.get(hidden.name, {})})
    return replace(changed, shape=_sharp(hidden.shape)) if hidden.name == "inclusion" else changed


def _sharp(shape: Mapping[str, float]) -> dict[str, float]:
    """Of an inclusion, as the catalogue has the rectangle about its ellipse."""
    angle = 2 * float(np.arctan2(shape["e2"], shape["e1"]))  # four times that of the long axis
    return {**shape, "q1": SHARP * float(np.cos(angle)), "q2": SHARP * float(np.sin(angle))}


@dataclass(frozen=True)
class Laws:
    """Of a foreign trial, for a `forward.sheet.thin_sheet.Sheet`; solved: names of the effects that they are."""

    additions: tuple[Addition, ...]
    branches: tuple[MaxwellBranch, ...]
    solved: frozenset[str]


def laws(trial: Trial) -> Laws:
    """The foreign laws of what is hidden; none of a trial that is not foreign."""
    additions: list[Addition] = []
    branches: tuple[MaxwellBranch, ...] = ()
    solved = set()
    for one in trial.effects if trial.foreign is not None else ():
        a, more = one.amplitudes, one.more
        solved.add(one.name)
        if one.name == "second invariant":  # with the initial modulus of c01
            additions.append(OgdenPart(4 * a["c01"] / more["alpha"], more["alpha"]))
        elif one.name == "one fibre family":
            k1 = a["k"] / (1 - 3 * more["kappa"]) ** 2
            additions.append(DispersedFibres(k1, more["k2"], more["kappa"], (one.shape["angle"],)))
        elif one.name == "Mullins softening":  # as soft, once unloaded
            additions.append(OgdenRoxburgh(1 / a["r"], more["m"], more["beta"]))
        elif one.name == "stiffness field":
            radius, root = INCLUSION * more["width"], more["slender"] ** 0.5
            inclusion = more["height"], more["x"], more["y"], radius * root, radius / root
            additions.append(TriangularInclusion(*inclusion, more["tip"]))
        elif one.name == "inclusion" and "half" in more:
            extent = effect_laws.Extent(2 * max(SPECIMENS[trial.specimen].half_extent))
            long, short, angle = half_axes(extent.size * one.shape["radius"], one.shape["e1"], one.shape["e2"])
            half_sides = more["half"] * long, more["half"] * short
            additions.append(
                RectangularInclusion(a["a"], *extent.place(one.shape["x"], one.shape["y"]), *half_sides, angle)
            )
        elif one.name == "viscoelasticity":
            mu, tau = a["g"] * trial.material.shear_modulus, one.shape["tau"]
            branches = (
                MaxwellBranch(more["share"] * mu, more["faster"] * tau), MaxwellBranch((1 - more["share"]) * mu, more["slower"] * tau)
            )  # fmt: skip
        else:
            solved.discard(one.name)
    return Laws(tuple(additions), branches, frozenset(solved))


def noise_of(trial: Trial, clean: Experiment, forces: Noise) -> tuple[Array, Noise | None]:
    """Errors (t, n, 2) of the displacements, mm, and the noise that the Experiment states. forces: the true noise of a trial that is
    not foreign."""
    assert trial.foreign is not None
    rng, n = stream(trial.seed, FIELDS), clean.n_increments

    def field() -> Array:
        kinds = ((SHORT, SHARE), (LONG, 1 - SHARE))
        fields = (np.sqrt(share) * GaussianField(factor * trial.correlation_length, FIELD_RESOLUTION).sample(clean.points, rng)
                  for factor, share in kinds)  # fmt: skip
        return np.asarray(sum(fields))

    common = trial.foreign.common
    growth = np.linalg.norm(clean.displacements, axis=(1, 2))
    pattern, reference = field(), field()
    own = np.array([field() for _ in range(n)])
    shared = np.sqrt(common / 2) * ((growth / growth.max())[:, None, None] * pattern + reference)
    errors = trial.displacement_std * (np.sqrt(1 - common) * own + shared)
    factor = trial.foreign.stated
    if factor is None:
        return errors, None
    split = {
        "displacement_std": np.sqrt(1 - common),
        "pattern_std": np.sqrt(common / 2),
        "reference_std": np.sqrt(common / 2),
    }
    stated = {name: float(factor * trial.displacement_std * share) for name, share in split.items()}
    return errors, replace(forces, **stated)
