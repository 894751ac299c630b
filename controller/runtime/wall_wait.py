"""Waits until the wall may come on: the loop runs without torque, and tells a person why."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from haptic_wall.controller.laws.engagement import REST_S, place_text
from haptic_wall.controller.laws.wall import NONE, Law
from haptic_wall.controller.runtime.axis import Axis
from haptic_wall.controller.runtime.loop import Loop
from haptic_wall.controller.runtime.safety import End, StopReason
from haptic_wall.controller.settings.config import Config

LOOK_S = 0.01
"""Period of the checks whether the wall may come on [s]"""
FAR = 0.5
"""Distance inside a wall from which the servo's sign is doubted [rad]"""


class WallWait:
    """Serves ticks without torque until all walls may come on.

    Args:
        loop: The running loop.
        configs: The configuration of each axis, by its name.
        tell: Called with the positions of wall and shaft, and where the shaft must go.

    Attributes:
        waited_for: The last unmet condition; empty: there was none.
        over: The wall may have come on.
    """

    def __init__(
        self, loop: Loop, configs: Mapping[str, Config], tell: Callable[[str], None]
    ) -> None:
        self._loop = loop
        names = [f"{name}: " if name else "" for name in configs]
        self._axes = list(zip(names, loop.cycle.axes, configs.values(), strict=True))
        self._unknown = self._axes  # those whose start has not been told
        self._tell = tell
        self.waited_for = ""
        self.over = False

    def __call__(self, most_s: float | None) -> StopReason | None:
        """Serve deadlines until the wall may come on; return why that did not happen, or None.

        Args:
            most_s: Longest wait [s]; None: for ever.
        """
        cycle = self._loop.cycle
        self._tell_starts()
        told = set()
        looks = 0
        while not cycle.may_engage():
            kind, self.waited_for = self._reason()
            # The first readings after a very short warm-up are not reported.
            if kind not in told and looks * LOOK_S > REST_S:
                self._tell(self.waited_for)
                told.add(kind)
            if most_s is not None and looks * LOOK_S >= most_s:
                return End.DURATION
            looks += 1
            if reason := self._loop.serve(LOOK_S):
                return reason
            self._tell_starts()
        self.over = True
        return None

    def lacking(self) -> str:
        """Return the unmet condition of a wall that was never on; empty: none, or stopped before.

        The shaft may have moved on in the tick in which the wall was to come on.
        """
        if all(axis.came_on for _, axis, _ in self._axes):
            return ""
        return self._reason()[1] if self.over else self.waited_for

    def _tell_starts(self) -> None:
        """Report the positions of each wall and shaft once they are known."""
        if self._unknown:
            self._unknown = [each for each in self._unknown if not self._tell_start(*each)]

    def _tell_start(self, name: str, axis: Axis, config: Config) -> bool:
        """Report the positions of wall and shaft; return whether they are known."""
        law, position = axis.law, axis.position
        if math.isnan(position) and config.servo.kind == "simulated" and not axis.wall_from_start:
            position = config.start_position  # no reading yet, and no torque has moved it
        if math.isnan(position):
            return False
        if law.guarded:
            self._tell(name + start_text(law, config.wall.acting_side, position))
        return True

    def _reason(self) -> tuple[str, str]:
        """Return the unmet condition of the first axis that has one: a name, a text for people."""
        waits = [each for each in self._axes if not each[1].engagement.ready]
        name, axis, config = (waits or self._axes)[0]
        if math.isnan(axis.position):
            return f"{name}reading", f"{name}the wall waits for the first reading"
        if not self._loop.cycle.held():
            return "dead man", "the dead man is not held; the wall comes on when it is"
        text = waiting_text(axis, config)
        if len(self._axes) > 1 and not axis.wall_from_start:
            text += sign_text(axis, config)
        return f"{name}place", name + text


def start_text(law: Law, side: str, position: float) -> str:
    """Say where the wall and the shaft are before the wall comes on.

    Args:
        law: The wall.
        side: Its side, as in the configuration.
        position: Position of the shaft [rad].
    """
    if law.name == NONE:
        return f"no torque is sent, the shaft is at {place_text(position)}"
    where = f"is at {place_text(law.position)}, the shaft at {place_text(position)}"
    return f"{_law_text(law, side)} {where}"


def waiting_text(axis: Axis, config: Config) -> str:
    """Say why a wall does not come on, where the shaft is, and where it must go."""
    law, position, side = axis.law, axis.position, config.wall.acting_side
    stiffness, gate = axis.gains.schedule.allowed.stiffness, axis.engagement
    away, room = abs(law.elongation(position)), gate.room(stiffness)
    text = (
        f"at {place_text(position)} {_law_text(law, side)} would push with up to "
        f"{min(stiffness * away, axis.torque_limit):.3g} N·m; it comes on when that has stayed "
        f"below {gate.most_torque(stiffness):.2g} N·m for {1e3 * REST_S:g} ms"
    )
    if away <= room or not law.linear:
        return text
    surface = place_text(law.position)
    goal = {
        "above": f"below {surface}",
        "below": f"above {surface}",
    }.get(side, f"to within {math.degrees(room):.2g}° of {surface}")
    return f"{text}: turn the shaft {goal}"


def sign_text(axis: Axis, config: Config) -> str:
    """Return a hint for ``waiting_text`` at a shaft that only the other sign puts outside the wall.

    Empty where it is not far inside, as a hand may have left it, or where the sign is no help.
    """
    law, servo = axis.law, config.servo
    room = axis.engagement.room(axis.gains.schedule.allowed.stiffness)
    other = 2.0 * servo.offset - axis.position
    if abs(law.elongation(axis.position)) < FAR or abs(law.elongation(other)) > room:
        return ""
    return (
        f"; or the sign of the servo is wrong: with servo.sign={-servo.sign} the shaft would be at "
        f"{place_text(other)}, where the wall may come on"
    )


def _law_text(law: Law, side: str) -> str:
    return f"the wall ({side})" if law.name == "wall" else f"the law {law.name}"
