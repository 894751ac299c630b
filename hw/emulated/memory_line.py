"""A line in memory to an emulated bus, on the simulated clock: no processes, no waiting."""

from __future__ import annotations

from haptic_wall.hw.clock import SimulatedClock
from haptic_wall.hw.emulated.bus import EmulatedBus
from haptic_wall.hw.errors import PortLostError


class MemoryLine:
    """A line to an emulated bus. Bytes, times and motion are deterministic.

    Time passes only in ``wait``: up to the next reply, or to the deadline. After the adapter was
    unplugged the line is dead, like a serial port, even if it is plugged in again: make another.

    Args:
        bus: The bus, begun at the clock's present time.
        clock: The simulated clock.
    """

    def __init__(self, bus: EmulatedBus, clock: SimulatedClock) -> None:
        self.bus = bus
        self.clock = clock
        self._arrived = b""
        self._times_unplugged = bus.times_unplugged

    def write(self, data: bytes) -> None:
        """Send ``data`` from the present time on."""
        self._check()
        self.bus.receive(data, self.clock.now_ns())
        self._check()

    def read(self) -> bytes:
        """Return the bytes that have arrived."""
        data = self._arrived + self.bus.transmit(self.clock.now_ns())
        self._check()
        self._arrived = b""
        return data

    def wait(self, deadline_ns: int) -> bool:
        """Let time pass until bytes arrive, or ``deadline_ns`` [ns]; return whether any have."""
        while True:
            now_ns = self.clock.now_ns()
            self._arrived += self.bus.transmit(now_ns)
            self._check()
            if self._arrived or now_ns >= deadline_ns:
                return bool(self._arrived)
            event_ns = self.bus.next_event_ns(deadline_ns)
            self.clock.wait_until(deadline_ns if event_ns is None else min(event_ns, deadline_ns))

    def close(self) -> None:
        """Do nothing: the line holds no resource."""

    def _check(self) -> None:
        if self.bus.times_unplugged != self._times_unplugged or not self.bus.connected:
            raise PortLostError(
                "The serial port is gone (the emulated adapter was unplugged)",
                advice="plug it in, then open it again.",
            )
