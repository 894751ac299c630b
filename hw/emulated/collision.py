"""Computes the bytes on the wire when several servos with one id reply at once.

A simple model: every servo starts after its own return delay, in whole byte times, and where two
send at once a bit is 0 if one of them pulls it low. Equal replies of two servos, as to a ping,
cannot be distinguished from one; all others become a frame with a wrong CRC or none at all. On a
real bus the edges differ within a bit and the levels depend on the transceivers: the bytes would
differ, but be as useless.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from haptic_wall.hw.dynamixel.codec import Frame
from haptic_wall.hw.dynamixel.wire import wire_ns


class Sending(NamedTuple):
    """Bytes that one servo begins to send after its return delay."""

    delay_ns: int
    baud: int
    frame: Frame
    wire: bytes


def collide(sendings: Sequence[Sending]) -> Iterator[tuple[int, Frame, bytes]]:
    """Yield overlaid replies: delay behind the bytes before [ns], first frame, received bytes."""
    waiting = sorted(sendings, key=lambda sending: sending.delay_ns)
    over_ns = 0
    while waiting:
        first = waiting[0]
        byte_ns = wire_ns(1, first.baud)
        end_ns = first.delay_ns + len(first.wire) * byte_ns
        together = []
        while waiting and waiting[0].delay_ns < end_ns:
            sending = waiting.pop(0)
            lead = b"\xff" * round((sending.delay_ns - first.delay_ns) / byte_ns)
            together.append(lead + sending.wire)
            end_ns = max(end_ns, first.delay_ns + len(together[-1]) * byte_ns)
        yield max(0, first.delay_ns - over_ns), first.frame, pull_low(together)
        over_ns = end_ns


def pull_low(sent: Sequence[bytes]) -> bytes:
    """Combine bytes sent at once: a bit is 0 if any sender pulls it low; an idle line is high."""
    heard = bytearray(max(sent, key=len))
    for data in sent:
        for at, byte in enumerate(data):
            heard[at] &= byte
    return bytes(heard)
