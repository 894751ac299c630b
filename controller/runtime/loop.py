"""Executes one tick at each deadline of a run, and counts missed periods."""

from __future__ import annotations

import math
from collections.abc import Callable

from haptic_wall.controller.runtime.deadlines import Waiter, first_deadline, next_deadline
from haptic_wall.controller.runtime.lateness.ticks import LateTicks
from haptic_wall.controller.runtime.safety import End, StopReason
from haptic_wall.controller.runtime.telemetry import Telemetry, Word
from haptic_wall.controller.runtime.tick import Tick
from haptic_wall.hw.clock import Clock
from haptic_wall.hw.servo import Bus

BLOCK = 1024
"""Ticks between two calls of ``on_block``; well below the rows that the telemetry holds."""

_never = (math.inf, math.inf, math.inf)


class Loop:
    """The loop of a run: waits for each deadline of the grid and executes a tick.

    Args:
        tick: Executed at each deadline.
        waiter: Waits for the deadlines.
        clock: The loop's clock.
        telemetry: Holds the control words: stop request, cut, counters.
        bus: Counts its waiting time, which explains late ticks.
        period_ns: Period from one deadline to the next [ns].
        on_block: Called periodically between two ticks.
        late: Explains late ticks; None: they are not explained.
        read_key: Reads the dead man's key at a time [ns], and returns when to do so again [ns];
            None: there is none.
    """

    def __init__(
        self,
        tick: Tick,
        waiter: Waiter,
        clock: Clock,
        telemetry: Telemetry,
        bus: Bus,
        period_ns: int,
        on_block: Callable[[], None],
        late: LateTicks | None,
        read_key: Callable[[int], float] | None = None,
    ) -> None:
        self.tick = tick
        self.period_ns = period_ns
        self._bus = bus
        self._late = late
        self._waiter = waiter
        self._clock = clock
        self._words = telemetry.words
        self._on_block = on_block
        self._read_key = read_key
        self._key_ns = math.inf if read_key is None else 0.0
        self._deadline = first_deadline(clock, period_ns)
        self._missed = 0
        self._begun = self._words[Word.BEGAN_NS] = self._deadline
        self._begun_offset = self._waited = 0
        if late is not None:
            late.begin(self._deadline)

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
        return (self._deadline - self._begun) // self.period_ns - self.tick.ticks

    def begin(self) -> None:
        """Restart the counts of time, ticks, missed periods and late ticks."""
        self._begun = self._deadline
        self._begun_offset = self._words[Word.OFFSET_NS]
        self.tick.ticks = self._words[Word.TICKS] = 0
        self.tick.missed = self._words[Word.MISSED] = 0
        if self._late is not None:
            self._late.begin(self._deadline)

    def serve(self, duration_s: float | None) -> StopReason | None:
        """Execute ticks for a duration [s], or without end; return the reason of an early end.

        Raises:
            ServoHealthError: The servo is in no state to be driven any longer.
            ServoLostError: The servo, or its torque, is gone.
        """
        end = math.inf if duration_s is None else self._deadline + round(duration_s * 1e9)
        tick, words, period_ns = self.tick, self._words, self.period_ns
        waiter, bus, late = self._waiter, self._bus, self._late
        wait, run, now = waiter.wait, tick.run, self._clock.now_ns
        limit_ns, long_ns, rest = _never if late is None else late.limits
        deadline, missed = self._deadline, self._missed
        stop, cut = int(Word.STOP), int(Word.CUT)  # plain numbers: read in every tick
        taken_out = int(Word.OFFSET_NS)
        read_key, key_ns = self._read_key, self._key_ns
        self._before = self._began = words[taken_out]
        waited_out = int(Word.WAITED_NS)
        served = woke = ended = deadline
        block = BLOCK
        try:
            while deadline < end:
                woke = wait(deadline)
                if words[stop] or words[cut]:
                    ended = woke
                    return End.INTERRUPTED
                if woke >= key_ns and read_key is not None:
                    key_ns = read_key(woke)
                served = deadline
                self._began, self._waited = words[taken_out], words[waited_out]
                run(deadline, woke, missed)
                if tick.trip is not None:
                    deadline += period_ns
                    return tick.trip
                if tick.done:
                    deadline += period_ns
                    return End.DURATION
                ended = now()
                deadline, missed = next_deadline(deadline, ended, period_ns)
                waited = bus.waited_ns
                rest -= 1
                stalled = words[taken_out] != self._before
                if ended - served - waited > limit_ns or waited > long_ns or stalled:
                    self._explain(served, woke, ended, missed)
                elif rest <= 0 and late is not None:
                    rest = late.rest(served, waiter, deadline - ended, bus.counts.lost)
                block -= 1
                if block == 0:
                    self._on_block()
                    block = BLOCK
        finally:
            self._deadline, self._missed, self._key_ns = deadline, missed, key_ns
            if ended < woke:  # in the tick that ended the run
                self._explain(served, woke, now(), 0)
        return None

    def _explain(self, served: int, woke: int, ended: int, missed: int) -> None:
        """Pass a late tick to ``late``, which finds its likely cause."""
        bus, words = self._bus, self._words
        before, self._before = self._before, words[Word.OFFSET_NS]
        if self._late is not None:
            lost = bus.counts.lost
            # Late in real time, whatever an elastic clock has taken out.
            waited_ns = bus.waited_ns + words[Word.WAITED_NS] - self._waited
            offsets = before, self._began, self._before
            self._late.late(served, woke, ended, self._waiter, waited_ns, lost, missed, offsets)
