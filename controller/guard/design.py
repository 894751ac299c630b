"""Finds which limit binds a wall, and what each improvement of servo, bus or wall would allow.

The guard's reasons and ``haptic-wall boundary`` both use this module. Each answer evaluates the
limits anew with one change. Improvements do not add up: with two of them another limit may bind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from haptic_wall.controller.guard.belief import Belief, Bounded
from haptic_wall.controller.guard.delay_parts import ADAPTER, SHORT_TIMER, WIRE, DelayParts, shorter
from haptic_wall.controller.guard.limits import (
    LOOKED_UP,
    PlantLimits,
    damping_ceiling,
    evaluate,
    evaluate_box,
    quantisation_limit,
)
from haptic_wall.controller.guard.plants import Plants
from haptic_wall.controller.guard.reasons import Change, Improvement
from haptic_wall.controller.guard.types import GuardSettings, Request, Situation
from haptic_wall.controller.theory import linear_limit
from haptic_wall.controller.theory.checks import FloatArray

FAST_BAUD = 4_000_000
FINER = 4
_OF_THE_SERVO: tuple[Change, ...] = ("two_sided", "encoder", "motor_encoder", "stiffer")
"""Changes after which the plants of the corner stay the same"""


def improvements(
    request: Request,
    settings: GuardSettings,
    situation: Situation,
    parts: Sequence[DelayParts],
    found: PlantLimits,
    changes: Sequence[Change],
    thorough: bool = False,
) -> list[list[Improvement]]:
    """Compute the limit after each change, for several delays at once.

    Args:
        request: The requested wall; its stiffness has no effect.
        settings: The guard's settings; in mode ``off`` any B may be commanded.
        situation: The belief about the servo, the period, encoder and torque limit.
        parts: The parts of each delay, the device's own longest lag included.
        found: The present limits, at the belief's corner, one per delay.
        changes: Changes to try. The answer leaves out changes that do not apply (a finer encoder
            where there is none, a two-sided wall in place of one, a baud rate without a part
            ``wire``).
        thorough: Find the limits to 1e-4, and the best virtual damping; else to 5 %, and a good
            one, in a fraction of the time.

    Returns:
        The improvements for each delay, the highest stiffness first.
    """
    answers: list[list[Improvement]] = [[] for _ in parts]
    if not parts:
        return answers
    corner = _corner(situation, parts)
    plants: list[Plants] = []
    asked: list[FloatArray] = []
    tried: list[Change] = []
    for change in changes:
        if change in _OF_THE_SERVO or not _applies(change, situation, parts):
            continue
        damping = np.full_like(corner.damping, request.damping)
        if change == "virtual_damping":
            search = _searched_damping if thorough else _promising_damping
            damping = search(request, settings, situation, corner)
        plants.append(_changed(change, corner, situation, parts))
        asked.append(damping)
        tried.append(change)
    tolerance = 1e-4 if thorough else LOOKED_UP
    # an exactly known servo is one plant; every other change needs the whole box
    for known in (True, False):
        some = [i for i, change in enumerate(tried) if (change == "belief") is known]
        if not some:
            continue
        after = (evaluate if known else evaluate_box)(
            request,
            settings,
            situation,
            plants[some[0]].followed_by(*(plants[i] for i in some[1:])),
            tolerance,
            np.concatenate([asked[i] for i in some]),
        )
        for k, index in enumerate(some):
            for i, answer in enumerate(answers):
                answer.append(_improvement(tried[index], after, k * len(parts) + i))
    if "two_sided" in changes and found.one_sided is not None and request.linear:
        _append(answers, "two_sided", replace(found, one_sided=None))
    if "encoder" in changes and found.quantisation is not None:
        finer = replace(situation, position_step=situation.position_step / FINER)
        limit = quantisation_limit(
            request, settings, finer, found.damping, corner.period, found.rigid_ceiling
        )
        _append(answers, "encoder", replace(found, quantisation=limit))
    for change in ("motor_encoder", "stiffer"):
        if change in changes and _applies(change, situation, parts):
            after = evaluate_box(
                request,
                settings,
                replace(situation, belief=_changed_belief(change, situation.belief)),
                corner,
                tolerance,
            )
            _append(answers, change, after)
    return [sorted(answer, key=lambda each: -each.stiffness) for answer in answers]


def _append(answers: list[list[Improvement]], change: Change, found: PlantLimits) -> None:
    for i, answer in enumerate(answers):
        answer.append(_improvement(change, found, i))


def _improvement(change: Change, found: PlantLimits, i: int) -> Improvement:
    binding, stiffness = found.limits(i).smallest()
    return Improvement(change, stiffness, binding, float(found.damping[i]))


def _corner(situation: Situation, parts: Sequence[DelayParts]) -> Plants:
    corner = Plants.at_corner(situation, np.zeros(len(parts)))
    return replace(corner, delay=np.array([each.delay for each in parts]))


def _applies(change: Change, situation: Situation, parts: Sequence[DelayParts]) -> bool:
    """Whether the change is possible in this situation."""
    belief = situation.belief
    match change:
        case "belief":
            known = (belief.inertia, belief.damping, belief.delay, belief.torque_gain)
            return any(each.low < each.high for each in known)
        case "damping":
            return belief.damping.low > 0
        case "motor_encoder":
            return belief.is_flexible and belief.encoder == "output"
        case "stiffer":
            return belief.is_flexible
        case "delay":
            return any(each.delay > 0 for each in parts)
        case "baud" | "latency_timer":
            name = WIRE if change == "baud" else ADAPTER
            return all(name in each.named for each in parts)
        case _:
            return True


def _changed_belief(change: Change, belief: Belief) -> Belief:
    """Return the belief of another encoder or transmission."""
    if change == "motor_encoder":
        return replace(belief, encoder="motor")
    hz = belief.flexible_hz
    return replace(belief, flexible_hz=Bounded(2.0 * hz.value, 2.0 * hz.low, 2.0 * hz.high))


def _changed(
    change: Change, corner: Plants, situation: Situation, parts: Sequence[DelayParts]
) -> Plants:
    """Return the plants of the belief's corner with one change."""
    match change:
        case "damping":
            return replace(corner, damping=2 * corner.damping)
        case "rate":
            return replace(corner, period=corner.period / 2)
        case "delay":
            return replace(corner, delay=corner.delay / 2)
        case "belief":
            # the parts already include the device's own longest delay
            rest = np.maximum(corner.delay - situation.belief.delay.high, 0.0)
            return Plants.nominal(situation, rest)
        case "largest_part":
            made = [
                each.with_part(each.largest()[0], shorter(each, situation.slow_replies))
                for each in parts
            ]
        case "baud":
            made = [
                each.with_part(WIRE, min(each.quickest_wire, each.named[WIRE])) for each in parts
            ]
        case "latency_timer":
            made = [
                each.with_part(ADAPTER, min(SHORT_TIMER, each.named[ADAPTER])) for each in parts
            ]
        case _:
            return corner
    return replace(
        corner,
        period=np.array([each.period for each in made]),
        delay=np.array([each.delay for each in made]),
    )


# Virtual damping


def _highest_damping(
    request: Request, settings: GuardSettings, situation: Situation, plants: Plants
) -> FloatArray:
    highest = damping_ceiling(request, situation, plants)[0]
    return highest if settings.mode == "off" else settings.damping_cap * highest


def _promising_damping(
    request: Request, settings: GuardSettings, situation: Situation, plants: Plants
) -> FloatArray:
    """Return a virtual damping that allows a high stiffness, by a quick approximation.

    Relative to the linear limit, the exact limit falls about in proportion to the fraction of the
    ceiling, and the one-sided limit falls below the exact one by about the same. This approximation
    guides only the choice; the limits at the chosen damping are evaluated properly.
    """
    if settings.mode == "passive":
        return np.zeros_like(plants.damping)  # virtual damping costs passivity
    highest = _highest_damping(request, settings, situation, plants)[:, None]
    share = np.geomspace(1e-4, 1.0, 200)
    of_ceiling = share if settings.mode == "off" else settings.damping_cap * share
    tried = highest * share
    b, g, t, t_d = (
        each[:, None] for each in (plants.damping, plants.gain, plants.period, plants.delay)
    )
    guide = linear_limit(b, g * tried, t, t_d) / g * (1 - of_ceiling)
    if request.side != "both":
        guide = guide * (1 - of_ceiling)
    rough = quantisation_limit(request, settings, situation, tried, t, tried + np.inf)
    if rough is not None:
        guide = np.minimum(guide, rough)
    best: FloatArray = tried[np.arange(tried.shape[0]), np.argmax(guide, axis=1)]
    return best


_SHARES, _POINTS, _ROUNDS = np.geomspace(1e-3, 1.0, 25), 9, 4
_WITHIN = 1e-4  # fraction of the range left out at both ends, where no stiffness is allowed


def _searched_damping(
    request: Request, settings: GuardSettings, situation: Situation, plants: Plants
) -> FloatArray:
    """Return the virtual damping with the highest limit over the belief, to 1e-3 of itself.

    The first points are spaced by a factor, as the encoder may leave only small dampings.
    """
    lowest = -plants.damping / plants.gain * (1 - _WITHIN)
    highest = _highest_damping(request, settings, situation, plants) * (1 - _WITHIN)
    rows = np.arange(lowest.size)
    tried = np.column_stack(
        [lowest, np.zeros_like(lowest), *(share * highest for share in _SHARES)]
    )
    for _ in range(_ROUNDS):
        spread = plants.take(np.repeat(rows, tried.shape[1]))
        after = evaluate_box(request, settings, situation, spread, 1e-3, asked=tried.ravel())
        top = np.argmax(after.smallest().reshape(tried.shape), axis=1)
        best: FloatArray = after.damping.reshape(tried.shape)[rows, top]
        low = tried[rows, np.maximum(top - 1, 0)]
        high = tried[rows, np.minimum(top + 1, tried.shape[1] - 1)]
        tried = np.linspace(low, high, _POINTS, axis=1)
    return best
