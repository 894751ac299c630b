"""Drives one Dynamixel servo: a group of one, as a ``Servo``."""

from __future__ import annotations

from haptic_wall.hw.dynamixel.group import DynamixelGroup
from haptic_wall.hw.serialport.line import Line
from haptic_wall.hw.servo import Bus, Check, Facts, Reading
from haptic_wall.hw.settings import DriverSettings


class DynamixelServo:
    """Driver of one servo on a line, real or emulated; see ``Servo`` and ``DynamixelGroup``.

    Args:
        settings: Its settings.
        line: The bus; ``close`` closes it. Nothing is sent yet.

    Raises:
        UnfitServoError: See ``DynamixelGroup``.
    """

    def __init__(self, settings: DriverSettings, line: Line) -> None:
        self._group = group = DynamixelGroup([settings], line)
        (self._one,) = group.servos
        self.request, self.stop, self.close = group.request, group.stop, group.close

    @property
    def facts(self) -> Facts:
        """Return the facts of the servo; some are known after ``start`` only."""
        return self._one.facts

    @property
    def bus(self) -> Bus:
        """Return the bus to it."""
        return self._one.bus

    @property
    def trouble(self) -> str:
        """Return what was wrong with it; see ``HasTrouble``."""
        return self._one.trouble

    def start(self) -> list[Check]:
        """Check and set up the servo; see ``DynamixelGroup``."""
        return self._group.start()[0]

    def collect(self, deadline_ns: int) -> Reading:
        """Return the reply to the last ``request``; see ``Servo``."""
        return self._group.collect(deadline_ns)[0]

    def write(self, torque: float) -> float:
        """Send a torque [N·m]; see ``DynamixelGroup``."""
        return self._group.write((torque,))[0]

    def health(self) -> tuple[float, float]:
        """Return the last known supply [V] and temperature [°C]; see ``HasHealth``."""
        last = self._one.health
        return last["supply"] / 10, float(last["temperature"])
