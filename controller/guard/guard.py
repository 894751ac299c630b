"""Decides which stiffness and damping may be commanded, with the reason of each clamp.

It is a pure computation outside the tick. It first limits the virtual damping to a fraction of the
ceiling above which no stiffness is stable. It then limits the stiffness to ``margin`` times the
smallest limit at that damping. Both use the least safe corner of the belief: lowest inertia and
damping, longest delay, highest torque gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from haptic_wall.controller.guard.delay_parts import SAMPLE_AGE, DelayParts
from haptic_wall.controller.guard.design import improvements
from haptic_wall.controller.guard.explain import REMEDIES, explain
from haptic_wall.controller.guard.limits import (
    LOOKED_UP,
    PlantLimits,
    evaluate_box,
    unstable_nominally,
)
from haptic_wall.controller.guard.plants import Plants
from haptic_wall.controller.guard.reasons import Improvement
from haptic_wall.controller.guard.types import (
    Decision,
    GuardSettings,
    Limits,
    Mode,
    Request,
    Situation,
)
from haptic_wall.controller.theory.checks import FloatArray, not_negative

__all__ = [
    "Decision",
    "GuardSettings",
    "Limits",
    "Mode",
    "Request",
    "Situation",
    "decide",
]


def decide(
    request: Request,
    settings: GuardSettings,
    situation: Situation,
    delays: Sequence[float],
    inserted: float = 0.0,
    explained: bool = True,
    reduced: bool = False,
    least_inserted: float | None = None,
) -> list[Decision]:
    """Decide which stiffness and damping may be commanded, for each of several delays.

    Args:
        request: The requested wall.
        settings: The guard's settings.
        situation: The belief about the servo, the period, and its limits.
        delays: Inserted delay and age of the sample, without the device's own lag, each >= 0 [s].
        inserted: The inserted part of each delay [s].
        explained: Whether to also give the reasons, which takes several times as long.
        reduced: Whether something else commands less than this decision; the reasons then say
            "allowed".
        least_inserted: Shortest inserted part, where it varies [s]; None: ``inserted``.

    Returns:
        One decision per delay, in order.

    Raises:
        ValueError: A value of the request or situation lies outside its domain; the message names
            it.
    """
    before_device = np.atleast_1d(not_negative("delays", list(delays)))
    least = inserted if least_inserted is None else least_inserted
    situation = replace(situation, inserted=least)
    corner = Plants.at_corner(situation, before_device)
    found = evaluate_box(request, settings, situation, corner, LOOKED_UP)
    alone = (
        unstable_nominally(request, situation, before_device)
        if settings.mode == "off"
        else np.zeros(before_device.size, dtype=np.bool_)
    )
    decisions = []
    for i, delay in enumerate(corner.delay.tolist()):
        limits = found.limits(i)
        name, smallest = limits.smallest()
        bound = settings.mode != "off" and request.stiffness > settings.margin * smallest
        decisions.append(
            Decision(
                request=request,
                delay=delay,
                period=situation.period,
                stiffness=settings.margin * smallest if bound else request.stiffness,
                damping=float(found.damping[i]),
                limits=limits,
                encoder_damping=float(found.encoder_damping[i]),
                damping_ceiling=float(found.ceiling[i]),
                margin=settings.margin,
                binding=name if bound else None,
                reasons=(),
                only_friction=bool(alone[i]) and situation.belief.coulomb.value > 0,
                vibrates=found.vibrates is not None and bool(found.vibrates[i]),
                inserted=inserted,
            )
        )
    if not explained:
        return decisions
    return _explained(decisions, settings, situation, before_device, inserted, found, reduced)


def _explained(
    decisions: list[Decision],
    settings: GuardSettings,
    situation: Situation,
    before_device: FloatArray,
    inserted: float,
    found: PlantLimits,
    reduced: bool,
) -> list[Decision]:
    """Return the decisions with their reasons and the limit that each remedy would give."""
    parts = [
        DelayParts(
            situation.period,
            {
                SAMPLE_AGE: max(delay - inserted, 0.0),
                "inserted": min(inserted, delay),
                "device": situation.belief.delay.high,
            },
        )
        for delay in before_device.tolist()
    ]
    bound = [i for i, d in enumerate(decisions) if d.binding]
    remedies: list[list[Improvement]] = [[] for _ in decisions]
    if bound:
        answers = improvements(
            decisions[0].request,
            settings,
            situation,
            [parts[i] for i in bound],
            found.take(np.array(bound, dtype=np.int64)),
            REMEDIES,
        )
        for i, answer in zip(bound, answers, strict=True):
            remedies[i] = answer
    return [
        replace(d, reasons=explain(d, settings, situation, parts[i], remedies[i], reduced))
        for i, d in enumerate(decisions)
    ]
