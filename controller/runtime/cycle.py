"""One period of a run, over all of its axes: collect, decide, write, and then the rest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from haptic_wall.controller.runtime.axis import Axis, Tick
from haptic_wall.controller.runtime.handover import Inbox
from haptic_wall.controller.runtime.safety import Trip
from haptic_wall.controller.runtime.telemetry import Word
from haptic_wall.controller.settings.shares import COLLECT_SHARE
from haptic_wall.hw.clock import Clock
from haptic_wall.hw.servo import Bus, Outcome, Traffic

LONGER_SHARE: Final = 1.05
"""``COLLECT_SHARE`` after a pipelined reply was lost, until another one is lost [1]. An adapter
flushes its buffer periodically. A request sent after giving up can then miss each tick by the time
that it takes itself, for ever. With the first fraction that happens at phases of 0.8 to about 0.95
periods, with this one at 0.05 to 0.2, so that changing the fraction leaves either."""
_LOST, _OK = Outcome.LOST, Outcome.OK
_HEARTBEAT_NS, _CUT = int(Word.HEARTBEAT_NS), int(Word.CUT)
_TICKS, _MISSED, _RAISE = int(Word.TICKS), int(Word.MISSED), int(Word.RAISE)
_STOP_AXIS, _OFFERED = int(Word.STOP_AXIS), int(Word.OFFERED)
_HELD_NS, _OFFSET_NS, _WAITED_NS = int(Word.HELD_NS), int(Word.OFFSET_NS), int(Word.WAITED_NS)


class Cycle:
    """Executes the steps of a period in order; the trip of any axis sends zero to all.

    Args:
        clock: The loop's clock.
        bus: The servos, started.
        axes: One for each servo, in the same order.
        words: The control words of the run.
        inbox: Changes of the running wall.
        period_ns: Of the grid [ns].
        pipelined: Requests are sent at the end of the period before; else in the period of the
            sample.

    Attributes:
        trip: Why the run must end; None: no trip. Once set, no torque is sent.
        done: All programs are over; the torques of the last period were zero.
        ticks: Periods executed.
    """

    def __init__(
        self,
        clock: Clock,
        bus: Bus,
        axes: Sequence[Axis],
        words: memoryview[int],
        inbox: Inbox,
        period_ns: int,
        *,
        pipelined: bool,
    ) -> None:
        self.bus, self.axes = bus, axes
        self.trip: Trip | None = None
        self.done = False
        self.ticks = 0
        self._now = clock.now_ns
        self._words, self._inbox = words, inbox
        self._period_ns = period_ns
        self._pipelined = pipelined
        self._collect_ns = int(COLLECT_SHARE * period_ns)
        self._other_collect_ns = int(LONGER_SHARE * period_ns)
        self._zeros = [0.0] * len(axes)
        self._traffic = bus.traffic or Traffic([])
        self._tick = Tick()
        self._offset = words[_OFFSET_NS]
        """Of an elastic clock, as last seen [ns]"""
        if pipelined:
            bus.request()

    def wall_on(self) -> None:
        """End the warm-up of all axes."""
        for axis in self.axes:
            axis.wall_on()

    def may_engage(self) -> bool:
        """Whether all walls would come on with the next readings, if those equal the last ones."""
        return all(axis.engagement.ready for axis in self.axes) and self.held()

    def held(self) -> bool:
        """Whether the dead man is held, or there is none."""
        return self._now() <= self._words[_HELD_NS]

    def run(self, deadline_ns: int, woke_ns: int, missed: int) -> None:
        """Serve one deadline.

        Args:
            deadline_ns: The deadline served [ns].
            woke_ns: When the loop woke for it [ns].
            missed: Whole periods skipped since the last tick.
        """
        words, bus, axes, now, tick = self._words, self.bus, self.axes, self._now, self._tick
        offset, waited = words[_OFFSET_NS], words[_WAITED_NS]
        # Reported is real time, whatever an elastic clock takes out.
        tick.lateness_ns = woke_ns - deadline_ns + offset - self._offset
        tick.deadline_ns, tick.woke_ns, tick.missed = deadline_ns, woke_ns, missed
        tick.held, tick.raises = woke_ns <= words[_HELD_NS], words[_RAISE]

        if not self._pipelined:
            bus.request()
        readings = bus.collect(woke_ns + self._collect_ns)
        tick.read_ns = now()
        torques, trip = [], None
        for axis, reading in zip(axes, readings):  # noqa: B905 - quicker
            torques.append(axis.torque(reading, tick))
            trip = trip or axis.trip
        if trip is not None:
            self.trip, torques = trip, self._zeros
            tripped = [number for number, axis in enumerate(axes, 1) if axis.trip is not None]
            if len(tripped) < len(axes):  # else it is the bus, or the loop
                words[_STOP_AXIS] = tripped[0]
        if words[_CUT]:
            return  # the supervisor has taken the bus: write nothing more
        # From sending the request to sending the torques: both have the same travel time, which
        # therefore is no part of the age.
        tick.sent_ns = now()
        sent = bus.write(torques)
        if self._pipelined:
            if any(reading.outcome is _LOST for reading in readings):  # see ``LONGER_SHARE``
                turned = self._other_collect_ns, self._collect_ns
                self._collect_ns, self._other_collect_ns = turned
            bus.request()

        self._measure(tick)
        self.done = True
        for axis, torque, one in zip(axes, torques, sent):  # noqa: B905 - quicker
            axis.after(torque, one, tick)
            self.done = self.done and axis.law.done
        if words[_OFFERED] != self._inbox.taken and (change := self._inbox.take()):
            axes[change.axis].change = change
        self.ticks = words[_TICKS] = self.ticks + 1
        words[_MISSED] += missed
        bus_ns = self._traffic.waited_ns
        words[_HEARTBEAT_NS] = ended_ns = now()
        work_ns = ended_ns - woke_ns - bus_ns
        if (ended := words[_OFFSET_NS]) != offset:  # elastic, in this tick
            waited_ns = words[_WAITED_NS] - waited
            bus_ns += waited_ns
            work_ns += ended - offset - waited_ns
        self._offset = ended
        tick.work_ns, tick.bus_ns = work_ns, bus_ns

    def _measure(self, tick: Tick) -> None:
        """Find the oldest sample and the longest interval: all axes count the worst of them."""
        sent_ns, woke_ns = tick.sent_ns, tick.woke_ns
        oldest_ns, longest_ns, ended = sent_ns, 0, True
        for axis in self.axes:
            if axis.sampled_ns is not None and axis.sampled_ns < oldest_ns:
                oldest_ns = axis.sampled_ns
            interval_ns = woke_ns - axis.served_ns if axis.served_ns else self._period_ns
            if interval_ns > longest_ns:
                longest_ns, ended = interval_ns, True
            if axis.outcome is _OK:
                axis.served_ns = woke_ns
            elif interval_ns == longest_ns:
                ended = False
        tick.age_ns = sent_ns - oldest_ns
        tick.interval_ns = longest_ns if ended else 0
