"""Computes the limits of a load behind a flexible transmission, over the belief's whole box.

The damping ceiling and the limit depend on the transmission's frequency through the cosine of a
phase, so that neither is monotone: a grid covers the box. Delays lie on a grid too, from the
shortest on that is believed with a sample that has just been taken: a shorter delay may be the less
safe one. Between two of the grid limits are in proportion to 1 / (T/2 + t_d). More friction may be
the less safe, because a motor that hardly moves lets the load vibrate alone: both ends of friction
are counted, and what lies between. ``fast_vibration`` has what needs no grid.
``scripts/study guard`` searches for truths inside the box that the guard's walls make vibrate.
"""

from __future__ import annotations

import math
from collections.abc import Hashable
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from haptic_wall.controller.guard.belief import (
    HEAVIEST,
    Belief,
    Bounded,
    lightest_load,
    motor_side,
    vibration,
)
from haptic_wall.controller.guard.fast_vibration import UNBOUND
from haptic_wall.controller.guard.work import Work
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.flexible_scan import FlexibleScan, Servos
from haptic_wall.controller.theory.velocity_filter import VelocityFilter

WITHIN = 0.96
"""Fraction of the least value over the grid that the guard uses"""
_TOGETHER = 100
"""So many servos are computed at once: fewer take more calls, more leave the cache"""
_PHASE = 0.4
"""Largest step of the phase of the vibration over the delay, between frequencies of the grid and
between its delays [rad]"""
_QUICK, _QUARTER = 0.3, 0.25
"""Friction times period over the lightest motor from which delays of the grid are nearer: the limit
of a motor that settles within a period dips beside each whole period; their distance in periods"""
_CYCLES = 1.15
"""Cycles of that phase that the frequencies of one delay span at most. Within a cycle each phase
occurs, and the slowest vibration of a phase bounds the damping and the stiffness most"""
_SLICES, _LOADS = 3.0, 1.45
"""Largest ratio of 1/motor + 1/load within a slice of a belief about a motor alone, and between two
of its loads: the ceiling may be least between the ends"""
_SLOWER = 0.93
"""Fraction of a frequency down to which a coarse grid of delays counts it"""
_DIGITS = 12
"""Of an interval in seconds"""
_NOTCH = 0.25
"""Largest relative step of the interval, in widths of a notch"""
_STOPPED, _STEPS = 3.0, 1.4
"""Frequency below which frequencies follow each other by a ratio, over that at which friction stops
the servo; the ratio"""
_MOTORS = 1.6
"""Largest ratio of two motor inertias of the grid"""
_BESIDE = np.linspace(-2.0, 2.0, 17)
"""Frequencies beside that of a notch, in widths of it"""
_CONTACT, _RETURNED = (0.1, 0.15, 0.3, 0.5), (0.96, 0.87, 0.6, 0.47)
"""Frequency of a contact over the vibration's, and the share of the limit that returns no more"""


class Knot(NamedTuple):
    """A delay of the grid, and the frequencies that are counted there."""

    delay: float
    """[s]"""
    low: float
    """[Hz]"""
    high: float
    """[Hz]"""


class LinkLimits:
    """Damping ceiling and limit of the stiffness, at any period and delay.

    Args:
        belief: Belief with a load behind a transmission.
        samples: Samples of the velocity difference.
        velocity_filter: Filter of the velocity that damps; None: none.
        inserted: The part of a delay that is neither the sample's age nor the device's lag [s].
        served: Shortest and longest interval that may take the place of a period, over it.
        highest: Frequency above which formulas count the vibration [Hz].
        work: What was computed before for the same asker.
    """

    def __init__(
        self,
        belief: Belief,
        samples: int,
        velocity_filter: VelocityFilter | None,
        inserted: float,
        served: tuple[float, float],
        highest: float,
        work: Work,
    ) -> None:
        hz = belief.flexible_hz
        most = min(hz.high, highest)
        belief = replace(belief, flexible_hz=Bounded(min(hz.value, most), hz.low, most))
        self._belief, self._samples, self._inserted = belief, samples, inserted
        self._filter = velocity_filter
        self._notch = velocity_filter is not None and velocity_filter.kind == "notch"
        self._served, self._work = served, work
        # stands for these in keys: a belief takes long to hash
        self._asked = work.once(("link", belief, samples, velocity_filter), object)

    def ceiling(self, period: FloatArray, delay: FloatArray) -> FloatArray:
        """Return the commanded damping above which the load may vibrate without any stiffness.

        Args:
            period: Period of each plant [s].
            delay: Total, of each plant, at the longest [s].

        Returns:
            [N·m·s/rad]
        """
        for t in np.unique(period).tolist():
            late = delay[period == t].tolist()
            for at in self._intervals(t):
                grids = (self._knots(at, t_d) for t_d in late)
                self._scan_together(at, [*dict.fromkeys(knot for grid in grids for knot in grid)])
        found = [
            min(
                self._ceiling_at(at, knot)
                for at in self._intervals(t)
                for knot in self._knots(at, t_d)
            )
            for t, t_d in zip(period.tolist(), delay.tolist(), strict=True)
        ]
        return WITHIN * np.array(found) / self._belief.torque_gain.high

    def stiffness(self, period: FloatArray, delay: FloatArray, damping: FloatArray) -> FloatArray:
        """Return the stiffness up to which every wall from 0 on is stable for the whole belief.

        Args:
            period: Period of each plant [s].
            delay: Total, of each plant, at the longest [s].
            damping: Commanded, of each plant [N·m·s/rad].

        Returns:
            In commanded units [N·m/rad].
        """
        found = [
            min((self._limit(at, t_d, b) for at in self._intervals(t)), default=UNBOUND)
            for t, t_d, b in zip(period.tolist(), delay.tolist(), damping.tolist(), strict=True)
        ]
        return np.minimum(WITHIN * np.array(found), UNBOUND)

    def _intervals(self, period: float) -> list[float]:
        asked = (self._belief, period, self._served, self._filter)
        key = ("intervals", self._asked, period, self._served)
        every = self._work.once(key, lambda: _all_intervals(*asked))
        return [self._shared(at) for at in every]

    def _shared(self, at: float) -> float:
        """Return an interval, or one that differs by rounding: a bin ends where the next begins."""
        return self._work.once(("interval", round(at, _DIGITS)), lambda: at)

    def _knots(self, at: float, delay: float) -> list[Knot]:
        """Return the grid from below the shortest possible delay to above ``delay`` [s].

        Delays a cycle of the slowest vibration ago are left out: the phases were the same then, and
        the delay of the stiffness was shorter. With a notch all believed frequencies are counted at
        each delay: it lets a faster vibration pass where it stops a slower one.
        """
        hz = self._belief.flexible_hz
        most = _QUARTER if _is_quick(self._belief, at) else math.inf
        asked = (hz.low, hz.high, at, delay, self._notch, most)
        grid = self._work.once(("delays", *asked), lambda: _delays(*asked))
        shortest = min(self._inserted + self._belief.delay.low, delay)
        if grid[-1].low > 0.0:
            shortest = max(shortest, delay - 1.0 / grid[-1].low)
        first = max(
            i for i, knot in enumerate(grid[:-1]) if i == 0 or knot.delay <= shortest + 1e-12
        )
        return grid[first:]

    def _limit(self, at: float, delay: float, damping: float) -> float:
        *shorter, below, above = self._knots(at, delay)
        found = [self._limit_at(at, knot, damping) for knot in shorter]
        for knot in (below, above):
            scale = (0.5 * at + knot.delay) / (0.5 * at + delay)
            if _is_quick(self._belief, at):
                scale = min(scale, 1.0)
            found.append(scale * self._limit_at(at, knot, damping))
        return min(found)

    def _limit_at(self, at: float, knot: Knot, damping: float) -> float:
        gains = {self._belief.torque_gain.low, self._belief.torque_gain.high}

        def least() -> float:
            scan = self._scan(at, knot)
            return min(float(scan.limits(gain * damping).min()) / gain for gain in gains)

        return self._work.once((*self._key("limit", at, knot), damping), least)

    def _ceiling_at(self, at: float, knot: Knot) -> float:
        key = self._key("ceiling", at, knot)
        return self._work.once(key, lambda: float(self._scan(at, knot).ceilings().min()))

    def _key(self, kind: str, at: float, knot: Knot) -> tuple[Hashable, ...]:
        return kind, self._asked, at, knot

    def _scan(self, at: float, knot: Knot) -> FlexibleScan:
        key = self._key("scan", at, knot)
        return self._work.once(key, lambda: self._scans(at, [self._servos_at(at, knot)])[0])

    def _scan_together(self, at: float, grid: list[Knot]) -> None:
        """Compute the scans of many delays, of a few servos together: most have hardly any."""
        new = [each for each in grid if not self._work.knows(self._key("ceiling", at, each))]
        knots: list[Knot] = []
        groups: list[Servos] = []
        for knot in new:
            knots.append(knot)
            groups.append(self._servos_at(at, knot))
            if knot is new[-1] or sum(each.inertia.size for each in groups) > _TOGETHER:
                for one, scan in zip(knots, self._scans(at, groups), strict=True):
                    self._work.keep(self._key("scan", at, one), scan)
                knots, groups = [], []

    def _servos_at(self, at: float, knot: Knot) -> Servos:
        return _servos(self._belief, at, knot, self._filter)

    def _scans(self, at: float, groups: list[Servos]) -> list[FlexibleScan]:
        return FlexibleScan.of(groups, at, self._samples, self._belief.encoder, self._filter)


def slices(belief: Belief) -> list[Belief]:
    """Return a belief about a motor alone in slices of its load, each with its own frequencies.

    A lighter load vibrates faster on the same transmission. The box of all loads and all
    frequencies would contain light loads on a far softer one, which allow hardly any wall.
    """
    stiffness = belief.transmission_stiffness
    if not belief.bare or not stiffness.high > 0.0:
        return [belief]
    found = []
    for heavy, light in pairwise(_loads(belief, _SLICES)):
        load = Bounded(heavy, light, heavy)
        hz = vibration(belief.inertia, load, stiffness, bare=True)
        found.append(replace(belief, load_inertia=load, flexible_hz=hz))
    return found


def _loads(belief: Belief, most: float) -> list[float]:
    """Return loads beside a motor from greatest to least; ``most``: ratio of 1/motor + 1/load."""
    motor, greatest = 1.0 / belief.inertia.low, belief.load_inertia.high
    least = lightest_load(belief.inertia, belief.load_inertia, belief.bare)
    ends = motor + 1.0 / greatest, motor + 1.0 / least
    count = 1 + math.floor(math.log(ends[1] / ends[0]) / math.log(most))
    between: list[float] = (1.0 / (np.geomspace(*ends, count + 1)[1:-1] - motor)).tolist()
    return [greatest, *between, least]


def returned_share(belief: Belief, stiffness: FloatArray) -> FloatArray:
    """Return the share of the two-sided limit up to which a contact leaves little vibration.

    The energy that a one-sided wall returns to a rigid servo is counted elsewhere. A contact also
    leaves energy in the vibration, the more the nearer its own frequency, sqrt(K/m), comes to the
    vibration's. The share lies below the results of exact contacts of random servos, for every
    damping, delay and encoder (``scripts/study guard``).

    Args:
        belief: Belief with a load behind a transmission.
        stiffness: The two-sided limit of each plant, in commanded units [N·m/rad].
    """
    acting = belief.torque_gain.high * stiffness
    near = np.sqrt(acting / belief.inertia.low) / (math.tau * belief.flexible_hz.low)
    found: FloatArray = np.interp(near, _CONTACT, _RETURNED)
    return found


def _all_intervals(
    belief: Belief,
    period: float,
    served: tuple[float, float],
    velocity_filter: VelocityFilter | None,
) -> list[float]:
    """Return the intervals that stand for all from ``served[0]`` to ``served[1]`` periods [s].

    Between two of them the phase of no vibration over the interval turns by more than ``_PHASE``.
    """
    low, high = served[0] * period, served[1] * period
    if low == high:
        return [period]
    hz = belief.flexible_hz
    even = math.ceil(math.tau * hz.high * (high - low) / _PHASE)
    if velocity_filter is not None:
        # a filter is slower by the interval, and a notch then lies elsewhere
        even = max(even, math.ceil(velocity_filter.q * math.log(high / low) / _NOTCH))
    found: list[float] = np.linspace(low, high, even + 1).tolist()
    return found


def _is_quick(belief: Belief, period: float) -> bool:
    """Whether friction stops the lightest motor within about a period."""
    return belief.damping.high * period > _QUICK * belief.lightest_motor


def _delays(
    low: float, high: float, period: float, longest: float, every: bool, most: float
) -> list[Knot]:
    """Return the grid from 0 to above ``longest`` [s], of vibrations ``low`` to ``high`` [Hz].

    Where the frequencies span more than a cycle of the phase, or the delay is more than one, delays
    follow each other by a ratio. A vibration after a delay between two of them has the same phase
    after the longer one at a frequency that is lower by the ratio: so the frequencies are
    widened downward by it. ``most`` is the longest step [periods].
    """
    if every:
        step = _PHASE / (math.tau * high)
        return [Knot(k * step, low, high) for k in range(math.floor(longest / step + 1e-9) + 2)]
    found = [Knot(0.0, *_counted(low, high, period, 0.0))]
    while found[-1].delay <= longest + 1e-12:
        last = found[-1]
        after = last.delay + period
        # limits in proportion to 1 / (T/2 + t_d) hold to a factor of 2 at most
        step = min(last.delay + 0.5 * period, most * period)
        step = min(_PHASE / (math.tau * last.high), step)
        widened = (1.0 / _SLOWER - 1.0) * after
        if step < widened and (last.high < high or low * after > 1.0):
            delay = last.delay + widened
            found.append(Knot(delay, *_counted(_SLOWER * low, high, period, delay)))
        else:
            delay = last.delay + step
            found.append(Knot(delay, *_counted(low, high, period, delay)))
    return found


def _counted(low: float, high: float, period: float, delay: float) -> tuple[float, float]:
    """Return the lowest and the highest of the frequencies that matter after a delay [Hz].

    Faster ones than a cycle above the lowest meet the same phases, and bound less: both damping and
    stiffness that a vibration allows rise with its frequency.
    """
    span = _CYCLES / (delay + 0.5 * period)
    if high <= low + span:
        return low, high
    return low, low + span


def _servos(
    belief: Belief, period: float, knot: Knot, velocity_filter: VelocityFilter | None
) -> Servos:
    """Return the servos that stand for the belief at a delay."""
    phase = math.tau * (knot.high - knot.low) * (knot.delay + period)
    count = 2 + math.ceil(phase / _PHASE) if phase > 0.0 else 1
    rates = np.linspace(knot.low, knot.high, count)
    # beside the rate at which friction stops it the frequency counts by itself, not by its phase
    slow = min(knot.high, _STOPPED * belief.damping.high / (math.tau * belief.inertia.low))
    if 0.0 < knot.low < slow:
        more = math.ceil(math.log(slow / knot.low) / math.log(_STEPS))
        rates = np.unique([*rates, *np.geomspace(knot.low, slow, more + 1)])
    if velocity_filter is not None and velocity_filter.kind == "notch":
        middle = velocity_filter.w0 / (math.tau * period)
        near = middle * (1.0 + _BESIDE / velocity_filter.q)
        rates = np.unique([*rates, *near[(near > knot.low) & (near < knot.high)]])
    ratios = np.unique([belief.flexible_damping_ratio.low, belief.flexible_damping_ratio.high])
    wholes, loads = _bodies(belief)
    every = np.meshgrid(ratios, math.tau * rates, np.arange(wholes.size), indexing="ij")
    ratio, rate, body = (each.ravel() for each in every)
    whole, load = wholes[body], loads[body]
    stiffness = belief.transmission_stiffness
    if belief.bare and stiffness.high > 0.0:
        # each body from its own slowest vibration on, over as many cycles of the phase
        slowest = np.sqrt(stiffness.low * whole / (load * (whole - load)))
        rate += slowest * knot.low / belief.flexible_hz.low - math.tau * knot.low
        rate = np.minimum(rate, slowest * math.sqrt(stiffness.high / stiffness.low))
    friction = np.unique([belief.damping.low, belief.damping.high])
    motor = whole - load
    moving = motor * load / whole
    return Servos(
        motor,
        np.tile(friction[:, None], whole.size),
        load,
        moving * rate**2,
        2.0 * ratio * moving * rate,
        knot.delay,
    )


def _bodies(belief: Belief) -> tuple[FloatArray, FloatArray]:
    """Return whole inertias and loads that stand for the belief [kg·m²].

    With a heavier motor the transmission takes up more, ``2 zeta rate`` times the whole, but
    friction less, ``b load / motor``: the ceiling, and the limit at a damping, may be least between
    the ends.
    """
    inertia, most = belief.inertia, belief.load_inertia.high
    found = []
    ends = {lightest_load(inertia, belief.load_inertia, belief.bare), most}
    for load in _loads(belief, _LOADS) if belief.bare else ends:
        light, heavy = inertia.low, inertia.high
        if not belief.bare:
            light, heavy = motor_side(light, load), motor_side(heavy, load)
        steps = math.ceil(math.log(heavy / light) / math.log(_MOTORS))
        motor = np.geomspace(light, heavy, steps + 1)
        whole = motor + load
        if not belief.bare:
            whole = np.minimum(whole, motor / (1.0 - HEAVIEST))
        found.append((whole, whole - motor))
    whole, load = np.concatenate(found, axis=1)
    return whole, load
