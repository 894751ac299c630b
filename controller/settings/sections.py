"""The sections of a configuration as one object, each section valid by itself."""

from __future__ import annotations

from haptic_wall.controller.settings.model import (
    Delay,
    Guard,
    Loop,
    Model,
    Realtime,
    Safety,
    Section,
    Wall,
)
from haptic_wall.controller.settings.servo import Servo


class Sections(Section):
    """All sections; the rules between fields read it."""

    loop: Loop = Loop()
    realtime: Realtime = Realtime()
    wall: Wall = Wall()
    delay: Delay = Delay()
    guard: Guard = Guard()
    servo: Servo = Servo()
    model: Model = Model()
    safety: Safety = Safety()

    @property
    def period_s(self) -> float:
        """Return the sampling period T [s]."""
        return 1.0 / self.loop.rate_hz
