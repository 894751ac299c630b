"""A port for dynamixel-sdk on a line and its clock."""

from __future__ import annotations

from dynamixel_sdk import PortHandler

from haptic_wall.hw.dynamixel.wire import READ_REQUEST_BYTES, wire_ns
from haptic_wall.hw.serialport.line import Line

_PATIENCE_NS = 3_000_000


class LinePort(PortHandler):  # type: ignore[misc]  # the SDK has no types
    """The SDK's port; the names are the SDK's."""

    def __init__(self, line: Line, baud: int) -> None:
        super().__init__("")
        self.baudrate = baud
        self._line = line
        self._arrived = bytearray()
        self._deadline_ns = 0

    def clearPort(self) -> None:  # noqa: N802
        self._line.read()
        self._arrived.clear()

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        self._line.write(bytes(packet))
        return len(packet)

    def readPort(self, length: int) -> bytes:  # noqa: N802
        if len(self._arrived) < length and self._line.wait(self._deadline_ns):
            self._arrived += self._line.read()
        taken = bytes(self._arrived[:length])
        del self._arrived[:length]
        return taken

    def setPacketTimeout(self, packet_length: int) -> None:  # noqa: N802
        busy_ns = wire_ns(packet_length + READ_REQUEST_BYTES, self.baudrate)
        self._deadline_ns = self._line.clock.now_ns() + busy_ns + _PATIENCE_NS

    def setPacketTimeoutMillis(self, msec: float) -> None:  # noqa: N802
        self._deadline_ns = self._line.clock.now_ns() + int(msec * 1e6)

    def isPacketTimeout(self) -> bool:  # noqa: N802
        return self._line.clock.now_ns() >= self._deadline_ns
