"""The backend of a servo simulated in the loop's own process."""

from __future__ import annotations

from haptic_wall.hw.backend import Backend
from haptic_wall.hw.clock import Clock
from haptic_wall.hw.servo import Bus
from haptic_wall.hw.settings import ServoSettings


def _open(settings: ServoSettings, clock: Clock, _descriptor: int | None) -> Bus:
    from haptic_wall.hw.simulated import SimulatedBus

    if settings.true is None:
        raise ValueError("found None in ServoSettings.true, wanted the truth of the servo")
    return SimulatedBus([settings.true], clock)


BACKEND = Backend(open=_open, simulated=True, cut_torque=lambda *_: True)
