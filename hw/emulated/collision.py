"""Computes the bytes on the wire when several servos with one id reply at once.

A simple model: every servo starts after its own return delay, in whole byte times, and where two
send at once a bit is 0 if one of them pulls it low. Equal replies of two servos, as to a ping,
cannot be distinguished from one; all others become a frame with a wrong CRC or none at all. On a
real bus the edges differ within a bit and the levels depend on the transceivers: the bytes would
differ, but be as useless.
"""

from __future__ import annotations

from collections.abc import Sequence

from haptic_wall.hw.dynamixel.wire import wire_ns
from haptic_wall.hw.emulated.traffic import Answer, Part, id_of


def collide(replies: Sequence[Answer], baud: int) -> list[Answer]:
    """Overlay the replies of servos that begin to send after their return delays [bit/s]."""
    waiting = sorted(replies, key=lambda reply: reply.delay_ns)
    byte_ns, over_ns, heard = wire_ns(1, baud), 0, []
    while waiting:
        first = waiting[0]
        end_ns = first.delay_ns + len(first.parts[0].wire) * byte_ns
        together = []
        while waiting and waiting[0].delay_ns < end_ns:
            reply = waiting.pop(0)
            lead = b"\xff" * round((reply.delay_ns - first.delay_ns) / byte_ns)
            together.append(lead + reply.parts[0].wire)
            end_ns = max(end_ns, first.delay_ns + len(together[-1]) * byte_ns)
        wire = pull_low(together)
        delay_ns = max(0, first.delay_ns - over_ns)
        heard.append(Answer(delay_ns, first.frame, [Part(id_of(wire), wire)]))
        over_ns = end_ns
    return heard


def pull_low(sent: Sequence[bytes]) -> bytes:
    """Combine bytes sent at once: a bit is 0 if any sender pulls it low; an idle line is high."""
    heard = bytearray(max(sent, key=len))
    for data in sent:
        for at, byte in enumerate(data):
            heard[at] &= byte
    return bytes(heard)
