"""Finds frames in a stream of bytes, however it is divided, and whatever lies between them."""

from __future__ import annotations

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


class Parser:
    """Finds frames in a stream of bytes, however it is divided, and whatever lies between them.

    A broken frame has no effect on others: after a wrong CRC the search continues right after its
    header. A truncated frame is given up when the next header is seen or, where headers may be
    data, when a frame after it is complete.
    """

    __slots__ = ("_buffer", "_joint", "_report_crc", "_skipping", "_unstuffed", "corrupt", "idle")

    def __init__(
        self, *, report_crc: bool = False, unstuffed: bool = False, joint: bool = True
    ) -> None:
        """Start with an empty buffer.

        Args:
            report_crc: Also return a frame with a wrong CRC, with ``ErrorCode.CRC`` as its error
                and no parameters (a servo answers those).
            unstuffed: Take a header inside a frame for data if that makes the frame's CRC correct
                (a servo counts bytes; some hosts do not stuff).
            joint: Wait for the rest of a fast read's reply although it contains a header. Without
                fast reads only noise begins like one, and would swallow the replies after it.
        """
        self._buffer = bytearray()
        self._report_crc = report_crc
        self._unstuffed = unstuffed
        self._joint = joint
        self._skipping = False
        self.idle = True
        """No partial frame is waiting for its rest"""
        self.corrupt = 0
        """Frames with a wrong CRC, truncated frames, and runs of bytes that belong to none."""

    def reset(self) -> None:
        """Discard a partial frame. Does not count as corrupt."""
        self._buffer.clear()
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
            if end > size:
                if self._cut_short(start, seen):
                    at = self._reject(start)
                    continue
                break
            frame = bytes(buffer[start:end])
            if crc16(frame[:-2]) != frame[-2] | frame[-1] << 8:
                if self._report_crc:
                    frames.append(Frame(frame[4], frame[7], ErrorCode.CRC, b""))
                at = self._reject(start)
                continue
            decoded = decode(frame)
            if decoded is None:
                at = self._reject(start)
                continue
            frames.append(decoded)
            self._skipping = False
            at = end
        del buffer[:at]
        self.idle = not buffer and not self._skipping
        return frames

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

        Stuffing keeps headers out of frames, so another header means that the sender began anew. A
        fast read's reply is not stuffed and may contain one; so may anything where hosts do not
        stuff, and then only a whole frame counts. Frames that were complete at ``seen`` bytes have
        been found.
        """
        buffer = self._buffer
        if self._unstuffed:
            return self._whole_frame_behind(start, seen)
        joint = (
            self._joint
            and len(buffer) > start + PREAMBLE
            and buffer[start + 4] == BROADCAST
            and buffer[start + 7] == Instruction.STATUS
        )
        return not joint and buffer.find(HEADER, start + len(HEADER)) >= 0

    def _whole_frame_behind(self, start: int, seen: int) -> bool:
        buffer = self._buffer
        size = len(buffer)
        at = start
        while (at := buffer.find(HEADER, at + len(HEADER))) >= 0 and at + PREAMBLE <= size:
            length = buffer[at + 5] | buffer[at + 6] << 8
            end = at + PREAMBLE + length
            believable = length >= 3 and seen < end <= size and buffer[at + 4] <= BROADCAST
            if believable and crc16(buffer[at : end - 2]) == buffer[end - 2] | buffer[end - 1] << 8:
                return True
        return False


def _header_prefix(buffer: bytearray, at: int) -> int:
    """Return how many bytes at the end of ``buffer[at:]`` may be the beginning of a header."""
    for count in (3, 2, 1):
        if len(buffer) - at >= count and buffer.endswith(HEADER[:count]):
            return count
    return 0
