"""Executes one tick at each deadline of a run, and counts missed periods."""

from __future__ import annotations

import math
from collections.abc import Callable

from haptic_wall.controller.runtime.cycle import Cycle
from haptic_wall.controller.runtime.deadlines import Wait, first_deadline, next_deadline
from haptic_wall.controller.runtime.safety import End, StopReason
from haptic_wall.controller.runtime.telemetry import Telemetry, Word
from haptic_wall.hw.clock import Clock

BLOCK = 1024
"""Ticks between two calls of ``on_block``; well below the rows that the telemetry holds."""
STALL_NS = 5_000_000
"""A tick that ends this long after its deadline is a stall [ns], which may end a run ..."""
RECENT_NS = 500_000_000
"""... within this time [ns]"""


class Loop:
    """The loop of a run: waits for each deadline of the grid and executes a tick.

    Args:
        cycle: Executed at each deadline.
        wait: Waits for the deadlines.
        clock: The loop's clock.
        telemetry: Holds the control words: stop request, cut, counters.
        period_ns: Period from one deadline to the next [ns].
        on_block: Called periodically between two ticks.
        read_key: Reads the dead man's key at a time [ns], and returns when to do so again [ns];
            None: there is none.
    """

    def __init__(
        self,
        cycle: Cycle,
        wait: Wait,
        clock: Clock,
        telemetry: Telemetry,
        period_ns: int,
        on_block: Callable[[], None],
        read_key: Callable[[int], float] | None = None,
    ) -> None:
        self.cycle = cycle
        self.period_ns = period_ns
        self._wait = wait
        self._clock = clock
        self._words = telemetry.words
        self._on_block = on_block
        self._read_key = read_key
        self._key_ns = math.inf if read_key is None else 0.0
        self._deadline = first_deadline(clock, period_ns)
        self._missed = 0
        self._begun = self._words[Word.BEGAN_NS] = self._deadline
        self._begun_offset = 0
        self._stall = 0, 0  # end and duration of the longest recent stall [ns]

    @property
    def stalled_s(self) -> float:
        """Return the time taken out of an elastic clock since ``begin`` [s]."""
        return (self._words[Word.OFFSET_NS] - self._begun_offset) * 1e-9

    @property
    def elapsed_s(self) -> float:
        """Return the time on the grid since ``begin``, or since the start before it [s]."""
        return (self._deadline - self._begun) * 1e-9

    @property
    def missed(self) -> int:
        """Return the number of periods since ``begin`` in which no tick was executed."""
        return (self._deadline - self._begun) // self.period_ns - self.cycle.ticks

    def begin(self) -> None:
        """Restart the counts of time, ticks and missed periods."""
        self._begun = self._deadline
        self._begun_offset = self._words[Word.OFFSET_NS]
        self.cycle.ticks = self._words[Word.TICKS] = 0
        self._words[Word.MISSED] = 0

    def serve(self, duration_s: float | None) -> StopReason | None:
        """Execute ticks for a duration [s], or without end; return the reason of an early end.

        Raises:
            ServoHealthError: The servo is in no state to be driven any longer.
            ServoLostError: The servo, or its torque, is gone.
        """
        end = math.inf if duration_s is None else self._deadline + round(duration_s * 1e9)
        cycle, words, period_ns = self.cycle, self._words, self.period_ns
        wait, run, now = self._wait, cycle.run, self._clock.now_ns
        deadline, missed = self._deadline, self._missed
        stop, cut = int(Word.STOP), int(Word.CUT)  # plain numbers: read in every tick
        read_key, key_ns = self._read_key, self._key_ns
        served = woke = ended = deadline
        block = BLOCK
        try:
            # A stall beyond the end hides no trip: one more tick tells it.
            while deadline < end or (missed and served < end):
                woke = wait(deadline)
                if words[stop] or words[cut]:
                    ended = woke
                    return End.INTERRUPTED
                if woke >= key_ns and read_key is not None:
                    key_ns = read_key(woke)
                served = deadline
                run(deadline, woke, missed)
                if cycle.trip is not None:
                    deadline += period_ns
                    return cycle.trip
                if cycle.done:
                    deadline += period_ns
                    return End.DURATION
                ended = now()
                deadline, missed = next_deadline(deadline, ended, period_ns)
                if missed:
                    self._stalled(served, ended)
                block -= 1
                if block == 0:
                    self._on_block()
                    block = BLOCK
        finally:
            self._deadline, self._missed, self._key_ns = deadline, missed, key_ns
            if ended < woke:  # in the tick that ended the run
                self._stalled(served, now())
        return None

    def stall_s(self, now_ns: int) -> float:
        """Return the longest stall of the last half second before ``now_ns`` [s]; 0: none."""
        end_ns, longest_ns = self._stall
        return longest_ns * 1e-9 if now_ns - end_ns <= RECENT_NS else 0.0

    def _stalled(self, deadline_ns: int, ended_ns: int) -> None:
        """Record the tick of a deadline, ended so late [ns], if it was a stall."""
        overdue_ns = ended_ns - deadline_ns
        if overdue_ns > max(STALL_NS, 2 * self.period_ns):
            end_ns, longest_ns = self._stall
            if overdue_ns >= longest_ns or ended_ns - end_ns > RECENT_NS:
                self._stall = ended_ns, overdue_ns
