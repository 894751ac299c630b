"""Computes the limits of a load behind a flexible transmission, over the belief's whole box.

The damping ceiling and the limit depend on the transmission's frequency through the cosine of a
phase, so that neither is monotone: a grid covers the box. Delays lie on a grid too, from the
shortest on that is believed with a sample that has just been taken: a shorter delay may be the less
safe one. Between two of the grid limits are in proportion to 1 / (T/2 + t_d). More friction may be
the less safe, because a motor that hardly moves lets the load vibrate alone: both ends of friction
are counted, and what lies between. ``link_grid`` lays the grid, ``link_servos`` picks the servos,
``fast_vibration`` has what needs no grid.
``scripts/study guard`` searches for truths inside the box that the guard's walls make vibrate.
"""

from __future__ import annotations

import os
from collections.abc import Hashable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import chain

import numpy as np

from haptic_wall.controller.guard.belief import Belief, Bounded
from haptic_wall.controller.guard.fast_vibration import UNBOUND
from haptic_wall.controller.guard.link_grid import Knot, delays, intervals, is_quick
from haptic_wall.controller.guard.link_servos import servos_at
from haptic_wall.controller.guard.types import Request, Situation
from haptic_wall.controller.guard.work import Work
from haptic_wall.controller.theory.checks import FloatArray
from haptic_wall.controller.theory.flexible_scan import FlexibleScan, Servos

WITHIN = 0.96
"""Fraction of the least value over the grid that the guard uses"""
_TOGETHER = 600
"""So many servos are computed at once: fewer take more calls, more leave the cache"""
_DIGITS = 12
"""Of an interval in seconds"""


class LinkLimits:
    """Damping ceiling and limit of the stiffness, at any delay.

    Args:
        belief: Belief with a load behind a transmission.
        request: The wall: its velocity samples, and its filter.
        situation: The period, and what may take its place; the shortest inserted delay.
        highest: Frequency above which formulas count the vibration [Hz].
        work: What was computed before for the same asker.
    """

    def __init__(
        self, belief: Belief, request: Request, situation: Situation, highest: float, work: Work
    ) -> None:
        hz = belief.flexible_hz
        most = min(hz.high, highest)
        belief = replace(belief, flexible_hz=Bounded(min(hz.value, most), hz.low, most))
        self._belief, self._inserted, self._work = belief, situation.inserted[0], work
        self._samples, self._filter = request.velocity_samples, request.velocity_filter
        self._notch = self._filter is not None and self._filter.kind == "notch"
        # stands for these in keys: a belief takes long to hash
        self._asked = work.once(("link", belief, self._samples, self._filter), object)
        period, served = situation.period, situation.served
        every = work.once(
            ("intervals", self._asked, period, served),
            lambda: intervals(belief, period, served, self._filter),
        )
        # one of those that differ by rounding: a bin ends where the next begins
        self._intervals = [
            work.once(("interval", round(at, _DIGITS)), partial(float, at)) for at in every
        ]

    def ceiling(self, delay: FloatArray) -> FloatArray:
        """Return the commanded damping above which the load may vibrate without any stiffness.

        Args:
            delay: Total, of each plant, at the longest [s].

        Returns:
            [N·m·s/rad]
        """
        late = delay.tolist()
        for at in self._intervals:
            grids = (self._knots(at, t_d) for t_d in late)
            self._scan_together(at, [*dict.fromkeys(knot for grid in grids for knot in grid)])
        found = [
            min(self._ceiling_at(at, knot) for at in self._intervals for knot in self._knots(at, t))
            for t in late
        ]
        return WITHIN * np.array(found) / self._belief.torque_gain.high

    def stiffness(self, delay: FloatArray, damping: FloatArray) -> FloatArray:
        """Return the stiffness up to which every wall from 0 on is stable for the whole belief.

        Args:
            delay: Total, of each plant, at the longest [s].
            damping: Commanded, of each plant [N·m·s/rad].

        Returns:
            In commanded units [N·m/rad].
        """
        found = [
            min(self._limit(at, t_d, b) for at in self._intervals)
            for t_d, b in zip(delay.tolist(), damping.tolist(), strict=True)
        ]
        return np.minimum(WITHIN * np.array(found), UNBOUND)

    def _knots(self, at: float, delay: float) -> list[Knot]:
        """Return the grid from below the shortest possible delay to above ``delay`` [s].

        Delays a cycle of the slowest vibration ago are left out: the phases were the same then, and
        the delay of the stiffness was shorter. With a notch all believed frequencies are counted at
        each delay: it lets a faster vibration pass where it stops a slower one.
        """
        hz = self._belief.flexible_hz
        asked = (hz.low, hz.high, at, delay, self._notch, is_quick(self._belief, at))
        grid = self._work.once(("delays", *asked), lambda: delays(*asked))
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
            if is_quick(self._belief, at):
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
        asked = (self._belief, at, knot, self._filter)
        return self._work.once(key, lambda: self._scans(at, [servos_at(*asked)])[0])

    def _scan_together(self, at: float, grid: list[Knot]) -> None:
        """Compute the scans of many delays: most have hardly any servo, so several in a turn.

        Turns run on all cores. numpy lets go of the interpreter in large arrays.
        """
        new = [each for each in grid if not self._work.knows(self._key("ceiling", at, each))]
        turns: list[list[Servos]] = [[]]
        for knot in new:
            if sum(each.inertia.size for each in turns[-1]) > _TOGETHER:
                turns.append([])
            turns[-1].append(servos_at(self._belief, at, knot, self._filter))
        scans = chain.from_iterable(self._on_all_cores(at, turns if new else []))
        for knot, scan in zip(new, scans, strict=True):
            self._work.keep(self._key("scan", at, knot), scan)

    def _on_all_cores(self, at: float, turns: list[list[Servos]]) -> list[list[FlexibleScan]]:
        scans = partial(self._scans, at)
        cores = min(len(os.sched_getaffinity(0)), len(turns))
        if cores > 1:
            with suppress(RuntimeError), ThreadPoolExecutor(cores) as pool:  # no thread to be had
                return [*pool.map(scans, turns)]
        return [*map(scans, turns)]

    def _scans(self, at: float, groups: list[Servos]) -> list[FlexibleScan]:
        return FlexibleScan.of(groups, at, self._samples, self._belief.encoder, self._filter)
