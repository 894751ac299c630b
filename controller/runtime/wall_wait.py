"""Waits until the wall may come on: the loop runs without torque, and tells a person why."""

from __future__ import annotations

import math
from collections.abc import Callable

from haptic_wall.controller.laws.engagement import REST_S, felt_text, start_text, waiting_text
from haptic_wall.controller.runtime.loop import Loop
from haptic_wall.controller.runtime.safety import End, StopReason
from haptic_wall.controller.settings.config import Config

LOOK_S = 0.01
"""Period of the checks whether the wall may come on [s]"""


class WallWait:
    """Serves ticks without torque until the wall may come on.

    Args:
        loop: The running loop.
        config: The effective configuration.
        tell: Called with the positions of wall and shaft, and where the shaft must go.

    Attributes:
        waited_for: The last unmet condition; empty: there was none.
        over: The wall may have come on.
    """

    def __init__(self, loop: Loop, config: Config, tell: Callable[[str], None]) -> None:
        self._loop = loop
        (self._axis,) = loop.cycle.axes
        self._config = config
        self._tell = tell
        self.waited_for = ""
        self.over = False

    def __call__(self, most_s: float | None) -> StopReason | None:
        """Serve deadlines until the wall may come on; return why that did not happen, or None.

        Args:
            most_s: Longest wait [s]; None: for ever.
        """
        cycle = self._loop.cycle
        known = self._tell_start()
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
            known = known or self._tell_start()
        self.over = True
        return None

    def lacking(self) -> str:
        """Return the unmet condition of a wall that was never on; empty: none, or stopped before.

        The shaft may have moved on in the tick in which the wall was to come on.
        """
        if self._axis.came_on:
            return ""
        return self._reason()[1] if self.over else self.waited_for

    def _tell_start(self) -> bool:
        """Report the positions of wall and shaft; return whether they are known."""
        config, axis = self._config, self._axis
        law, position = axis.law, axis.position
        if math.isnan(position) and config.servo.kind == "simulated" and not axis.wall_from_start:
            position = config.start_position  # no reading yet, and no torque has moved it
        if math.isnan(position):
            return False
        if law.guarded:
            stiffness = axis.gains.schedule.allowed.stiffness
            felt = felt_text(stiffness, config.belief().coulomb.value) if law.linear else ""
            self._tell(start_text(law, config.wall.acting_side, position) + felt)
        return True

    def _reason(self) -> tuple[str, str]:
        """Return the unmet condition: a name, and a text for people."""
        axis = self._axis
        if math.isnan(axis.position):
            return "reading", "the wall waits for the first reading"
        if not self._loop.cycle.held():
            return "dead man", "the dead man is not held; the wall comes on when it is"
        stiffness = axis.gains.schedule.allowed.stiffness
        room = axis.engagement.limits.room(stiffness)
        text = waiting_text(
            axis.law,
            self._config.wall.acting_side,
            axis.position,
            stiffness,
            room,
            axis.torque_limit,
        )
        return "place", text
