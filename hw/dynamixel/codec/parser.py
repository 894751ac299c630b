"""Finds frames in a stream of bytes, however it is divided, and whatever lies between them."""

from __future__ import annotations

from collections.abc import Sequence

from haptic_wall.hw.dynamixel.codec.frames import (
    BROADCAST,
    HEADER,
    MAX_LENGTH,
    PREAMBLE,
    ErrorCode,
    Frame,
    Instruction,
    crc16,
    decode,
)

_JOINT = bytes((BROADCAST, Instruction.STATUS))
_AROUND_PART = 4
"""Bytes of a part beside its data: error, id, CRC"""


class Parser:
    """Finds frames in a stream of bytes, however it is divided, and whatever lies between them.

    A broken frame has no effect on others: after a wrong CRC the search continues right after its
    header. A truncated frame is given up when the next header is seen or, where headers may be
    data, when a frame after it is complete.

    The joint reply to a fast sync read gives a frame for each servo, as soon as its part has come:
    each part ends with a checksum over all before it. So the parts before a missing or a broken one
    are valid, and none after it is.
    """

    def __init__(
        self, *, report_crc: bool = False, unstuffed: bool = False, joint: int = 0
    ) -> None:
        """Start with an empty buffer.

        Args:
            report_crc: Also return a frame with a wrong CRC, with ``ErrorCode.CRC`` as its error
                and no parameters (a servo answers those).
            unstuffed: Take a header inside a frame for data if that makes the frame's CRC correct
                (a servo counts bytes; some hosts do not stuff).
            joint: Number of servos in a joint reply, which is not stuffed; 0: there are none, and
                only noise begins like one.
        """
        self._buffer = bytearray()
        self._report_crc = report_crc
        self._unstuffed = unstuffed
        self.joint = joint
        self.parts: Sequence[int] = ()
        """Bytes of the parts of a joint reply of their total length; others have equal parts"""
        self._parts = 0
        """Parts of the joint reply at the buffer's begin that have been returned"""
        self._skipping = False
        self.idle = True
        """Nothing is waiting for its rest"""
        self.corrupt = 0
        """Frames with a wrong CRC, truncated frames, and runs of bytes that belong to none."""

    def reset(self) -> None:
        """Discard a partial frame. Does not count as corrupt."""
        self._buffer.clear()
        self._parts = 0
        self._skipping = False
        self.idle = True

    def feed(self, data: bytes) -> list[Frame]:
        """Process bytes; return the completed frames, in order."""
        buffer = self._buffer
        seen = len(buffer)
        buffer += data
        frames: list[Frame] = []
        at = 0
        size = len(buffer)
        while True:
            start = buffer.find(HEADER, at)
            if start < 0:
                start = size - _header_prefix(buffer, at)
                self._skip(start - at)
                at = start
                break
            self._skip(start - at)
            at = start
            if size - start < PREAMBLE:
                break
            length = buffer[start + 5] | buffer[start + 6] << 8
            if not 3 <= length <= MAX_LENGTH or buffer[start + 4] > BROADCAST:
                at = self._reject(start)
                continue
            end = start + PREAMBLE + length
            if self.joint and buffer[start + 4 : start + 8 : 3] == _JOINT:
                at = self._take_parts(start, end, seen, frames)
            elif end <= size:
                at = self._take_frame(start, end, frames)
            elif self._cut_short(start, seen):
                at = self._reject(start)
            if at == start:
                break
        del buffer[:at]
        self.idle = not buffer and not self._skipping
        return frames

    def _take_frame(self, start: int, end: int, frames: list[Frame]) -> int:
        """Append a whole frame if it is valid; return where the search continues."""
        frame = bytes(self._buffer[start:end])
        right = crc16(frame[:-2]) == frame[-2] | frame[-1] << 8
        decoded = decode(frame) if right else None
        if decoded is not None:
            frames.append(decoded)
            self._skipping = False
            return end
        if self._report_crc and not right:
            frames.append(Frame(frame[4], frame[7], ErrorCode.CRC, b""))
        return self._reject(start)

    def _take_parts(self, start: int, end: int, seen: int, frames: list[Frame]) -> int:
        """Append the new parts of a joint reply; return where the search continues.

        Args:
            start: Its begin; returned if its rest is missing.
            end: Its end.
            seen: Bytes of the buffer that were there before.
            frames: The frames found.
        """
        buffer = self._buffer
        at = start + PREAMBLE + 1
        sizes = self._sizes(end - at)
        parts, known, self._parts = 0, self._parts, 0
        if not sizes:
            return self._reject(start)
        crc = crc16(buffer[start:at])
        for part in sizes:
            if at + part > len(buffer):
                break
            if buffer.startswith(HEADER, at):  # no part begins so: the servos from here are missing
                return at
            last = at + part - 2
            crc = crc16(buffer[at:last], crc)
            if crc != buffer[last] | buffer[last + 1] << 8:
                return self._reject(start)
            if parts >= known:
                data = bytes(buffer[at + 2 : last])
                frames.append(Frame(buffer[at + 1], Instruction.STATUS, buffer[at], data))
            crc = crc16(buffer[last : last + 2], crc)
            at += part
            parts += 1
        self._skipping = False
        if at == end:
            return end
        if self._frame_behind(at, seen) >= 0:
            return at if buffer.startswith(HEADER, at) else self._reject(start)
        self._parts = parts
        return start

    def _sizes(self, total: int) -> Sequence[int]:
        """Return the bytes of each part of a joint reply with ``total``; empty: it is none."""
        if total == sum(self.parts):
            return self.parts
        part, rest = divmod(total, self.joint)
        return () if rest or part < _AROUND_PART else [part] * self.joint

    def _skip(self, count: int) -> None:
        """Count a run of garbage once; bytes after a rejected header were counted with it."""
        if count and not self._skipping:
            self.corrupt += 1
            self._skipping = True

    def _reject(self, start: int) -> int:
        """Count the frame at ``start`` as broken; return where the search continues."""
        self.corrupt += 1
        self._skipping = True
        return start + len(HEADER)

    def _cut_short(self, start: int, seen: int) -> bool:
        """Whether the incomplete frame at ``start`` will never be completed.

        Stuffing keeps headers out of frames, so another header means that the sender began anew.
        Where hosts do not stuff, only a whole frame counts.
        """
        if self._unstuffed:
            return self._frame_behind(start + len(HEADER), seen) >= 0
        return self._buffer.find(HEADER, start + len(HEADER)) >= 0

    def _frame_behind(self, at: int, seen: int) -> int:
        """Return the begin of a valid frame, or of a joint reply with a valid part; -1: none.

        Those that were complete at ``seen`` bytes have been found.
        """
        buffer = self._buffer
        size = len(buffer)
        while (at := buffer.find(HEADER, at)) >= 0 and at + PREAMBLE <= size:
            length = buffer[at + 5] | buffer[at + 6] << 8
            end = at + PREAMBLE + length
            if self.joint and buffer[at + 4] == BROADCAST:
                end = at + PREAMBLE + 1 + (*self._sizes(length - 1), 0)[0]
            believable = length >= 3 and seen < end <= size and buffer[at + 4] <= BROADCAST
            if believable and crc16(buffer[at : end - 2]) == buffer[end - 2] | buffer[end - 1] << 8:
                return at
            at += len(HEADER)
        return -1


def _header_prefix(buffer: bytearray, at: int) -> int:
    """Return how many bytes at the end of ``buffer[at:]`` may be the beginning of a header."""
    for count in (3, 2, 1):
        if len(buffer) - at >= count and buffer.endswith(HEADER[:count]):
            return count
    return 0
