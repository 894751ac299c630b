"""Applies faults to the bytes of one frame."""

from __future__ import annotations

from dataclasses import dataclass
from random import Random

from haptic_wall.hw.dynamixel.codec import MAX_ID, crc16
from haptic_wall.hw.dynamixel.codec.frames import HEADER
from haptic_wall.hw.emulated.faults import Fault

_ID, _SHORTEST = 4, 10
_NOISE = 8
"""Default number of garbage bytes"""


@dataclass(slots=True)
class Passage:
    """A frame after the faults."""

    chunks: list[bytes]
    """The received bytes: noise, the frame, a copy; empty where it is lost"""
    late_ns: int = 0
    """Added delay [ns]"""
    names: tuple[str, ...] = ()
    """The faults that hit it"""


def strike(fault: Fault, passage: Passage, rng: Random) -> None:
    """Apply ``fault`` to the frame in ``passage``."""
    values = fault.values
    chunks = passage.chunks
    passage.names += (fault.name,)
    if fault.name == "late":
        passage.late_ns += round(values["ms"] * 1_000_000)
    elif fault.name == "noise":
        chunks.insert(0, rng.randbytes(values.get("bytes", _NOISE)))
    elif fault.name == "duplicate":
        chunks.append(chunks[-1])
    elif fault.name == "drop":
        chunks.clear()
    else:
        change = {"corrupt": _flip, "truncate": _truncate, "wrong-id": _readdress}[fault.name]
        chunks[-1] = change(chunks[-1], fault, rng)


def id_of(wire: bytes) -> int | None:
    """Return the id in a frame's bytes; None where they do not begin with a header."""
    return wire[_ID] if wire.startswith(HEADER) and len(wire) > _ID else None


def _flip(wire: bytes, fault: Fault, rng: Random) -> bytes:
    """Flip distinct bits, each with equal probability."""
    damaged = bytearray(wire)
    count = min(fault.values.get("flips", 1), 8 * len(wire))
    for bit in rng.sample(range(8 * len(wire)), count):
        damaged[bit // 8] ^= 1 << bit % 8
    return bytes(damaged)


def _truncate(wire: bytes, fault: Fault, rng: Random) -> bytes:
    """Keep the first bytes: the given number, else from one to all but one."""
    keep = fault.values.get("keep")
    return wire[: rng.randint(1, max(1, len(wire) - 1)) if keep is None else keep]


def _readdress(wire: bytes, fault: Fault, rng: Random) -> bytes:
    """Replace the id and adapt the CRC; bytes that are no whole frame stay."""
    own = id_of(wire)
    if own is None or len(wire) < _SHORTEST:
        return wire
    other = fault.values.get("to")
    if other is None:
        other = rng.choice([id_ for id_ in range(MAX_ID + 1) if id_ != own])
    frame = wire[:_ID] + bytes([other]) + wire[_ID + 1 : -2]
    return frame + crc16(frame).to_bytes(2, "little")
