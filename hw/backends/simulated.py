"""The backend of servos simulated in the loop's own process."""

from __future__ import annotations

from collections.abc import Sequence

from haptic_wall.hw.backend import Backend
from haptic_wall.hw.clock import Clock
from haptic_wall.hw.servo import Bus
from haptic_wall.hw.settings import ServoSettings


def _open(servos: Sequence[ServoSettings], clock: Clock, _descriptor: int | None) -> Bus:
    from haptic_wall.hw.simulated import SimulatedBus

    trues = [one.true for one in servos if one.true is not None]
    if len(trues) < len(servos):
        raise ValueError("found None in ServoSettings.true, wanted the truth of the servo")
    return SimulatedBus(trues, clock, servos[0].arm)


BACKEND = Backend(open=_open, simulated=True)
