"""The explanations that compete with the final model of a diagnosis, as they are replayed.

In: a `Discovery` whose explanations were fitted. Out: models with their probabilities.
"""

from __future__ import annotations

from calibrate.diagnosis.evidence.explanations import RIVALS, TIE
from calibrate.diagnosis.selection.rounds import Discovery
from studies.replay.compared_test import ReplayedModel


def own_probability(found: Discovery) -> float:
    """Of the final model; 1 where explanations were not fitted, or it is none of them."""
    return _probabilities(found).get(frozenset(found.final.names), 1.0)


def rivals(found: Discovery) -> list[tuple[tuple[str, ...], float, ReplayedModel]]:
    """Other explanations that compete, the most probable first, with the models that were fitted."""
    known = _probabilities(found)
    result = []
    for names, probability in sorted(known.items(), key=lambda pair: -pair[1]):
        if probability > TIE and names != frozenset(found.final.names):
            assert found.weighing is not None
            one = next(
                e for e in found.weighing.alternatives.explanations if frozenset(e.names) == names and e.c is not None
            )
            assert one.c is not None
            result.append((one.names, probability, ReplayedModel(one.c, one.additions)))
    return result[:RIVALS]


def _probabilities(found: Discovery) -> dict[frozenset[str], float]:
    """Of effects, whatever discrepancy is beside them; none where they were not fitted."""
    if found.weighing is None or not found.weighing.fitted:
        return {}
    result: dict[frozenset[str], float] = {}
    for one in found.weighing.alternatives.explanations:
        if one.c is not None:
            key = frozenset(one.names)
            result[key] = result.get(key, 0.0) + one.probability
    return result
