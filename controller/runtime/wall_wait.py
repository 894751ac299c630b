"""Waits until the wall may come on: the loop runs without torque, and tells a person why."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from haptic_wall.controller.laws.engagement import (
    REST_S,
    sign_text,
    start_text,
    waiting_text,
)
from haptic_wall.controller.runtime.axis import Axis
from haptic_wall.controller.runtime.loop import Loop
from haptic_wall.controller.runtime.safety import End, StopReason
from haptic_wall.controller.settings.config import Config

LOOK_S = 0.01
"""Period of the checks whether the wall may come on [s]"""


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
        stiffness, gate = axis.gains.schedule.allowed.stiffness, axis.engagement
        text = waiting_text(
            axis.law,
            config.wall.acting_side,
            axis.position,
            stiffness,
            gate,
            axis.torque_limit,
        )
        if len(self._axes) > 1 and not axis.wall_from_start:
            servo, room = config.servo, gate.room(stiffness)
            text += sign_text(axis.law, axis.position, servo.sign, servo.offset, room)
        return f"{name}place", name + text
