"""Models that a diagnosis leaves as files.

In: a `Discovery`. Out: the final model, with a network distilled from its base, and models without a named effect of a test that nothing explains.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

from calibrate.diagnosis import distillation
from calibrate.diagnosis.distillation import bulk_modulus
from calibrate.diagnosis.replayed.checked_replay import replay_record
from calibrate.diagnosis.replayed.few_effects import Usable
from calibrate.diagnosis.replayed.replay_verdict import replayed_level, stiffness_level
from calibrate.diagnosis.selection import Discovery
from calibrate.effects.chain import Additions
from calibrate.models.extended_model import ExtendedModel
from calibrate.models.fitness import Fitness, Use
from studies.reports.discovery.replays.replayed_models import usable_models
from studies.reports.discovery.statement import network_words
from studies.reports.headline import WORDS as HEADLINE


def extended(found: Discovery, hold_out: str, record: dict[str, Any]) -> ExtendedModel:
    """The final model of a discovery as a model file, with a network distilled from its base."""
    final = found.final
    bulk = bulk_modulus(found.problem, final)
    model = _file(found, final.c, final.additions, final.deviations, hold_out, record)
    model = replace(model, groups=found.groups, bulk_modulus_deviation=None if bulk is None else bulk[1])
    model = replace(model, replay=replay_record(found.replay_check) or {}, uncertainty=found.uncertainty)
    level = stiffness_level(found, final)
    model = model.scaled(level)
    distilled = distillation.distil(found.problem, final, level=level)
    loss = {
        "network": distilled.network_loss, "spline": distilled.spline_loss, "equations": distilled.n_rows,
        "good": distilled.good, "remark": network_words(distilled),
    }  # fmt: skip
    return model.with_network(distilled.network, loss)


def unexplained(found: Discovery, hold_out: str, record: dict[str, Any]) -> dict[str, ExtendedModel]:
    """Models of a test that nothing explains, without a network, by their files: few effects, where they were updated by forces, and neo-Hooke."""
    return {file: _without_network(found, one, hold_out, record) for file, one in usable_models(found).items()}


def _without_network(found: Discovery, use: Usable, hold_out: str, record: dict[str, Any]) -> ExtendedModel:
    """At the level of its replay where there is one."""
    model = _file(found, use.c, use.additions, use.deviations, hold_out, record)
    model = replace(model, fitness=Fitness(Use.RESERVATIONS, (HEADLINE.unexplained(),)))
    return model.scaled(replayed_level(found, use.replayed, use.c, use.additions))


def _file(
    found: Discovery, c: Any, additions: Additions, deviations: tuple[tuple[float, ...], ...], hold_out: str,
    record: dict[str, Any],
) -> ExtendedModel:  # fmt: skip
    parts = found.problem.parts
    return ExtendedModel(
        found.problem.basis,
        c,
        additions,
        deviations,
        parts[0].experiment.stress_unit,
        tuple(
            {
                "name": p.experiment.name,
                "fingerprint": p.experiment.whole,
                "spacing": p.system.fields.spacing,
                "noise": None if p.experiment.noise is None else asdict(p.experiment.noise),
            }
            for p in parts
            if p.train.size
        ),
        hold_out,
        tuple(p.experiment.name for p in parts if not p.train.size),
        found.verdict,
        provenance={key: record[key] for key in ("command", "settings", "inputs", "versions", "revision")},
        level_is_nominal=found.problem.level_is_nominal,
        calibrated_range=distillation.range_of(found.problem) | distillation.fibre_ranges(found.problem, additions),
    )
