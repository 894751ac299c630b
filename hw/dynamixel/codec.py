"""Dynamixel Protocol 2.0 as pure functions: bytes to frames and back, no port and no clock.

Shared by the driver and the emulated bus. Frames on the wire are
``FF FF FD 00 | id | length (2) | instruction | parameters ... | CRC (2)``, little endian;
the length counts everything behind itself.

Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0".
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum
from typing import Final, NamedTuple

BROADCAST: Final = 0xFE
MAX_ID: Final = 252
MAX_LENGTH: Final = 2048
"""Longest believable length field: more is taken for garbage, so a broken length cannot make the
parser wait for 64 kB (a whole control table is 662 bytes)."""

_HEADER: Final = b"\xff\xff\xfd\x00"
_MARK: Final = b"\xff\xff\xfd"
_STUFFED: Final = b"\xff\xff\xfd\xfd"
_PREAMBLE: Final = 7
"""Bytes before the instruction: header, id, length."""


class Instruction(IntEnum):
    """What a frame asks for, or that it is a reply (``STATUS``)."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    CONTROL_TABLE_BACKUP = 0x20
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93
    FAST_BULK_READ = 0x9A


class ErrorCode(IntEnum):
    """Why a servo refused, in the low seven bits of a reply's error byte."""

    NONE = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


ALERT: Final = 0x80
"""Bit of the error byte: a hardware error is latched; the reply's data is still valid."""


class Frame(NamedTuple):
    """One frame off the wire."""

    id: int
    instruction: int
    error: int
    """The error byte of a reply; 0 for an instruction, except ``ErrorCode.CRC`` where the parser
    was asked to report what failed its CRC."""
    params: bytes
    """Un-stuffed, without the error byte of a reply."""


class FastReply(NamedTuple):
    """One servo's share of a fast sync read reply."""

    id: int
    error: int
    data: bytes


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ (0x8005 if crc & 0x8000 else 0)
        table.append(crc & 0xFFFF)
    return tuple(table)


_CRC_TABLE: Final = _crc_table()


def crc16(data: bytes | bytearray | memoryview, crc: int = 0) -> int:
    """Checksum of a frame: polynomial 0x8005, most significant bit first, no reflection.

    Args:
        data: The bytes.
        crc: Checksum of what came before; 0 at the start.
    """
    table = _CRC_TABLE
    for byte in data:
        crc = ((crc & 0xFF) << 8) ^ table[(crc >> 8) ^ byte]
    return crc


def encode(id: int, instruction: int, params: bytes = b"") -> bytes:  # noqa: A002
    """An instruction frame, stuffed and with its CRC.

    Raises:
        ValueError: The id is not one (0 to 252, 254), or the parameters do not fit in a frame.
    """
    return _frame(id, bytes((instruction,)) + params)


def encode_status(id: int, error: int, params: bytes = b"") -> bytes:  # noqa: A002
    """A reply, stuffed and with its CRC.

    Raises:
        ValueError: The id is not one (0 to 252, 254), or the parameters do not fit in a frame.
    """
    return _frame(id, bytes((Instruction.STATUS, error)) + params)


def encode_fast_status(replies: Iterable[FastReply]) -> bytes:
    """The joint reply to a fast sync read, as if every servo had appended its share.

    Never stuffed; each share ends with the CRC of everything before it.

    Raises:
        ValueError: The replies do not fit in a frame.
    """
    items = list(replies)
    length = 1 + sum(len(item.data) + 4 for item in items)
    if length > MAX_LENGTH:
        raise ValueError(f"a reply of {length} bytes does not fit in a frame of {MAX_LENGTH}")
    frame = bytearray(_HEADER)
    frame += bytes((BROADCAST, length & 0xFF, length >> 8, Instruction.STATUS))
    crc = crc16(frame)
    for item in items:
        share = bytes((item.error, item.id)) + item.data
        crc = crc16(share, crc)
        share += crc.to_bytes(2, "little")
        frame += share
        crc = crc16(share[-2:], crc)
    return bytes(frame)


def decode_fast_status(frame: Frame, size: int) -> list[FastReply]:
    """Each servo's share of a fast sync read reply.

    The frame's last CRC, which the parser has checked, covers all of them.

    Args:
        frame: A reply from the broadcast id.
        size: Bytes asked of each servo.

    Returns:
        The shares in the order asked for; empty when this is not such a reply.
    """
    block = size + 4
    count, rest = divmod(len(frame.params) + 3, block)
    if frame.id != BROADCAST or frame.instruction != Instruction.STATUS or rest or not count:
        return []
    shares = bytes((frame.error,)) + frame.params
    return [
        FastReply(shares[at + 1], shares[at], shares[at + 2 : at + 2 + size])
        for at in range(0, count * block, block)
    ]


class ExpectedReply:
    """Recognises the one reply that a cyclic request should get, in half the time of a search.

    Args:
        id: Of the servo asked.
        size: Bytes of data asked for.
    """

    __slots__ = ("_crc", "_prefix", "_size")

    def __init__(self, id: int, size: int) -> None:  # noqa: A002
        length = size + 4
        self._prefix = _HEADER + bytes((id, length & 0xFF, length >> 8, Instruction.STATUS))
        self._size = len(self._prefix) + length - 1
        self._crc = crc16(self._prefix)

    def match(self, data: bytes) -> Frame | None:
        """The reply, if ``data`` is just that; None for whatever needs a ``Parser``."""
        prefix = self._prefix
        if len(data) != self._size or not data.startswith(prefix):
            return None
        body = data[8:-2]
        if _MARK in body or crc16(body, self._crc) != data[-2] | data[-1] << 8:
            return None
        return Frame(prefix[4], Instruction.STATUS, body[0], body[1:])


class Parser:
    """Finds frames in a stream of bytes, however it is cut, and whatever lies between them.

    A broken frame costs itself alone: after a wrong CRC the search goes on right behind its
    header, and a frame that is cut short is given up as soon as the next header is seen.
    """

    __slots__ = ("_buffer", "_report_crc", "_skipping", "corrupt")

    def __init__(self, *, report_crc: bool = False) -> None:
        """Start with nothing received.

        Args:
            report_crc: Return a frame that fails its CRC too, with ``ErrorCode.CRC`` as its error
                and no parameters (a servo answers those).
        """
        self._buffer = bytearray()
        self._report_crc = report_crc
        self._skipping = False
        self.corrupt = 0
        """Frames with a wrong CRC, frames cut short, and runs of bytes that belong to none."""

    @property
    def idle(self) -> bool:
        """Whether nothing of a frame is waiting for its rest."""
        return not self._buffer and not self._skipping

    def reset(self) -> None:
        """Forget a frame that has come in part only. Does not count as corrupt."""
        self._buffer.clear()
        self._skipping = False

    def feed(self, data: bytes) -> list[Frame]:
        """Take in bytes; the frames they complete, in order."""
        buffer = self._buffer
        buffer += data
        frames: list[Frame] = []
        at = 0
        size = len(buffer)
        while True:
            start = buffer.find(_HEADER, at)
            if start < 0:
                start = size - _header_prefix(buffer, at)
                self._skip(start - at)
                at = start
                break
            self._skip(start - at)
            at = start
            if size - start < _PREAMBLE:
                break
            length = buffer[start + 5] | buffer[start + 6] << 8
            if not 3 <= length <= MAX_LENGTH or buffer[start + 4] > BROADCAST:
                at = self._reject(start)
                continue
            end = start + _PREAMBLE + length
            if end > size:
                if self._cut_short(start):
                    at = self._reject(start)
                    continue
                break
            frame = bytes(buffer[start:end])
            if crc16(frame[:-2]) != frame[-2] | frame[-1] << 8:
                if self._report_crc:
                    frames.append(Frame(frame[4], frame[7], ErrorCode.CRC, b""))
                at = self._reject(start)
                continue
            decoded = _decode(frame)
            if decoded is None:
                at = self._reject(start)
                continue
            frames.append(decoded)
            self._skipping = False
            at = end
        del buffer[:at]
        return frames

    def _skip(self, count: int) -> None:
        """Count a run of garbage once; what follows a rejected header was counted with it."""
        if count and not self._skipping:
            self.corrupt += 1
            self._skipping = True

    def _reject(self, start: int) -> int:
        """Count the frame at ``start`` as broken; where to search on."""
        self.corrupt += 1
        self._skipping = True
        return start + len(_HEADER)

    def _cut_short(self, start: int) -> bool:
        """Whether the incomplete frame at ``start`` will never be completed.

        Stuffing keeps headers out of frames, so a further one means the sender began anew. A fast
        sync read reply is not stuffed and may hold one.
        """
        buffer = self._buffer
        if len(buffer) > start + _PREAMBLE and (
            buffer[start + 4] == BROADCAST and buffer[start + 7] == Instruction.STATUS
        ):
            return False
        return buffer.find(_HEADER, start + len(_HEADER)) >= 0


def _frame(id: int, body: bytes) -> bytes:  # noqa: A002
    if not (0 <= id <= MAX_ID or id == BROADCAST):
        raise ValueError(f"id {id} is none: wanted 0 to {MAX_ID}, or {BROADCAST} for all")
    body = body.replace(_MARK, _STUFFED)
    length = len(body) + 2
    if length > MAX_LENGTH:
        raise ValueError(f"{length} bytes do not fit in a frame of {MAX_LENGTH}")
    frame = _HEADER + bytes((id, length & 0xFF, length >> 8)) + body
    return frame + crc16(frame).to_bytes(2, "little")


def _decode(frame: bytes) -> Frame | None:
    """A whole frame whose CRC holds; None for a reply too short to hold its error byte."""
    id_, instruction = frame[4], frame[7]
    if instruction != Instruction.STATUS:
        params = frame[8:-2]
        if _MARK in params:
            params = params.replace(_STUFFED, _MARK)
        return Frame(id_, instruction, 0, params)
    if len(frame) < _PREAMBLE + 4:
        return None
    params = frame[9:-2]
    if id_ != BROADCAST and _MARK in params:
        params = params.replace(_STUFFED, _MARK)
    return Frame(id_, instruction, frame[8], params)


def _header_prefix(buffer: bytearray, at: int) -> int:
    """How many bytes at the end of ``buffer[at:]`` may be the beginning of a header."""
    for count in (3, 2, 1):
        if len(buffer) - at >= count and buffer.endswith(_HEADER[:count]):
            return count
    return 0
