"""One servo on a line: its counts, and its millisecond clock, by which late samples are refused."""

from __future__ import annotations

from typing import Final

from haptic_wall.hw.dynamixel.registers import TICK_MODULUS
from haptic_wall.hw.servo import BusCounts

_HALF: Final = TICK_MODULUS // 2
_SLACK_NS: Final = 5_000_000
"""Tolerance [ns]: two consecutive requests may wait in the adapter"""
_DRIFT: Final = 0.02
"""Largest relative drift of the servo's clock against this machine's"""
_TRUST_NS: Final = 10_000_000_000
"""Pause after which a tick, which wraps every 33 s, proves nothing"""
_NEVER_NS: Final = -1 << 62


class Station:
    """One servo on a line, as its requests and replies show it.

    Args:
        id_: Its id.
    """

    def __init__(self, id_: int) -> None:
        self.id = id_
        self.counts = BusCounts()
        self.refusal = 0
        """Reason of the last refusal of a read or write (``ErrorCode``); set it to 0 to know of the
        next"""
        self.block = b""
        """All data of the answer to the last request, if that was for a wider block"""
        self.forget()

    def forget(self) -> None:
        """Discard what is known of the servo and its line: both may have changed."""
        self.twins = False
        """Two servos have replied to one request"""
        self.longest_ns = 0
        """Longest time that an answer took [ns]"""
        self._tick = 0
        """Of the last accepted sample; the servo has read it between these two [ns]:"""
        self._since_ns = self._until_ns = _NEVER_NS

    def accept(self, tick: int, sent_ns: int, now_ns: int) -> bool:
        """Whether a sample answers this request: its tick has advanced by the time that passed.

        A stall of computer or adapter delays requests and replies, in their order. So a servo has
        read a tick before its reply was received, and after the tick of the reply before.

        Args:
            tick: The servo's tick.
            sent_ns: When it was requested [ns].
            now_ns: The present time, after the reply was received [ns].
        """
        passed_ns = sent_ns - self._since_ns
        ahead_ns = (tick - self._tick) % TICK_MODULUS * 1_000_000 - passed_ns
        if -_SLACK_NS <= ahead_ns <= _SLACK_NS >= passed_ns:
            self._tick, self._since_ns, self._until_ns = tick, sent_ns, sent_ns  # the usual case
            return True
        if passed_ns > _TRUST_NS:
            return self._take(tick, sent_ns, now_ns)
        advance_ns = ((tick - self._tick + _HALF) % TICK_MODULUS - _HALF) * 1_000_000
        first_ns, end_ns = self._since_ns + advance_ns, self._until_ns + advance_ns
        slack_ns = _SLACK_NS + _DRIFT * passed_ns
        if advance_ns < 0 or sent_ns > end_ns + slack_ns or first_ns > sent_ns + slack_ns:
            return False
        # The tick was read between the bounds that both samples give.
        begin_ns = min(max(sent_ns, first_ns), now_ns)
        return self._take(tick, begin_ns, max(begin_ns, min(now_ns, end_ns)))

    def _take(self, tick: int, since_ns: int, until_ns: int) -> bool:
        self._tick, self._since_ns, self._until_ns = tick, since_ns, until_ns
        return True
