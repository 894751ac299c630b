"""A bus of one servo, without lists."""

from __future__ import annotations

from typing import Any

from haptic_wall.hw.dynamixel.driven import Driven
from haptic_wall.hw.dynamixel.group import DynamixelGroup
from haptic_wall.hw.serialport.line import Line
from haptic_wall.hw.servo import Bus, BusCounts, Check, Facts, Reading
from haptic_wall.hw.settings import DriverSettings


class OneServo:
    """The only servo of a bus; what it does not define is the bus's."""

    def __init__(self, bus: Bus) -> None:
        self.bus = bus

    @classmethod
    def driven(cls, settings: DriverSettings, line: Line) -> OneServo:
        """The servo on a line, by its driver."""
        return cls(DynamixelGroup([settings], line))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.bus, name)

    @property
    def facts(self) -> Facts:
        return self.bus.facts[0]

    @property
    def counts(self) -> BusCounts:
        assert self.bus.traffic is not None
        return self.bus.traffic.counts[0]

    @property
    def one(self) -> Driven:
        assert isinstance(self.bus, DynamixelGroup)
        return self.bus.servos[0]

    def start(self) -> list[Check]:
        return self.bus.start()[0]

    def collect(self, deadline_ns: int) -> Reading:
        return self.bus.collect(deadline_ns)[0]

    def write(self, torque: float) -> float:
        return self.bus.write([torque])[0]

    def health(self) -> tuple[float, float]:
        return self.bus.health()[0]
