"""Simulates the USB adapter between wire and host: its latency timer and its blocks.

Bytes gather in the adapter until a block is full or the timer expires. The timer measures the time
since bytes were last sent to the host, and restarts whenever it expires, even with nothing to send.
While replies are short its expiries therefore lie on a fixed grid. The waiting time of a reply
depends on its place in the grid, not on the time of the request.

Not modelled: the host's polling of the USB bus (every 1 ms on full-speed, 125 µs on high-speed
parts), which adds to the wait, and the drift of the adapter's clock against the host's, which moves
the grid slowly through all phases.

Source: FTDI, application note AN232B-04, "Small Amounts of Data and End of Buffer Conditions".
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from haptic_wall.hw.dynamixel.wire import BYTE_AT_ONE_BAUD_NS, wire_ns

BLOCKS = (62, 510)
"""User bytes of a full USB packet, on full-speed and on high-speed parts"""


class _Stretch(NamedTuple):
    """Consecutive bytes that reach the adapter, from the ``first`` one still there."""

    start_ns: int
    baud: int
    data: bytes
    first: int = 0

    def arrived_ns(self, index: int) -> int:
        """Return when that byte has arrived [ns]."""
        return self.start_ns + wire_ns(index + 1, self.baud)

    def through(self, now_ns: int) -> int:
        """Return how many bytes have arrived at ``now_ns`` [ns], those handed over included."""
        passed_ns = max(0, now_ns - self.start_ns)
        count = ((passed_ns + 1) * self.baud - 1) // BYTE_AT_ONE_BAUD_NS
        return max(self.first, min(count, len(self.data)))


class Adapter:
    """Buffers bytes on their way to the host.

    Args:
        timer_ns: The latency timer [ns]; 0: none, each reply is handed over when it is complete.
        block: Number of bytes that are handed over without waiting for the timer.
        start_ns: Start of the timer [ns]; it sets the phase of the grid of expiries.
    """

    def __init__(self, timer_ns: int, block: int, start_ns: int) -> None:
        self._timer_ns = timer_ns
        self._block = block
        self._sent_ns = start_ns
        """When bytes were last handed over"""
        self._stretches: deque[_Stretch] = deque()
        self._full_ns = start_ns
        """Arrival of the last known byte"""

    @property
    def holds(self) -> bool:
        """Whether bytes are on their way to the host."""
        return bool(self._stretches)

    def put(self, data: bytes, start_ns: int, baud: int) -> None:
        """Let bytes arrive from ``start_ns`` [ns] on, but after the bytes before them."""
        stretch = _Stretch(max(start_ns, self._full_ns), baud, data)
        self._stretches.append(stretch)
        self._full_ns = stretch.arrived_ns(len(data) - 1)

    def next_ns(self) -> int | None:
        """Return when the next bytes are handed over [ns]; None: there are none."""
        if not self._stretches:
            return None
        first = self._stretches[0]
        if not self._timer_ns:
            return first.arrived_ns(len(first.data) - 1)
        periods = max(1, -((self._sent_ns - first.arrived_ns(first.first)) // self._timer_ns))
        expiry_ns = self._sent_ns + periods * self._timer_ns
        full_ns = self._block_ns()
        return expiry_ns if full_ns is None else min(expiry_ns, full_ns)

    def take(self, now_ns: int) -> bytes:
        """Return the bytes handed over by ``now_ns`` [ns] since the last call."""
        taken = b""
        while (time_ns := self.next_ns()) is not None and time_ns <= now_ns:
            taken += self._hand_over(time_ns)
        return taken

    def truncate(self, now_ns: int) -> None:
        """Stop the sender at ``now_ns`` [ns]: bytes that have not arrived are lost."""
        heard = [
            stretch._replace(data=stretch.data[: stretch.through(now_ns)])
            for stretch in self._stretches
        ]
        self._stretches = deque(stretch for stretch in heard if len(stretch.data) > stretch.first)
        self._full_ns = now_ns

    def clear(self) -> None:
        """Lose all bytes."""
        self._stretches.clear()

    def _block_ns(self) -> int | None:
        """Return when a block will be full [ns]; None: not with the known bytes."""
        wanted = self._block
        for stretch in self._stretches:
            here = len(stretch.data) - stretch.first
            if wanted <= here:
                return stretch.arrived_ns(stretch.first + wanted - 1)
            wanted -= here
        return None

    def _hand_over(self, time_ns: int) -> bytes:
        self._sent_ns = time_ns
        stretches = self._stretches
        if not self._timer_ns:
            return stretches.popleft().data
        given = b""
        while stretches and len(given) < self._block:
            stretch = stretches[0]
            end = min(stretch.through(time_ns), stretch.first + self._block - len(given))
            given += stretch.data[stretch.first : end]
            if end < len(stretch.data):
                stretches[0] = stretch._replace(first=end)
                break
            stretches.popleft()
        return given
