"""Several servos with one id answer at once: what is left of their bytes on the wire.

A simple picture: every servo starts after its own return delay, in whole byte times, and where two
send at once a bit is 0 if one of them pulls it low. So two of a kind that say the same, as to a
ping, cannot be told from one; all else becomes a frame with a wrong CRC or none at all. On a real
bus the edges differ within a bit and the levels depend on the transceivers: the bytes would be
others, as useless.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from haptic_wall.hw.dynamixel.codec import Frame
from haptic_wall.hw.dynamixel.wire import wire_ns


class Sending(NamedTuple):
    """Bytes that one servo begins to send when its return delay has passed."""

    delay_ns: int
    baud: int
    frame: Frame
    wire: bytes


def collide(sendings: Sequence[Sending]) -> Iterator[tuple[int, Frame, bytes]]:
    """Overlay replies: delay behind what came before [ns], the first frame, the bytes heard."""
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
    """Bytes sent at once: every bit is 0 that one of them pulls low; an idle line is high."""
    heard = bytearray(max(sent, key=len))
    for data in sent:
        for at, byte in enumerate(data):
            heard[at] &= byte
    return bytes(heard)
