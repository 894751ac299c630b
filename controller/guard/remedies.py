"""Finds what changes of servo, bus or wall would allow, and says so in words.

Each remedy is found by evaluating the limits anew with one change. Remedies do not add up: with two
of them another limit may bind.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.guard.evaluation import Evaluation
from haptic_wall.controller.guard.limits import evaluate, least_of
from haptic_wall.controller.guard.plants import Plants
from haptic_wall.controller.guard.types import GuardSettings, Request, Situation
from haptic_wall.controller.guard.work import Work
from haptic_wall.controller.milliseconds import ms

HOLD, SAMPLE_AGE = "hold", "sample_age"
"""Names of the delay's parts"""
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
    """A wall, its servo, and the delay it is decided for."""

    request: Request
    settings: GuardSettings
    situation: Situation
    parts: Mapping[str, float]
    """The parts of t_d by name, the device's own longest lag included, each >= 0 [s]"""

    @property
    def delay(self) -> float:
        """Return t_d, the delay without the hold [s]."""
        return sum(self.parts.values())

    def corner(self, count: int = 1) -> Plants:
        """Return the least safe corner of the belief, ``count`` times."""
        found = Plants.at_corner(self.situation, np.zeros(count))
        return replace(found, delay=np.full(count, self.delay))


def remedies(wall: Wall, work: Work) -> list[Remedy]:
    """Return the limits after each change that applies, to 5 %, the highest first.

    Args:
        wall: The requested wall, whose stiffness has no effect.
        work: Results of earlier evaluations.
    """
    found = []
    for other, text in _changes(wall, work):
        asked = (other.request, other.settings, other.situation, other.corner())
        after = evaluate(Evaluation(*asked, work=work))
        found.append(Remedy(text, float(least_of(after)[0])))
    return sorted(found, key=lambda each: -each.stiffness)


def _changes(wall: Wall, work: Work) -> Iterator[tuple[Wall, str]]:
    """Yield the wall after each change, and the change in words."""
    request, situation = wall.request, wall.situation
    belief = situation.belief
    best = _good_damping(wall, work)
    text = f"virtual damping {best:.2g} instead of {request.damping:.3g} N·m·s/rad"
    yield wall._replace(request=replace(request, damping=best)), text
    yield _largest_part(wall)
    if request.side != "both" and request.linear:
        both = replace(request, side="both")
        yield wall._replace(request=both), "a two-sided wall, which also pulls"
    if not belief.is_known:
        rest = max(wall.delay - belief.delay.high, 0.0)
        known = wall._replace(
            situation=replace(situation, belief=belief.nominal),
            parts={"delay": rest + belief.delay.value},
        )
        yield known, "the servo known exactly, at its believed values"


def _largest_part(wall: Wall) -> tuple[Wall, str]:
    hold = wall.situation.period / 2  # counts as delay, by the zero-order hold
    name, size = max([*wall.parts.items(), (HOLD, hold)], key=lambda part: part[1])
    total = hold + wall.delay
    share = f"{100 * size / total:.0f} % of the total delay (period/2 + delay = {ms(total)})"
    if name == HOLD:
        text = f"a period of {ms(size)} instead of {ms(2.0 * size)}, half of which is"
        return wall._replace(situation=replace(wall.situation, period=size)), f"{text} {share}"
    what = {
        SAMPLE_AGE: "a sample's age",
        "inserted": "an inserted delay",
        "device": "a lag of the device",
    }.get(name, f"a delay ({name})")
    least = size / 2
    text = f"{what} of {ms(least)} instead of {ms(size)}, {share}"
    return wall._replace(parts={**wall.parts, name: least}), text


def _good_damping(wall: Wall, work: Work) -> float:
    """Return the virtual damping of the highest limit over the belief, of some.

    They are spaced by a factor, as the encoder may leave only small dampings.
    """
    request, settings, situation, _ = wall
    asked = (request, settings, situation, wall.corner())
    # asked for little damping, the ceiling may be a lower bound
    most = Evaluation(*asked, work=work).rigid_ceiling
    ceiling = float(Evaluation(*asked, asked=most, work=work).vibration[0])
    tried = settings.damping_cap * ceiling * (1 - _WITHIN) * _SHARES
    spread = wall.corner(tried.size)
    after = Evaluation(request, settings, situation, spread, asked=tried, work=work)
    return float(after.damping[np.argmax(least_of(evaluate(after)))])
