"""Drives one Dynamixel servo: a group of one."""

from __future__ import annotations

from haptic_wall.hw.dynamixel.group import DynamixelGroup
from haptic_wall.hw.serialport.line import Line
from haptic_wall.hw.servo import Bus, Check, Facts, Reading
from haptic_wall.hw.settings import DriverSettings


class DynamixelServo:
    """Driver of one servo on a line, real or emulated; see ``Servo`` for its methods.

    After ``start`` the servo needs an instruction within every Bus Watchdog period; otherwise it
    drops its torque and silently refuses goals. ``request`` detects such a pause, and may wait
    then: it arms the watchdog again if that tripped while the torque was zero.

    Args:
        settings: Its settings.
        line: The bus; ``close`` closes it. Nothing is sent yet.

    Raises:
        UnfitServoError: The model is unknown, has no current control, or its smallest torque
            exceeds the torque limit.
    """

    facts: Facts
    bus: Bus
    trouble: str
    """See ``HasTrouble``"""

    def __init__(self, settings: DriverSettings, line: Line) -> None:
        self._settings = settings
        self._group = DynamixelGroup([settings], line)
        (self._one,) = self._group.servos
        self._send = self._group.exchange.send
        self.facts, self.bus, self.trouble = self._one.facts, self._one.bus, ""

    def start(self) -> list[Check]:
        """Check and set up the servo, then switch the torque on at a goal of zero.

        Raises:
            StrangeServoError: It is of no known model; nothing was written.
        """
        self.trouble = ""
        (checks,) = self._group.start()
        self.facts = self._one.facts
        return checks

    def request(self) -> None:
        """Request the position; see ``Servo``.

        Raises:
            ServoLostError: The port is gone.
            TorqueLostError: The Bus Watchdog has ended a torque.
        """
        self._group.request()

    def collect(self, deadline_ns: int) -> Reading:
        """Return the reply to the last ``request``; see ``Servo``."""
        return self._group.collect(deadline_ns)[0]

    def write(self, torque: float) -> float:
        """Send a torque [N·m], limited and rounded to the servo's current unit.

        A servo that senses its supply current gives this torque only at a standstill: it gives less
        when it moves with the torque, more when it moves against it.
        """
        one = self._one
        goal = one.goal_of(torque)
        self._send((goal,))
        return one.law.torque(goal)

    def stop(self) -> bool:
        """Send zero torque, switch torque off and return whether that was read back.

        If no known model has replied, nothing was written, and it was not.
        """
        off = self._group.stop()
        self.trouble = self._one.trouble
        return off

    def close(self) -> None:
        """Stop the servo if it was started and not stopped, and close the line."""
        self._group.close()

    def health(self) -> tuple[float, float]:
        """Return the last known supply [V] and temperature [°C]; see ``HasHealth``."""
        last = self._one.health.last
        return last["supply"] / 10, float(last["temperature"])
