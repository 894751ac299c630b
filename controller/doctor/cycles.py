"""Measures whether replies come in time, in both schedules and at every phase of the loop's grid.

An adapter forwards bytes by its own timer. The phase of the loop's grid in that timer's period
decides whether a reply makes its tick, and the two drift slowly: a loop that runs well now may lose
every reply an hour later. So short series are run with a shifted grid.

It sends only the reads of the running cycle; the goal's time on the wire is computed.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, get_args

from haptic_wall.controller.doctor.replies import percentile
from haptic_wall.hw.dynamixel.exchange import Exchange
from haptic_wall.hw.serialport.line import Line
from haptic_wall.hw.servo import Outcome
from haptic_wall.hw.settings import Schedule

SCHEDULES: Final[tuple[Schedule, ...]] = get_args(Schedule)

_LATE_SHARE: Final = 4
"""A tick later than a period over this is no evidence about the adapter"""
_DOUBTFUL: Final = 0.02
"""Largest fraction of misses at which a phase is not repeated"""
_RUNS: Final = 3
"""Number of runs of a phase: a stall of the machine occurs once, an adapter's fault persists"""
Wait = Callable[[int], int]
"""Waits until an instant [ns]; returns the present time [ns]"""


@dataclass(frozen=True, slots=True)
class Phase:
    """One series of cycles with the grid at one phase."""

    offset_ns: int
    """Offset of the grid, relative to the first series"""
    cycles: int
    missed: int
    """Replies that were too late for their tick"""
    ages_ns: list[int]
    """From the request of the used sample, an older one where a reply was missed, to the tick that
    used it, in order of size"""

    @property
    def share(self) -> float:
        """Return the fraction of missed replies; there must be cycles."""
        return self.missed / self.cycles


@dataclass(frozen=True, slots=True)
class Series:
    """All phases of one schedule."""

    schedule: Schedule
    phases: list[Phase]
    lateness_ns: list[int]
    """Lateness of all wake-ups, in order of size"""
    skipped: int
    """Ticks too late to be evidence about the bus"""
    repeated: int = 0
    """Repeated runs of phases with many misses; the best one counts"""

    @property
    def worst(self) -> float:
        """Return the fraction of missed replies at the worst phase."""
        return max((phase.share for phase in self.phases if phase.cycles), default=1.0)

    @property
    def oldest_median_ns(self) -> int:
        """Return the median age at the phase where it is the longest; there must be ages."""
        return max(percentile(phase.ages_ns, 0.5) for phase in self.phases if phase.ages_ns)

    @property
    def ages_ns(self) -> list[int]:
        """Return the ages of all phases, in order of size."""
        return sorted(age for phase in self.phases for age in phase.ages_ns)


def run_series(
    line: Line,
    servo_id: int,
    schedule: Schedule,
    *,
    wait: Wait,
    period_ns: int,
    collect_ns: int,
    longer_ns: int,
    phases: int,
    cycles: int,
) -> Series:
    """Run the read-only cycle of a schedule with the grid at each of several phases.

    Args:
        line: The bus.
        servo_id: The servo.
        schedule: ``immediate`` requests and collects in one tick; ``pipelined`` collects the
            request of the tick before.
        wait: Waits for a deadline on the line's clock.
        period_ns: Period of the grid [ns].
        collect_ns: Time after its wake-up at which a tick gives a reply up [ns].
        longer_ns: The same time after a pipelined reply was lost, until another one is lost [ns].
        phases: Number of shifts, evenly over a period.
        cycles: Number of cycles at each.

    Raises:
        ServoLostError: The port is gone.
    """
    runner = _Runner(line, servo_id, schedule, wait, period_ns, (collect_ns, longer_ns))
    done: list[Phase] = []
    repeated = 0
    for number in range(phases):
        offset_ns = number * period_ns // phases
        phase = runner.run(offset_ns, cycles)
        for _ in range(_RUNS - 1):
            if phase.cycles and phase.share <= _DOUBTFUL:
                break
            repeated += 1
            phase = min(phase, runner.run(offset_ns, cycles), key=_badness)
        done.append(phase)
    return Series(schedule, done, sorted(runner.lateness), runner.skipped, repeated)


def _badness(phase: Phase) -> float:
    """Return the fraction of missed replies; a run without a punctual tick is the worst."""
    return phase.share if phase.cycles else math.inf


class _Runner:
    def __init__(
        self,
        line: Line,
        servo_id: int,
        schedule: Schedule,
        wait: Wait,
        period_ns: int,
        collect_ns: tuple[int, int],
    ) -> None:
        self.lateness: list[int] = []
        self.skipped = 0
        self._exchange = Exchange(line, [servo_id])
        self._now_ns = line.clock.now_ns
        self._pipelined = schedule == "pipelined"
        self._wait = wait
        self._period_ns = period_ns
        self._collect_ns = collect_ns
        self._origin_ns = self._now_ns()

    def run(self, offset_ns: int, cycles: int) -> Phase:
        """Run one series on the grid at ``offset_ns`` after the first one."""
        exchange, now_ns, period_ns = self._exchange, self._now_ns, self._period_ns
        behind_ns = now_ns() + period_ns - self._origin_ns - offset_ns
        deadline_ns = self._origin_ns + offset_ns + -(-behind_ns // period_ns) * period_ns
        ages: list[int] = []
        missed = counted = 0
        sampled_ns: int | None = None
        collect_ns, other_ns = self._collect_ns
        if self._pipelined:
            exchange.request()
        valid = not self._pipelined  # the first reply has had more than a period
        for _ in range(cycles + 1):
            woke_ns = self._wait(deadline_ns)
            self.lateness.append(woke_ns - deadline_ns)
            punctual = woke_ns - deadline_ns < period_ns // _LATE_SHARE
            self.skipped += not punctual
            if not self._pipelined:
                exchange.request()
            (sample,) = exchange.collect(woke_ns + collect_ns)
            used_ns = now_ns()
            if self._pipelined:
                exchange.request()
            good = sample.outcome is Outcome.OK
            if good:
                sampled_ns = sample.sampled_ns
            if punctual and valid:
                counted += 1
                missed += not good
                if sampled_ns is not None:
                    ages.append(used_ns - sampled_ns)
            if self._pipelined and sample.outcome is Outcome.LOST:
                collect_ns, other_ns = other_ns, collect_ns
            valid = punctual or not self._pipelined
            passed = max(1, -(-(now_ns() - deadline_ns) // period_ns))
            deadline_ns += passed * period_ns
        if self._pipelined:
            exchange.collect(now_ns() + collect_ns)
        return Phase(offset_ns, counted, missed, sorted(ages))
