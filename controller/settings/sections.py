"""The sections of a configuration side by side, each valid by itself."""

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
    """All sections: what the rules between fields read."""

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
        """The sampling period T [s]."""
        return 1.0 / self.loop.rate_hz
