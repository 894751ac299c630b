"""Finds what changes of servo, bus or wall would allow, and says so in words.

Each remedy is found by evaluating the limits anew with one change. Remedies do not add up: with two
of them another limit may bind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from haptic_wall.controller.guard.belief import Belief, Bounded
from haptic_wall.controller.guard.delay_parts import (
    HOLD,
    SAMPLE_AGE,
    DelayParts,
    ms,
)
from haptic_wall.controller.guard.evaluation import Evaluation
from haptic_wall.controller.guard.limits import evaluate, least_of
from haptic_wall.controller.guard.plants import Plants
from haptic_wall.controller.guard.types import GuardSettings, Request, Situation
from haptic_wall.controller.guard.work import Work

FINER = 4
_SHARES = np.array([0.0, *np.geomspace(1e-2, 1.0, 10)])
"""Virtual dampings that are tried, as fractions of the largest that may be commanded"""
_WITHIN = 1e-4  # fraction of the range left out at its end, where no stiffness is allowed


@dataclass(frozen=True, slots=True)
class Remedy:
    """The limit after one change."""

    text: str
    """The change in words, with its numbers"""
    stiffness: float
    """The smallest limit after the change [N·m/rad]"""


class Wall(NamedTuple):
    """A wall, its servo, and the parts of the delay, the device's own longest lag included."""

    request: Request
    settings: GuardSettings
    situation: Situation
    parts: DelayParts

    @property
    def corner(self) -> Plants:
        """Return the least safe corner of the belief."""
        one = Plants.at_corner(self.situation, np.zeros(1))
        return replace(one, delay=np.array([self.parts.delay]))


def remedies(wall: Wall, changes: Sequence[str], work: Work) -> list[Remedy]:
    """Return the limits after each change, to 5 %, the highest first.

    Args:
        wall: The requested wall, whose stiffness has no effect.
        changes: Changes to try: ``virtual_damping`` another B; ``largest_part`` of the delay
            ``shorter``, the hold included; ``damping``, the viscous, twice; ``encoder`` ``FINER``
            times finer; ``two_sided`` a wall that also pulls; ``motor_encoder`` on the motor's side
            of a flexible transmission; ``stiffer``, that transmission's vibration at twice its
            frequency; ``belief`` the servo known exactly, at its believed values. Those that do not
            apply are left out (a two-sided wall in place of one).
        work: Results of earlier evaluations.
    """
    found = []
    for change in changes:
        made = _changed(change, wall, work)
        if made is not None:
            other, text = made
            asked = (other.request, other.settings, other.situation, other.corner)
            after = evaluate(Evaluation(*asked, work=work))
            found.append(Remedy(text, float(least_of(after)[0])))
    return sorted(found, key=lambda each: -each.stiffness)


def _changed(change: str, wall: Wall, work: Work) -> tuple[Wall, str] | None:
    """Return the wall after a change, and the change in words; None where it does not apply."""
    request, _, situation, parts = wall
    belief = situation.belief
    match change:
        case "virtual_damping":
            best = _good_damping(wall, work)
            text = f"virtual damping {best:.2g} instead of {request.damping:.3g} N·m·s/rad"
            return wall._replace(request=replace(request, damping=best)), text
        case "largest_part":
            return _largest_part(wall)
        case "encoder" if situation.position_step > 0:
            finer = replace(situation, position_step=situation.position_step / FINER)
            return wall._replace(situation=finer), f"an encoder {FINER} times finer"
        case "two_sided" if request.side != "both" and request.linear:
            both = replace(request, side="both")
            return wall._replace(request=both), "a two-sided wall, which also pulls"
        case "belief" if not belief.is_known:
            rest = max(parts.delay - belief.delay.high, 0.0)
            made = replace(parts, named={"delay": rest + belief.delay.value})
            names = ("inertia", "damping", "delay", "torque_gain")
            exact: dict[str, Any] = {
                name: Bounded.exactly(getattr(belief, name).value) for name in names
            }
            known = _with_belief(wall, replace(belief, **exact))
            return known._replace(parts=made), "the servo known exactly, at its believed values"
        case "damping" if belief.damping.low > 0:
            low = belief.damping.low
            text = f"twice the viscous damping, {2 * low:.3g} instead of {low:.3g} N·m·s/rad"
            return _with_belief(wall, replace(belief, damping=_twice(belief.damping))), text
        case "motor_encoder" if belief.is_flexible and belief.encoder == "output":
            text = "an encoder on the motor's side of the flexible transmission"
            return _with_belief(wall, replace(belief, encoder="motor")), text
        case "stiffer" if belief.is_flexible:
            hz = _twice(belief.flexible_hz)
            text = f"a stiffer horn and link, {hz.low:.3g} Hz at least instead of"
            text += f" {belief.flexible_hz.low:.3g}"
            return _with_belief(wall, replace(belief, flexible_hz=hz)), text
        case _:
            return None


def _largest_part(wall: Wall) -> tuple[Wall, str]:
    parts = wall.parts
    name, size = parts.largest()
    least = size / 2
    share = f"{100 * size / parts.total:.0f} % of the total delay (period/2 + delay ="
    share += f" {ms(parts.total)})"
    if name == HOLD:
        text = f"a period of {ms(size)} instead of {ms(2.0 * size)}, half of which is"
        faster = replace(wall.situation, period=size)
        shorter_hold = replace(parts, period=size)
        return wall._replace(situation=faster, parts=shorter_hold), f"{text} {share}"
    what = {
        SAMPLE_AGE: "a sample's age",
        "inserted": "an inserted delay",
        "device": "a lag of the device",
    }.get(name, f"a delay ({name})")
    text = f"{what} of {ms(least)} instead of {ms(size)}, {share}"
    return wall._replace(parts=replace(parts, named={**parts.named, name: least})), text


def _with_belief(wall: Wall, belief: Belief) -> Wall:
    return wall._replace(situation=replace(wall.situation, belief=belief))


def _twice(value: Bounded) -> Bounded:
    return Bounded(2.0 * value.value, 2.0 * value.low, 2.0 * value.high)


def _good_damping(wall: Wall, work: Work) -> float:
    """Return the virtual damping of the highest limit over the belief, of some.

    They are spaced by a factor, as the encoder may leave only small dampings.
    """
    request, settings, situation, _ = wall
    corner = wall.corner
    ceiling = float(Evaluation(request, settings, situation, corner, work=work).vibration[0])
    tried = settings.damping_cap * ceiling * (1 - _WITHIN) * _SHARES
    spread = corner.take(np.zeros(tried.size, dtype=np.int64))
    after = Evaluation(request, settings, situation, spread, asked=tried, work=work)
    return float(after.damping[np.argmax(least_of(evaluate(after)))])
