"""Finds the reasons of a decision, in order of importance."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from haptic_wall.controller.guard.delay_parts import DelayParts
from haptic_wall.controller.guard.limits import count_torque
from haptic_wall.controller.guard.reasons import (
    Change,
    CoarseCount,
    CoarseDamping,
    DampingBound,
    DampingTooLow,
    GuardOff,
    Improvement,
    LimitName,
    NothingAllowed,
    Reason,
    StiffnessBound,
    Unstable,
    WouldRaise,
)
from haptic_wall.controller.guard.types import Decision, GuardSettings, Situation

REMEDIES: tuple[Change, ...] = (
    "virtual_damping",
    "largest_part",
    "damping",
    "belief",
    "encoder",
    "two_sided",
    "motor_encoder",
    "stiffer",
)
"""Changes that are tried where the stiffness is bound."""

_MOST = 4
"""Largest number of reasons; the best remedies are kept, at least two."""


def explain(
    decision: Decision,
    settings: GuardSettings,
    situation: Situation,
    parts: DelayParts,
    remedies: Sequence[Improvement],
    reduced: bool = False,
) -> tuple[Reason, ...]:
    """Return the reasons of a decision, most important first; none where nothing was clamped.

    Args:
        decision: The decision to explain.
        settings: The guard's settings.
        situation: The servo and loop that render the wall.
        parts: The parts of the delay.
        remedies: The improvements, the best first; empty where K is not bound.
        reduced: Something other than the guard commands less.
    """
    if settings.mode == "off":
        return tuple(_off(decision))
    reasons = [
        *_stiffness(decision, situation, settings, not reduced),
        *_damping(decision, settings, situation, not reduced),
    ]
    worth = [each for each in remedies if each.buys(decision.limits.smallest()[1])]
    for remedy in worth[: max(2, _MOST - len(reasons))]:
        reasons.append(
            WouldRaise(
                remedy,
                min(decision.margin * remedy.stiffness, decision.request.stiffness),
                decision.damping,
                parts,
                situation.slow_replies,
                situation.belief,
            )
        )
    return tuple(reasons)


def _off(decision: Decision) -> Iterator[Reason]:
    yield GuardOff(decision.stiffness, decision.damping, *decision.limits.smallest())
    exact = decision.limits.exact
    if decision.only_friction or (exact is not None and decision.stiffness > exact):
        yield Unstable(decision.only_friction)


def _stiffness(
    decision: Decision, situation: Situation, settings: GuardSettings, commanded: bool
) -> Iterator[Reason]:
    if decision.binding is None:
        return
    value = decision.limits.smallest()[1]
    yield StiffnessBound(
        decision.request.stiffness,
        decision.stiffness,
        decision.binding,
        value,
        decision.margin,
        commanded,
        decision.request.law,
    )
    if decision.binding == LimitName.QUANTISATION:
        if not decision.is_coarse:
            yield _coarse_count(decision, situation, settings)
    elif value == 0:
        highest = settings.damping_cap * decision.damping_ceiling
        yield NothingAllowed(decision.damping, decision.delay, highest)


def _coarse_count(decision: Decision, situation: Situation, settings: GuardSettings) -> CoarseCount:
    return CoarseCount(
        abs(decision.damping) * _per_damping(decision, situation),
        settings.quantisation_share * situation.torque_limit,
        decision.encoder_damping if decision.damping else None,
        decision.request.velocity_samples,
    )


def _per_damping(decision: Decision, situation: Situation) -> float:
    return float(count_torque(decision.request, situation, np.array([decision.period]))[0])


def _damping(
    decision: Decision, settings: GuardSettings, situation: Situation, commanded: bool
) -> Iterator[Reason]:
    asked, given = decision.request.damping, decision.damping
    if given == asked:
        return
    if decision.is_coarse:
        yield CoarseDamping(
            asked,
            given,
            abs(asked) * _per_damping(decision, situation),
            settings.quantisation_share * situation.torque_limit,
            decision.request.velocity_samples,
            commanded,
        )
        return
    if asked < given:
        lowest = situation.belief.damping.low / situation.belief.torque_gain.high
        yield DampingTooLow(asked, given, -lowest, commanded)
        return
    yield DampingBound(
        asked,
        given,
        decision.damping_ceiling,
        settings.damping_cap,
        decision.delay,
        settings.mode == "passive",
        decision.vibrates,
        commanded,
    )
