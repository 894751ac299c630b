"""One frame: its numbers, its checksum, its stuffing, its bytes.

Frames on the wire are
``FF FF FD 00 | id | length (2) | instruction | parameters ... | CRC (2)``, little endian;
the length counts everything behind itself.

Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0".
"""

from __future__ import annotations

from enum import IntEnum
from functools import cache
from struct import Struct
from typing import Final, NamedTuple

BROADCAST: Final = 0xFE
MAX_ID: Final = 252
MAX_LENGTH: Final = 2048
"""Longest believable length field: more is taken for garbage, so a broken length cannot make the
parser wait for 64 kB (a whole control table is 662 bytes)."""

HEADER: Final = b"\xff\xff\xfd\x00"
MARK: Final = b"\xff\xff\xfd"
STUFFED: Final = b"\xff\xff\xfd\xfd"
PREAMBLE: Final = 7
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


def _crc_table() -> tuple[int, ...]:
    """The checksum of every two bytes; of the last one alone where the first is 0."""
    last = []
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ (0x8005 if crc & 0x8000 else 0)
        last.append(crc & 0xFFFF)
    first = [(crc & 0xFF) << 8 ^ last[crc >> 8] for crc in last]
    return tuple([high ^ low for high in first for low in last])


_CRC_TABLE: Final = _crc_table()


@cache
def _words(count: int) -> Struct:
    return Struct(f">{count}H")


def crc16(data: bytes | bytearray | memoryview, crc: int = 0) -> int:
    """Checksum of a frame: polynomial 0x8005, most significant bit first, no reflection.

    Two bytes at a time: it is the largest part of what a long reply costs.

    Args:
        data: The bytes.
        crc: Checksum of what came before; 0 at the start.
    """
    table = _CRC_TABLE
    size = len(data)
    for word in _words(size >> 1).unpack_from(data):
        crc = table[crc ^ word]
    if size & 1:
        crc = ((crc & 0xFF) << 8) ^ table[(crc >> 8) ^ data[-1]]
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


def _frame(id: int, body: bytes) -> bytes:  # noqa: A002
    if not (0 <= id <= MAX_ID or id == BROADCAST):
        raise ValueError(f"id {id} is none: wanted 0 to {MAX_ID}, or {BROADCAST} for all")
    body = body.replace(MARK, STUFFED)
    length = len(body) + 2
    if length > MAX_LENGTH:
        raise ValueError(f"{length} bytes do not fit in a frame of {MAX_LENGTH}")
    frame = HEADER + bytes((id, length & 0xFF, length >> 8)) + body
    return frame + crc16(frame).to_bytes(2, "little")


def decode(frame: bytes) -> Frame | None:
    """A whole frame whose CRC holds; None for a reply too short to hold its error byte."""
    id_, body = frame[4], frame[PREAMBLE:-2]
    fast = id_ == BROADCAST and body[0] == Instruction.STATUS
    if MARK in body and not fast:
        body = body.replace(STUFFED, MARK)
    if body[0] != Instruction.STATUS:
        return Frame(id_, body[0], 0, body[1:])
    return Frame(id_, Instruction.STATUS, body[1], body[2:]) if len(body) > 1 else None
