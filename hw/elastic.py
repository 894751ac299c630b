"""An elastic time for a loop and its own emulated bus: each waits for the other in a stall.

Both run on CLOCK_MONOTONIC less an offset in shared memory, which only the loop raises. While the
computer keeps up the offset stands still. In a stall it grows instead of the time:

- The loop promises until when the bus may run without it. The bus goes no further. A loop that
  comes back later than promised takes the excess out.
- Bytes that the bus has not taken, a reply that is due, and a reply on its way are debts. With a
  debt the loop's time stops a little after it was due.

A bus that settles nothing for ``DEBT_S`` is dead: then time passes again, for good.
"""

from __future__ import annotations

import mmap
import time
from collections.abc import Callable
from typing import Final

PLACE: Final = 480
"""First of the words in the page of control words"""
OFFSET, WAITED, UNTIL, PATIENCE, SENT, SENT_AT, GOT, EXPECTS = range(8)
"""Written by the loop: time taken out [ns]; the part that waited for the bus; its promise [ns]; how
long debts may last [ns]; bytes sent; when [ns]; bytes received; whether it waits for some"""
TAKEN, GIVEN, DUE = range(8, 11)
"""Written by the bus: bytes taken; bytes given, one more while a reply is due; since when [ns]"""
COUPLED = 11
"""Whether this is in force (loop, supervisor)"""
WORDS: Final = 12
PATIENCE_S: Final = 5.0
"""Longest silence of the loop [s]"""
DEBT_S: Final = 20.0
"""Longest debt [s]: the kernel's thread that carries the bytes may get no processor for seconds"""
_NAP_S: Final = 200e-6
_BRIEF_NS: Final = 100_000
"""The loop does not sleep for a debt this young: it would lose its processor [ns]"""
_PAGE: Final = 4096
_NEVER: Final = 1 << 62


def shared_words(descriptor: int) -> memoryview[int]:
    """Return the words in a memory that was inherited."""
    return memoryview(mmap.mmap(descriptor, _PAGE)).cast("q")[PLACE : PLACE + WORDS]


def _settled_until(words: memoryview[int]) -> int:
    """Return until when the present debts let the time pass [ns]."""
    if words[TAKEN] != words[SENT]:
        return words[SENT_AT] + words[PATIENCE]
    if words[EXPECTS] and words[GIVEN] != words[GOT]:
        return words[DUE] + words[PATIENCE]
    return _NEVER


class ElasticClock:
    """The loop's clock; plain CLOCK_MONOTONIC outside of ``engage`` and ``release``.

    Args:
        words: The shared words.
        period_ns: Period of the loop [ns].
        real_ns: The system's clock.
        nap: Sleeps for a time [s].
    """

    def __init__(
        self,
        words: memoryview[int],
        period_ns: int,
        real_ns: Callable[[], int] = time.monotonic_ns,
        nap: Callable[[float], None] = time.sleep,
    ) -> None:
        self._words = words
        self._real = real_ns
        self._nap = nap
        # No stall yet: a loop and then a bus as late as this still meet the loop's patience with a
        # reply, 0.8 periods.
        self._late_ns = max(period_ns // 4, 250_000)
        self._owed_ns = words[PATIENCE] = max(period_ns // 5, 200_000)
        self._offset = self._limit = self._until = self._now = 0
        self._waits: tuple[int, ...] = (0,)  # since when [ns], and for what

    def now_ns(self) -> int:
        """Return the elastic time [ns]."""
        now = self._real() - self._offset
        if now < self._limit:
            self._now = now
            return now
        return self._judged(now)

    def wait_until(self, instant_ns: int) -> None:
        """Sleep until ``instant_ns`` [ns]."""
        self.promise(instant_ns)
        while (left_ns := instant_ns - self.now_ns()) > 0:
            self._nap(left_ns * 1e-9)

    def engage(self) -> None:
        """Begin: no bytes are on their way now."""
        words = self._words
        words[SENT], words[GOT] = words[TAKEN], words[GIVEN]
        self.promise(self.now_ns())
        words[COUPLED] = 1

    def release(self) -> None:
        """End: from now on the offset stands still."""
        self._words[COUPLED] = 0

    def promise(self, instant_ns: int) -> None:
        """Do nothing before ``instant_ns`` [ns]."""
        self._words[EXPECTS] = 0
        self._let_run(instant_ns)

    def expect(self, instant_ns: int) -> None:
        """Do nothing before bytes come, or ``instant_ns`` [ns]."""
        self._words[EXPECTS] = 1
        self._let_run(instant_ns)

    def _let_run(self, instant_ns: int) -> None:
        until = instant_ns + self._late_ns
        if until > self._until:
            self._until = self._words[UNTIL] = until

    def sent(self, count: int) -> None:
        """Count bytes that are about to be sent, just after the time was read."""
        words = self._words
        words[SENT_AT] = now = self._now
        words[SENT] += count
        if now + self._owed_ns < self._limit:  # noqa: PLR1730 - min() takes longer
            self._limit = now + self._owed_ns

    def got(self, count: int) -> None:
        """Count bytes received from the bus, just after the time was read."""
        words = self._words
        words[GOT] += count
        self._limit = self._until = words[UNTIL] = self._now + self._late_ns

    def _judged(self, now: int) -> int:
        """Take a stall out of ``now`` [ns]; decide until when that is not necessary again."""
        words, last, until = self._words, self._now, self._until
        owed = _settled_until(words)
        if (now <= until and now <= owed) or not words[COUPLED]:
            self._now = now
            self._limit = until if until < owed else owed
            return now
        latest = max(until, last + self._late_ns)
        most = max(min(latest, owed), last)
        if excess := max(0, now - most):
            self._offset += excess
            words[OFFSET] = self._offset
            now = most
            if most < latest:
                words[WAITED] += excess
                self._wait()
        self._now = now
        self._let_run(now)
        self._limit = min(self._until, owed)
        return now

    def _wait(self) -> None:
        """Nap for the bus; give it up in the end."""
        real, words = self._real(), self._words
        debt = tuple(words[SENT:COUPLED])
        if self._waits[1:] != debt:
            self._waits = real, *debt
        elif real - self._waits[0] > 1e9 * DEBT_S:
            self.release()
        elif real - self._waits[0] > _BRIEF_NS:
            self._nap(_NAP_S)


class BusClock:
    """The clock of the emulated bus.

    Args:
        words: The shared words.
        real_ns: The system's clock.

    Attributes:
        held: The time stood still at its last reading.
    """

    def __init__(
        self, words: memoryview[int], real_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._words = words
        self._real = real_ns
        self._now = 0
        self.held = False

    def now_ns(self) -> int:
        """Return the elastic time [ns]: no later than promises and debts allow."""
        words = self._words
        until = words[UNTIL]  # first: the loop raises it after the offset
        now = self._real() - words[OFFSET]
        if words[COUPLED]:
            until = min(until, _settled_until(words))
            self.held = now > until
            now = min(now, until)
        self._now = now = max(now, self._now)
        return now

    def report(self, taken: int, given: int, due_ns: int | None) -> None:
        """Tell the loop how the exchange stands.

        Args:
            taken: Bytes taken so far.
            given: Bytes given so far.
            due_ns: The next event of a reply under way [ns]; None: none is.
        """
        words = self._words
        if due_ns is not None:
            words[DUE] = due_ns
        words[GIVEN] = given + (due_ns is not None)
        words[TAKEN] = taken
