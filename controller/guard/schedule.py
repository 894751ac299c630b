"""The gain schedule: guard decisions in bins of sample age and served interval, picked in the tick.

The guard's mathematics takes milliseconds to seconds; a tick has microseconds. The decisions are
therefore computed before the start, for bins of the sample age and bins of the interval between
executed ticks. The tick only picks the pair of bins.

The interval takes the place of the sampling period in the theory. Over a block of ``RUN_S`` it is
``sum(D²) / sum(D)``, where D is the time from one tick with a reading to the next. With a sample
age a, the mean age of the acting torque is then ``a + sum(D²) / (2 sum(D))``. Skipped periods, late
ticks and failed readings lengthen D. A tick in which no reply is due yet does not: it raises the
age.

The same rule smooths both. A high percentile over a window picks the bin. A run of observations
above the bin lowers the gains at once, without waiting for the window; a single old sample has no
effect. Raising the gains needs ``RAISE_WINDOWS`` whole windows that allow it, and a moment out of
contact or at the surface, because raising K at penetration x puts the energy ΔK x²/2 into the
spring.

See docs/decisions/served-interval.md.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from typing import TYPE_CHECKING

from haptic_wall.controller.guard.types import WITHIN

if TYPE_CHECKING:
    from haptic_wall.controller.guard.guard import Decision

RUN = 10
"""Smallest number of consecutive ages above the bin that lowers the gains at once."""
RUN_S = 0.05
"""Duration of such a run at high rates [s]. Shorter runs may be ignored: within them even a wall at
twice its limit oscillates only a few per cent more."""
SETTLE = 50
"""Number of ages that is enough to settle the schedule at the start."""
RAISE_WINDOWS = 5
"""Consecutive windows that must allow a lower bin before it is taken."""
RUN_BLOCKS = 2
"""Consecutive blocks above the bin that lower the gains at once: one stall lies in one block."""
INTERVAL_BINS = (1.0, 1.25, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0, 20.0, 60.0)
"""Upper ends of the bins of the served interval [periods]."""
NARROW_BINS = (
    *(1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0),
    *(8.0, 10.0, 14.0, 20.0, 28.0, 40.0, 60.0),
)
"""The same where a link is believed [periods]"""
_INSIDE = 64
"""Steps inside a bin in which the ring's delay is evaluated"""
IRREGULAR_CAP = 0.5
"""Factor on ``guard.damping_cap`` in all bins but the first. Damping near the ceiling of the
weighted interval exceeds the ceiling of the longest intervals, and some repeated patterns then grow
at 0.8 of the limit."""
LONGEST_NS = 60_000_000
"""Longer intervals are ignored, except those up to ``_ALWAYS`` periods [ns]."""
_ALWAYS = 6.0


def age_bins_ns(period_ns: int, reply_ns: int = 0) -> list[int]:
    """Return the upper ends of the age bins [ns]: fine for quick buses, coarse for slow ones.

    They reach to 20 ms and three periods. At low rates this covers a pipelined sample, which is one
    period old, and the loss of the next one. Where a reply takes several periods they reach to
    three reply times.

    Args:
        period_ns: The sampling period [ns].
        reply_ns: Time that a reply takes, where that is several periods [ns].
    """
    microseconds = [*range(0, 600, 10), *range(600, 2000, 100), *range(2000, 20_001, 1000)]
    microseconds += range(22_000, 3 * max(period_ns, reply_ns) // 1000 + 2000, 2000)
    return [us * 1000 for us in microseconds]


def interval_bins_ns(period_ns: int, flexible: bool = False) -> list[int]:
    """Return the upper ends of the interval bins [ns], the period first.

    Args:
        period_ns: The sampling period [ns].
        flexible: A link is believed: its limits are the least over a bin, so bins are narrower.
    """
    bins = NARROW_BINS if flexible else INTERVAL_BINS
    return [
        round(each * period_ns)
        for each in bins
        if each <= _ALWAYS or round(each * period_ns) <= LONGEST_NS
    ]


def served_range(intervals_ns: Sequence[int], index: int) -> tuple[float, float]:
    """Return the shortest and the longest interval that a bin covers, over its upper end.

    Args:
        intervals_ns: The upper ends of the bins, the period first [ns].
        index: Index of the bin.
    """
    if index == 0:
        return 1.0, WITHIN
    return WITHIN * intervals_ns[index - 1] / intervals_ns[index], WITHIN


def inserted_delays(
    steps: int, period: float, interval: float, served: tuple[float, float]
) -> tuple[float, float]:
    """Return the shortest and the longest delay of the ring over the intervals of a bin [s].

    A torque leaves the ring in the first tick that is at least ``steps`` periods of the grid later.
    Ticks at intervals that are no whole periods lie anywhere between the points of the grid, so
    that torques wait for different numbers of ticks: their mean counts. At the bin's upper end the
    longest wait counts.

    Args:
        steps: Length of the ring [periods].
        period: Period of the grid [s].
        interval: Upper end of the bin [s].
        served: As of ``served_range``.
    """
    longest = math.ceil(steps * period / interval - 1e-9) * interval
    if not steps or interval <= period:
        return longest, longest
    low, high = (share * interval / period for share in served)
    means = [
        period * _mean_wait(steps, low + (high - low) * k / _INSIDE) for k in range(_INSIDE + 1)
    ]
    return min(means), max(longest, *means)


def _mean_wait(steps: int, interval: float) -> float:
    """Return the mean delay of the ring; all in periods, ``interval`` at least 1."""
    ticks = math.ceil(steps / interval)
    return interval * sum(min(steps - n * interval, 1.0) for n in range(ticks))


class BinFilter:
    """Picks one bin from a sequence of observed bins: lowers at once on a run, raises slowly.

    Args:
        bins: Number of bins.
        percentile: Percentile of a window that the bin must cover [%].
        window: Observations in a window.
        run: Consecutive observations above the bin that lower the gains at once.
        settle: Observations that ``settle`` needs before it takes a lower bin.
        spare: Observations that a window, however short, always leaves uncovered.
    """

    __slots__ = (
        "_counts",
        "_percent_above",
        "_raise_bin",
        "_raise_windows",
        "_run",
        "_run_bin",
        "_run_length",
        "_seen",
        "_settle",
        "_spare",
        "_window",
        "bin",
    )

    def __init__(
        self, bins: int, percentile: float, window: int, run: int, settle: int, spare: int = 0
    ) -> None:
        self._counts = [0] * bins
        self._percent_above = 100.0 - percentile
        self._window = window
        self._run_length = run
        self._settle = settle
        self._spare = spare
        self._seen = 0
        self._run = 0
        self._run_bin = 0
        self._raise_windows = 0
        self._raise_bin = 0
        self.bin = 0

    def observe(self, found: int) -> None:
        """Count one observation in the bin ``found``."""
        self._counts[found] += 1
        self._seen += 1
        if found > self.bin:
            self._run += 1
            self._run_bin = found if self._run == 1 else min(found, self._run_bin)
            if self._run >= self._run_length:
                self._lower(self._run_bin)
        else:
            self._run = 0
        if self._seen >= self._window:
            self._end_window()

    def take_raise(self) -> None:
        """Take the lower bin if enough windows allowed it; call with an unloaded spring."""
        if self._raise_windows >= RAISE_WINDOWS and self._raise_bin < self.bin:
            self.bin = self._raise_bin
            self._raise_windows = 0

    def settle(self) -> None:
        """Take the bin of the observations so far, higher or lower, and restart."""
        if self._seen:
            found = self._percentile_bin()
            self.bin = found if self._seen >= self._settle else max(found, self.bin)
        self._restart_window()
        self._run = self._raise_windows = 0

    def _lower(self, found: int) -> None:
        """Take a higher bin and discard the windows counted toward leaving the one before."""
        self.bin = found
        self._run = self._raise_windows = 0

    def _percentile_bin(self) -> int:
        allowed = max(self._seen * self._percent_above / 100.0, self._spare)
        above = 0
        for found in range(len(self._counts) - 1, -1, -1):
            above += self._counts[found]
            if above > allowed:
                return found
        return 0

    def _restart_window(self) -> None:
        self._counts = [0] * len(self._counts)
        self._seen = 0

    def _end_window(self) -> None:
        found = self._percentile_bin()
        self._restart_window()
        if found >= self.bin:
            if found > self.bin:
                self._lower(found)
            self._raise_windows = 0
            return
        self._raise_bin = found if self._raise_windows == 0 else max(found, self._raise_bin)
        self._raise_windows += 1


class GainSchedule:
    """Picks the decision that holds for the observed ages and intervals.

    Args:
        decisions: For each interval one for each age: ``len(intervals_ns)`` rows of
            ``len(ages_ns)``.
        ages_ns: The ages of the decisions [ns], rising.
        intervals_ns: The intervals of the decisions [ns], rising, the period first.
        percentile: Percentile of a window that the bins must cover [%].
        window: Ticks in a window.
        run: Consecutive ages above the bin that lower the gains at once; also the periods in a
            block of intervals.
    """

    def __init__(
        self,
        decisions: Sequence[Sequence[Decision]],
        ages_ns: Sequence[int],
        intervals_ns: Sequence[int],
        percentile: float,
        window: int,
        run: int = RUN,
    ) -> None:
        self._rows = decisions
        self._ages = ages_ns
        self._intervals = intervals_ns
        self._percentile, self._window, self._run = percentile, window, run
        self._oldest = len(ages_ns) - 1
        self._longest = len(intervals_ns) - 1
        self._edges = [WITHIN * each for each in intervals_ns]
        self._age = BinFilter(len(ages_ns), percentile, window, run, SETTLE)
        blocks = max(RUN_BLOCKS, window // run)
        self._interval = BinFilter(len(intervals_ns), percentile, blocks, RUN_BLOCKS, 1, spare=1)
        self._block_ns = run * intervals_ns[0]
        self._span_ns = 0
        self._squares = 0.0
        self.decision = decisions[0][0]

    def anew(self) -> GainSchedule:
        """Return a schedule with the same bins and no observations."""
        return GainSchedule(
            self._rows, self._ages, self._intervals, self._percentile, self._window, self._run
        )

    @property
    def rows(self) -> Sequence[Sequence[Decision]]:
        """Return the decisions, as the class takes them."""
        return self._rows

    def present(self, rows: Sequence[Sequence[Decision]]) -> Decision:
        """Return the decision of other rows for the present bins."""
        return rows[self._interval.bin][self._age.bin]

    def take(self, rows: Sequence[Sequence[Decision]]) -> None:
        """Use other decisions for the same bins; the observations stay."""
        self._rows = rows
        self.decision = self.present(rows)

    @property
    def decisions(self) -> list[Decision]:
        """Return all decisions; ``index`` counts in this order."""
        return [each for row in self._rows for each in row]

    @property
    def index(self) -> int:
        """Return the index of the present decision in ``decisions``."""
        return self._interval.bin * (self._oldest + 1) + self._age.bin

    @property
    def age_ns(self) -> int:
        """Return the sample age of the present decision [ns]."""
        return self._ages[self._age.bin]

    @property
    def interval_ns(self) -> int:
        """Return the interval that the present decision uses as the period [ns]."""
        return self._intervals[self._interval.bin]

    def observe(self, age_ns: int, interval_ns: int, may_raise: bool) -> bool:
        """Count one tick; return whether the decision changed.

        Args:
            age_ns: Age of the sample when its torque was sent [ns].
            interval_ns: Interval from the last tick with a reading to this one [ns]; 0: the reading
                of this tick failed, and the interval continues.
            may_raise: The wall's spring is unloaded, so the stiffness may be raised.
        """
        age, interval = self._age, self._interval
        age.observe(min(bisect_left(self._ages, age_ns), self._oldest))
        self._span_ns += interval_ns
        self._squares += float(interval_ns) * interval_ns
        if self._span_ns >= self._block_ns:
            self._end_block()
        if may_raise:
            age.take_raise()
            interval.take_raise()
        before = self.decision
        self.decision = self._rows[interval.bin][age.bin]
        return self.decision is not before

    def settle(self) -> None:
        """End the warm-up: take the bins that its observations ask for, and restart.

        Fewer than ``SETTLE`` ages since the last window ended cannot cause a lower bin.
        """
        self._age.settle()
        self._interval.settle()
        self.decision = self._rows[self._interval.bin][self._age.bin]

    def _end_block(self) -> None:
        counted = self._squares / self._span_ns
        self._span_ns, self._squares = 0, 0.0
        self._interval.observe(min(bisect_left(self._edges, counted), self._longest))
