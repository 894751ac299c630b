"""A cycle's bytes and times are those of what the driver puts on a line and is answered."""

from __future__ import annotations

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.dynamixel.exchange import Exchange
from haptic_wall.hw.dynamixel.wire import (
    CYCLE_BYTES,
    EMPTY_REPLY_BYTES,
    READ_REQUEST_BYTES,
)
from tests.hw.dynamixel.lines import MS, ClockLine


class CountingLine(ClockLine):
    """Counts bytes, both ways."""

    sent = 0
    heard = 0

    def write(self, data: bytes) -> None:
        self.sent += len(data)
        super().write(data)

    def read(self) -> bytes:
        data = super().read()
        self.heard += len(data)
        return data


def test_a_cycle_is_what_the_driver_sends_and_hears() -> None:
    line = CountingLine(SimulatedClock(start_ns=1_000 * MS))
    exchange = Exchange(line, [1])
    exchange.request()
    exchange.collect(line.clock.now_ns() + MS)
    assert (line.sent, line.heard) == (READ_REQUEST_BYTES, EMPTY_REPLY_BYTES + 16)
    exchange.send((-3,))
    assert line.sent + line.heard == CYCLE_BYTES
