"""Encodes and decodes one frame of Protocol 2.0: fields, checksum, byte stuffing.

Frames on the wire are
``FF FF FD 00 | id | length (2) | instruction | parameters ... | CRC (2)``, little endian;
the length counts everything after itself.

Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0".
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum
from typing import Final, NamedTuple

from fastcrc.crc16 import umts

BROADCAST: Final = 0xFE
MAX_ID: Final = 252
MAX_LENGTH: Final = 2048
"""Largest length field that the parser accepts, so that a corrupt length does not make it wait for
64 kB (a whole control table has 662 bytes)."""

HEADER: Final = b"\xff\xff\xfd\x00"
MARK: Final = b"\xff\xff\xfd"
STUFFED: Final = b"\xff\xff\xfd\xfd"
PREAMBLE: Final = 7
"""Bytes before the instruction: header, id, length."""


class Instruction(IntEnum):
    """Instruction code of a frame; ``STATUS`` marks a reply."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REBOOT = 0x08
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    FAST_BULK_READ = 0x9A


class ErrorCode(IntEnum):
    """Reason of a servo's refusal, in the low seven bits of a reply's error byte."""

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
    """One decoded frame."""

    id: int
    instruction: int
    error: int
    """The error byte of a reply; 0 for an instruction, except ``ErrorCode.CRC`` where the parser
    reports frames with a wrong CRC."""
    params: bytes
    """The parameters without byte stuffing, and without the error byte of a reply."""


crc16: Final = umts
"""Returns the checksum of bytes [and of those before, from their checksum]: polynomial 0x8005, most
significant bit first, from 0, no reflection"""


def encode(id: int, instruction: int, params: bytes = b"") -> bytes:  # noqa: A002
    """Return an instruction frame with byte stuffing and CRC.

    Raises:
        ValueError: The id is not one (0 to 252, 254), or the parameters do not fit in a frame.
    """
    return _frame(id, bytes((instruction,)) + params)


def encode_status(id: int, error: int, params: bytes = b"") -> bytes:  # noqa: A002
    """Return a reply frame with byte stuffing and CRC.

    Raises:
        ValueError: The id is not one (0 to 252, 254), or the parameters do not fit in a frame.
    """
    return _frame(id, bytes((Instruction.STATUS, error)) + params)


class FastReply(NamedTuple):
    """One servo's part of the joint reply."""

    id: int
    error: int
    data: bytes


def encode_fast_status(replies: Iterable[FastReply]) -> bytes:
    """Return the joint reply to a fast read, as if every servo had appended its part.

    It is never stuffed, and each part ends with the CRC of everything before it.

    Raises:
        ValueError: The replies do not fit in a frame.
    """
    items = list(replies)
    length = 1 + sum(len(item.data) + 4 for item in items)
    if length > MAX_LENGTH:
        raise ValueError(f"a reply of {length} bytes does not fit in a frame of {MAX_LENGTH}")
    frame = bytearray(HEADER)
    frame += bytes((BROADCAST, length & 0xFF, length >> 8, Instruction.STATUS))
    crc = crc16(frame)
    for item in items:
        share = bytes((item.error, item.id)) + item.data
        crc = crc16(share, crc)
        share += crc.to_bytes(2, "little")
        frame += share
        crc = crc16(share[-2:], crc)
    return bytes(frame)


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
    """Decode a whole frame whose CRC is valid; return None for a reply without an error byte."""
    id_, body = frame[4], frame[PREAMBLE:-2]
    fast = id_ == BROADCAST and body[0] == Instruction.STATUS
    if MARK in body and not fast:
        body = body.replace(STUFFED, MARK)
    if body[0] != Instruction.STATUS:
        return Frame(id_, body[0], 0, body[1:])
    return Frame(id_, Instruction.STATUS, body[1], body[2:]) if len(body) > 1 else None
