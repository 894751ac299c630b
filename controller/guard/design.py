"""Finds what each change of servo, bus or wall would allow, and says so in words.

The guard's reasons and ``haptic-wall boundary`` both use this module. Each answer evaluates the
limits anew with one change. Improvements do not add up: with two of them another limit may bind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from haptic_wall.controller.guard.belief import Belief, Bounded
from haptic_wall.controller.guard.delay_parts import (
    HOLD,
    SAMPLE_AGE,
    SHORT_TIMER,
    DelayParts,
    ms,
    shorter,
)
from haptic_wall.controller.guard.evaluation import Evaluation
from haptic_wall.controller.guard.limits import evaluate, smallest
from haptic_wall.controller.guard.plants import Plants
from haptic_wall.controller.guard.types import GuardSettings, Request, Situation
from haptic_wall.controller.guard.work import Work
from haptic_wall.controller.theory.checks import FloatArray

FINER = 4
WORTH_NAMING = 1.02
"""Smallest factor that counts as an improvement: the limits are accurate to about 1 %."""
Change = Literal[
    "virtual_damping",
    "largest_part",
    "delay",
    "rate",
    "damping",
    "encoder",
    "two_sided",
    "motor_encoder",
    "stiffer",
    "belief",
]
"""Names of the changes: ``virtual_damping`` another B; ``largest_part`` of the delay ``shorter``,
the hold included; ``delay`` t_d halved; ``rate`` twice; ``damping``, the viscous, twice;
``encoder`` ``FINER`` times finer; ``two_sided`` a wall that also pulls; ``motor_encoder`` on the
motor's side of a flexible transmission; ``stiffer``, that transmission's vibration at twice its
frequency; ``belief`` the servo known exactly, at its believed values."""


@dataclass(frozen=True, slots=True)
class Improvement:
    """The limit after one change."""

    change: str
    text: str
    """The change in words, with its numbers"""
    stiffness: float
    """The smallest limit after the change [N·m/rad]"""
    binding: str
    """The name of that limit"""
    damping: float
    """Virtual damping after the change [N·m·s/rad]"""

    def factor(self, now: float) -> float | None:
        """Return the new limit as a multiple of ``now`` [N·m/rad]; None where ``now`` is 0."""
        return self.stiffness / now if now > 0 else None

    def buys(self, now: float) -> bool:
        """Whether the new limit exceeds ``now`` [N·m/rad] by more than 2 %."""
        return self.stiffness > WORTH_NAMING * now


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


def improvements(
    wall: Wall, changes: Sequence[str], *, exact: bool = False, work: Work | None = None
) -> list[Improvement]:
    """Compute the limit after each change.

    Args:
        wall: The requested wall, whose stiffness has no effect. In mode ``off`` any B may be
            commanded.
        changes: Changes to try, of ``Change``. The answer leaves out changes that do not apply (a
            finer encoder where there is none, a two-sided wall in place of one).
        exact: Find the limits to 1e-4, and the best virtual damping; else to 5 %, and a good one,
            in a fraction of the time.
        work: What was evaluated before for the same asker.

    Returns:
        The improvements, the highest stiffness first.
    """
    work = Work() if work is None else work
    found = []
    for change in changes:
        made = _changed(change, wall, exact, work)
        if made is None:
            continue
        other, text = made
        asked = (other.request, other.settings, other.situation, other.corner)
        after = evaluate(Evaluation(*asked, exact=exact, work=work))
        name, stiffness = smallest(after.at(0))
        found.append(Improvement(change, text, stiffness, name, float(after.damping[0])))
    return sorted(found, key=lambda each: -each.stiffness)


def _changed(change: str, wall: Wall, exact: bool, work: Work) -> tuple[Wall, str] | None:
    """Return the wall after a change, and the change in words; None where it does not apply."""
    request, _, situation, parts = wall
    belief, period = situation.belief, situation.period
    match change:
        case "virtual_damping":
            best = _best_damping(wall, exact, work)
            text = f"virtual damping {best:.2g} instead of {request.damping:.3g} N·m·s/rad"
            return wall._replace(request=replace(request, damping=best)), text
        case "largest_part":
            return _largest_part(wall)
        case "delay" if parts.delay > 0:
            half = {name: 0.5 * size for name, size in parts.named.items()}
            made = replace(parts, named=half)
            text = f"half the delay, {ms(made.delay)} instead of {ms(parts.delay)}"
            return wall._replace(parts=made), text
        case "rate":
            text = f"twice the rate, {2 / period:.4g} Hz instead of {1 / period:.4g}"
            return _with_period(wall, 0.5 * period), text
        case "encoder" if situation.position_step > 0:
            finer = replace(situation, position_step=situation.position_step / FINER)
            return wall._replace(situation=finer), f"an encoder {FINER} times finer"
        case "two_sided" if request.side != "both" and request.linear:
            both = replace(request, side="both")
            return wall._replace(request=both), "a two-sided wall, which also pulls"
        case "belief" if not belief.is_known:
            rest = max(parts.delay - belief.delay.high, 0.0)
            made = replace(parts, named={"delay": rest + belief.delay.value})
            known = _with_belief(wall, _known(belief))
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
    parts, slow = wall.parts, wall.situation.slow_replies
    name, size = parts.largest()
    least = shorter(parts, slow)
    share = f"{100 * size / parts.total:.0f} % of the total delay (period/2 + delay ="
    share += f" {ms(parts.total)})"
    if name == HOLD:
        text = f"a period of {ms(2.0 * least)} instead of {ms(2.0 * size)}, half of which is"
        return _with_period(wall, 2.0 * least), f"{text} {share}"
    what = {
        SAMPLE_AGE: "a sample's age",
        "inserted": "an inserted delay",
        "device": "a lag of the device",
    }.get(name, f"a delay ({name})")
    text = f"{what} of {ms(least)} instead of {ms(size)}, {share}"
    if slow and name == SAMPLE_AGE:
        text += f": the adapter holds back replies; set its latency timer to {ms(SHORT_TIMER)}"
    return wall._replace(parts=parts.with_part(name, least)), text


def _with_period(wall: Wall, period: float) -> Wall:
    situation = replace(wall.situation, period=period)
    return wall._replace(situation=situation, parts=wall.parts.with_part(HOLD, 0.5 * period))


def _with_belief(wall: Wall, belief: Belief) -> Wall:
    return wall._replace(situation=replace(wall.situation, belief=belief))


def _known(belief: Belief) -> Belief:
    return replace(
        belief,
        inertia=Bounded.exactly(belief.inertia.value),
        damping=Bounded.exactly(belief.damping.value),
        delay=Bounded.exactly(belief.delay.value),
        torque_gain=Bounded.exactly(belief.torque_gain.value),
    )


def _twice(value: Bounded) -> Bounded:
    return Bounded(2.0 * value.value, 2.0 * value.low, 2.0 * value.high)


_FEW, _MANY = np.geomspace(1e-2, 1.0, 10), np.geomspace(1e-3, 1.0, 25)
_POINTS, _ROUNDS = 9, 3
_WITHIN = 1e-4  # fraction of the range left out at both ends, where no stiffness is allowed


def _best_damping(wall: Wall, exact: bool, work: Work) -> float:
    """Return the virtual damping with the highest limit over the belief.

    The first points are spaced by a factor, as the encoder may leave only small dampings. ``exact``
    searches between them too, to 1e-3 of the damping.
    """
    request, settings, situation, _ = wall
    p = wall.corner
    at = Evaluation(request, settings, situation, p, work=work)
    share = 1.0 if settings.mode == "off" else settings.damping_cap
    low = -float((p.damping / p.gain)[0]) * (1 - _WITHIN)
    high = share * float(at.vibration[0]) * (1 - _WITHIN)
    shares = [low, 0.0, *(high * _MANY)] if exact else [0.0, *(high * _FEW)]
    tried: FloatArray = np.array(shares)
    best = 0.0
    for _ in range(1 + _ROUNDS if exact else 1):
        spread = p.take(np.zeros(tried.size, dtype=np.int64))
        asked = (request, settings, situation, spread)
        after = evaluate(Evaluation(*asked, asked=tried, exact=exact, work=work))
        top = int(np.argmax(after.smallest()))
        best = float(after.damping[top])
        ends = tried[max(top - 1, 0)], tried[min(top + 1, tried.size - 1)]
        tried = np.linspace(*ends, _POINTS)
    return best
