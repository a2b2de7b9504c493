"""All thresholds by which a diagnosis decides, in one place."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Thresholds:
    """Thresholds of `discover`.

    significance: adjusted p-value of the whole search, below which an effect is significant.
    misfit_p: p-value of the misfit as a whole, below which the residual is more than noise; once where the model was fitted and
    once where it was not.
    residual_share: of what was explained, that the residual may be.
    secondary_share, secondary_share_truncated: of what an effect explains, that it may leave for other effects; truncated: where
    its formula is a series cut off.
    most_named: effects that together are called an explanation.
    equal_scores: difference of scores below which the likelihoods of two effects differ by less than 100 to 1, 2 ln 100.
    worse: a misfit larger by this factor is worse.
    small_force_error, large_force_error: relative, of what is held out; an explanation leaves no more than the first, or than twice
    the stated uncertainty and the second.
    negligible_error: relative error of force or field that may grow up to here: that of a load cell of class 0.5 (ISO 7500-1).
    above_noise: factor on the standard deviation of noise, above which an error in N stands clear of it.
    clear_fall: share of the square of such an error, that must fall.
    softest_base: share of the stiffness of the base that an effect must leave it.
    most_effects: in a model: one more than can be named.
    tries: effects that are fitted in a round, before one is added.
    rival: share of the best score; effects so close are fitted before one is chosen, as scores are those of small effects.
    refined: significant effects that have a shape, which is refined before they are compared.
    dominant_share: of the misfit of the base beyond noise, that the dominant effect of an unexplained test takes alone.
    as_good: factor on what it leaves, up to which another could stand in its place.
    collinear: |cos| of signatures that cannot be told apart.
    similar: |cos| of signatures from which on a table shows it.
    """

    significance: float = 0.03
    misfit_p: float = 0.005
    residual_share: float = 0.03
    secondary_share: float = 0.005
    secondary_share_truncated: float = 0.03
    most_named: int = 2
    equal_scores: float = 9.2
    worse: float = 1.02
    small_force_error: float = 0.02
    large_force_error: float = 0.1
    negligible_error: float = 0.005
    above_noise: float = 2.0
    clear_fall: float = 0.2
    softest_base: float = 0.1
    most_effects: int = 3
    tries: int = 3
    rival: float = 0.8
    refined: int = 4
    dominant_share: float = 0.9
    as_good: float = 2.0
    collinear: float = 0.9
    similar: float = 0.5


DEFAULT = Thresholds()
