"""The gain schedule: guard decisions in bins of sample age and served interval, picked in the tick.

The guard's mathematics takes milliseconds to seconds; a tick has microseconds. The decisions are
therefore computed before the start, for bins of the sample age and bins of the interval between
executed ticks. The tick only picks the pair of bins.

The interval takes the place of the sampling period in the theory: ``sum(D²) / sum(D)``, where D is
the time from one tick with a reading to the next. With a sample age a, the mean age of the acting
torque is then ``a + sum(D²) / (2 sum(D))``. Skipped periods, late ticks and failed readings
lengthen D. Long intervals may always come at the worst phase of an oscillation; ``ServedInterval``
counts that.

A longer age or interval lowers the gains, at once if it lasts; a single old sample has no effect.
Beyond the last age and the last interval the wall fades out: it gets no stiffness and no damping.
Raising the gains needs ``RAISE_WINDOWS`` whole windows that allow it, and a moment out of contact
or at the surface, because raising K at penetration x puts the energy ΔK x²/2 into the spring.

See docs/decisions/served-interval.md.
"""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Final, NamedTuple

from haptic_wall.controller.guard.types import WITHIN

RUN = 10
"""Smallest number of consecutive ages above the bin that lowers the gains at once."""
RUN_S = 0.05
"""Duration of such a run at high rates [s]. Shorter runs may be ignored: within them even a wall at
twice its limit oscillates only a few per cent more."""
SETTLE = 50
"""Number of ages that is enough to settle the schedule in a lower bin at the start."""
RAISE_WINDOWS = 5
"""Consecutive windows that must allow a lower bin before it is taken."""
AT_ONCE = 0.9
"""Fraction of the interval of two blocks that lowers the gains at once; the margin covers the rest
until the sums over the windows have found it"""
LEFT_OUT = 1.75
"""Shortest interval that counts as one that left out a tick [periods]"""
FORGIVEN = 20.0
"""Longest stall, one in the windows, that is not counted [periods]: at 0.8 of the limit one in 5 s
cannot feed an oscillation"""
INTERVAL_BINS = (1.0, 1.25, 1.5, 2.0, 3.0, 4.0, 6.0)
"""Upper ends of the bins of the served interval [periods]."""
LINK_BINS = (1.0, 1.5, 2.0)
"""The same where a link is believed: its limits are the least over a bin, and take long to compute
[periods]"""
IRREGULAR_CAP = 0.5
"""Factor on ``guard.damping_cap`` in all bins but the first. Damping near the ceiling of the
weighted interval exceeds the ceiling of the longest intervals, and some repeated patterns then grow
at 0.8 of the limit."""
OLDEST, OLDEST_SLOW = 3, 2
"""Oldest age that gets gains, over a period: a pipelined sample is one old, and two after a lost
reply; and over ``guard.sample_age``"""


def age_bins_ns(period_ns: int, slowest_ns: int = 0) -> list[int]:
    """Return the upper ends of the age bins [ns]: fine for quick buses, coarse for slow ones.

    Args:
        period_ns: The sampling period [ns].
        slowest_ns: Time that a sample takes, where that may be more than a period [ns].
    """
    longest_us = max(OLDEST * period_ns, OLDEST_SLOW * slowest_ns) // 1000
    microseconds = [*range(0, 600, 10), *range(600, 2000, 100), *range(2000, 20_000, 1000)]
    microseconds += range(20_000, longest_us + 2000, 2000)
    return [us * 1000 for us in microseconds[: bisect_left(microseconds, longest_us) + 1]]


def interval_bins_ns(period_ns: int, flexible: bool = False) -> list[int]:
    """Return the upper ends of the interval bins [ns], the period first.

    Args:
        period_ns: The sampling period [ns].
        flexible: A link is believed.
    """
    return [round(each * period_ns) for each in (LINK_BINS if flexible else INTERVAL_BINS)]


class BinFilter:
    """Picks one bin from a sequence of observed bins: lowers at once on a run, raises slowly.

    Args:
        bins: Number of bins.
        percentile: Percentile of a window that the bin must cover [%].
        window: Observations in a window.
        run: Consecutive observations above the bin that lower the gains at once.
    """

    def __init__(self, bins: int, percentile: float, window: int, run: int) -> None:
        self._counts = [0] * bins
        self._percent_above = 100.0 - percentile
        self._window = window
        self._run_length = run
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
            self.bin = found if self._seen >= SETTLE else max(found, self.bin)
        self._restart_window()
        self._run = self._raise_windows = 0

    def _lower(self, found: int) -> None:
        """Take a higher bin and discard the windows counted toward leaving the one before."""
        self.bin = found
        self._run = self._raise_windows = 0

    def _percentile_bin(self) -> int:
        allowed = self._seen * self._percent_above / 100.0
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


@dataclass(slots=True)
class Served:
    """Sums over intervals D between ticks with a reading."""

    sum_ns: float = 0.0
    squares: float = 0.0
    """[ns²]"""
    count: float = 0.0
    late: float = 0.0
    """Of D (D - period), over the intervals that left out a tick [ns²]"""
    longest_ns: float = 0.0

    def add(self, other: Served, times: float = 1.0) -> None:
        """Add other sums, or take them away with -1; the longest interval stays."""
        self.sum_ns += times * other.sum_ns
        self.squares += times * other.squares
        self.count += times * other.count
        self.late += times * other.late

    def counted_ns(self, period_ns: int, least_ns: float, forgiven: float) -> float:
        """Return the interval that counts, without the longest stall [ns].

        With M = sum(D²) / sum(D), a wall of the counted period M is stable on the average over the
        phases of its oscillation. Where the long intervals always begin at the wall's surface they
        feed it twice as much: by 2 M - E[D], which is M where all intervals are alike. Late ticks
        that leave out none cannot do so.

        Args:
            period_ns: Period of the grid [ns].
            least_ns: Time over which the sums are filled up with whole periods [ns].
            forgiven: Longest stall that is left out, or part of it [periods].
        """
        stall, rest = min(self.longest_ns, forgiven * period_ns), least_ns - self.sum_ns
        sum_ns, squares, count, late = self.sum_ns, self.squares, self.count, self.late
        if rest > 0.0:
            sum_ns, squares, count = least_ns, squares + rest * period_ns, count + rest / period_ns
        if count > 1.0 and sum_ns > stall:
            sum_ns, squares, count = sum_ns - stall, squares - stall * stall, count - 1.0
            late -= stall * (stall - period_ns) if stall > LEFT_OUT * period_ns else 0.0
        mean_square = squares / sum_ns
        return mean_square + min(mean_square - sum_ns / count, late / sum_ns)


class ServedInterval:
    """Counts the interval between ticks with a reading, and picks its bin.

    The sums run over ``RAISE_WINDOWS`` windows, the present one the last, without their longest
    stall. As soon as they reach a higher bin, however good the rest may be, they lower the gains.
    Two blocks in a row in which M is higher lower the gains at once: one stall lies in one block.
    The end of a window may allow a lower bin: that of the sums in it and of each window alone.

    Args:
        intervals_ns: Upper ends of the bins, the period first [ns].
        block_ns: Length of a block [ns].
        window_ns: Length of a window [ns].
    """

    def __init__(self, intervals_ns: Sequence[int], block_ns: int, window_ns: int) -> None:
        self._edges = [WITHIN * each for each in intervals_ns]
        self._period_ns = intervals_ns[0]
        self._block_ns, self._window_ns = block_ns, window_ns
        self.bin = 0
        self._restart()

    def _restart(self) -> None:
        self._block, self._now, self._sums = Served(), Served(), Served()
        self._windows: deque[Served] = deque()
        self._last_block = 0.0
        self._lower: int | None = None  # the bin that the last windows allow
        self._peak = 0  # highest bin of the sums in this window

    def observe(self, interval_ns: int) -> None:
        """Count one interval [ns]."""
        block, period_ns = self._block, self._period_ns
        block.sum_ns += interval_ns
        block.squares += float(interval_ns) * interval_ns
        block.count += 1.0
        if interval_ns > LEFT_OUT * period_ns:
            block.late += float(interval_ns) * (interval_ns - period_ns)
        self._now.longest_ns = max(self._now.longest_ns, interval_ns)
        if block.sum_ns >= self._block_ns:
            self._end_block()

    def take_raise(self) -> None:
        """Take the lower bin if the windows allow it; call with an unloaded spring."""
        if self._lower is not None:
            self.bin, self._lower = min(self.bin, self._lower), None

    def settle(self) -> None:
        """Take the bin of the intervals so far, without the longest: one stall; and restart."""
        self._sums.add(self._block)
        if self._sums.count > 1.0:
            self.bin = self._counted_bin(self._sums, 0.0, math.inf)
        self._restart()

    def _counted_bin(self, sums: Served, least_ns: float, forgiven: float = FORGIVEN) -> int:
        sums.longest_ns = max([self._now.longest_ns, *(each.longest_ns for each in self._windows)])
        return self._bin_of(sums.counted_ns(self._period_ns, least_ns, forgiven))

    def _end_block(self) -> None:
        block, self._block = self._block, Served()
        mean_square = block.squares / block.sum_ns
        found = self._bin_of(AT_ONCE * min(mean_square, self._last_block))
        self._last_block = mean_square
        self._now.add(block)
        self._sums.add(block)
        counted = self._counted_bin(self._sums, RAISE_WINDOWS * self._window_ns)
        self._peak = max(self._peak, counted)
        found = max(found, counted)
        if found > self.bin:
            self.bin, self._lower = found, None
        if self._now.sum_ns >= self._window_ns:
            self._end_window()

    def _end_window(self) -> None:
        windows = self._windows
        windows.append(self._now)
        self._now = Served()
        self._lower = None
        if len(windows) == RAISE_WINDOWS:
            alone = (each.counted_ns(self._period_ns, 0.0, FORGIVEN) for each in windows)
            self._lower = max(self._peak, self._bin_of(max(alone)))
            self._sums.add(windows.popleft(), -1.0)
        self._peak = 0

    def _bin_of(self, interval_ns: float) -> int:
        return bisect_left(self._edges, interval_ns)


class Allowed(NamedTuple):
    """The numbers of a decision that a tick needs."""

    stiffness: float
    """[N·m/rad]"""
    damping: float
    """[N·m·s/rad]"""
    delay: float = 0.0
    """Total [s]"""
    ceiling: float = math.inf
    """Damping above which no stiffness is stable [N·m·s/rad]"""
    injected: float = 0.0
    """Damping that may be added [N·m·s/rad]"""


_WIDTH: Final = len(Allowed._fields)


class GainTable:
    """The gains of all bins as plain floats: interval by interval, one for each age.

    Args:
        gains: Of each bin, and last those of all older ages and longer intervals.
    """

    def __init__(self, gains: Iterable[Allowed]) -> None:
        self._values = array("d", chain.from_iterable(gains))

    def at(self, index: int) -> Allowed:
        """Return the gains of a bin."""
        return Allowed(*self._values[_WIDTH * index : _WIDTH * index + _WIDTH])

    @property
    def highest(self) -> float:
        """Return the largest stiffness [N·m/rad]."""
        return max(self._values[::_WIDTH])


class GainSchedule:
    """Picks the gains that hold for the observed ages and intervals.

    Args:
        table: For each interval the gains of each age.
        ages_ns: The ages of the table [ns], rising.
        intervals_ns: The intervals of the table [ns], rising, the period first.
        percentile: Percentile of the ages in a window that their bin must cover [%].
        window: Ticks in a window.
        run: Consecutive ages above the bin that lower the gains at once; also the periods in a
            block of intervals.

    Attributes:
        table: The table in force.
        index: Index of the present bin in it.
        allowed: The gains of the present bin.
    """

    def __init__(
        self,
        table: GainTable,
        ages_ns: Sequence[int],
        intervals_ns: Sequence[int],
        percentile: float,
        window: int,
        run: int = RUN,
    ) -> None:
        self._ages = ages_ns
        self._intervals = intervals_ns
        self._age = BinFilter(len(ages_ns) + 1, percentile, window, run)
        period_ns = intervals_ns[0]
        self._interval = ServedInterval(intervals_ns, run * period_ns, window * period_ns)
        self._beyond = len(ages_ns) * len(intervals_ns)
        self.index = 0
        self._bins = 0, 0
        self.take(table)

    def take(self, table: GainTable) -> None:
        """Use another table for the same bins; the observations stay."""
        self.table = table
        self.allowed = table.at(self.index)

    @property
    def age_ns(self) -> int:
        """Return the sample age of the present bin [ns]."""
        return self._ages[min(self._age.bin, len(self._ages) - 1)]

    def observe(self, age_ns: int, interval_ns: int, may_raise: bool) -> bool:
        """Count one tick; return whether the gains changed.

        Args:
            age_ns: Age of the sample when its torque was sent [ns].
            interval_ns: Interval from the last tick with a reading to this one [ns]; 0: the reading
                of this tick failed, and the interval continues.
            may_raise: The wall's spring is unloaded, so the stiffness may be raised.
        """
        age, interval = self._age, self._interval
        age.observe(bisect_left(self._ages, age_ns))
        if interval_ns:
            interval.observe(interval_ns)
        if may_raise:
            age.take_raise()
            interval.take_raise()
        return (age.bin, interval.bin) != self._bins and self._move()

    def settle(self) -> None:
        """End the warm-up: take the bins that its observations ask for, and restart.

        Fewer than ``SETTLE`` ages since the last window ended cannot cause a lower bin.
        """
        self._age.settle()
        self._interval.settle()
        self._move()

    def _move(self) -> bool:
        """Take the bin; return whether its gains differ: long ages share those of one decision."""
        self._bins = age, interval = self._age.bin, self._interval.bin
        is_within = age < len(self._ages) and interval < len(self._intervals)
        index = interval * len(self._ages) + age if is_within else self._beyond
        if index == self.index:
            return False
        before, self.index = self.allowed, index
        self.allowed = self.table.at(index)
        return self.allowed != before
