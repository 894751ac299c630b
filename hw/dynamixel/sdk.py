"""Sets a servo up with dynamixel-sdk: ping, registers and reboot, over any line and clock.

The SDK is used for set-up only, because it flushes received bytes before each transmission, so that
no request can be in flight. This module corrects three of its faults. Its port waits 34 ms for a
lost reply, spinning, on the wall clock: ``LinePort`` waits on the line's own clock, asleep, and not
much longer than the reply takes. It returns 0 after a failed read: ``Sdk`` raises.

It takes any status of the servo for the answer, and a checksum's byte for the value if the status
is too short: ``_Packets`` accepts only one of the expected length.

It also does not stuff what it sends and may lose a byte un-stuffing what it receives. Neither can
happen in registers of one or two bytes, and no others are accepted.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from dynamixel_sdk import COMM_SUCCESS, PortHandler, Protocol2PacketHandler

from haptic_wall.hw.dynamixel.line import Line
from haptic_wall.hw.dynamixel.tables import Register
from haptic_wall.hw.dynamixel.wire import READ_REQUEST_BYTES, wire_ns
from haptic_wall.hw.errors import Problem, ServoLostError, ServoMissingError, UnfitServoError

_PATIENCE_NS: Final = 3_000_000
"""Time allowed beyond the bytes' own: the servo's return delay (0.5 ms) and the adapter's hold (1
ms)"""
_LAST_PATIENCE_NS: Final = 40_000_000
"""For the last attempt: with an adapter at its 16 ms timer the cause must be named"""
_SILENCE_NS: Final = 20_000_000
"""Silence after which no reply is under way: more than an adapter's 16 ms timer"""
_SETTLE_END_NS: Final = 200_000_000
"""Longest wait for a silence"""
_ATTEMPTS: Final = 3
_ALERT: Final = 0x80
_PING_BYTES: Final = 3
"""Data of a reply to a ping: model number and firmware"""
_LENGTH_BESIDE_DATA: Final = 4
"""Length of a status without its data: instruction, error, checksum"""


class LinePort(PortHandler):  # type: ignore[misc]  # the SDK has no types
    """The SDK's port on a line. The names are the SDK's."""

    def __init__(self, line: Line, baud: int) -> None:
        super().__init__("")
        self.baudrate = baud
        self.patience_ns = _PATIENCE_NS
        self._line = line
        self._arrived = bytearray()
        self._deadline_ns = 0

    def clearPort(self) -> None:  # noqa: N802
        """Drop what has arrived; the SDK calls this before each transmission."""
        self._line.read()
        self._arrived.clear()

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        """Send a packet; the number of bytes sent."""
        self._line.write(bytes(packet))
        return len(packet)

    def readPort(self, length: int) -> bytes:  # noqa: N802
        """Up to ``length`` bytes, waiting for the first until the packet's time is up."""
        if len(self._arrived) < length and self._line.wait(self._deadline_ns):
            self._arrived += self._line.read()
        taken = bytes(self._arrived[:length])
        del self._arrived[:length]
        return taken

    def setPacketTimeout(self, packet_length: int) -> None:  # noqa: N802
        """Start waiting for ``packet_length`` bytes; the request may still be on the wire."""
        busy_ns = wire_ns(packet_length + READ_REQUEST_BYTES, self.baudrate)
        self._deadline_ns = self._line.clock.now_ns() + busy_ns + self.patience_ns

    def setPacketTimeoutMillis(self, msec: float) -> None:  # noqa: N802
        """Start waiting for ``msec`` milliseconds."""
        self._deadline_ns = self._line.clock.now_ns() + int(msec * 1e6)

    def isPacketTimeout(self) -> bool:  # noqa: N802
        """Whether the packet's time is up."""
        return self._line.clock.now_ns() >= self._deadline_ns

    def settle(self) -> None:
        """Let a late reply pass, so that it is not taken for the answer to another request."""
        now_ns = self._line.clock.now_ns
        end = now_ns() + _SETTLE_END_NS
        while self._line.wait(min(now_ns() + _SILENCE_NS, end)) and now_ns() < end:
            self._line.read()


class _Packets(Protocol2PacketHandler):  # type: ignore[misc]  # the SDK has no types
    """The SDK's protocol, passing over replies that cannot answer the question."""

    def __init__(self) -> None:
        super().__init__()
        self._wanted = 0
        self._other: int | None = None
        """Bytes of data in the last ignored reply"""

    def expect(self, size: int) -> None:
        """Set the expected bytes of data in the next answer."""
        self._wanted = size
        self._other = None

    def rxPacket(self, port: LinePort, fast_option: bool) -> tuple[list[int], int]:  # noqa: N802
        """Return the next status with the expected data or a refusal, with the SDK's result."""
        while True:
            packet, result = super().rxPacket(port, fast_option)
            if result != COMM_SUCCESS:
                return packet, result
            size = packet[5] + (packet[6] << 8) - _LENGTH_BESIDE_DATA
            if size == self._wanted or packet[8] & ~_ALERT:
                return packet, result
            self._other = size

    def what_came(self, result: int) -> str:
        """Describe the result of the last request, for people."""
        if self._other is not None:
            return f"a reply with {self._other} bytes of data came, {self._wanted} wanted"
        text: str = self.getTxRxResult(result)
        return text.removeprefix("[TxRxResult] ").rstrip("!")


class Sdk:
    """One servo's registers, through the SDK. Every failure raises; nothing reads as 0."""

    def __init__(self, line: Line, baud: int, servo_id: int, where: str) -> None:
        """Use ``line`` for one servo.

        Args:
            line: The bus.
            baud: Its rate [bit/s], for the time of a reply.
            servo_id: The servo.
            where: Names the bus in messages, e.g. the port's path.
        """
        self._port = LinePort(line, baud)
        self._packets = _Packets()
        self._id = servo_id
        self._name = f"id {servo_id} at {baud} baud on {where}"

    def ping(self) -> int:
        """Return the servo's model number.

        Raises:
            ServoMissingError: No reply.
            UnfitServoError: The servo refuses.
        """
        for last in _attempts():
            self._prepare(last, _PING_BYTES)
            number, result, error = self._packets.ping(self._port, self._id)
            if result == COMM_SUCCESS:
                self._refuse_error(error, "a ping")
                return int(number)
            self._port.settle()
        raise ServoMissingError(
            f"No servo answers as {self._name} ({self._packets.what_came(result)})",
            advice="check its power and cable, and that servo.id and servo.baud are the servo's"
            " own.",
        )

    def read(self, register: Register) -> int:
        """Return the value of a register of one or two bytes.

        Raises:
            ServoLostError: No reply, though it replied before.
            UnfitServoError: The servo refuses.
        """
        size = _small(register)
        for last in _attempts():
            self._prepare(last, size)
            data, result, error = self._packets.readTxRx(
                self._port, self._id, register.address, size
            )
            if result == COMM_SUCCESS:
                self._refuse_error(error, f"to read {_label(register)}")
                return register.decode(bytes(data))
            self._port.settle()
        raise self._silent(f"{_label(register)} was read", result)

    def write(self, register: Register, value: int) -> None:
        """Write a register of one or two bytes, and wait for the servo's confirmation.

        Raises:
            ServoLostError: No reply, though it replied before.
            UnfitServoError: The servo refuses.
        """
        _small(register)
        data = list(register.encode(value))
        for last in _attempts():
            self._prepare(last)
            result, error = self._packets.writeTxRx(
                self._port, self._id, register.address, len(data), data
            )
            if result == COMM_SUCCESS:
                self._refuse_error(error, f"to write {value} to {_label(register)}")
                return
            self._port.settle()
        raise self._silent(f"{value} was written to {_label(register)}", result)

    def write_unanswered(self, register: Register, value: int) -> None:
        """Write a register without waiting: a servo may be set to confirm nothing."""
        _small(register)
        data = list(register.encode(value))
        self._prepare(last=False)
        self._packets.writeTxOnly(self._port, self._id, register.address, len(data), data)
        self._port.settle()

    def reboot(self) -> None:
        """Restart the servo; it replies again after about a second.

        Raises:
            ServoLostError: No reply, though it replied before.
            UnfitServoError: The servo refuses.
        """
        self._prepare(last=True)
        result, error = self._packets.reboot(self._port, self._id)
        if result != COMM_SUCCESS:
            raise self._silent("the reboot was requested", result)
        self._refuse_error(error, "to reboot")

    def _prepare(self, last: bool, size: int = 0) -> None:
        self._packets.expect(size)
        self._port.is_using = False  # the SDK leaves it set when the port raised
        self._port.patience_ns = _LAST_PATIENCE_NS if last else _PATIENCE_NS

    def _refuse_error(self, error: int, what: str) -> None:
        """Raise for a refusal; a latched hardware error alone is none."""
        error &= ~_ALERT
        if error:
            reason = self._packets.getRxPacketError(error).removeprefix("[RxPacketError] ")
            raise UnfitServoError(
                Problem(
                    f"The servo {self._name} refuses {what}: {reason.rstrip('!.')}",
                    advice="check that it is the configured model and that its torque is off.",
                )
            )

    def _silent(self, what: str, result: int) -> ServoLostError:
        return ServoLostError(
            f"The servo {self._name} answered before, but not when {what} "
            f"({self._packets.what_came(result)})",
            advice="check the cable and for a second servo with this id.",
        )


class Table:
    """A servo's registers by name."""

    def __init__(self, sdk: Sdk, registers: Mapping[str, Register]) -> None:
        """Use ``sdk`` for the registers of one model."""
        self.sdk = sdk
        self.registers = registers

    def read(self, name: str) -> int:
        """Return the value of a register; see ``Sdk.read``."""
        return self.sdk.read(self.registers[name])

    def write(self, name: str, value: int) -> None:
        """Write a register; see ``Sdk.write``."""
        self.sdk.write(self.registers[name], value)

    def label(self, name: str) -> str:
        """Return a register's name and address as in the manual."""
        return _label(self.registers[name])


def _attempts() -> list[bool]:
    """Return for each attempt whether it is the last."""
    return [False] * (_ATTEMPTS - 1) + [True]


def _small(register: Register) -> int:
    if register.size > 2:
        raise ValueError(
            f"{_label(register)} has {register.size} bytes, 1 or 2 wanted: "
            "the SDK may garble longer ones; read them with Link."
        )
    return register.size


def _label(register: Register) -> str:
    """Return name and address as in the manual."""
    return f"{register.name.replace('_', ' ').title()} ({register.address})"
